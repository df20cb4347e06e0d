"""Scenes at the ends of every range: no daemon ends, every plane has numbers, and normals are those
of the triangles.

20,000 scenes of a closed mesh of 1e-5 to 1e5 m in its own frame and 1e-4 to 1e4 m in the world,
with random materials, lights, poses and cameras. HELIOGRAPHD may name a daemon of a sanitizer's
build; HELIOGRAPH_BACKEND=cuda tries a GPU.
"""

import os

import common
import heliograph as hg
import numpy as np

SIZE = (24, 16)
LIGHT = ["beauty", "albedo_mean", "normal_mean", "direct_diffuse", "indirect_glossy"]
LABELS = ["normal", "geometric_normal", "base_color", "primitive", "instance", "depth"]
OBJECTS = 5


class Random:
    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)

    def power(self, low, high):
        """10 to a number between these."""
        return float(10 ** self.rng.uniform(low, high))

    def one_of(self, *values):
        return values[self.rng.integers(len(values))]

    def share(self):
        return self.one_of(0.0, 1.0, float(self.rng.random()))

    def turn(self):
        """A rotation or a mirror image of one."""
        return np.linalg.qr(self.rng.normal(size=(3, 3)))[0]

    def material(self):
        return {
            "base_color": self.rng.random(3),
            "roughness": self.one_of(0.0, 1e-3, 0.03, 1.0, float(self.rng.random())),
            "ior": self.one_of(1.0, 1.0001, 1.5, 4.0),
            "specular_color": self.power(-4, 4),
            "subsurface": self.one_of(0.0, 0.0, 1.0),
            "subsurface_radius": self.power(-9, 4),
            "attenuation_distance": self.power(-9, 9),
            "medium_density": self.one_of(0.0, 0.0, self.power(-6, 6)),
            "emission": self.one_of(0.0, 0.0, self.power(-9, 9)),
            "iridescence_thickness": self.power(-3, 4),
            "dispersion": self.one_of(0.0, 0.0, self.power(-3, 2)),
            "thin_walled": bool(self.rng.integers(2)),
            "priority": int(self.rng.integers(-2, 3)),
            **{
                name: self.share()
                for name in (
                    "metallic",
                    "transmission",
                    "diffuse_transmission",
                    "transmission_roughness",
                    "clearcoat",
                    "clearcoat_roughness",
                    "sheen",
                    "anisotropic",
                    "iridescence",
                )
            },
        }


def crumpled_ball(rng, size):
    """A closed mesh, vertices within 0.7 to 1 of its size."""
    ball = hg.shapes.sphere(1.0, 6)
    places, numbers = np.unique(np.round(ball["positions"], 5), axis=0, return_inverse=True)
    places = places * rng.uniform(0.7, 1, (len(places), 1)) * size
    faces = numbers.reshape(-1)[np.asarray(ball["indices"])]
    return places.astype("f4"), faces.astype("u4")


def furnish(scene, random):
    """Returns the mesh and the poses of its objects."""
    rng, size = random.rng, random.power(-5, 5)
    positions, faces = crumpled_ball(rng, size)
    poses = []
    with scene.edit() as edit:
        edit.mesh("mesh", positions=positions, indices=faces)
        for i in range(OBJECTS):
            edit.material(f"m{i}", **random.material())
            pose = np.eye(4)
            stretch = random.one_of(np.ones(3), rng.uniform(0.3, 1, 3))
            pose[:3, :3] = random.turn() * stretch * (random.power(-4, 4) / size)
            pose[:3, 3] = rng.normal(size=3) * random.power(-3, 6)
            poses.append(pose)
            edit.entity(f"o{i}", mesh="mesh", material=f"m{i}", transform=pose)
        edit.dome(color=(1, 1, 1), intensity=random.power(-9, 9))
        sun = hg.Light(irradiance=random.power(-3, 9), sun_angle=random.power(-4, -0.4))
        edit.entity("sun", light=sun, transform=hg.look_at((0, 0, 0), rng.normal(size=3)))
        lamp = hg.Light(power=random.power(-9, 9), shape="sphere", radius=random.power(-6, 6))
        edit.entity("lamp", light=lamp, transform=hg.Pose(rng.normal(size=3) * random.power(-3, 6)))
        target = poses[0][:3, 3]
        away = rng.normal(size=3) * random.power(-1, 1) * size * np.abs(poses[0][:3, :3]).max()
        lens = hg.Camera.from_fov(60, *SIZE, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at(target + away, target))
    return positions, faces, poses


def bad_pixels(frame):
    """Number of pixels that are no numbers, or of radiance below 0."""
    bad = sum(int((~np.isfinite(frame[plane])).sum()) for plane in LIGHT + LABELS[:3])
    return bad + int((frame["beauty"] < 0).sum())


def bad_normals(frame, positions, faces, poses):
    """Pixels whose geometric normal is off by over 1e-4 from that of the triangle in f64."""
    hit = (frame["instance"] > 0) & (frame["instance"] <= OBJECTS)
    of = frame["instance"][hit].astype(int) - 1
    triangles = positions.astype("f8")[faces[frame["primitive"][hit]]]
    linear = np.array(poses)[of, :3, :3].astype("f4").astype("f8")
    corners = np.einsum("nij,nkj->nki", linear, triangles)
    exact = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    exact /= np.linalg.norm(exact, axis=1, keepdims=True)
    off = np.linalg.norm(np.cross(exact, frame["geometric_normal"][hit].astype("f8")), axis=1)
    return int((off > 1e-4).sum()), int(hit.sum())


def main():
    flags = ("--backend", os.environ.get("HELIOGRAPH_BACKEND", "embree"))
    scenes = common.size(20_000, 150)
    bad = wrong = seen = 0
    with common.Report("random scenes") as report, common.daemon(*flags) as client:
        for seed in range(scenes):
            random = Random(seed)
            with client.create_scene() as scene:
                mesh = furnish(scene, random)
                frame = scene.render("cam", spp=4, planes=LIGHT + LABELS, seed=seed)
            found = bad_pixels(frame)
            off, hit = bad_normals(frame, *mesh)
            if found or off:
                print(f"  scene {seed}: {found} values, {off} of {hit} normals", flush=True)
            bad, wrong, seen = bad + found, wrong + off, seen + hit
        report.figure(f"values that are no number, {scenes} scenes", bad, 0, slack=False)
        report.figure(f"normals off by 1e-4, of {seen}", wrong, 0, slack=False)
        report.figure("pixels a scene without a surface", SIZE[0] * SIZE[1] - seen / scenes, 380)


if __name__ == "__main__":
    main()
