"""R13, host memory: twice what the budget holds is refused with what is needed and available; the
scene stays at its revision, and its next picture is the same, bit for bit."""

import contextlib

import common
import heliograph as hg
import numpy as np

MB = 1 << 20
BUDGET = 64 * MB


def noise(megabytes, seed):
    """Texels that compress and repeat nowhere."""
    side = int((megabytes * MB / 4) ** 0.5)
    return np.random.default_rng(seed).integers(0, 255, (side, side, 4), dtype="u1")


def one_array(edit):
    edit.texture("large", noise(128, 1))


def many_arrays(edit):
    for i in range(16):
        edit.texture(f"large/{i}", noise(8, i))


def meshes(edit):
    points = np.random.default_rng(0).random((2 * BUDGET // 12, 3), dtype="f4")
    edit.mesh("large", positions=points, indices=np.arange(30, dtype="u4").reshape(10, 3))


def entities(edit):
    edit.instances("large", transforms=np.tile(np.eye(4), (2 * 20_000, 1, 1)))


# Limit -> what it is set to, and an edit that needs twice as much
CASES = {
    "blob_store_bytes": (BUDGET, one_array),
    "tenant_bytes": (BUDGET, many_arrays),
    "array_bytes": (BUDGET, meshes),
    "entities": (20_000, entities),
}


def refused(scene, change):
    with contextlib.suppress(ValueError):
        try:
            with scene.edit() as edit:
                change(edit)
        except hg.ResourceExhausted as error:
            return error
    return None


def check(limit, report):
    budget, change = CASES[limit]
    with common.daemon("--grace", "0", **{limit: budget}) as client:
        pid, scene = common.pid_of(client), common.stage(client, 64, 48)
        picture = {"planes": ["beauty", "instance"], "spp": 4}
        before = scene.render("cam", **picture)
        size, revision = common.resident(pid), scene.revision
        for _ in range(3):  # what was refused is not kept either
            error = refused(scene, change)
        good = error is not None and error.needed > error.available
        report.figure(f"{limit}: not refused with needed and available", not good, 0, slack=False)
        report.figure(f"{limit}: revisions moved", scene.revision - revision, 0, slack=False)
        after = scene.render("cam", **picture)
        differ = any(not np.array_equal(before[plane], after[plane]) for plane in before)
        report.figure(f"{limit}: the next picture differs", differ, 0, slack=False)
        grown = (common.resident(pid) - size) / 1e6
        report.figure(f"{limit}: growth of memory", grown, 2.5 * BUDGET / 1e6, "MB", slack=False)
        with scene.edit() as edit:
            edit.texture("small", noise(1, 9))


def main():
    with common.Report("R13 host memory") as report:
        for limit in CASES:
            check(limit, report)


if __name__ == "__main__":
    main()
