"""A frame's bytes do not depend on how many threads rendered it."""

import heliograph as hg
import numpy as np

PLANES = ["beauty", "variance", "depth", "normal", "instance", "material", "uv", "coverage"]


def frame(threads):
    """A lit scene with glass, a texture and a hole, from a daemon of so many threads."""
    with (
        hg.connect(arguments=["--threads", str(threads)]) as client,
        client.create_scene() as scene,
    ):
        with scene.edit() as edit:
            edit.sample_studio()
            dots = np.zeros((8, 8, 4), "u1")
            dots[::2, ::2] = 255
            holes = edit.material(
                "holes",
                base_color=edit.texture("dots", dots),
                alpha=hg.Tex("dots", channel=3),
                alpha_mode="mask",
            )
            glass = edit.material("glass", transmission=1.0, roughness=0.2)
            mesh = edit.mesh("ball", **hg.shapes.sphere(0.5))
            for x, material in ((-0.6, glass), (0.6, holes)):
                edit.entity(
                    None,
                    mesh=mesh,
                    material=material,
                    category="ball",
                    transform=hg.Pose((x, 0, 0.5)),
                )
            lens = hg.Camera.from_fov(50, 101, 67, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 1.5), (0, 0, 0.5)))
        return scene.render("cam", spp=21, planes=PLANES, seed=9, labels=True)


def test_one_thread_and_two_give_the_same_bytes():
    one, two = frame(1), frame(2)
    for plane in PLANES:
        assert one[plane].tobytes() == two[plane].tobytes(), plane
    for name in one.labels:
        assert np.array_equal(one.labels[name], two.labels[name]), name
    assert one["beauty"][..., :3].mean() > 0.05 and len(one.labels["label"]) == 2
