"""One ledger: no tenant takes another's share of sessions, scenes, jobs and bytes; what is kept is
counted (attributes, older revisions, requests that wait); work is refused in order when the bytes
run out; an upload over the memory there is is refused, and the daemon goes on; held frames leave
descriptors for others."""

import contextlib
import fcntl
import os
import pathlib
import socket
import struct
import subprocess
import threading
import time

import common
import grpc
import heliograph as hg
import numpy as np
import served
from heliograph._wire._proto import render_pb2, types_pb2
from heliograph._wire._proto import service_pb2 as service

MIB = 1 << 20
GROUPS = pathlib.Path("/sys/fs/cgroup")
POD = 768 * MIB  # memory of a container


def limit_flags(**limits):
    return [flag for name, value in limits.items() for flag in ("--limit", f"{name}={value}")]


@contextlib.contextmanager
def two_tenants(**limits):
    """A daemon of two tenants."""
    with served.folder() as folder:
        tenants = ("--tenants", served.tenants_file(folder))
        with served.served(*tenants, *limit_flags(**limits)) as daemon:
            yield daemon


def connect(daemon, tenant):
    return hg.connect(daemon.socket, token=served.TOKENS[tenant])


def refused(call):
    """The error of a call that is refused for want of something, or None."""
    try:
        call()
    except hg.ResourceExhausted as error:
        return error
    except grpc.RpcError as error:
        return error if error.code() == grpc.StatusCode.RESOURCE_EXHAUSTED else None
    return None


def fails(daemon):
    """True if the other tenant cannot open a session, make a scene, upload, ask and render."""
    try:
        with connect(daemon, "vision") as client, client.create_scene() as scene:
            with scene.edit() as edit:
                edit.texture("t", np.zeros((1000, 1000, 3), "u1"))
                lens = hg.Camera.from_fov(50, 32, 32, degrees=True)
                edit.entity("cam", camera=lens, transform=hg.Pose())
            scene.pick("cam", [(16, 16)])
            scene.render("cam", planes=["depth"], labels=False)
    except hg.HeliographError as error:
        print("   ", error)
        return True
    return False


def begin(client, name, request):
    """A call that is under way: an iterator of its replies, or a future of its reply."""
    link = client.connection.link
    method = link.method(name)
    start = getattr(method, "future", method)
    return start(request, metadata=link.metadata, timeout=60)


def errors_of(calls):
    """A list that gets the errors of streams as they end."""
    errors = []

    def read(call):
        try:
            for _ in call:
                pass
        except grpc.RpcError as error:
            errors.append(error)

    for call in calls:
        threading.Thread(target=read, args=(call,), daemon=True).start()
    return errors


def put(scene, number, name, attribute):
    """A request that puts an entity with an attribute."""
    request = service.ApplyRequest(scene=scene.id, number=number)
    edit = request.transaction.edits.add()
    edit.target.name = name
    edit.entity.attributes.values["k"] = attribute
    return request


def apply(scene, request):
    begin(scene.client, "Apply", request).result()


def long_job(scene, **overlay):
    """A request that takes for ever."""
    request = render_pb2.RenderRequest(scene=scene.id, spp=1 << 20)
    request.cameras.append(types_pb2.Ref(name="cam"))
    request.planes.append(render_pb2.PlaneRequest(plane=render_pb2.PLANE_BEAUTY))
    for name, attribute in overlay.items():
        edit = request.overlay.edits.add()
        edit.target.name = name
        edit.entity.attributes.values["k"] = attribute
    return request


def check(report, daemon, limit, error):
    is_named = error is not None and f"limit {limit}" in str(error)
    report.figure(f"{limit}: not refused, or not told why", not is_named, 0)
    report.figure(f"{limit}: another tenant is refused", fails(daemon), 0)


def takes_sessions(report):
    with two_tenants(sessions=24) as daemon, contextlib.ExitStack() as robots:
        why = refused(lambda: [robots.enter_context(connect(daemon, "robots")) for _ in range(40)])
        check(report, daemon, "sessions", why)


def takes_scenes(report):
    with two_tenants(scenes=40) as daemon, connect(daemon, "robots") as client:
        check(report, daemon, "scenes", refused(lambda: [client.create_scene() for _ in range(50)]))


def takes_jobs(report):
    with two_tenants(jobs=16) as daemon, connect(daemon, "robots") as client:
        scene = common.stage(client, 256, 256)
        calls = [begin(client, "Render", long_job(scene)) for _ in range(20)]
        errors = errors_of(calls)
        common.seconds_until(lambda: errors)
        check(report, daemon, "jobs", errors[0])
        for call in calls:
            call.cancel()


def takes_bytes(report):
    with two_tenants(blob_store_bytes=64 * MIB) as daemon, connect(daemon, "robots") as client:
        scene = client.create_scene()

        def fill():
            for i in range(40):
                with scene.edit() as edit:
                    edit.texture(f"t{i}", np.full((1024, 512, 4), i, "u1"))

        check(report, daemon, "blob_store_bytes", refused(fill))


def takes_channels(report):
    """Sockets for quick calls: who has none calls by gRPC."""
    with two_tenants(quick_calls=4) as daemon, contextlib.ExitStack() as stack:
        used = {}
        for tenant, sessions in (("robots", 8), ("vision", 1)):
            for _ in range(sessions):
                client = stack.enter_context(connect(daemon, tenant))
                common.stage(client, 16, 16)
            used[tenant] = common.used(client, "quick_calls")
        report.figure("quick_calls: of a tenant with 8 sessions", used["robots"], 3, slack=False)
        report.figure("quick_calls: another tenant has none", used["vision"] == 0, 0)


def in_order(report):
    """While the bytes run out sessions are refused first, then uploads, then jobs."""
    with common.daemon(blob_store_bytes=100 * MIB) as client, client.create_scene() as scene:
        with scene.edit() as edit:
            lens = hg.Camera.from_fov(50, 32, 32, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.Pose())
        names = iter(range(1000))

        def upload(mebibytes):
            number = next(names)
            with scene.edit() as edit:
                edit.texture(f"t{number}", np.full((mebibytes * 512, 512, 4), number, "u1"))

        def state():
            """Which of the three are refused now: an upload has 2 MiB."""
            calls = (
                lambda: hg.connect(client.address).close(),
                lambda: upload(2),
                lambda: scene.render("cam", planes=["depth"], labels=False),
            )
            errors = [refused(call) for call in calls]
            if any(error is not None and error.retry_seconds <= 0 for error in errors):
                return "no retry time"
            return "".join("." if error is None else "x" for error in errors)

        for mebibytes, promised in ((78, "..."), (6, "x.."), (5, "xx.")):
            upload(mebibytes)
            got = state()
            print(f"    {common.used(client, 'tenant_bytes') / MIB:.1f} MiB of 100: {got}")
            report.figure(f"sessions, uploads, jobs: not {promised}", got != promised, 0)
        while common.used(client, "tenant_bytes") < 97.5 * MIB:  # small edits go on
            with scene.edit() as edit:
                number = next(names)
                edit.texture(f"t{number}", np.full((256, 256, 4), number % 256, "u1"))
        report.figure("sessions, uploads, jobs: not xxx", state() != "xxx", 0)


def kept(report):
    """Attributes and older revisions are counted, and bounded."""
    most = 64 * MIB
    with common.daemon(tenant_bytes=most) as client:
        before = common.peak(common.pid_of(client))
        used = lambda: common.used(client, "tenant_bytes")  # noqa: E731

        def check_scene(what, name_of):
            with client.create_scene() as scene:
                text = "x" * (6 * MIB)
                requests = (put(scene, i + 1, name_of(i), text) for i in range(40))
                error = refused(lambda: [apply(scene, request) for request in requests])
                report.figure(f"{what}: not refused", "limit tenant_bytes" not in str(error), 0)
                report.figure(f"{what}: counted less than is kept", used() < most / 2, 0)
            gone = common.seconds_until(lambda: used() == 0)
            report.figure(f"{what}: until they are gone", gone, 1, "s")

        check_scene("attributes", lambda i: f"e{i}")
        check_scene("revisions of one entity", lambda i: "e")
        with client.create_scene() as scene:
            for i in range(3):
                with scene.edit() as edit:
                    root = edit.entity(f"root{i}")
                    poses = np.tile(np.eye(4), (10_000, 1, 1))
                    edit.instances(f"i{i}", transforms=poses, parent=root)
                with scene.edit() as edit:
                    edit.remove(f"root{i}", cascade=True)
            report.figure("removed entities: not counted", used() < 3 * 10_000 * 300, 0)
        grown = (common.peak(common.pid_of(client)) - before) / MIB
        report.figure("memory beside the limit of 64 MiB", grown, 64 + 100, "MiB", slack=False)


def waiting(report):
    """Batches whose items wait."""
    with common.daemon(tenant_bytes=64 * MIB) as client:
        scene = common.stage(client, 64, 64)
        over = threading.Event()

        def items():
            yield service.RenderBatchRequest(tag=0, job=long_job(scene), credits=1)
            for i in range(2):
                job = long_job(scene, z="x" * (6 * MIB))
                yield service.RenderBatchRequest(tag=i + 1, job=job)
            over.wait()

        before = common.resident(common.pid_of(client))
        calls = [begin(client, "RenderBatch", items()) for _ in range(24)]
        errors = errors_of(calls)
        with contextlib.suppress(TimeoutError):
            common.seconds_until(lambda: errors)
        time.sleep(1)
        is_named = any("limit tenant_bytes" in error.details() for error in errors)
        report.figure("batches that wait: not refused", not is_named, 0)
        grown = (common.resident(common.pid_of(client)) - before) / MIB
        report.figure("batches that wait: memory", grown, 64 + 150, "MiB", slack=False)
        over.set()
        for call in calls:
            call.cancel()


def removed(group):
    with contextlib.suppress(OSError):
        group.rmdir()
    return not group.exists()


@contextlib.contextmanager
def pod(limit):
    """The command that runs a process in a container of this much memory; () where none can
    be made."""
    if (GROUPS / "memory").is_dir():
        root, file = GROUPS / "memory", "memory.limit_in_bytes"
    else:
        root, file = GROUPS, "memory.max"
    group = root / f"heliograph-{os.getpid()}"

    enter = ("sh", "-c", f'echo $$ > {group}/cgroup.procs && exec "$@"', "sh")
    possible = False
    with contextlib.suppress(OSError, subprocess.SubprocessError):
        group.mkdir()
        (group / file).write_text(str(limit))
        subprocess.run([*enter, "true"], check=True, stderr=subprocess.DEVNULL)
        possible = True
    if not possible:
        print("    no container can be made here: the limit memory_bytes stands for it")
    yield enter if possible else ()
    with contextlib.suppress(TimeoutError):
        common.seconds_until(lambda: removed(group))


def sparse(client, size):
    """Hands over a file without blocks, as an array of a mesh."""
    fd = os.memfd_create("sparse", os.MFD_ALLOW_SEALING)
    os.ftruncate(fd, size)
    fcntl.fcntl(fd, fcntl.F_ADD_SEALS, fcntl.F_SEAL_WRITE | fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW)
    socket.send_fds(client.connection.link._local_channel, [struct.pack("=QQ", 7, size)], [fd])
    os.close(fd)
    with client.create_scene() as scene:
        request = service.ApplyRequest(scene=scene.id, number=1)
        mesh = request.transaction.edits.add().mesh
        mesh.positions.dtype = types_pb2.D_TYPE_F32
        mesh.positions.shape.extend([size // 12, 3])
        mesh.positions.buffer.CopyFrom(types_pb2.BufferRef(buffer=7, size=size))
        mesh.indices.dtype = types_pb2.D_TYPE_U32
        mesh.indices.shape.extend([1, 3])
        mesh.indices.inline = struct.pack("<3I", 0, 1, 2)
        apply(scene, request)


def fill(client):
    """Twice the container's memory, in scenes that have an eighth of it each."""
    for i in range(16):
        scene = client.create_scene()
        for k in range(POD // 8 // (32 * MIB)):
            with scene.edit() as edit:
                edit.texture(f"t{k}", np.full((4096, 2048, 4), 16 * i + k, "u1"))


def stage_in(daemon):
    with hg.connect(daemon.socket) as client:
        common.stage(client, 32, 32)


def memory(report):
    """Uploads of more than the container's memory, with limits that fit it and with some that the
    operator set too high."""
    high = {"tenant_bytes": 16 << 30, "blob_store_bytes": 16 << 30}
    for what, limits in (("memory", {}), ("limits above the memory", high)):
        with pod(POD) as enter:
            if not enter:
                limits = {**limits, "memory_bytes": POD}
            with served.served("--grace", "0", *limit_flags(**limits), under=enter) as daemon:
                with hg.connect(daemon.socket) as client:
                    error = refused(lambda c=client: fill(c))
                    print("   ", error)
                    named = "memory_bytes" if "tenant_bytes" in limits else "tenant_bytes"
                    report.figure(
                        f"{what}: an upload is not refused", f"limit {named}" not in str(error), 0
                    )
                took = common.seconds_until(lambda d=daemon: refused(lambda: stage_in(d)) is None)
                report.figure(f"{what}: until a client is served again", took, 5, "s")
                with hg.connect(daemon.socket) as client:
                    error = refused(lambda c=client: sparse(c, 2 * POD))
                    report.figure(f"{what}: a sparse file is not refused", error is None, 0)
                    report.figure(f"{what}: it is not ready", not client.info().ready, 0)


def descriptors(report):
    """Small frames that are held leave descriptors for others."""
    few = 256
    with (
        served.served(under=served.few_descriptors(few)) as daemon,
        hg.connect(daemon.socket) as client,
    ):
        scene = common.stage(client, 128, 128)
        held = [scene.render("cam", planes=["depth"], labels=False)["depth"] for _ in range(300)]
        report.figure("held frames: descriptors", daemon.descriptors(), few - 32, slack=False)
        with hg.connect(daemon.socket) as other:
            report.figure("held frames: a client is not served", not other.info().ready, 0)
        report.figure("held frames: lost", 300 - len(held), 0)


def main():
    with common.Report("one ledger") as report:
        for part in (
            takes_sessions,
            takes_scenes,
            takes_jobs,
            takes_bytes,
            takes_channels,
            in_order,
            kept,
            waiting,
            memory,
            descriptors,
        ):
            part(report)


if __name__ == "__main__":
    main()
