"""A client that knows docs/protocol.md and proto/heliograph/v1 alone: grpcio, protobuf,
googleapis-common-protos, numpy.

usage: minimal_client.py SOCKET [OUT.npz]     with the stubs' folder in PYTHONPATH

It opens a session with its local channel, edits a scene, sends one edit twice, hands over a mesh
in shared memory, renders planes and labels, takes a frame from shared memory, reads an error,
follows the scene by Watch and Stream, runs a batch, branches, and closes.
"""

import array
import fcntl
import mmap
import os
import queue
import socket
import struct
import sys
import threading

import grpc
import numpy as np
from google.rpc import error_details_pb2, status_pb2
from heliograph.v1 import render_pb2, scene_pb2, service_pb2, service_pb2_grpc, types_pb2
from heliograph.v1.scene_pb2 import Edit, Entity
from heliograph.v1.types_pb2 import Ref

DTYPES = dict(enumerate(("u1", "<u2", "<u4", "<i4", "<u8", "<f2", "<f4", "<f8"), 1))  # types.proto
NUMBERS = {np.dtype(name): number for number, name in DTYPES.items()}


class SecondSocket:
    """The ticket, then packets about shared memory."""

    def __init__(self, path):
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.socket.connect(path + ".fd.sock")
        self.ticket = self.socket.recv(4096)
        self.maps, self.changed, self.on = {}, threading.Condition(), False

    def start(self):
        """Tells the daemon, after OpenSession, that this client maps buffers."""
        threading.Thread(target=self.listen, daemon=True).start()
        self.send(0, 0)
        with self.changed:
            self.changed.wait_for(lambda: self.on, 10)

    def send(self, buffer, number, descriptors=()):
        rights = (socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array("i", descriptors))
        self.socket.sendmsg([struct.pack("=QQ", buffer, number)], [rights] if descriptors else [])

    def listen(self):
        while True:
            packet, descriptors, _, _ = socket.recv_fds(self.socket, 16, 1)
            if not packet:
                return
            buffer, size = struct.unpack("=QQ", packet)
            with self.changed:
                if descriptors:
                    self.maps[buffer] = mmap.mmap(descriptors[0], size, prot=mmap.PROT_READ)
                    os.close(descriptors[0])
                elif buffer == 0:
                    self.on = True
                else:
                    self.maps.pop(buffer, None)
                self.changed.notify_all()

    def take(self, ref):
        """Copies the range that a BufferRef names and gives the buffer back."""
        with self.changed:
            self.changed.wait_for(lambda: ref.buffer in self.maps, 10)
            data = self.maps[ref.buffer][ref.offset : ref.offset + ref.size]
        self.send(ref.buffer, ref.generation)
        return data

    def give(self, number, values):
        """Hands an array over as buffer `number`; one request may name it."""
        descriptor = os.memfd_create("array", os.MFD_ALLOW_SEALING)
        with open(descriptor, "wb", closefd=False) as file:
            file.write(values.tobytes())
        seals = fcntl.F_SEAL_WRITE | fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW
        fcntl.fcntl(descriptor, fcntl.F_ADD_SEALS, seals)
        self.send(number, values.nbytes, [descriptor])
        os.close(descriptor)
        ref = types_pb2.BufferRef(buffer=number, size=values.nbytes)
        return types_pb2.Array(dtype=NUMBERS[values.dtype], shape=values.shape, buffer=ref)


class Client:
    def __init__(self, path):
        self.second = SecondSocket(path)
        options = [("grpc.max_receive_message_length", -1)]
        self.channel = grpc.insecure_channel("unix:" + path, options=options)
        self.stub = service_pb2_grpc.RendererStub(self.channel)
        request = service_pb2.OpenSessionRequest(client="minimal", ticket=self.second.ticket)
        session = self.stub.OpenSession(request).session
        self.metadata = [("heliograph-session", str(session))]
        self.second.start()

    def call(self, name, request):
        return getattr(self.stub, name)(request, metadata=self.metadata)

    def apply(self, scene, number, *edits):
        transaction = scene_pb2.Transaction(edits=edits)
        request = service_pb2.ApplyRequest(scene=scene, number=number, transaction=transaction)
        return self.call("Apply", request)

    def frames(self, parts):
        """Yields (FrameHeader, {plane: (H, W, C)}) of a call's FrameParts."""
        for part in parts:
            if part.HasField("header"):
                header = part.header
                planes = [bytearray(plane.size) for plane in header.planes]
                missing = sum(map(len, planes))
            elif part.HasField("chunk"):
                chunk = part.chunk
                shared = chunk.WhichOneof("data") == "buffer"
                data = self.second.take(chunk.buffer) if shared else chunk.chunk
                planes[chunk.plane][chunk.offset : chunk.offset + len(data)] = data
                missing -= len(data)
            else:
                continue
            if missing == 0:
                images = {}
                for index, info in enumerate(header.planes):
                    plane = np.frombuffer(planes[index], DTYPES[info.dtype])
                    images[info.name] = plane.reshape(header.height, header.width, info.channels)
                yield header, images


def inline(values, dtype="<f4"):
    values = np.ascontiguousarray(values, dtype)
    number = NUMBERS[values.dtype]
    return types_pb2.Array(dtype=number, shape=values.shape, inline=values.tobytes())


def at(x, y, z):
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return types_pb2.Pose(matrices=inline(matrix))


def column(labels, name):
    (found,) = [column for column in labels if column.name == name]
    if found.strings:
        return list(found.strings)
    return np.frombuffer(found.data, DTYPES[found.dtype]).reshape(found.shape)


def field_and_nearest(error):
    """The field in the way and the nearest names, of an error's google.rpc.Status."""
    found = dict(error.trailing_metadata())["grpc-status-details-bin"]
    info, bad = error_details_pb2.ErrorInfo(), error_details_pb2.BadRequest()
    for detail in status_pb2.Status.FromString(found).details:
        _ = detail.Unpack(info) or detail.Unpack(bad)
    near = [value for key, value in sorted(info.metadata.items()) if key.startswith("nearest_")]
    return bad.field_violations[0].field, near


def furniture():
    """A red square of 2 m with label 7, a lamp and a camera 3 m above it."""
    square = scene_pb2.Mesh(
        positions=inline([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]),
        indices=inline([[0, 1, 2], [0, 2, 3]], "<u4"),
    )
    red = scene_pb2.ColorParameter(value=types_pb2.Vec3(x=0.8, y=0.1, z=0.1))
    plate = Entity(
        mesh=Ref(created_by_edit=0),
        materials=scene_pb2.Materials(parts=[Ref(created_by_edit=1)]),
        label=scene_pb2.Label(value=7, category="plate"),
    )
    lamp = scene_pb2.Light(shape=scene_pb2.Light.SHAPE_SPHERE, radius=0.2, intensity=50)
    eye = scene_pb2.Camera(width=32, height=32, fx=32, fy=32, cx=15.5, cy=15.5)
    return [
        Edit(target=Ref(name="square"), mesh=square),
        Edit(target=Ref(name="red"), material=scene_pb2.Material(base_color=red)),
        Edit(target=Ref(name="plate"), entity=plate),
        Edit(target=Ref(name="lamp"), entity=Entity(pose=at(0, 0, 4), light=lamp)),
        Edit(target=Ref(name="eye"), entity=Entity(pose=at(0, 0, 3), camera=eye)),
    ]


def move_lamp(x):
    return Edit(target=Ref(name="lamp"), entity=Entity(pose=at(x, 0, 4)))


def edit(client, scene):
    """Revisions 1 and 2: each edit is done once, however often it is sent."""
    first = client.apply(scene, 1, *furniture())
    assert client.apply(scene, 1, *furniture()) == first
    positions = np.array([[-1, -1, 0.5], [1, -1, 0.5], [0, 1, 0.5]], "<f4")
    mesh = scene_pb2.Mesh(
        positions=client.second.give(1, positions),
        indices=client.second.give(2, np.array([[0, 1, 2]], "<u4")),
    )
    roof = Entity(mesh=Ref(created_by_edit=0), label=scene_pb2.Label(value=8))
    reply = client.apply(scene, 2, Edit(mesh=mesh), Edit(target=Ref(name="roof"), entity=roof))
    print("ids", np.frombuffer(reply.ids, "<u8"), "revision", reply.revision)


def render(client, request):
    """The planes come as bytes at 32 x 32, in shared memory at 128 x 128."""
    [(header, planes)] = client.frames(client.call("Render", request))
    print("labels", column(header.labels, "label"), column(header.labels, "name"))
    print("boxes", column(header.labels, "bbox_visible").tolist())
    large = render_pb2.RenderRequest()
    large.CopyFrom(request)
    large.width = large.height = 128
    [(_, large_planes)] = client.frames(client.call("Render", large))
    assert set(np.unique(large_planes["instance"])) == set(np.unique(planes["instance"]))
    return planes


def refuse(client, scene):
    """An edit that is refused has used up its number, 3."""
    update = Edit(target=Ref(name="plat"), mode=Edit.MODE_UPDATE, entity=Entity())
    try:
        client.apply(scene, 3, update)
    except grpc.RpcError as error:
        print(error.code().name, *field_and_nearest(error))


def follow(client, scene, request):
    """Watch reports edit 4, and Stream shows it."""
    watch = client.call("Watch", service_pb2.WatchRequest(scene=scene, from_revision=3))
    assert next(watch).revision == 2  # a bookmark
    messages = queue.SimpleQueue()
    first = service_pb2.StreamRequest(settings=request, policy="POLICY_LOSSLESS", credits=1)
    messages.put(first)
    frames = client.frames(client.call("Stream", iter(messages.get, None)))
    shown = [next(frames)[0].revision]
    client.apply(scene, 4, move_lamp(1))
    event = next(watch)
    watch.cancel()
    messages.put(service_pb2.StreamRequest(credits=1))  # the frame's credit goes back
    shown.append(next(frames)[0].revision)
    messages.put(None)
    assert not list(frames)
    print("watched", event.revision, "shown", shown)


def batch(client, request):
    """Three items, each with a lamp of its own; the scene is not changed."""
    items = []
    for tag in range(3):
        item = service_pb2.RenderBatchRequest(tag=tag, job=request, credits=0 if tag else 2)
        item.job.overlay.edits.append(move_lamp(tag))
        items.append(item)
    parts = {tag: [] for tag in range(3)}
    for reply in client.call("RenderBatch", iter(items)):
        if not reply.done:
            parts[reply.tag].append(reply.part)
            continue
        assert not reply.HasField("status"), reply.status.message
        [(_, planes)] = client.frames(parts[reply.tag])
        print("item", reply.tag, "mean", planes["beauty"][..., :3].mean())


def main(path, out=None):
    client = Client(path)
    create = service_pb2.CreateSceneRequest(request_id="minimal-1", name="minimal")
    scene = client.call("CreateScene", create).scene
    edit(client, scene)
    planes = ("BEAUTY", "DEPTH", "INSTANCE")
    request = render_pb2.RenderRequest(
        scene=scene,
        cameras=[Ref(name="eye")],
        spp=4,
        planes=[render_pb2.PlaneRequest(plane="PLANE_" + plane) for plane in planes],
        labels=render_pb2.LabelRequest(boxes=True),
    )
    before = render(client, request)
    refuse(client, scene)
    follow(client, scene, request)
    batch(client, request)
    branch = service_pb2.BranchSceneRequest(request_id="minimal-2", scene=scene, revision=2)
    request.scene = client.call("BranchScene", branch).scene
    [(_, again)] = client.frames(client.call("Render", request))
    assert all((again[name] == before[name]).all() for name in before)
    if out:
        np.savez(out, **before)
    client.call("CloseSession", service_pb2.CloseSessionRequest())


if __name__ == "__main__":
    main(*sys.argv[1:])
