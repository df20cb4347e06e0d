"""Directional albedos of the principled material here and in Mitsuba, lobe by lobe: why pictures of
the principled workloads differ where those with Lambert agree.

usage: terms.py MITSUBA_PYTHON      Run with .venv/bin/python; MITSUBA_PYTHON has mitsuba installed.
"""

import json
import math
import subprocess
import sys

import heliograph as hg
import numpy as np

COLOR = 0.5
ROUGHNESS = (0.2, 0.4, 0.6, 0.8)
ANGLES = (10, 45, 75)  # of the view, degrees from the normal
SAMPLES = 1 << 16
LOBES = {
    "specular": {"base_color": 0.0, "metallic": 0.0},
    "plastic": {"base_color": COLOR, "metallic": 0.0},
    "metal": {"base_color": COLOR, "metallic": 1.0},
}

THEIRS = """
import json, math, sys
import drjit as dr
import mitsuba as mi
mi.set_variant("llvm_ad_rgb")
lobes, roughness, angles, count = json.loads(sys.argv[1])
out = []
for lobe in lobes:
    for r in roughness:
        color = {"type": "rgb", "value": lobe["base_color"]}
        bsdf = mi.load_dict({"type": "principled", "roughness": r, "metallic": lobe["metallic"],
                             "eta": 1.5, "base_color": color})
        for angle in angles:
            sampler = mi.load_dict({"type": "independent"})
            sampler.seed(1, count)
            si = dr.zeros(mi.SurfaceInteraction3f, count)
            a = math.radians(angle)
            si.wi = mi.Vector3f(math.sin(a), 0, math.cos(a))
            weight = bsdf.sample(mi.BSDFContext(), si, sampler.next_1d(), sampler.next_2d())[1]
            out.append(float(dr.mean(weight.x)[0]))
print(json.dumps(out))
"""


def ours():
    """Reflection of a white sky by a plane, by lobe, roughness and angle."""
    out = []
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], "f4")
    with hg.connect() as client:
        scene = client.create_scene()
        with scene.edit() as edit:
            mesh = edit.mesh(
                "square", positions=square, indices=np.array([[0, 1, 2], [0, 2, 3]], "u4")
            )
            material = edit.material("m")
            edit.entity("plane", mesh=mesh, material=material)
            edit.dome(color=1.0)
            lens = hg.Camera.from_fov(1, 16, 16, axis="y", degrees=True)
            cameras = []
            for angle in ANGLES:
                a = math.radians(angle)
                eye = 4 * np.array([math.sin(a), 0, math.cos(a)])
                cameras.append(edit.entity(f"at {angle}", camera=lens, transform=looking(eye)))
        for lobe in LOBES.values():
            for roughness in ROUGHNESS:
                with scene.edit() as edit:
                    edit.material("m", roughness=roughness, ior=1.5, **lobe)
                for camera in cameras:
                    picture = scene.render(
                        camera, spp=SAMPLES // 256, max_depth=2, planes=["beauty"], progress=False
                    )["beauty"]
                    out.append(float(picture[..., 0].mean()))
    return out


def looking(eye):
    z = eye / np.linalg.norm(eye)
    x = np.cross([0, 1, 0], z)
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    pose[:3, 3] = eye
    return pose


def main(python):
    request = json.dumps([list(LOBES.values()), ROUGHNESS, ANGLES, SAMPLES])
    done = subprocess.run(
        [python, "-c", THEIRS, request], capture_output=True, text=True, check=True
    )
    shape = (len(LOBES), len(ROUGHNESS), len(ANGLES))
    theirs = np.array(json.loads(done.stdout.splitlines()[-1])).reshape(shape)
    mine = np.array(ours()).reshape(shape)
    print("lobe      roughness " + "".join(f"   {a:2d} deg: ours  theirs" for a in ANGLES))
    rows = {name: (mine[i], theirs[i]) for i, name in enumerate(LOBES)}
    rows["diffuse"] = tuple(rows["plastic"][k] - rows["specular"][k] for k in (0, 1))
    for name, (a, b) in rows.items():
        for i, roughness in enumerate(ROUGHNESS):
            pairs = "".join(f"       {x:8.4f} {y:7.4f}" for x, y in zip(a[i], b[i], strict=True))
            print(f"{name:9s} {roughness:9.1f} {pairs}")


if __name__ == "__main__":
    main(sys.argv[1])
