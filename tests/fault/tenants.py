"""Limits and weights of single tenants: the tenants file gives them, and again when it is replaced
while the tenants work. Nothing that runs is lost, and the device is shared by weight.
"""

import contextlib
import threading
import time

import common
import heliograph as hg
import numpy as np
import served

SECONDS = common.size(20, 2.5)  # of each measurement of shares
ROUNDS = common.size(50, 4)  # replacements of the file under load
DEFAULTS = {"tenant_entities": 500, "tenant_jobs": 64}


class Load:
    """Renders jobs of a scene without end; `frames` that came, and the `errors` of others."""

    def __init__(self, scene):
        self.frames, self.errors = 0, []
        jobs = (hg.Job("cam", spp=4, seed=i) for i in range(1_000_000))
        self._results = scene.render_batch(jobs, credits=12)
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        with contextlib.suppress(hg.Cancelled):
            for result in self._results:
                if result.error is None:
                    self.frames += 1
                else:
                    self.errors.append(result.error)

    def stop(self):
        self._results.close()
        self._thread.join()


def give(place, *lines):
    """Replaces the tenants file: who they are, and these lines."""
    served.tenants_file(place, "ops socket\n", *(f"{line}\n" for line in lines))


def until_limit(client, name, value):
    """Seconds until the client's tenant has this limit."""
    return common.seconds_until(lambda: client.info().limits[name] == value)


def put_entities(scene, count):
    """True if there was room for them."""
    try:
        with scene.edit() as edit:
            for _ in range(count):
                edit.entity(transform=np.eye(4))
    except hg.ResourceExhausted as error:
        return not ("tenant_entities" in str(error) and error.needed > error.available)
    return True


def shares(daemon):
    """Vision's seconds of the device over robots'."""
    name = "heliograph_job_device_seconds_sum"
    before = daemon.scrape(name)
    time.sleep(SECONDS)
    after = daemon.scrape(name)
    robots, vision = (after[key] - before[key] for key in ('tenant="robots"', 'tenant="vision"'))
    return vision / robots


def check_given(report, daemon, clients):
    """Each has what its lines give, the rest of what the daemon gives to all."""
    limits = daemon.scrape("heliograph_tenant_limit")
    weights = daemon.scrape("heliograph_tenant_weight")
    wrong, misjudged = [], []
    for tenant, weight, jobs, entities in (
        ("robots", 1, 64, 100),
        ("vision", 3, 8, 1000),
        ("ops", 1, 64, 500),
    ):
        own = clients[tenant].info().limits
        for name, value in (("tenant_jobs", jobs), ("tenant_entities", entities)):
            wrong += [own[name] != value, limits[f'limit="{name}",tenant="{tenant}"'] != value]
        wrong.append(weights[f'tenant="{tenant}"'] != weight)
        with clients[tenant].create_scene() as scene:
            misjudged.append(put_entities(scene, 200) != (entities >= 200))
    report.figure("limits and weights that are not as written", sum(wrong), 0)
    report.figure("edits let in or refused against them", sum(misjudged), 0)


def check_reload(report, place, clients):
    """A raised limit lets work in, a lowered one keeps what there is, a line that goes leaves the
    daemon's."""
    with contextlib.ExitStack() as stack:
        robots, vision = (
            stack.enter_context(clients[tenant].create_scene()) for tenant in ("robots", "vision")
        )
        put_entities(vision, 200)
        give(place, "robots limit tenant_entities 300", "vision limit tenant_entities 150")
        seconds = [
            until_limit(clients["robots"], "tenant_entities", 300),
            until_limit(clients["vision"], "tenant_entities", 150),
        ]
        wrong = [
            not put_entities(robots, 200),
            common.used(clients["vision"], "tenant_entities") < 200,
            put_entities(vision, 1),
        ]
        give(place, "vision weight 3")
        seconds.append(until_limit(clients["vision"], "tenant_entities", 500))
        wrong += [not put_entities(vision, 200), not put_entities(robots, 200)]
    report.figure("new limits that did not hold", sum(wrong), 0)
    report.figure("new limits hold after, worst", max(seconds), 1, "s")


def check_under_load(report, place, daemon, clients):
    """Shares by weight, and files that come while all work."""
    loads = [Load(common.stage(clients[tenant], 64, 64)) for tenant in ("robots", "vision")]
    time.sleep(2)  # what one may be ahead of the other is used up
    ratio = shares(daemon)
    report.figure("weights 1 and 3: share off by", abs(ratio / 3 - 1), 0.2, slack=False)
    for i in range(ROUNDS):
        jobs = 32 + i
        give(place, f"robots weight {1 + i % 3}", f"robots limit tenant_jobs {jobs}")
        until_limit(clients["robots"], "tenant_jobs", jobs)
    give(place, "robots weight 3", "vision weight 3")
    until_limit(clients["robots"], "tenant_jobs", DEFAULTS["tenant_jobs"])
    time.sleep(0.5)
    report.figure("weights equal: share off by", abs(shares(daemon) - 1), 0.2, slack=False)
    for load in loads:
        load.stop()
    frames = sum(load.frames for load in loads)
    errors = sum(len(load.errors) for load in loads)
    report.figure(f"lost, of {frames} frames and {ROUNDS} new files", errors, 0)


def main():
    limits = [f for name, n in DEFAULTS.items() for f in ("--limit", f"{name}={n}")]
    with common.Report("tenants") as report, served.folder() as place:
        give(
            place,
            "robots limit tenant_entities 100",
            "vision weight 3",
            "vision limit tenant_entities 1000",
            "vision limit tenant_jobs 8",
        )
        flags = ("--tenants", place / "tenants", "--metrics", "127.0.0.1:0", *limits)
        with contextlib.ExitStack() as stack:
            daemon = stack.enter_context(served.served(*flags))
            clients = {
                tenant: stack.enter_context(
                    hg.connect(daemon.socket, token=served.TOKENS.get(tenant))
                )
                for tenant in ("robots", "vision", "ops")
            }
            check_given(report, daemon, clients)
            check_reload(report, place, clients)
            check_under_load(report, place, daemon, clients)


if __name__ == "__main__":
    main()
