"""Requests of render_batch and stream, and what they make of the replies."""

import gc

import heliograph as hg
import pytest
from heliograph._wire._proto import service_pb2


def sent(daemon, kind):
    return [request for request in daemon.requests if isinstance(request, kind)]


def test_results_carry_tags_frames_and_errors(daemon, scene):
    jobs = [hg.Job(["cam", "side"], spp=1, seed=i, tag={"i": i}) for i in range(12, 15)]
    results = list(scene.render_batch(jobs, credits=2))
    assert [result.tag["i"] for result in results] == [12, 13, 14]
    assert [len(result.frames) for result in results] == [2, 0, 2]
    error = results[1].error
    assert isinstance(error, hg.ResourceExhausted) and str(error) == "unlucky"
    assert error.field == "job.seed" and error.retry_seconds == 2.5
    with pytest.raises(hg.ResourceExhausted):
        assert results[1].frame
    assert results[2].frame["beauty"].shape == (48, 64, 4)


def test_the_first_item_has_the_credits_and_each_later_one_returns_one(daemon, scene):
    jobs = [hg.Job("cam", spp=1) for _ in range(6)]
    assert len(list(scene.render_batch(jobs, credits=3))) == 6
    found = sent(daemon, service_pb2.RenderBatchRequest)
    assert [request.credits for request in found] == [3, 0, 0, 1, 1, 1]
    assert not any(request.job.progressive for request in found)


def test_what_the_client_refuses_is_a_result_too(scene):
    jobs = [hg.Job("cam", spp=-1, tag="bad"), hg.Job("cam", spp=1, tag="good")]
    found = {result.tag: result for result in scene.render_batch(jobs)}
    assert isinstance(found["bad"].error, hg.InvalidArgument)
    assert found["good"].error is None
    assert [r.tag for r in scene.render_batch([hg.Job("cam", spp=-1, tag="bad")])] == ["bad"]


def test_a_batch_that_is_let_go_of_is_cancelled(scene):
    results = scene.render_batch(hg.Job("cam", spp=1) for _ in range(1000))
    next(results)
    call = results._stream._call
    del results
    gc.collect()
    assert not call.is_active()


def test_a_stream_sends_settings_whole_and_returns_credits(daemon, scene):
    with scene.stream("cam", spp=8, seed=1, credits=3) as live:
        first = next(live)
        live.update(seed=2)
        assert next(live).width == first.width == 64
        live.finish()
        assert list(live) == []
    first, *rest = sent(daemon, service_pb2.StreamRequest)
    assert first.policy == service_pb2.StreamRequest.POLICY_LATEST and first.credits == 3
    assert first.settings.progressive and first.settings.seed == 1
    changed = next(request for request in rest if request.HasField("settings"))
    assert changed.settings.seed == 2 and changed.settings.spp == 8
    assert sum(request.credits for request in rest) >= 1


def test_lossless_asks_for_final_frames(daemon, scene):
    with scene.stream("cam", policy="lossless", spp=1) as live:
        next(live)
    (first,) = [r for r in sent(daemon, service_pb2.StreamRequest) if r.policy]
    assert (
        first.policy == service_pb2.StreamRequest.POLICY_LOSSLESS and not first.settings.progressive
    )


def test_what_is_not_for_them_is_refused(scene):
    for name, value in {"progress": True, "on_pass": print, "timeout": 3}.items():
        with pytest.raises(hg.InvalidArgument, match=name):
            hg.Job("cam", **{name: value})
    with pytest.raises(hg.InvalidArgument, match="on_pass"):
        scene.stream("cam", on_pass=print)
    with pytest.raises(hg.InvalidArgument, match="policy"):
        scene.stream("cam", policy="all")
    with pytest.raises(hg.InvalidArgument, match="credits"):
        scene.render_batch([], credits=0)
