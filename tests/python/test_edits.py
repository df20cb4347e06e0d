"""Edits on the wire, and their replies."""

import pickle
import threading

import grpc
import heliograph as hg
import numpy as np
import pytest
from heliograph._wire._proto import scene_pb2
from heliograph._wire.arrays import from_message
from statuses import status


def last(daemon):
    return daemon.transactions[-1].edits


def test_one_block_is_one_transaction(daemon, scene):
    with scene.edit() as edit:
        mesh = edit.mesh("m", **hg.shapes.cube())
        steel = edit.material("steel", **hg.materials.steel)
        bolt = edit.entity("bolt", mesh=mesh, material=steel, label="auto", category="bolt")
        assert daemon.transactions == []
    assert len(daemon.transactions) == 1
    assert [e.WhichOneof("action") for e in last(daemon)] == ["mesh", "material", "entity"]
    entity = last(daemon)[2].entity
    assert entity.mesh.created_by_edit == 0 and entity.materials.parts[0].created_by_edit == 1
    assert entity.label.auto and entity.label.category == "bolt"
    assert bolt.id == daemon.objects["bolt"] and mesh.id >> 56 == 2


def test_an_exception_drops_the_transaction(daemon, scene):
    with pytest.raises(RuntimeError), scene.edit() as edit:
        edit.entity("a")
        raise RuntimeError
    assert daemon.transactions == []


def test_an_edit_after_the_block_is_refused(scene):
    with scene.edit() as edit:
        edit.entity("a")
    with pytest.raises(hg.FailedPrecondition, match="open another"):
        edit.entity("b")


def test_handles_and_names_are_interchangeable(daemon, scene):
    with scene.edit() as edit:
        a = edit.entity("a")
    with scene.edit() as edit:
        edit.entity("b", parent=a)
        edit.entity("c", parent="a")
        edit.update(a, visible=False)
    b, c, update = last(daemon)
    assert b.entity.parent.id == a.id and c.entity.parent.name == "a"
    assert update.target.id == a.id and update.mode == scene_pb2.Edit.MODE_UPDATE
    assert update.entity.visible is False and update.entity.HasField("visible")


def test_none_clears_and_absent_stays(daemon, scene):
    with scene.edit() as edit:
        edit.entity("a", parent=None, transform=None, camera=None, material=None, label=None)
    entity = last(daemon)[0].entity
    assert sorted(entity.clear) == ["camera", "label", "materials", "parent", "pose"]
    assert not entity.HasField("mesh") and not entity.HasField("label")


def test_exist_ok_false_only_creates(daemon, scene):
    with scene.edit() as edit:
        edit.entity("a", exist_ok=False)
    assert last(daemon)[0].mode == scene_pb2.Edit.MODE_CREATE


def test_poses(daemon, scene):
    turned = hg.Pose((1, 2, 3), wxyz=(np.sqrt(0.5), 0, 0, np.sqrt(0.5)), scale=2)
    same = hg.Pose((1, 2, 3), xyzw=(0, 0, np.sqrt(0.5), np.sqrt(0.5)), scale=2)
    angles = hg.Pose((1, 2, 3), euler=(0, 0, np.pi / 2), scale=2)
    want = np.array([[0, -2, 0, 1], [2, 0, 0, 2], [0, 0, 2, 3], [0, 0, 0, 1]])
    for pose in (turned, same, angles):
        assert np.allclose(pose.matrix, want)
    with scene.edit() as edit:
        edit.entity("a", transform=turned)
        edit.entity("b", keys={1.0: np.eye(4), 0.5: turned})
    a, b = (e.entity.pose for e in last(daemon))
    assert np.allclose(from_message(a.matrices), want)
    assert from_message(b.times).tolist() == [0.5, 1.0]
    assert np.allclose(from_message(b.matrices)[0], want)


def test_look_at_sees_the_point_in_the_middle():
    pose = hg.look_at((3, -2, 1), (0, 0, 0))
    local = np.linalg.inv(pose) @ (0, 0, 0, 1)
    assert np.allclose(local[:2], 0) and local[2] == pytest.approx(-np.sqrt(14))
    assert (pose[:3, :3].T @ (0, 0, 1))[1] > 0
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
    assert np.isfinite(hg.look_at((0, 0, 5), (0, 0, 0))).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda e: e.entity("a", transform=(0, 0, 0, 1)), "wxyz"),
        (lambda e: e.entity("a", transform=np.full((4, 4), np.nan)), r"transform\[0\]\[0\]"),
        (lambda e: e.entity("a", parnt=1), "did you mean parent"),
        (lambda e: e.mesh("m", positions=np.zeros((3, 2)), indices=[[0, 1, 2]]), r"\(N, 3\)"),
        (lambda e: e.mesh("m", positions=np.zeros((3, 3)), indices=[[0, 1, -2]]), "outside"),
        (lambda e: e.mesh("m", positions=np.zeros((3, 3)), indices=[[0, 1, 1.5]]), "whole"),
        (lambda e: e.material("m", roughnes=1), "did you mean roughness"),
        (lambda e: e.material("m", base_color=(1, 2)), r"\(3\)"),
        (lambda e: e.texture("t", np.zeros((4, 4, 5), "u1")), "1..4"),
        (lambda e: e.texture("t", np.zeros((4, 4), "i8")), "u8"),
        (lambda e: e.entity("a", label="seven"), "label"),
        (lambda e: e.entity("a", light=hg.Light()), "exactly one"),
        (lambda e: e.entity("a", camera=hg.Camera.from_fov(60, 64, 64)), "degrees"),
        (lambda e: e.entity("a", parent=3), "handle or a name"),
        (lambda e: e.set_transforms(["a"], np.zeros((2, 4, 4))), "2 matrices for 1"),
        (lambda e: e.entity("a", transform=(0, 0, 1)), r"write hg\.Pose\(\(0, 0, 1\)\)"),
        (lambda e: e.entity("a", transform=np.zeros(16)), r"has \(16,\); reshape it"),
        (lambda e: e.entity("a", transform=np.eye(3)), r"has \(3, 3\)$"),
        (lambda e: e.mesh("m", vertices=1), "has no 'vertices'; there are positions, "),
        (lambda e: e.categories(["a", "b"]), "categories: needs a str"),
        (lambda e: e.import_file("a.obj", units="mm"), "metres a unit, such as 0.001, not 'mm'"),
        (lambda e: e.sky(45), r"1\.5708\] radians"),
        (
            lambda e: e.entity("a", light=hg.Light(power=1, shape="disc", outer_cone_angle=45)),
            "outer_cone_angle: 45 is above pi; give radians",
        ),
    ],
)
def test_bad_input_is_refused_before_it_is_sent(daemon, scene, call, message):
    with pytest.raises(hg.InvalidArgument, match=message) as refused, scene.edit() as edit:
        call(edit)
    assert refused.value.field or "encoding" in message
    assert daemon.transactions == []


def test_material_parameters(daemon, scene):
    with scene.edit() as edit:
        image = edit.texture("t", np.zeros((2, 2, 3), "u1"), wrap="clamp", encoding="linear")
        edit.material(
            "m",
            base_color=hg.Tex(image, factor=(1, 0.5, 0.25)),
            roughness=hg.Tex("t", channel=1, scale=2),
            metallic=0.5,
            emission=None,
            normal_map=image,
            alpha_mode="mask",
        )
    texture, material = (getattr(e, e.WhichOneof("action")) for e in last(daemon))
    assert texture.wrap_u == texture.wrap_v == scene_pb2.Texture.WRAP_CLAMP
    assert material.base_color.texture.texture.created_by_edit == 0
    assert material.base_color.value.z == 0.25
    assert not material.base_color.texture.HasField("channel")
    assert material.roughness.texture.texture.name == "t"
    assert (material.roughness.value, material.roughness.texture.channel) == (1.0, 1)
    assert material.metallic.value == 0.5
    assert material.metallic.HasField("texture")  # unbinds whatever was there
    assert list(material.clear) == ["emission"]


def test_large_arrays_are_uploaded_and_assets_only_once(daemon, scene):
    positions = np.random.default_rng(0).random((200_000, 3))
    indices = np.arange(200_000 * 3, dtype="u4").reshape(-1, 3) % 200_000
    for _ in range(2):
        with scene.edit() as edit:
            edit.mesh("m", positions=positions, indices=indices)
    mesh = last(daemon)[0].mesh
    assert mesh.indices.WhichOneof("source") == "blob"
    assert daemon.blobs[mesh.indices.blob] == indices.astype("<u4").tobytes()
    assert mesh.positions.WhichOneof("source") == "upload"
    assert daemon.uploads[mesh.positions.upload] == positions.astype("<f4").tobytes()
    assert len(daemon.blobs) == 1 and len(daemon.uploads) == 2
    assert len(daemon.uploaded) == 3


def test_overlays_use_blobs_and_are_not_applied(daemon, scene):
    matrices = np.tile(np.eye(4), (20_000, 1, 1))
    with scene.overlay() as overlay:
        overlay.instances("many", transforms=matrices)
    assert daemon.transactions == []
    for _ in range(2):
        scene.render("cam", spp=1, overlay=overlay, size=(8, 8))
        sent = daemon.requests[-1].overlay.edits[0].instances.matrices
        assert sent.WhichOneof("source") == "blob"
    assert len(daemon.uploaded) == 1


def test_instances_and_their_transforms(daemon, scene):
    with scene.edit() as edit:
        bolts = edit.instances("bolt", transforms=np.tile(np.eye(4), (3, 1, 1)), category="bolt")
        edit.update(bolts[1], visible=False)
    assert [b.name for b in bolts] == ["bolt/0", "bolt/1", "bolt/2"]
    assert bolts[2].id == daemon.objects["bolt/2"]
    assert last(daemon)[1].target.name == "bolt/1"
    with scene.edit() as edit:
        edit.advance(1 / 30)
        edit.set_transforms(bolts, np.tile(2 * np.eye(4), (3, 1, 1)))
    advance, poses = last(daemon)
    assert advance.advance.dt == pytest.approx(1 / 30)
    assert from_message(poses.poses.ids).tolist() == [b.id for b in bolts]


@pytest.mark.parametrize("loss", ["UNAVAILABLE", "CANCELLED"])  # the latter by one that drains
def test_a_lost_reply_is_not_applied_twice(daemon, scene, loss):
    daemon.fail_applies, daemon.loss = 2, grpc.StatusCode[loss]
    with scene.edit() as edit:
        a = edit.entity("a")
    assert len(daemon.transactions) == 1 and a.id == daemon.objects["a"]


def test_a_refusal_for_now_does_not_say_that_nothing_was_done_before(daemon, scene):
    daemon.fail_applies, daemon.loss = 1, grpc.StatusCode.RESOURCE_EXHAUSTED
    daemon.loss_fields = {"retry_seconds": 1}  # a full daemon, to the second sending
    with pytest.raises(hg.ResourceExhausted), scene.edit() as edit:
        edit.entity("a")
    with scene.edit() as edit:
        b = edit.entity("b")
    assert len(daemon.transactions) == 2 and b.id == daemon.objects["b"]


def test_numbers_recover_from_a_gap(daemon, scene):
    with scene.edit() as edit:
        edit.entity("a")
    scene.client.state_of(scene.id).next = 40
    with scene.edit() as edit:
        edit.entity("b")
    assert len(daemon.transactions) == 2


def test_threads_are_numbered_in_one_order(daemon, scene):
    def work(name):
        for k in range(20):
            with scene.edit() as edit:
                edit.entity(f"{name}/{k}")

    threads = [threading.Thread(target=work, args=(n,)) for n in "abcd"]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(daemon.transactions) == 80 and daemon.last[1] == 80


def test_a_refusal_is_typed_and_names_the_object(daemon, scene):
    fields = {"field": "edits[1].mesh.indices[4]", "nearest": ["x", "y"], "needed": 9}
    fields |= {"limit": "edits", "used": 2, "allowed": 8, "reason": "LIMIT_EXCEEDED"}
    code = grpc.StatusCode.INVALID_ARGUMENT
    daemon.refusal = status(code, "index 9 is too large", **fields, retry_seconds=1.5)
    refusal = pytest.raises(hg.InvalidArgument, match=r"too large \[mesh 'm'\]")
    with refusal as refused, scene.edit() as edit:
        edit.entity("a")
        edit.mesh("m", **hg.shapes.cube())
    assert refused.value.field == "edits[1].mesh.indices[4]"
    assert isinstance(refused.value, ValueError)
    fields = {**fields, "available": 6, "retry_seconds": 1.5, "expected": 0, "users": []}
    assert {name: getattr(refused.value, name) for name in fields} == fields
    daemon.refusal = None
    with scene.edit() as edit:
        edit.entity("a")


def test_removal_lists_the_users(daemon, scene):
    fields = {"field": "edits[0].remove", "users": ["bolt/1", "bolt/2"]}
    daemon.refusal = status(grpc.StatusCode.FAILED_PRECONDITION, "in use", **fields)
    with pytest.raises(hg.FailedPrecondition) as refused, scene.edit() as edit:
        edit.remove("steel")
    assert refused.value.users == ["bolt/1", "bolt/2"]


def test_domes(daemon, scene):
    image = np.ones((4, 8, 3), "f4")
    with scene.edit() as edit:
        edit.dome(image, intensity=2, rotation=np.pi / 2)
        edit.dome(None)
        edit.dome(color=(1, 2, 3))
    texture, dome, off, color, removal = last(daemon)
    assert texture.target.name.startswith("dome/array-")
    assert dome.settings.dome.texture.created_by_edit == 0
    assert from_message(dome.settings.dome.rotation)[0] == pytest.approx((0, -1, 0), abs=1e-6)
    assert "texture" in off.settings.dome.clear
    assert not color.settings.dome.HasField("texture")
    assert removal.HasField("remove") and removal.target.name == texture.target.name


def test_the_sample_studio_fits_into_one_message(daemon, scene):
    with scene.edit() as edit:
        floor = edit.sample_studio()
    assert floor.name == "floor" and daemon.uploaded == []


def test_imports(daemon, scene, tmp_path):
    (tmp_path / "model.gltf").write_bytes(b"{}")
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "a.png").write_bytes(b"png")
    (tmp_path / "b.bin").write_bytes(b"bin")
    daemon.needs = ["maps/a.png", "b.bin"]
    with scene.edit() as edit:
        asset = edit.import_file(tmp_path / "model.gltf", name="shoe", category="shoe", count=2)
    assert daemon.bundles[-1] == ["model.gltf", "maps/a.png", "b.bin"]
    assert len(daemon.bundles) == 3
    assert [e.target.name for e in last(daemon)] == ["shoe/0", "shoe/1"]
    assert last(daemon)[0].instantiate.label.category == "shoe"
    assert asset.root.name == "shoe/0" and len(asset.roots) == 2
    assert [e.name for e in asset.entities] == ["shoe/0", "shoe/0/node"]
    assert asset.entities[1].id == 1 << 56 | 900
    assert asset.cameras[0] == asset.entities[1]
    assert asset.materials["Wood"].id == 3 << 56 | 902
    assert asset.warnings == ["sheen is ignored"] and asset.bounds[1].tolist() == [1, 2, 3]
    with pytest.raises(KeyError, match="'Leather', 'Wood'"):
        asset.materials["Wod"]
    with scene.edit() as edit:
        edit.instance(asset, materials={"Leather": "steel"}, animation="Walk")
    placed = last(daemon)[0]
    assert placed.target.name == "shoe/2" and placed.instantiate.animation == 0
    assert placed.instantiate.materials["Leather"].name == "steel"


ESCAPES = ["../secret", "/etc/passwd", "a\\b", "link.png", "c:x", "a/../../b"]


@pytest.mark.parametrize("name", ESCAPES)
def test_companions_stay_beneath_the_models_folder(daemon, scene, tmp_path, name):
    folder = tmp_path / "inside"
    folder.mkdir()
    (folder / "model.gltf").write_bytes(b"{}")
    (tmp_path / "secret").write_bytes(b"secret")
    (tmp_path / "b").write_bytes(b"secret")
    (folder / "link.png").symlink_to(tmp_path / "secret")
    daemon.needs = [name]
    with scene.edit() as edit:
        edit.import_file(folder / "model.gltf")
    assert daemon.bundles[-1] == ["model.gltf", name]
    assert b"secret" not in daemon.blobs.values()


def test_a_missing_companion_is_named_where_all_are_asked_for(daemon, scene, tmp_path):
    (tmp_path / "model.gltf").write_bytes(b"{}")
    daemon.needs = ["gone.png"]
    with pytest.raises(hg.NotFound, match=r"gone\.png"), scene.edit() as edit:
        edit.import_file(tmp_path / "model.gltf", strict=True)


def test_handles_pickle(daemon, scene):
    with scene.edit() as edit:
        a = edit.entity("a")
        with pytest.raises(hg.FailedPrecondition):
            pickle.dumps(a)
    twin = pickle.loads(pickle.dumps(a))
    assert twin == a and twin.scene.client is scene.client


def test_many_poses_by_names_ask_once_and_a_group_never_again(scene, daemon):
    with scene.edit() as edit:
        group = edit.instances("many", transforms=np.tile(np.eye(4), (20, 1, 1)))
    asked = []
    describe = type(scene).describe
    scene_of = lambda self, **options: asked.append(options) or describe(self, **options)  # noqa: E731
    type(scene).describe = scene_of
    try:
        for entities in (group, group, [f"many/{i}" for i in range(20)]):
            with scene.edit() as edit:
                edit.set_transforms(entities, np.tile(np.eye(4), (20, 1, 1)))
    finally:
        type(scene).describe = describe
    sent = [np.frombuffer(t.edits[0].poses.ids.inline, "<u8") for t in daemon.transactions[1:]]
    assert all(ids.tolist() == [e.id for e in group] for ids in sent) and len(sent) == 3
    assert len(asked) == 1
    with pytest.raises(hg.InvalidArgument, match="20 entities"), scene.edit() as edit:
        edit.set_transforms(group, np.eye(4)[None])
    with pytest.raises(hg.NotFound, match="none/0"), scene.edit() as edit:
        edit.set_transforms([f"none/{i}" for i in range(9)], np.tile(np.eye(4), (9, 1, 1)))
