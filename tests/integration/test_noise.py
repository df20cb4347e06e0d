"""The noise that a frame reports is the error that its pixels have, also where light is rare."""

import heliograph as hg
import numpy as np
import pytest

SIZE = (48, 36)
EXPOSED = {"base_color": 0.7, "specular": 0.0}


def walls(edit, hole):
    """A room of 4 m with a hole of so many metres in its ceiling, and a bright sky outside."""
    n = 41
    x = np.linspace(-2, 2, n)
    grid = np.stack(np.meshgrid(x, x, indexing="ij"), -1).reshape(-1, 2)
    a = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    quads = np.stack([a, a + 1, a + n + 1, a + n], -1)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    for axis in range(3):
        for side in (-2.0, 2.0):
            points = np.insert(grid, axis, side, axis=1).astype("f4")
            faces = triangles
            if axis == 2 and side > 0:
                middle = np.abs(grid[triangles].mean(1)).max(1)
                faces = triangles[middle > hole / 2]
            name = f"wall {axis} {side}"
            material = edit.material("wall", **EXPOSED)
            edit.entity(
                name,
                mesh=edit.mesh(name, positions=points, indices=faces.astype("u4")),
                material=material,
            )
    edit.dome(color=1.0, intensity=1000.0)
    camera(edit, (0, -1.8, 0), (0, 1, -0.2))


def camera(edit, eye, target):
    lens = hg.Camera.from_fov(70, *SIZE, degrees=True)
    edit.entity("cam", camera=lens, transform=hg.look_at(eye, target))


def floor(edit):
    edit.entity(
        "floor",
        mesh=edit.mesh("floor", **hg.shapes.plane(20)),
        material=edit.material("floor", **EXPOSED),
    )
    camera(edit, (0, -4, 2), (0, 0, 0.5))


def lamp_behind_glass(edit):
    """Light that only paths find: through a ball of glass around the lamp."""
    floor(edit)
    glass = edit.material("glass", base_color=1.0, transmission=1.0, roughness=0.0)
    edit.entity("ball", mesh=edit.mesh("ball", **hg.shapes.sphere(0.5)), material=glass)
    edit.entity("ball", transform=hg.Pose((0, 0, 1)))
    lamp = hg.Light(power=100.0, shape="sphere", radius=0.05)
    edit.entity("lamp", light=lamp, transform=hg.Pose((0, 0, 1)))


def spot(edit):
    """A cone of light; no light reaches most of the rest."""
    floor(edit)
    light = hg.Light(
        power=50.0, shape="disc", radius=0.05, inner_cone_angle=0.1, outer_cone_angle=0.2
    )
    edit.entity("spot", light=light, transform=hg.look_at((0, 0, 3), (0, 0, 0)))
    edit.entity("ball", mesh=edit.mesh("ball", **hg.shapes.sphere(0.4)), material="floor")
    edit.entity("ball", transform=hg.Pose((1, 1, 0.4)))


def true_error(scene, samples, renders):
    """The mean over the pixels of the standard deviation of pictures over their mean."""
    light = np.stack(
        [
            scene.render("cam", spp=samples, planes=["beauty"], seed=100 + i)["beauty"]
            for i in range(renders)
        ]
    )[..., :3] @ np.array([0.2126, 0.7152, 0.0722])
    mean, deviation = light.mean(0), light.std(0, ddof=1)
    return float((deviation / np.maximum(mean, 0.01 * mean.mean())).mean())


@pytest.mark.parametrize(
    "build",
    [
        lambda edit: walls(edit, 2.0),
        lambda edit: walls(edit, 0.6),
        lambda edit: walls(edit, 0.2),
        lambda edit: walls(edit, 0.1),
        lamp_behind_glass,
    ],
    ids=["window", "hatch", "hole", "keyhole", "glass"],
)
def test_reported_noise_is_the_error(scene, build):
    with scene.edit() as edit:
        build(edit)
    samples = 64
    reported = [
        scene.render("cam", spp=samples, planes=["beauty", "variance"], seed=i).noise
        for i in range(3)
    ]
    truth = true_error(scene, samples, 48)
    assert truth / 1.5 < np.mean(reported) < truth * 1.5


def test_a_dark_room_is_not_done(scene):
    """Where nearly all pixels are black still, the picture goes on."""
    with scene.edit() as edit:
        walls(edit, 0.2)
    frame = scene.render("cam", noise=0.5, spp=256, planes=["beauty"])
    assert frame.samples == 256 and frame.noise > 0.5


def test_a_shadow_beside_light_is_done(scene):
    """Surfaces that no light reaches need no samples."""
    with scene.edit() as edit:
        spot(edit)
    frame = scene.render("cam", noise=0.05, spp=4096, planes=["beauty"], max_depth=2)
    assert frame.noise <= 0.05 and frame.samples < 4096


@pytest.mark.parametrize("adaptive", [False, True])
def test_light_that_glass_focuses_is_looked_for(scene, adaptive):
    """Few of the first samples meet a caustic: 16 of them tell nothing where there may be one."""
    with scene.edit() as edit:
        floor(edit)
        lamp = hg.Light(power=100.0, shape="sphere", radius=0.3)
        edit.entity("lamp", light=lamp, transform=hg.Pose((0, 0, 3)))
        edit.entity("ball", mesh=edit.mesh("ball", **hg.shapes.sphere(0.4)), material="floor")
        edit.entity("ball", transform=hg.Pose((1, 1, 0.4)))
        edit.dome(color=1.0)
    options = {"noise": 1.0, "adaptive": adaptive, "planes": ["beauty"]}
    assert scene.render("cam", **options).samples == 16
    with scene.edit() as edit:
        glass = edit.material("glass", base_color=1.0, transmission=1.0, roughness=0.0)
        edit.entity("ball", material=glass)
    assert scene.render("cam", **options).samples == 64
    assert scene.render("cam", spp=32, **options).samples == 32
    with scene.edit() as edit:
        edit.remove("lamp")
    assert scene.render("cam", **options).samples == 16  # nothing small shines
