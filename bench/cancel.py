"""Time until the device is free after a cancel or a deadline: 50 ms are promised.

usage: bench/cancel.py [ROUNDS]   Cancels jobs of every kind at random moments and asks at once for
a tiny frame of another scene; prints milliseconds until it is here, less what it takes on an idle
device. HELIOGRAPHD names the daemon.
"""

import random
import sys
import threading
import time

import heliograph as hg
import numpy as np

SIZE = (1280, 720)
SIDE = 20  # SIDE^2 balls
CENTRE = [
    "depth",
    "normal",
    "position",
    "instance",
    "semantic",
    "part",
    "uv",
    "tangent",
    "base_color",
]


def grid(side):
    """Poses (side^2, 4, 4), a metre apart."""
    poses = np.tile(np.eye(4), (side * side, 1, 1))
    poses[:, 0, 3], poses[:, 1, 3] = np.mgrid[0:side, 0:side].reshape(2, -1) - side / 2
    poses[:, 2, 3] = 0.4
    return poses


def balls(scene, side, segments):
    """Side x side balls on a floor, under the bundled dome."""
    with scene.edit() as edit:
        edit.sample_studio()
        mesh = edit.mesh("ball/mesh", **hg.shapes.sphere(0.4, segments=segments))
        glass = edit.material("glass", transmission=1.0, roughness=0.1)
        edit.instances("ball", mesh=mesh, material=glass, transforms=grid(side), category="ball")
        pose = hg.look_at((0, -0.7 * side, 0.4 * side), (0, 0, 0))
        edit.entity("cam", camera=hg.Camera.from_fov(50, 64, 48, degrees=True), transform=pose)


class Bench:
    def __init__(self, client):
        self.tiny, self.heavy = client.create_scene(), client.create_scene()
        balls(self.tiny, 2, 32)
        balls(self.heavy, SIDE, 128)
        self.client = client
        self.names = [f"ball/{i}" for i in range(SIDE * SIDE)]
        self.rays = np.random.default_rng(1).normal(size=(65536, 3)).astype("f4")
        self.heavy.render("cam", planes=["depth"])
        self.idle = float(np.median([self.tiny_frame() for _ in range(20)]))

    def tiny_frame(self):
        start = time.perf_counter()
        self.tiny.render("cam", planes=["depth"], labels=False)
        return time.perf_counter() - start

    def jobs(self):
        """name -> a function that runs a long call, given what takes its cancel."""

        def frame(**options):
            return lambda on_start: self.heavy.render(
                "cam", size=SIZE, on_start=on_start, **options
            )

        def fresh(on_start):
            with self.client.create_scene() as scene:
                with scene.edit() as edit:
                    mesh = edit.mesh("m", **hg.shapes.sphere(0.4, segments=700))
                    edit.instances("e", mesh=mesh, transforms=grid(200))
                    edit.entity("cam", camera=hg.Camera.from_fov(1, 64, 48))
                scene.render("cam", planes=["depth"], on_start=on_start, labels=False)

        def moved(on_start):
            with self.heavy.branch() as branch:
                with branch.edit() as edit:
                    edit.instances("more", mesh="ball/mesh", transforms=grid(250))
                branch.render("cam", planes=["depth"], on_start=on_start, labels=False)

        def asked(method, request):
            def run(on_start):
                link = self.client.connection.link
                future = link.method("Query").future(request, metadata=link.metadata)
                on_start(future.cancel)
                future.result()

            return run

        from heliograph._wire._proto import service_pb2 as service
        from heliograph._wire._proto import types_pb2 as types
        from heliograph._wire.arrays import inline

        refs = [types.Ref(name=name) for name in self.names]
        rays = inline(self.rays)
        query = lambda **fields: service.QueryRequest(scene=self.heavy.id, **fields)  # noqa: E731
        return {
            "samples": frame(spp=1 << 20),
            "one pass, deep": frame(spp=1 << 20, max_depth=256, roulette=False),
            "centre planes": frame(planes=CENTRE, labels=False),
            "amodal masks": frame(planes=["instance"], labels=["amodal_masks"]),
            "derived data": fresh,
            "62,500 more": moved,
            "rays": asked("rays", query(cast_rays=service.CastRays(origins=rays, directions=rays))),
            "visible": asked(
                "visible",
                query(visible=service.Visible(camera=types.Ref(name="cam"), entities=refs)),
            ),
            "overlaps": asked("overlaps", query(overlaps=service.Overlaps(a=refs, b=refs))),
            "surface": asked(
                "surface", query(sample_surface=service.SampleSurface(entities=refs, count=1 << 20))
            ),
        }

    def cancelled(self, job, longest):
        """Seconds from the cancel to the tiny frame; None when the job was over before."""
        cancel, started, over = [], threading.Event(), threading.Event()

        def on_start(function):
            cancel.append(function)
            started.set()

        def work():
            try:
                job(on_start)
                over.set()
            except Exception:
                pass

        thread = threading.Thread(target=work)
        thread.start()
        started.wait()
        time.sleep(random.random() * longest)
        if over.is_set():
            thread.join()
            return None
        start = time.perf_counter()
        cancel[0]()
        self.tiny_frame()
        seconds = time.perf_counter() - start - self.idle
        thread.join()
        return seconds


def show(name, seconds):
    if not seconds:
        return print(f"{name:16} over before it could be cancelled")
    ms = 1000 * np.array(seconds)
    print(
        f"{name:16} {len(ms):4} x  median {np.median(ms):6.1f}  90 % {np.quantile(ms, 0.9):6.1f}  "
        f"worst {ms.max():6.1f} ms"
    )


def main():
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    random.seed(1)
    with hg.connect() as client:
        bench = Bench(client)
        print(f"a tiny frame on an idle device: {1000 * bench.idle:.1f} ms")
        for name, job in bench.jobs().items():
            start = time.perf_counter()
            longest = 0.3
            if name not in ("samples", "one pass, deep"):
                job(lambda function: None)
                longest = min(longest, 0.9 * (time.perf_counter() - start))
            found = [bench.cancelled(job, longest) for _ in range(rounds)]
            show(name, [s for s in found if s is not None])
        late = []
        for _ in range(rounds):
            wanted = random.uniform(0.02, 0.3)
            start = time.perf_counter()
            try:
                bench.heavy.render("cam", size=SIZE, spp=1 << 20, timeout=wanted)
            except hg.DeadlineExceeded:
                bench.tiny_frame()
                late.append(time.perf_counter() - start - wanted - bench.idle)
        show("deadline", late)


if __name__ == "__main__":
    main()
