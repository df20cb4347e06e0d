"""S4: mutants of every call, as the contract's descriptors name them: NaN, infinity, negative and
huge numbers, dangling ids, cycles, unknown fields, messages cut short. The daemon lives, each
refusal names the field where the request was wrong, and the next request is answered as before."""

import collections
import concurrent.futures
import contextlib
import itertools
import pathlib
import re
import sys
import tempfile
import time

import common
import grpc
import heliograph as hg
import mutants
from google.protobuf import message_factory
from google.protobuf.internal import encoder
from heliograph._wire import status as _status
from heliograph._wire._proto import service_pb2
from heliograph._wire.quick import QUICK_BYTES

MODEL = pathlib.Path(__file__).parents[1] / "assets/gltf/simple-instancing.glb"
LIMITS = {
    "samples": 16,
    "frame_bytes": 4 << 20,
    "array_bytes": 64 << 20,
    "entities": 20_000,
    "query_items": 4096,
    "blob_store_bytes": 64 << 20,
    "scenes": 200,
    "stall_seconds": 2,
}
BROKEN = {"INTERNAL", "UNKNOWN", "UNAVAILABLE", "DATA_LOSS"}
# Statuses of a wrong request; they must name the field.
PLACED = {"INVALID_ARGUMENT", "NOT_FOUND", "ALREADY_EXISTS"}
SECONDS = 2.0  # of one call
WORKERS = 3
_QUICK = {  # by method
    field.message_type.name.removesuffix("Request"): field
    for field in service_pb2.QuickCall.DESCRIPTOR.oneofs_by_name["call"].fields
}
_VARINT = encoder._VarintBytes


def known_path(descriptor, path):
    """True if a path names a field beneath a message; of an array's element, the array."""
    for step in re.sub(r"\[[^]]*\]", "", path).split("."):
        if descriptor is None or step in descriptor.oneofs_by_name:
            return descriptor is not None
        if step not in descriptor.fields_by_name:
            return False
        descriptor = descriptor.fields_by_name[step].message_type
    return True


def is_placed(message, path):
    """True if `path` names something of a request; of a transaction, it starts at its edits; of a
    bundle it may be a file's name; of an empty message there is nothing to name."""
    descriptor = message.DESCRIPTOR
    if not path:
        return not message.ListFields()
    if any(path in getattr(f, "path", "") for f in getattr(message, "files", ())):
        return True
    inner = [descriptor.fields_by_name.get(name) for name in ("transaction", "header")]
    return any(
        known_path(each, path)
        for each in (descriptor, *(f.message_type for f in inner if f and f.message_type))
    )


def weight(method):
    """How often a call comes: the more kinds of messages it is made of, the more often."""
    found, waiting = set(), [method.input_type]
    while waiting:
        each = waiting.pop()
        if each.full_name not in found:
            found.add(each.full_name)
            waiting += [f.message_type for f in each.fields if f.message_type is not None]
    return 1 + len(found) // 6


def refusals(kind, data):
    """Status in a reply of a stream: of an edit, or of an item of a batch."""
    if "status" not in kind.fields_by_name:
        return []
    reply = message_factory.GetMessageClass(kind).FromString(data)
    if not reply.status.code:
        return []
    return [(_status._CODES[reply.status.code], _status.status_error(reply.status))]


class Worker:
    """A session that sends mutants, and its scene."""

    def __init__(self, client, seeds, control, known):
        self.address, self.seeds, self.control = client.address, seeds, control
        self.names, self.ids = known
        self.session = None

    def open(self):
        self.session = hg.connect(self.address)
        self.link = self.session.connection.link
        tour = self.session.open_scene("tour")
        self.tour, self.branch = tour.id, tour.branch()
        self.scene, self.number = self.branch.id, 0

    def aim(self, message):
        """Mutants go to the worker's own scene, mostly in the order of its edits, or to none."""
        for field, value in message.ListFields():
            if field.message_type is not None and not mutants.is_map(field):
                for each in value if mutants.is_repeated(field) else [value]:
                    self.aim(each)
        fields = message.DESCRIPTOR.fields_by_name
        if "scene" in fields and (message.scene < 1 << 40 or self.mutator.chance(0.5)):
            message.scene = self.scene
        if "number" in fields and self.mutator.chance(0.9):
            message.number = self.number + 1

    def requests(self, method):
        """Messages of one call, as bytes and as they are."""
        kind = message_factory.GetMessageClass(method.input_type)
        seeds = self.seeds.get(method.input_type.full_name, [])
        made = self.mutator.mutants(kind, seeds, 4 if method.client_streaming else 1)
        for message in made:
            self.aim(message)
        data = [message.SerializeToString() for message in made]
        if self.mutator.chance(0.05):
            data[0] = self.mutator.spoil(data[0])
        return data, made

    def call(self, method, data):
        """(status name, typed error) of each answer: of the call, and of replies that hold one."""
        kind = ("stream" if method.client_streaming else "unary") + (
            "_stream" if method.server_streaming else "_unary"
        )
        path = f"/{method.containing_service.full_name}/{method.name}"
        stub = getattr(self.link.channel, kind)(path)
        given = iter(data) if method.client_streaming else data[0]
        is_endless = method.name in ("KeepSession", "Watch")
        seconds = 0.05 if is_endless else SECONDS
        answers = []
        try:
            reply = stub(given, metadata=self.link.metadata, timeout=seconds)
            if method.output_type.name == "SceneInfo":
                self.delete(service_pb2.SceneInfo.FromString(reply).scene)
            if method.server_streaming:
                for one in itertools.islice(reply, 2000):
                    answers += refusals(method.output_type, one)
                reply.cancel()
        except grpc.RpcError as error:
            return [*answers, (error.code().name, _status.to_error(error))]
        return [*answers, ("OK", None)]

    def ask_quickly(self, method, data):
        """The same of a quick call; None: it has none, or no room. What is no message closes the
        socket, what takes too long does here."""
        field = _QUICK.get(method.name)
        packet = field and encoder.TagBytes(field.number, 2) + _VARINT(len(data)) + data
        if not packet or len(packet) > QUICK_BYTES:
            return None
        line = self.link.quick
        (line._socket or line._open()).settimeout(SECONDS)
        reply = line._exchange(packet, None)
        if reply is None:
            return [("CLOSED", None)]
        name = _status._CODES[reply.status.code]
        error = _status.status_error(reply.status)
        return [(name, error if reply.status.code else None)]

    def delete(self, scene):
        """Deletes a mutant's scene, unless another did; keeps the tour, which others need."""
        if scene != self.tour:
            request = service_pb2.DeleteSceneRequest(scene=scene)
            with contextlib.suppress(hg.NotFound):
                self.session.connection.call("DeleteScene", request)

    def renew(self):
        """Another session when a mutant has closed it, another scene when one has deleted it."""
        try:
            request = service_pb2.DescribeSceneRequest(scene=self.scene)
            described = self.session.connection.call("DescribeScene", request)
            self.number = described.scene.next_edit - 1
        except (hg.Unauthenticated, hg.PermissionDenied, hg.NotFound):
            self.session.close()
            self.open()

    def run(self, methods, count, seed):
        """Counts of outcomes: (method, status) -> how often, and the faults."""
        self.mutator = mutants.Mutator(seed, self.seeds, self.names, self.ids)
        self.open()
        seen, faults = collections.Counter(), []
        for trial in range(count):
            method = methods[trial % len(methods)]
            self.renew()
            data, messages = self.requests(method)
            quick = self.ask_quickly(method, data[0]) if self.mutator.chance(0.5) else None
            for status, error in quick or self.call(method, data):
                seen[method.name + (" quick" if quick else ""), status] += 1
                unplaced = status in PLACED and not any(is_placed(m, error.field) for m in messages)
                if status in BROKEN or unplaced:
                    shown = "\n".join(str(message) for message in messages)[:1500]
                    faults.append((method.name, status, error.field, str(error), shown))
            if trial % 100 == 99:
                self.control.check()
        self.session.close()
        return seen, faults


class Control:
    """A scene that no mutant means; its picture stays the same."""

    def __init__(self, client):
        self.scene = common.stage(hg.connect(client.address), 32, 24)
        self.first = self.picture()
        self.wrong = 0

    def picture(self):
        frame = self.scene.render("cam", planes=["beauty", "instance"], spp=2)
        return frame["beauty"].tobytes() + frame["instance"].tobytes()

    def check(self):
        self.wrong += self.picture() != self.first


def show(seen, faults):
    methods = sorted({name for name, _ in seen})
    for method in methods:
        row = {status: n for (name, status), n in sorted(seen.items()) if name == method}
        print(f"    {method:14} " + "  ".join(f"{k} {v}" for k, v in row.items()))
    for method, status, where, text, message in faults[:20]:
        print(f"  FAULT {method} {status} field {where!r}: {text}\n{message}\n", file=sys.stderr)


def main():
    count, start = common.size(100_000, 2_000), time.time()
    service = service_pb2.DESCRIPTOR.services_by_name["Renderer"]
    methods = [m for m in service.methods for _ in range(weight(m))]
    seeds = mutants.record()
    with common.Report("S4 malformed requests") as report, common.daemon(**LIMITS) as client:
        with tempfile.TemporaryDirectory() as folder:
            scene, *known = mutants.tour(client, MODEL, pathlib.Path(folder))
        lacking = {m.name for m in methods if m.input_type.full_name not in seeds}
        print(f"  without a seed: {', '.join(sorted(lacking))}")
        report.figure("calls without a seed that have one", len(lacking & {"Apply", "Render"}), 0)
        control, before = Control(client), common.resident(common.pid_of(client))
        with concurrent.futures.ThreadPoolExecutor(WORKERS) as pool:
            seeds = {name: list(listed) for name, listed in seeds.items()}
            share = count // WORKERS
            found = list(
                pool.map(
                    lambda seed: Worker(client, seeds, control, known).run(methods, share, seed),
                    range(WORKERS),
                )
            )
        seen = sum((each for each, _ in found), collections.Counter())
        faults = [fault for _, each in found for fault in each]
        show(seen, faults)
        print(f"  {sum(seen.values()) / (time.time() - start):.0f} mutants a second")
        broken = [fault for fault in faults if fault[1] in BROKEN]
        report.figure("answered INTERNAL or not at all", len(broken), 0, slack=False)
        report.figure("wrong, but not told where", len(faults) - len(broken), 0, slack=False)
        died = client.connection.daemon.exit_code() is not None
        report.figure("crashes", died, 0, slack=False)
        control.check()
        report.figure("requests in between that were not as before", control.wrong, 0)
        grown = (common.resident(common.pid_of(client)) - before) / 1e6
        report.figure("growth of the daemon's memory", grown, 300, "MB", slack=False)


if __name__ == "__main__":
    main()
