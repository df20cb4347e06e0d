"""A daemon that frees uploads, and refuses what names one with its hash: they are sent again."""

import asyncio
import gc
import hashlib
import tracemalloc

import fake
import grpc
import heliograph as hg
import numpy as np
import pytest
from heliograph import aio
from heliograph._wire import uploads
from heliograph._wire._proto import render_pb2, service_pb2, types_pb2
from heliograph.datasets.uploads import named
from statuses import status

LARGE = (700, 700, 3)  # texels of more than 1 MiB
RNG = np.random.default_rng(0)
WAYS = ["NOT_FOUND in the message", "NOT_FOUND in the field", "FAILED_PRECONDITION"]


def texels():
    return RNG.integers(0, 255, LARGE).astype("u1")


class Frugal(fake.FakeDaemon):
    """Checks each hash that a request names. `frees`: before how many calls everything goes."""

    def __init__(self, folder):
        super().__init__(folder)
        self.way = WAYS[0]
        self.frees = 0
        self.refused = 0
        self.assets = set()

    def _check(self, digests, context, known):
        if self.frees:
            self.frees -= 1
            self.blobs.clear()
            self.assets.clear()
        for digest in digests:
            if digest not in known and digest not in self.blobs:
                self.refused += 1
                in_field = self.way == WAYS[1]
                sha256 = f"sha256 {digest.hex()}"
                field = sha256 if in_field else "edits[0].blob"
                code = grpc.StatusCode[self.way.split()[0]]
                self._abort(context, status(code, "" if in_field else sha256, field=field))

    def Apply(self, request, context):
        session = self._session(context)
        self.last.setdefault(session, 0)
        try:
            self._check(named(request.transaction), context, self.assets)
        except Exception:
            self.last[session] += 1
            raise
        return super().Apply(request, context)

    def Render(self, request, context):
        self._check(named(request.overlay), context, self.assets)
        yield from super().Render(request, context)

    def Stream(self, requests, context):
        for request in requests:
            if request.HasField("settings"):
                self._check(named(request.settings.overlay), context, self.assets)
                yield from self._frame(request.settings, 0)

    def RenderBatch(self, requests, context):
        for request in requests:
            gone = [d for d in named(request.job.overlay) if d not in self.blobs]
            if gone:
                self.refused += 1
                missing = status(grpc.StatusCode.NOT_FOUND, f"sha256 {gone[0].hex()}")
                yield service_pb2.RenderBatchReply(tag=request.tag, status=missing, done=True)
                continue
            for part in self._frame(request.job, 0):
                yield service_pb2.RenderBatchReply(tag=request.tag, part=part)
            yield service_pb2.RenderBatchReply(tag=request.tag, done=True)

    def DecodeAsset(self, request, context):
        self._check([file.sha256 for file in request.files], context, ())
        if request.files[0].path.endswith(".png"):
            data = self.blobs[request.files[0].sha256]
            digest = hashlib.sha256(b"texels of " + data).digest()
            self.assets.add(digest)
            array = types_pb2.Array(dtype=types_pb2.D_TYPE_U8, shape=LARGE, blob=digest)
            info = service_pb2.AssetInfo(texels=array, encoding="ENCODING_SRGB")
            yield service_pb2.DecodeAssetReply(done=1, asset=info)
            return
        for reply in super().DecodeAsset(request, context):
            if reply.HasField("asset"):
                self.assets.add(reply.asset.sha256)
            yield reply


@pytest.fixture
def daemon(tmp_path):
    daemon = Frugal(tmp_path)
    try:
        yield daemon
    finally:
        daemon.stop()


@pytest.mark.parametrize("way", WAYS)
def test_an_edit(daemon, scene, way):
    daemon.way = way
    image = texels()
    with scene.edit() as edit:
        edit.texture("t", image)
    daemon.blobs.clear()
    with scene.edit() as edit:
        edit.texture("other", image)
    assert daemon.refused == 1 and daemon.uploaded == [image.nbytes] * 2
    assert [edit.target.name for t in daemon.transactions for edit in t.edits] == ["t", "other"]


def test_an_edit_of_several_uploads(daemon, scene):
    with scene.edit() as edit:
        for k in range(3):
            edit.texture(f"t{k}", texels())
        edit.mesh("m", positions=np.zeros((3, 3)), indices=np.zeros((200_000, 3), "u4"))
        edit.volume("v", density=np.ones((80, 80, 80), "f4"))
        edit.dome(texels())
        daemon.frees = 1
    assert daemon.refused == 6 and len(daemon.uploaded) == 12


def test_arrays_that_were_inline(daemon, scene):
    """A transaction that is too large for a message has its arrays uploaded."""
    with scene.edit() as edit:
        for k in range(12):
            edit.texture(f"t{k}", texels()[:500])
        daemon.frees = 1
    assert daemon.refused == 12


def test_ids_of_a_group(daemon, scene):
    matrices = np.tile(np.eye(4, dtype="f4"), (20_000, 1, 1))
    with scene.edit() as edit:
        bolts = edit.instances("bolt", transforms=matrices)
    for _ in range(4):
        with scene.edit() as edit:
            edit.set_transforms(bolts, matrices)
            daemon.blobs.clear()
    assert daemon.refused == 3


def test_what_was_never_here_is_an_error(daemon, scene):
    with pytest.raises(hg.NotFound), scene.edit() as edit:
        edit.texture("t", np.zeros((2, 2), "u1"))
        edit.transaction.edits[0].texture.texels.blob = b"x" * 32
    assert daemon.refused == 1


def test_a_daemon_that_never_keeps_anything_is_no_endless_loop(daemon, scene):
    daemon.frees = 1_000_000
    with pytest.raises(hg.NotFound), scene.edit() as edit:
        edit.texture("t", texels())
    assert daemon.refused == 2


def test_an_array_that_was_changed_is_not_sent_in_its_place(daemon, scene):
    image = texels()
    with pytest.raises(hg.FailedPrecondition, match="was changed"), scene.edit() as edit:
        edit.texture("t", image)
        image[:] = 0
        daemon.frees = 1
    with scene.overlay() as overlay:  # has a copy
        overlay.texture("t", image)
        image[:] = 1
    daemon.blobs.clear()
    scene.render("cam", spp=1, overlay=overlay)
    assert daemon.refused == 2


@pytest.mark.parametrize("call", ["render", "worlds", "batch", "stream", "aio"])
def test_an_overlay(daemon, scene, call):
    with scene.overlay() as overlay:
        overlay.texture("t", texels())
        overlay.texture("u", texels())
    for _ in range(2):
        daemon.blobs.clear()
        if call == "render":
            assert scene.render("cam", spp=1, overlay=overlay)["beauty"].size
        elif call == "batch":
            jobs = [hg.Job("cam", spp=1, overlay=overlay, tag=k) for k in range(3)]
            results = list(scene.render_batch(jobs, credits=2))
            assert sorted(result.tag for result in results) == [0, 1, 2]
            assert all(result.frame["beauty"].size for result in results)
        elif call == "stream":
            with scene.stream("cam", spp=1, overlay=overlay, timeout=30) as live:
                live.finish()  # holds for the stream that takes the place of the refused one
                assert [frame["beauty"].size > 0 for frame in live] == [True]
        elif call == "aio":
            asyncio.run(_render_async(daemon.address, overlay))
        else:
            request = render_pb2.RenderRequest(scene=7, overlay=overlay.transaction, spp=1)
            request.cameras.add(name="cam")
            assert hg.client.scene.call.run(scene, request, {"overlay": overlay})
    assert daemon.refused >= 4 and len(daemon.uploaded) >= 6


def test_a_stream_that_stays_refused_has_ended(daemon, scene):
    with scene.overlay() as overlay:
        overlay.texture("t", texels())
    daemon.frees = 1_000_000
    with scene.stream("cam", spp=1, overlay=overlay) as live:
        with pytest.raises(hg.NotFound):
            next(live)
        refused = daemon.refused
        assert not list(live) and daemon.refused == refused


async def _render_async(address, overlay):
    async with await aio.connect(address) as client:
        scene = await client.create_scene()
        assert (await scene.render("cam", spp=1, overlay=overlay))["beauty"].size


def test_files(daemon, scene, tmp_path):
    (tmp_path / "a.png").write_bytes(b"picture")
    (tmp_path / "b.glb").write_bytes(b"model")
    daemon.frees = 1
    with scene.edit() as edit:
        edit.texture("t", tmp_path / "a.png")  # decoding is refused, then the edit
        asset = edit.import_file(tmp_path / "b.glb")
        daemon.frees = 1
    refused = daemon.refused
    assert refused >= 3
    with scene.overlay() as overlay:
        overlay.instance(asset)
        overlay.dome(tmp_path / "a.png")
        daemon.frees = 1
    scene.render("cam", spp=1, overlay=overlay)
    assert daemon.refused == refused + 2
    (tmp_path / "b.glb").write_bytes(b"another")
    with pytest.raises(hg.FailedPrecondition, match="is not what it was"), scene.edit() as edit:
        edit.instance(asset)
        daemon.frees = 1


def test_nothing_is_kept_that_no_repetition_needs(daemon, scene, monkeypatch):
    monkeypatch.setattr(uploads, "_REMEMBERED", 8)
    indices = np.zeros((100_000, 3), "u4")

    def draw(k):
        daemon.blobs.clear()
        with scene.edit() as edit:
            edit.texture("t", texels())
            edit.dome(texels())
            edit.mesh("m", positions=np.zeros((3, 3)), indices=indices + k)
        with scene.overlay() as overlay:
            overlay.texture("t", texels())
        return overlay

    for k in range(10):
        draw(k)
    gc.collect()
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        for k in range(20):
            draw(k)
        daemon.blobs.clear()
        daemon.transactions.clear()
        gc.collect()
        assert tracemalloc.get_traced_memory()[0] - before < 1 << 20
    finally:
        tracemalloc.stop()
    assert len(scene.client.store._known) == 8
