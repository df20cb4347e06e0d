"""S12: each quota of a tenant is refused with what is needed and when to retry; what is used goes
back to 0 when it is deleted."""

import time

import common
import heliograph as hg
import numpy as np

LIMITS = {
    "tenant_bytes": 8 << 20,
    "tenant_entities": 100,
    "tenant_streams": 2,
    "tenant_jobs": 2,
    "tenant_edits_per_second": 100,
    "tenant_samples_per_second": 200_000,
}
COUNTED = ("tenant_bytes", "tenant_entities", "tenant_streams", "tenant_jobs")


def refused(call):
    """The error of a call that goes over a quota."""
    try:
        call()
    except hg.ResourceExhausted as error:
        return error
    return None


def entities(scene):
    with scene.edit() as edit:
        for _ in range(200):
            edit.entity(transform=np.eye(4))


def array_bytes(scene):
    with scene.edit() as edit:
        edit.texture("large", np.zeros((2048, 2048, 4), dtype="u1"))


def many_streams(scene):
    lives = [scene.stream("cam", spp=1) for _ in range(LIMITS["tenant_streams"] + 1)]
    try:
        for live in lives:
            next(live)
    finally:
        for live in lives:
            live.close()


def many_jobs(scene):
    jobs = [hg.Job("cam", spp=1 << 20) for _ in range(LIMITS["tenant_jobs"] + 1)]
    results = scene.render_batch(jobs, credits=len(jobs))
    try:
        next(results).frame.image()
    finally:
        results.close()


def many_edits(scene):
    for i in range(3000):
        with scene.edit() as edit:
            edit.entity("ball", transform=hg.Pose((i * 1e-3, 0, 0.5)))


def many_samples(scene):
    for _ in range(50):
        scene.render("cam", spp=8)


def main():
    with common.Report("S12 quotas") as report, common.daemon("--grace", "0", **LIMITS) as client:
        for name, call in (
            ("tenant_bytes", array_bytes),
            ("tenant_entities", entities),
            ("tenant_streams", many_streams),
            ("tenant_jobs", many_jobs),
            ("tenant_edits_per_second", many_edits),
            ("tenant_samples_per_second", many_samples),
        ):
            with hg.connect(client.address) as other:
                scene = common.stage(other)
                error = refused(lambda call=call, scene=scene: call(scene))
                good = error is not None and name in str(error) and error.needed > error.available
                report.figure(f"{name}: not refused, or not told why", not good, 0)
                if name.endswith("_per_second"):
                    wait = error.retry_seconds if error else 0
                    report.figure(f"{name}: no retry time", not 0 < wait < 60, 0)
                    time.sleep(wait)
                    again = refused(lambda scene=scene: scene.render("cam", planes=["depth"]))
                    report.figure(f"{name}: refused after it", again is not None, 0)
                    time.sleep(1)  # what follows needs room too
            common.seconds_until(lambda: common.used(client, "tenant_jobs") == 0)
            common.clear_device(client)
            gone = lambda: all(common.used(client, each) == 0 for each in COUNTED)  # noqa: E731
            report.figure(f"{name}: until all is 0 again", common.seconds_until(gone), 1, "s")


if __name__ == "__main__":
    main()
