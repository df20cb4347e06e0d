"""A scene that was edited and shown in turn is the one that has the same edits and was never shown:
every plane and every column of labels has the same bytes.

500 scenes of 20 random edits each, of poses, meshes, textures, materials, lights, parents, labels,
volumes and instances. HELIOGRAPH_BACKEND=cuda tries a GPU.
"""

import os

import common
import heliograph as hg
import numpy as np

SIZE = (40, 30)
OBJECTS = 8
EDITS = 20
PLANES = """
    beauty depth instance semantic part normal base_color emission direct_diffuse indirect_glossy
    ambient_occlusion shadow_catcher object_coordinates
""".split()


def crumpled(seed):
    """A closed box whose corners are moved."""
    mesh = hg.shapes.cube(0.7)
    corners, numbers = np.unique(np.round(mesh["positions"], 5), axis=0, return_inverse=True)
    corners = corners * np.random.default_rng(seed).uniform(0.7, 1.3, (len(corners), 1))
    faces = numbers.reshape(-1)[np.asarray(mesh["indices"])]
    return {"positions": corners.astype("f4"), "indices": faces.astype("u4")}


def texels(seed, shape):
    return np.random.default_rng(seed).integers(0, 255, shape).astype("u1")


def furnish(edit):
    edit.texture("tiles", texels(1, (16, 16, 3)))
    edit.texture("leaves", texels(2, (16, 32, 4)))
    meshes = (hg.shapes.sphere(0.4), crumpled(1), hg.shapes.plane(1.0))
    for name, mesh in zip("abc", meshes, strict=True):
        edit.mesh(name, **mesh)
        edit.material(name, base_color=0.5, roughness=0.3)
    for i in range(OBJECTS):
        at = hg.Pose((0.8 * (i % 3) - 0.8, 0.8 * (i // 3) - 0.8, 0.3 * i))
        look = {"mesh": "abc"[i % 3], "material": "abc"[i % 3], "category": f"kind {i % 2}"}
        edit.entity(f"o{i}", transform=at, **look)
    lamp = hg.Light(power=20.0, shape="sphere", radius=0.1)
    edit.entity("lamp", light=lamp, transform=hg.Pose((0, 0, 3)))
    sun = hg.Light(irradiance=1.0, sun_angle=0.1)
    edit.entity("sun", light=sun, transform=hg.look_at((0, 0, 0), (1, 1, -1)))
    edit.dome(color=(0.5, 0.5, 0.6), intensity=0.3)
    lens = hg.Camera.from_fov(50, *SIZE, degrees=True)
    edit.entity("cam", camera=lens, transform=hg.look_at((0, -5, 2), (0, 0, 0.5)))


def edits(rng):
    """A random edit of each kind; each is a function of an edit, the same whenever it is called."""
    this, other = (f"o{i}" for i in sorted(rng.integers(0, OBJECTS, 2)))
    name, share, yes = "abc"[rng.integers(3)], float(rng.random()), bool(rng.integers(2))
    seed, color = int(rng.integers(1000)), tuple(rng.random(3))
    pose = hg.look_at(tuple(rng.uniform(-2, 2, 3)), tuple(rng.uniform(-2, 2, 3)))
    places = np.tile(np.eye(4), (5, 1, 1))
    places[:, :3, 3] = rng.uniform(-2, 2, (5, 3))
    rays = ["camera", "diffuse", "glossy", "transmission", "shadow", "volume"]
    shape = "disc" if yes else "sphere"
    lamp = hg.Light(power=30 * share + 1, shape=shape, radius=0.05 + 0.2 * share)
    return [
        lambda edit: edit.entity(this, transform=pose),
        lambda edit: edit.entity(this, visible=yes),
        lambda edit: edit.entity(this, material=name),
        lambda edit: edit.entity(this, mesh=name),
        lambda edit: edit.entity(this, category=f"kind {seed % 2}"),
        lambda edit: edit.entity(this, static=yes),
        lambda edit: edit.entity(this, shadow_catcher=yes),
        lambda edit: edit.entity(this, visibility=rays if yes else ["diffuse", "shadow"]),
        lambda edit: edit.entity(other, parent=this if yes and this != other else None),
        lambda edit: edit.entity(this, light=hg.Light(radiance=3 * share) if yes else None),
        lambda edit: edit.entity(this, label=seed + 1 if yes else None),
        lambda edit: edit.entity("lamp", light=lamp, transform=pose),
        lambda edit: edit.entity("sun", light=hg.Light(irradiance=share, sun_angle=0.02 + share)),
        lambda edit: edit.entity("cam", transform=hg.look_at((share, -5, 2), (0, 0, 0.5))),
        lambda edit: edit.dome(color=color, intensity=share),
        lambda edit: edit.dome("leaves" if yes else "tiles", intensity=share),
        lambda edit: edit.material(name, base_color=color, roughness=share),
        lambda edit: edit.material(name, emission=color, emission_strength=2 * share * yes),
        lambda edit: edit.material(name, base_color="tiles" if yes else "leaves"),
        lambda edit: edit.material(name, alpha=share, alpha_mode="blend" if yes else "opaque"),
        lambda edit: edit.material(name, transmission=float(yes), attenuation_distance=share),
        lambda edit: edit.mesh("b", **crumpled(seed)),
        lambda edit: edit.texture("tiles", texels(seed, (16, 16, 3))),
        lambda edit: edit.instances(f"many {seed % 3}", mesh=name, transforms=places, static=yes),
        lambda edit: edit.entity(
            f"smoke {seed % 2}",
            volume=edit.volume(f"smoke {seed % 2}", density=texels(seed, (6, 6, 6)) / 255.0),
            transform=pose,
        ),
    ]


def applied(scene, change):
    """True if the scene took an edit: what does not fit others before it is refused."""
    try:
        with scene.edit() as edit:
            change(edit)
    except hg.errors.HeliographError:
        return False
    return True


def show(scene, **options):
    return scene.render("cam", planes=PLANES, labels=True, **options)


def same(a, b):
    return np.asarray(a).tobytes() == np.asarray(b).tobytes()


def differences(client, seed):
    """The edits that were taken, and the planes and columns that differ."""
    rng = np.random.default_rng(seed)
    taken = []
    with client.create_scene() as watched, client.create_scene() as unseen:
        for scene in (watched, unseen):
            with scene.edit() as edit:
                furnish(edit)
        for _ in range(EDITS):
            kinds = edits(rng)
            kind = int(rng.integers(len(kinds)))
            if applied(watched, kinds[kind]):
                taken.append(kind)
                assert applied(unseen, kinds[kind])
            if rng.random() < 0.8:
                show(watched, spp=1)
        a, b = (show(scene, spp=4, seed=seed) for scene in (watched, unseen))
    planes = [plane for plane in PLANES if not same(a[plane], b[plane])]
    columns = [key for key in a.labels if not same(a.labels[key], b.labels[key])]
    return taken, planes + [key for key in columns if key != "entity"]


def main():
    flags = ("--backend", os.environ.get("HELIOGRAPH_BACKEND", "embree"))
    scenes = common.size(500, 25)
    different = count = 0
    with common.Report("random edits") as report, common.daemon(*flags) as client:
        for seed in range(scenes):
            taken, names = differences(client, seed)
            count += len(taken)
            different += len(names)
            if names:
                print(f"  scene {seed}, edits {taken}: {', '.join(names)}", flush=True)
        report.figure(f"planes and columns that differ, {count} edits", different, 0, slack=False)
        report.figure("edits refused, share", 1 - count / scenes / EDITS, 0.2, slack=False)


if __name__ == "__main__":
    main()
