"""Every number, enum and message of the contract, made wrong in a valid request: refused by its
path, with the scene at its revision. Rows come from the descriptors, so that a new field is one."""

import struct

import pytest
from conftest import Client, detail
from google.protobuf.descriptor import FieldDescriptor as Field
from heliograph.v1 import scene_pb2, types_pb2
from heliograph.v1 import service_pb2 as service
from test_edits import array, f32, named, refused, triangle
from test_render import render, request, setup

NUMBERS = {Field.TYPE_FLOAT, Field.TYPE_DOUBLE}
FLOAT_ARRAYS = {types_pb2.D_TYPE_F32: "f", types_pb2.D_TYPE_F64: "d"}
EYE = (1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1)


def f64(shape: tuple, *values) -> types_pb2.Array:
    return array(types_pb2.D_TYPE_F64, shape, "d", *values)


def vec3(x: float, y: float, z: float) -> types_pb2.Vec3:
    return types_pb2.Vec3(x=x, y=y, z=z)


def use(name: str) -> scene_pb2.TextureUse:
    return scene_pb2.TextureUse(
        texture=named(name), scale=1, offset=0, uv_transform=f32((2, 3), 1, 0, 0, 0, 1, 0)
    )


def full_mesh() -> scene_pb2.Mesh:
    """A triangle that has one of everything."""
    mesh = scene_pb2.Mesh()
    mesh.CopyFrom(triangle("full").mesh)
    mesh.positions.CopyFrom(f32((1, 3, 3), -1, -1, 0, 1, -1, 0, 0, 1, 0))
    mesh.times.CopyFrom(f64((1,), 0))
    mesh.normals.CopyFrom(f32((1, 3, 3), *[0, 0, 1] * 3))
    mesh.colors.CopyFrom(f32((3, 3), *[1] * 9))
    mesh.tangents.CopyFrom(f32((3, 4), *[1, 0, 0, 1] * 3))
    mesh.joints.CopyFrom(array(types_pb2.D_TYPE_U16, (3, 4), "H", *[0] * 12))
    mesh.weights.CopyFrom(f32((3, 4), *[1, 0, 0, 0] * 3))
    for name in ("morph_positions", "morph_normals"):
        getattr(mesh, name).CopyFrom(f32((1, 3, 3), *[0] * 9))
    for name in ("uvs", "uvs1"):
        getattr(mesh, name).CopyFrom(f32((3, 2), *[0] * 6))
    mesh.keypoints.add(name="tip", position=vec3(0, 0, 0))
    mesh.symmetries.add(axis=vec3(0, 0, 1), offset=vec3(0, 0, 0))
    mesh.symmetries.add(matrix=f32((4, 4), *EYE))
    return mesh


def full_material() -> scene_pb2.Material:
    material = scene_pb2.Material(
        normal_map=use("dots"), alpha_cutoff=0.5, alpha_mode=scene_pb2.Material.ALPHA_MODE_MASK
    )
    for field in material.DESCRIPTOR.fields:
        if field.message_type is scene_pb2.ScalarParameter.DESCRIPTOR:
            getattr(material, field.name).value = 1 if field.name.endswith("ior") else 0
            getattr(material, field.name).texture.CopyFrom(use("dots"))
        elif field.message_type is scene_pb2.ColorParameter.DESCRIPTOR:
            getattr(material, field.name).value.CopyFrom(vec3(1, 1, 1))
            getattr(material, field.name).texture.CopyFrom(use("dots"))
    return material


def full_entity() -> scene_pb2.Entity:
    out = scene_pb2.Entity(
        pose=types_pb2.Pose(matrices=f32((1, 4, 4), *EYE), times=f64((1,), 0)),
        mesh=named("full"),
        light=scene_pb2.Light(
            color=vec3(1, 1, 1),
            intensity=1,
            exposure=0,
            temperature=6500,
            unit=scene_pb2.Light.UNIT_RADIANCE,
            texture=use("dots"),
        ),
        camera=scene_pb2.Camera(
            width=8,
            height=8,
            fx=8,
            fy=8,
            cx=4,
            cy=4,
            projection=scene_pb2.Camera.PROJECTION_PERSPECTIVE,
            aperture=0.1,
            focus_distance=1,
            blades=5,
            blade_rotation=0,
            near=0.1,
            far=100,
        ),
        skin=scene_pb2.Skin(joints=[named("thing")], inverse_binds=f32((1, 4, 4), *EYE)),
        visibility=scene_pb2.Visibility(camera=True),
        label=scene_pb2.Label(auto=True),
        materials=scene_pb2.Materials(parts=[named("glow")]),
    )
    out.morph_weights.weights.CopyFrom(f32((1, 1), 0))
    out.morph_weights.times.CopyFrom(f64((1,), 0))
    return out


def light(**fields) -> scene_pb2.Entity:
    return scene_pb2.Entity(light=scene_pb2.Light(color=vec3(1, 1, 1), intensity=1, **fields))


def full_lights() -> dict[str, scene_pb2.Entity]:
    """One of each kind with all that it may have, and a window."""
    kinds = scene_pb2.Light
    return {
        "luminaire": light(
            unit=kinds.UNIT_PROFILE_SCALE,
            exposure=0,
            temperature=0,
            two_sided=True,
            texture=use("dots"),
            shape=kinds.SHAPE_DISC,
            radius=1,
            profile=named("dots"),
        ),
        "spot": light(
            unit=kinds.UNIT_CANDELA,
            shape=kinds.SHAPE_RECTANGLE,
            width=1,
            height=1,
            inner_cone_angle=0.25,
            outer_cone_angle=0.5,
        ),
        "sun": light(unit=kinds.UNIT_ILLUMINANCE, sun_angle=0.01),
        "window": scene_pb2.Entity(portal=scene_pb2.Portal(width=1, height=1)),
    }


def dots() -> scene_pb2.Edit:
    texels = f32((2, 2, 3), *[0] * 12)
    sampler = dict(
        encoding=scene_pb2.Texture.ENCODING_LINEAR,
        filter=scene_pb2.Texture.FILTER_LINEAR,
        wrap_u=scene_pb2.Texture.WRAP_CLAMP,
        wrap_v=scene_pb2.Texture.WRAP_CLAMP,
    )
    return scene_pb2.Edit(target=named("dots"), texture=scene_pb2.Texture(texels=texels, **sampler))


def edits() -> list[scene_pb2.Edit]:
    """One of each action that carries numbers."""
    dome = scene_pb2.Dome(
        texture=named("dots"),
        color=vec3(1, 1, 1),
        intensity=1,
        rotation=f32((3, 3), 1, 0, 0, 0, 1, 0, 0, 0, 1),
    )
    instances = scene_pb2.Instances(
        prototype=scene_pb2.Entity(mesh=named("mesh")), matrices=f32((1, 4, 4), *EYE)
    )
    return [
        dots(),
        scene_pb2.Edit(target=named("full"), mesh=full_mesh()),
        scene_pb2.Edit(target=named("matter"), material=full_material()),
        scene_pb2.Edit(target=named("whole"), entity=full_entity()),
        *(scene_pb2.Edit(target=named(n), entity=e) for n, e in full_lights().items()),
        scene_pb2.Edit(target=named("many"), instances=instances),
        scene_pb2.Edit(settings=scene_pb2.Settings(time=0, dome=dome)),
        scene_pb2.Edit(advance=scene_pb2.Advance(dt=1)),
    ]


def transaction() -> service.ApplyRequest:
    out = service.ApplyRequest()
    out.transaction.edits.extend(edits())
    return out


def rendering():
    out = request(
        0,
        "BEAUTY",
        "FLOW_FORWARD",
        spp=1,
        seconds=1,
        noise=0.1,
        time=0,
        clamp=1e9,
        frame_interval=0.1,
        hold=True,
    )
    out.filter = 1
    out.labels.MergeFrom(type(out.labels)(boxes=True, canvas=1, keypoint_radius=0.1))
    out.overlay.edits.add().advance.dt = 1
    return out


def queries() -> list[service.QueryRequest]:
    point = f32((1, 3), 0, 0, 1)
    things = [named("thing")]
    return [
        service.QueryRequest(cast_rays=service.CastRays(origins=point, directions=point, t_max=9)),
        service.QueryRequest(pick=service.Pick(camera=named("cam"), pixels=f32((1, 2), 0, 0))),
        service.QueryRequest(visible=service.Visible(camera=named("cam"), entities=things), time=0),
        service.QueryRequest(overlaps=service.Overlaps(a=things, b=things)),
        service.QueryRequest(sample_surface=service.SampleSurface(entities=things, count=1)),
    ]


def places(message, steps=()):
    """Every message set beneath one, as the steps that lead to it: (field, index or None)."""
    yield steps
    for field, value in message.ListFields():
        if field.message_type is None or field.message_type.GetOptions().map_entry:
            continue
        if field.is_repeated if hasattr(field, "is_repeated") else field.label == 3:
            for index, element in enumerate(value):
                yield from places(element, (*steps, (field.name, index)))
        else:
            yield from places(value, (*steps, (field.name, None)))


def at(message, steps):
    for name, index in steps:
        message = getattr(message, name)
        message = message if index is None else message[index]
    return message


def path_of(steps) -> str:
    names = [name if index is None else f"{name}[{index}]" for name, index in steps]
    return ".".join(names).removeprefix("transaction").removeprefix(".")


def spoiled_array(value: float):
    def spoil(message: types_pb2.Array):
        one = struct.pack("<" + FLOAT_ARRAYS[message.dtype], value)
        message.inline = message.inline[: -len(one)] + one

    return spoil


def faults(message):
    """(what, path, code, spoil, steps): each fault that can be put into a message."""
    for steps in places(message):
        path, found = path_of(steps), at(message, steps)
        yield (
            "field 1999",
            path,
            "UNIMPLEMENTED",
            lambda m: m.MergeFromString(b"\xf8\x7c\x01"),
            steps,
        )
        if isinstance(found, types_pb2.Array) and found.dtype in FLOAT_ARRAYS:
            for x in ("nan", "inf"):
                yield x, path, "INVALID_ARGUMENT", spoiled_array(float(x)), steps
        for field, _ in found.ListFields():
            inner = f"{path}.{field.name}".lstrip(".")
            if field.type in NUMBERS:
                for x in ("nan", "inf"):
                    yield (
                        x,
                        inner,
                        "INVALID_ARGUMENT",
                        lambda m, n=field.name, x=float(x): setattr(m, n, x),
                        steps,
                    )
            elif field.type == Field.TYPE_ENUM:
                yield (
                    "999",
                    inner,
                    "UNIMPLEMENTED",
                    lambda m, n=field.name: setattr(m, n, 999),
                    steps,
                )


def tracks() -> list[service.TracksRequest]:
    def integers(*values: int) -> types_pb2.Array:
        return array(types_pb2.D_TYPE_U32, (len(values),), "I", *values)

    common = {"camera": named("cam"), "entities": [named("thing")], "times": f64((2,), 1, 0)}
    on_triangles = {"primitive": integers(0, 0), "barycentric": f32((2, 2), 0, 1, 0.5, 0.5)}
    return [
        service.TracksRequest(**common, **on_triangles, entity=integers(0, 0)),
        service.TracksRequest(**common, vertices=integers(0, 2)),
    ]


REQUESTS = {
    "Apply": [transaction()],
    "Render": [rendering()],
    "Query": queries(),
    "Tracks": tracks(),
}
ROWS = {
    f"{method} {path} {what}": (method, message, path, code, spoil, steps)
    for method, messages in REQUESTS.items()
    for message in messages
    for what, path, code, spoil, steps in faults(message)
}


def send(client, scene, method, message):
    message.scene = scene
    if method == "Render":
        return render(client, message)
    if method == "Apply":
        client.numbers[scene] = message.number = client.numbers.get(scene, 0) + 1
    return client.call(method, message)


@pytest.fixture(scope="module")
def furnished(daemon):
    client = Client(daemon)
    yield client, setup(client)
    client.close()


@pytest.mark.parametrize("method", REQUESTS)
def test_the_requests_are_good_as_they_are(client, method):
    for message in REQUESTS[method]:
        good = type(message)()
        good.CopyFrom(message)
        send(client, setup(client), method, good)


@pytest.mark.parametrize("row", ROWS)
def test_a_fault_is_refused_by_its_path(furnished, row):
    (client, scene), (method, message, path, code, spoil, steps) = furnished, ROWS[row]
    bad = type(message)()
    bad.CopyFrom(message)
    spoil(at(bad, steps))
    error = refused(lambda: send(client, scene, method, bad))
    assert error.code().name == code, error.details()
    assert detail(error).field.startswith(path), (detail(error).field, error.details())
    assert client.revision(scene) == 1


@pytest.mark.parametrize("name", ["vertices", "times"])
def test_what_is_followed_is_counted_before_it_is_read(furnished, name):
    client, scene = furnished
    huge = service.TracksRequest()
    huge.CopyFrom(tracks()[1])
    getattr(huge, name).shape[0] = 1 << 40
    error = refused(lambda: send(client, scene, "Tracks", huge))
    assert error.code().name == "RESOURCE_EXHAUSTED", error.details()
    assert detail(error).field == "times" and "ask in parts" in error.details()


def test_the_next_request_works(furnished):
    client, scene = furnished
    assert len(render(client, request(scene, "DEPTH"))) == 1
