"""The trace of a caller: in manifests, and in nothing that is kept or compared."""

import asyncio
import contextvars
import json
import pickle

import balls
import heliograph as hg
import heliograph.aio
import heliograph.datasets as hd
import pytest
from recordings import furnish, methods, played

TRACE = "4bf92f3577b34da6a3ce929d0e0e4736"
SPAN: contextvars.ContextVar[str] = contextvars.ContextVar("span", default="")


def headers():
    """Headers of OpenTelemetry's inject(), and some of no trace."""
    if not SPAN.get():
        return {}
    parent = f"00-{TRACE}-{SPAN.get()}-01"
    return {"traceparent": parent, "tracestate": "v=1", "baggage": "secret=1"}


@pytest.fixture(scope="module")
def traced():
    with hg.connect(trace=headers) as client:
        yield client


@pytest.fixture(autouse=True)
def no_span():
    token = SPAN.set("")
    yield
    SPAN.reset(token)


def test_a_manifest_names_the_trace_of_its_call_alone(traced):
    with traced.create_scene() as scene:
        balls.furnished(scene)
        plain = scene.render("cam", spp=2)
        assert "trace" not in json.loads(plain.manifest)
        made = []
        for span in ("00f067aa0ba902b7", "00f067aa0ba902b8"):
            SPAN.set(span)
            frame = scene.render("cam", spp=2)
            manifest = json.loads(frame.manifest)
            assert manifest.pop("trace")["traceparent"] == f"00-{TRACE}-{span}-01"
            assert manifest == json.loads(plain.manifest)
            made.append(frame)
        SPAN.set("")
        again = scene.rerender(made[0].manifest)
        assert again.sha256 == made[0].sha256 == plain.sha256
        assert again.manifest == plain.manifest


def test_a_data_set_does_not_depend_on_the_trace(traced, tmp_path):
    for folder, span in (("plain", ""), ("traced", "00f067aa0ba902b7")):
        SPAN.set(span)
        with traced.create_scene() as scene:
            stage = (scene, *balls.furnished(scene))
            writers = [hd.Coco(tmp_path / folder / "coco"), hd.Exr(tmp_path / folder / "exr")]
            balls.make(stage, None, writer=writers)
    assert balls.files(tmp_path / "plain") == balls.files(tmp_path / "traced")


def test_a_recording_of_traced_calls_is_played(tmp_path):
    SPAN.set("00f067aa0ba902b7")
    path = tmp_path / "session.recording"
    with (
        hg.connect(arguments=("--record", str(path)), trace=headers) as client,
        client.create_scene("room", lifetime="daemon") as scene,
    ):
        furnish(scene)
        scene.render("cam", spp=2, planes=["beauty"])
    verdicts = played(path)
    assert "Render" in methods(verdicts["same"]) and not verdicts["differs"]


def test_a_pickled_client_has_no_trace(traced):
    access = pickle.loads(pickle.dumps(traced.connection.access))
    assert access == traced.connection.access and access.trace is None


def test_calls_that_are_awaited_have_the_trace_of_their_task():
    async def span_of(scene, span):
        SPAN.set(span)
        frame = await scene.render("cam", spp=1)
        return json.loads(frame.manifest)["trace"]["traceparent"].split("-")[2]

    async def work():
        async with await heliograph.aio.connect(trace=headers) as client:
            scene = await client.create_scene()
            async with scene.edit() as edit:
                lens = hg.Camera.from_fov(50, 8, 8, degrees=True)
                edit.entity("cam", camera=lens, transform=hg.Pose((0, 0, 1)))
            spans = [f"{number:016x}" for number in range(1, 5)]
            assert spans == await asyncio.gather(*(span_of(scene, span) for span in spans))

    asyncio.run(work())
