"""Structured mutants of requests, driven by the contract's descriptors, so that a new call or field
is among them without a change here. Used by fuzz_rpc.py."""

import heliograph as hg
import numpy as np
from google.protobuf import message_factory
from google.protobuf.descriptor import FieldDescriptor as Field
from heliograph._wire import link
from heliograph._wire.quick import FastPathConnection

NUMBERS = [0, -0.0, 1, -1, 0.5, 2, 1e-30, 1e30, 1e300, -1e300, np.inf, -np.inf, np.nan]
INTEGERS = [0, 1, 2, 3, 255, 65536, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1]
TEXTS = ["", "*", "../x", "/etc/passwd", "a\0b", "x" * 5000, "\u202e", "file:x", "lossless"]
RANGES = {
    Field.TYPE_INT32: (-(2**31), 2**31 - 1),
    Field.TYPE_SINT32: (-(2**31), 2**31 - 1),
    Field.TYPE_UINT32: (0, 2**32 - 1),
    Field.TYPE_INT64: (-(2**63), 2**63 - 1),
    Field.TYPE_UINT64: (0, 2**64 - 1),
}


def record():
    """Every request that this process's clients send from now on: input type -> list of bytes."""
    seeds = {}

    def serialize(message):
        data = bytes(message.SerializeToString())
        listed = seeds.setdefault(message.DESCRIPTOR.full_name, [])
        if data not in listed and len(data) < 100_000:
            listed.append(data)
        return data

    def ask(line, call, *arguments):
        serialize(getattr(call, call.WhichOneof("call")))
        return ask_quickly(line, call, *arguments)

    ask_quickly, FastPathConnection.ask = FastPathConnection.ask, ask
    link._serialize = serialize
    return seeds


def is_repeated(field):
    return field.is_repeated if hasattr(field, "is_repeated") else field.label == 3


def is_map(field):
    return field.message_type is not None and field.message_type.GetOptions().map_entry


class Mutator:
    """Changes messages. `names` and `ids` are what references may hit."""

    def __init__(self, seed, seeds, names, ids):
        self.dice = np.random.default_rng(seed)
        self.names, self.ids = names, ids
        self.parts = {}  # full name of a message type -> messages seen in the seeds
        for full_name, listed in seeds.items():
            kind = message_factory.GetMessageClass(_descriptor(full_name))
            for data in listed:
                self._collect(kind.FromString(data))

    def _collect(self, message):
        listed = self.parts.setdefault(message.DESCRIPTOR.full_name, [])
        if len(listed) < 200:
            listed.append(message)
        for field, value in message.ListFields():
            if field.message_type is not None and not is_map(field):
                for each in value if is_repeated(field) else [value]:
                    self._collect(each)

    def pick(self, listed):
        return listed[self.dice.integers(len(listed))]

    def chance(self, share):
        return self.dice.random() < share

    def bytes(self):
        return self.dice.bytes(int(self.dice.integers(0, 65)))

    def scalar(self, field, old=None):
        kind = field.type
        if kind in (Field.TYPE_FLOAT, Field.TYPE_DOUBLE):
            return float(self.pick(NUMBERS))
        if kind == Field.TYPE_BOOL:
            return self.chance(0.5)
        if kind == Field.TYPE_ENUM:
            return int(self.dice.integers(0, 1000 if self.chance(0.1) else 12))
        if kind == Field.TYPE_STRING:
            return str(self.pick(self.names if self.chance(0.6) else TEXTS))
        if kind == Field.TYPE_BYTES:
            if old and self.chance(0.7):
                data = bytearray(old)
                data[self.dice.integers(len(data))] = self.dice.integers(256)
                return bytes(data[: len(data) - int(self.chance(0.3))])
            return self.bytes()
        low, high = RANGES[kind]
        if field.name == "id" and self.chance(0.6):
            return int(self.pick(self.ids))
        return min(max(int(self.pick(INTEGERS)), low), high)

    def mutate(self, message, depth=0):
        """Changes, adds, repeats or takes away one thing somewhere beneath."""
        descriptor = message.DESCRIPTOR
        present = [field for field, _ in message.ListFields()]
        if self.chance(0.02):
            return message.MergeFromString(b"\xf8\x7c\x01")  # field 1999
        if not descriptor.fields:
            return None
        field = self.pick(descriptor.fields)
        if present and self.chance(0.75):
            field = self.pick(present)
        if self.chance(0.06):
            return message.ClearField(field.name)
        if is_map(field):
            return self._map(message, field)
        if is_repeated(field):
            return self._repeated(getattr(message, field.name), field, depth)
        if field.message_type is None:
            old = getattr(message, field.name) if field.type == Field.TYPE_BYTES else None
            return setattr(message, field.name, self.scalar(field, old))
        inner = getattr(message, field.name)
        inner.SetInParent()
        known = self.parts.get(field.message_type.full_name)
        if known and self.chance(0.15):
            return inner.CopyFrom(self.pick(known))
        return self.mutate(inner, depth + 1) if depth < 12 else None

    def _map(self, message, field):
        key = field.message_type.fields_by_name["key"]
        value = field.message_type.fields_by_name["value"]
        entries = getattr(message, field.name)
        if value.message_type is None:
            entries[self.scalar(key)] = self.scalar(value)
        else:
            self.mutate(entries[self.scalar(key)])

    def _repeated(self, listed, field, depth):
        if field.message_type is None:
            if listed and self.chance(0.7):
                at = int(self.dice.integers(len(listed)))
                listed[at] = self.scalar(field)
            else:
                listed.append(self.scalar(field))
            return
        known = self.parts.get(field.message_type.full_name)
        if known and self.chance(0.2):
            listed.add().CopyFrom(self.pick(known))
        elif listed and self.chance(0.15):
            del listed[int(self.dice.integers(len(listed)))]
        elif listed and self.chance(0.1):
            one = type(listed[0]).FromString(self.pick(listed).SerializeToString())
            listed.extend([one] * int(self.pick([1, 2, 100])))
        elif not listed:
            self.mutate(listed.add(), depth + 1)
        else:
            self.mutate(self.pick(listed), depth + 1)

    def mutants(self, kind, seeds, most):
        """One to `most` requests of a message class: seeds that followed each other, or nothing;
        one of them, or more, changed in one to four places."""
        first = int(self.dice.integers(len(seeds) + 1))
        chosen = seeds[first : first + int(self.dice.integers(1, most + 1))] or [b""]
        made = [kind.FromString(data) for data in chosen]
        changed = int(self.dice.integers(len(made)))
        for i, message in enumerate(made):
            self.thin(message)
            for _ in range(int(self.dice.integers(1, 5))):
                if i == changed or self.chance(0.2):
                    self.mutate(message)
        return made

    def thin(self, message):
        """Sometimes leaves three edits of many, so that a mutant's own is reached."""
        listed = getattr(getattr(message, "transaction", None), "edits", ())
        if len(listed) > 3 and self.chance(0.7):
            kept = sorted(self.dice.choice(len(listed), 3, replace=False))
            few = [type(listed[0]).FromString(listed[i].SerializeToString()) for i in kept]
            del listed[:]
            listed.extend(few)

    def spoil(self, data):
        """The bytes of a message, one of them changed or the end gone."""
        out = bytearray(data)
        if out:
            out[self.dice.integers(len(out))] = self.dice.integers(256)
            out = out[: self.dice.integers(len(out)) + 1] if self.chance(0.3) else out
        return bytes(out)


def _descriptor(full_name):
    return link.service.DESCRIPTOR.pool.FindMessageTypeByName(full_name)


def furnish(scene, model):
    """One of each thing that an edit can make, so that each field is in some seed."""
    eyes = np.tile(np.eye(4), (3, 1, 1))
    ball = hg.shapes.sphere(0.5, 8)
    count = len(ball["positions"])
    shift = np.zeros((1, count, 3), "f4")
    joints, weights = np.zeros((count, 4), "u2"), np.tile([1.0, 0, 0, 0], (count, 1))
    with scene.edit() as edit:
        edit.sample_studio()
        edit.import_file(model, name="model", transform=hg.Pose((2, 0, 0)))
    with scene.edit() as edit:
        edit.categories("ball", "box")
        edit.mesh("mesh", **ball, keypoints={"tip": (0, 0, 0.5)})
        edit.mesh("soft", **ball, morph_positions=shift, joints=joints, weights=weights)
        edit.texture("dots", np.zeros((4, 4, 3), "u1"), wrap="clamp", filter="nearest")
        dots = hg.Tex("dots", factor=0.5)
        edit.material("paint", base_color=hg.Tex("dots"), roughness=dots, normal_map="dots")
        edit.material("glass", transmission=1, ior=1.5, clearcoat=0.5)
        edit.volume("smoke", density=np.ones((2, 2, 2), "f4"), voxel_size=0.2)
        edit.entity("bone", transform=hg.Pose((0, 0, 1)))
        edit.entity("ball", mesh="mesh", material="paint", category="ball", attributes={"a": "b"})
        keys = {0.0: np.eye(4), 1.0: hg.Pose((1, 0, 0))}
        edit.entity("child", parent="ball", keys=keys, mesh="mesh", materials=["glass"], part=2)
        binds = np.eye(4)[None]
        edit.entity("soft/0", mesh="soft", skin=(["bone"], binds), morph_weights={0.0: [0.0]})
        edit.entity("cloud", volume="smoke", transform=hg.Pose((0, 1, 1)))
        lamp = hg.Light(lumen=300, shape="rectangle", width=0.5, height=0.25)
        edit.entity("lamp", light=lamp, light_group="lamp", transform=hg.Pose((0, 0, 2)))
        edit.entity("window", portal=hg.Portal(1, 1), visibility=hg.Visibility(camera=False))
        edit.instances("many", transforms=eyes, mesh="mesh", label="auto")
        lens = hg.Camera.from_fov(50, 32, 24, degrees=True, aperture=0.01, focus_distance=3)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 1), (0, 0, 0.5)))
    with scene.edit() as edit:
        edit.advance(0.1)
        edit.update("ball", transform=hg.Pose((0.1, 0, 0)))
        edit.set_transforms(["many/0", "many/1"], eyes[:2])
        edit.prune()
    with scene.edit() as edit:
        edit.remove("many/2")


def tour(client, model, folder):
    """Every call of the Python client: its requests are the seeds. Gives the names of objects and
    their ids."""
    scene = client.create_scene("tour", lifetime="daemon")
    furnish(scene, model)
    with scene.overlay() as overlay:
        overlay.entity("ball", visible=False)
    scene.render(["cam", "cam"], planes=["beauty", "depth", "flow_backward"], spp=1, hold=True)
    many = {"seed": 1, "noise": 0.5, "size": (16, 12), "time": 0, "adaptive": True, "clamp": 10}
    scene.render("cam", overlay=overlay, labels=["amodal", "keypoints"], **many)
    list(scene.render_batch([hg.Job("cam", spp=1, overlay=overlay), hg.Job("cam", spp=1)]))
    with scene.stream("cam", spp=1, policy="lossless") as live:
        next(live)
        live.update(overlay=overlay)
    with scene.watch(1, bookmark_seconds=1) as watch:
        next(watch)
    hits = scene.cast_rays([[0.05, 0.02, 1.5]], [[0, 0.01, -1]])
    scene.pick("cam", [[16, 12]])
    scene.visible("cam", ["ball"])
    scene.overlaps(["ball"], ["child"])
    scene.sample_surface(["ball"], 3)
    scene.tracks("cam", hits, [0.0, 0.1])
    found = scene["ball"].world_transform, scene["cam"].camera, scene["mesh"].positions
    assert len(found) == 3 and scene.memory() and scene.tree() and client.scenes()
    with scene.branch() as branch:
        branch.save(folder / "x.helio")
    client.load_scene(folder / "x.helio").delete()
    client.open_scene("tour")
    handles = scene.find("*")
    return scene, [str(handle.name) for handle in handles], [handle.id for handle in handles]
