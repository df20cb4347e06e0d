"""An in-process daemon that keeps the requests it gets: the client's tests run against it.

It numbers edits and tickets by the contract; it renders constant planes.
"""

import contextlib
import os
import socket
import threading
import time
from concurrent import futures

import grpc
import numpy as np
from heliograph._wire._proto import render_pb2, service_pb2, service_pb2_grpc, types_pb2
from heliograph._wire.arrays import inline
from statuses import status

U = service_pb2


class FakeDaemon(service_pb2_grpc.RendererServicer):
    """Listens in `folder`; `transactions` and `requests` hold what arrived."""

    def __init__(self, folder):
        self.address = f"unix://{folder}/h.sock"
        self.transactions, self.requests, self.sessions = [], [], []
        self.blobs, self.uploads, self.uploaded = {}, {}, []
        self.objects = {}
        self.replies = {}
        self.fail_applies = 0  # how many Apply calls get lost after they were done
        self.loss = grpc.StatusCode.UNAVAILABLE  # how, and
        self.loss_fields = {}
        self.refusal = None  # a google.rpc.Status
        self.last = {}
        self.cancelled = threading.Event()
        self.tickets = set()
        self.bundles = []
        self.needs = []  # companions DecodeAsset asks for, one a round
        self.exported = []
        self.imported = []
        self.server = U.GetServerInfoReply(version="fake", min_api=1, max_api=1)
        for name in ("BEAUTY", "DEPTH", "DISPARITY"):
            plane = render_pb2.Plane.Value(f"PLANE_{name}")
            self.server.planes.add(plane=plane, averaged=name == "BEAUTY")
        self._local_channels = []
        self._server = grpc.server(futures.ThreadPoolExecutor(16))
        service_pb2_grpc.add_RendererServicer_to_server(self, self._server)
        assert self._server.add_insecure_port(self.address)
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._listener.bind(f"{folder}/h.sock.fd.sock")
        self._listener.listen()
        threading.Thread(target=self._hand_out_tickets, daemon=True).start()
        self._server.start()

    def _hand_out_tickets(self):
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            ticket = os.urandom(16)
            self.tickets.add(ticket)
            connection.send(ticket)
            self._local_channels.append(connection)

    def stop(self):
        self._listener.close()
        self._server.stop(0)

    def local_channels(self):
        """The number of local channels that are still open at the client's end."""
        alive = 0
        for line in self._local_channels:
            line.setblocking(False)
            try:
                alive += line.recv(1) != b""
            except BlockingIOError:
                alive += 1
        return alive

    # ------------------------------------------------------------ sessions and scenes

    def OpenSession(self, request, context):
        if request.ticket not in self.tickets:
            context.abort(grpc.StatusCode.UNAUTHENTICATED, "no such ticket")
        self.tickets.remove(request.ticket)
        self.sessions.append(request.client)
        return U.OpenSessionReply(session=len(self.sessions), instance=1, server=self.server)

    def CloseSession(self, request, context):
        return U.CloseSessionReply()

    def GetServerInfo(self, request, context):
        return self.server

    def ListSessions(self, request, context):
        return U.ListSessionsReply(sessions=[U.SessionUse(client=name) for name in self.sessions])

    def ListScenes(self, request, context):
        return U.ListScenesReply()

    def CreateScene(self, request, context):
        self.requests.append(request)
        return U.SceneInfo(scene=7, name=request.name, next_edit=1)

    def BranchScene(self, request, context):
        self.requests.append(request)
        return U.SceneInfo(scene=8, name=request.name, next_edit=1)

    def OpenScene(self, request, context):
        context.abort(grpc.StatusCode.NOT_FOUND, f"no scene {request.name!r}")

    def DeleteScene(self, request, context):
        self.requests.append(request)
        return U.DeleteSceneReply()

    def DescribeScene(self, request, context):
        session = self._session(context)
        info = U.SceneInfo(
            scene=request.scene,
            next_edit=self.last.get(session, 0) + 1,
            revision=len(self.transactions),
        )
        objects = [U.ObjectInfo(id=i, name=n) for n, i in self.objects.items()]
        return U.DescribeSceneReply(scene=info, objects=objects)

    def _session(self, context):
        metadata = dict(context.invocation_metadata())
        return int(metadata["heliograph-session"])

    # ------------------------------------------------------------ edits

    def Apply(self, request, context):
        session = self._session(context)
        last = self.last.get(session, 0)
        if request.number != last + 1 and (session, request.number) not in self.replies:
            fields = {"field": "number", "expected": last + 1}
            self._abort(context, status(grpc.StatusCode.ABORTED, "gap", **fields))
        if request.number == last + 1:
            self.last[session] = request.number
            if self.refusal:
                self._abort(context, self.refusal)
            self.replies[(session, request.number)] = self._apply(request)
        if self.fail_applies:
            self.fail_applies -= 1
            failure = status(self.loss, "lost on the way back", **self.loss_fields)
            self._abort(context, failure)
        return self.replies[(session, request.number)]

    def _abort(self, context, error):
        """error: a google.rpc.Status."""
        data = error.SerializeToString()
        context.set_trailing_metadata((("grpc-status-details-bin", data),))
        codes = {code.value[0]: code for code in grpc.StatusCode}
        context.abort(codes[error.code], error.message)

    def _apply(self, request):
        self.transactions.append(request.transaction)
        kinds = {"entity": 1, "mesh": 2, "material": 3, "texture": 4, "instantiate": 1}
        ids, further, counts = [], [], []
        for edit in request.transaction.edits:
            kind = kinds.get(edit.WhichOneof("action"), 0)
            number = (kind << 56 | 100 + len(self.objects)) if kind else 0
            ids.append(number)
            if edit.target.name and number:
                self.objects[edit.target.name] = number
            more = []
            if edit.HasField("instances"):
                count = edit.instances.matrices.shape[0]
                for k in range(count):
                    more.append(1 << 56 | 100 + len(self.objects))
                    self.objects[f"{edit.target.name}/{k}"] = more[-1]
            if edit.HasField("instantiate"):
                more = [1 << 56 | 900, 3 << 56 | 901, 3 << 56 | 902]
            further += more
            counts.append(len(more))
        packed = np.array(ids + further, dtype="<u8").tobytes()
        revision = len(self.transactions)
        return U.ApplyReply(number=request.number, revision=revision, ids=packed, counts=counts)

    # ------------------------------------------------------------ blobs and assets

    def UploadBlob(self, requests, context):
        data, first = b"", None
        for request in requests:
            first = first or request
            assert len(request.chunk) <= 1 << 20
            data += request.chunk
        assert len(data) == first.size
        store = self.blobs if first.sha256 else self.uploads
        store[first.sha256 or first.request_id] = data
        self.uploaded.append(len(data))
        return U.UploadBlobReply(size=len(data))

    def DecodeAsset(self, request, context):
        self.bundles.append([file.path for file in request.files])
        yield U.DecodeAssetReply(done=0.5)
        missing = [name for name in self.needs if name not in self.bundles[-1]][:1]
        if missing:
            yield U.DecodeAssetReply(done=1, missing=missing)
            return
        asset = U.AssetInfo(
            sha256=b"a" * 32,
            entities=["model", "node"],
            cameras=["node"],
            materials=["Leather", "Wood"],
            animations=["Walk"],
            warnings=["sheen is ignored"],
            bounds=inline(np.array([[0, 0, 0], [1, 2, 3]], dtype="<f4")),
        )
        yield U.DecodeAssetReply(done=1, asset=asset)

    # ------------------------------------------------------------ reading, rendering

    def Read(self, request, context):
        for i, _ in enumerate(request.refs):
            for k, field in enumerate(request.fields):
                data = np.arange(16, dtype="<f4").reshape(4, 4) + i
                array = types_pb2.Array(dtype=types_pb2.D_TYPE_F32, shape=data.shape)
                raw = data.tobytes()
                for start in (0, 20):  # in two parts
                    array.inline = raw[start : start + 20] if start == 0 else raw[20:]
                    assert field == "pose"
                    yield U.ReadReply(ref=i, field=k, offset=start, array=array)

    def Query(self, request, context):
        self.requests.append(request)
        count = request.cast_rays.origins.shape[0]
        column = render_pb2.LabelColumn(name="t", dtype=types_pb2.D_TYPE_F32, shape=[count])
        origins = np.frombuffer(request.cast_rays.origins.inline, dtype="<f4").reshape(-1, 3)
        column.data = origins[:, 2].astype("<f4").tobytes()
        yield U.QueryReply(revision=5, columns=[column])

    def Render(self, request, context):
        self.requests.append(request)
        if request.seconds > 100:
            context.add_callback(self.cancelled.set)
            while context.is_active():
                yield self._progress(0.1)
                time.sleep(0.02)
            return
        for frame in range(len(request.cameras)):
            yield self._progress(0.5)
            yield from self._frame(request, frame)

    def RenderBatch(self, requests, context):
        for request in requests:
            self.requests.append(request)
            if request.job.seed == 13:
                fields = {"field": "job.seed", "retry_seconds": 2.5}
                unlucky = status(grpc.StatusCode.RESOURCE_EXHAUSTED, "unlucky", **fields)
                yield U.RenderBatchReply(tag=request.tag, status=unlucky, done=True)
                continue
            for frame in range(len(request.job.cameras)):
                for part in self._frame(request.job, frame):
                    yield U.RenderBatchReply(tag=request.tag, part=part)
            yield U.RenderBatchReply(tag=request.tag, done=True)

    def Stream(self, requests, context):
        for request in requests:
            self.requests.append(request)
            if request.HasField("settings"):
                yield from self._frame(request.settings, 0)

    def _progress(self, done):
        progress = render_pb2.Progress(done=done, rays_per_second=1e6, noise=0.1)
        return render_pb2.FramePart(progress=progress)

    def _frame(self, request, frame):
        width, height = request.width or 64, request.height or 48
        header = render_pb2.FrameHeader(
            frame=frame, revision=len(self.transactions), camera="cam", samples=request.spp
        )
        header.width, header.height, header.final = width, height, True
        header.k.CopyFrom(inline(np.eye(3)))
        header.camera_from_world_cv.CopyFrom(inline(np.eye(4)))
        header.manifest = '{"request": {}}'
        rng = np.random.default_rng(frame)
        arrays = []
        for asked in request.planes:
            name = render_pb2.Plane.Name(asked.plane)[len("PLANE_") :].lower()
            channels = {"beauty": 4, "normal": 3}.get(name, 1)
            dtype = "<u4" if name == "instance" else "<f4"
            data = (rng.random((height, width, channels)) * 9).astype(dtype)
            arrays.append(data)
            number = types_pb2.D_TYPE_U32 if dtype == "<u4" else types_pb2.D_TYPE_F32
            header.planes.add(name=name, dtype=number, channels=channels, size=data.nbytes)
        header.labels.add(name="label", dtype=types_pb2.D_TYPE_U32, shape=[2]).data = np.array(
            [1, 2], dtype="<u4"
        ).tobytes()
        header.labels.add(name="name", strings=["bolt/0", "bolt/1"])
        header.labels.add(
            name="bbox_visible", dtype=types_pb2.D_TYPE_I32, shape=[2, 4]
        ).data = np.array([[2, 2, 20, 20], [0, 0, 0, 0]], dtype="<i4").tobytes()
        self.sent = arrays
        yield render_pb2.FramePart(header=header)
        for plane, data in enumerate(arrays):
            raw = data.tobytes()
            for start in range(0, len(raw), 5000):
                chunk = render_pb2.PlaneChunk(frame=frame, plane=plane, offset=start)
                chunk.chunk = raw[start : start + 5000]
                yield render_pb2.FramePart(chunk=chunk)

    def ExportScene(self, request, context):
        yield from self.exported

    def ImportScene(self, requests, context):
        self.imported = list(requests)
        return U.SceneInfo(scene=9, name="loaded", next_edit=1)


@contextlib.contextmanager
def running(folder):
    daemon = FakeDaemon(folder)
    try:
        yield daemon
    finally:
        daemon.stop()
