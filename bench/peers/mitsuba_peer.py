#!/usr/bin/env python3
"""Mitsuba 3 on a neutral scene. Run by measure.py.

A (mesh, material) pair used more than once, and the edited object, become instances.
"""

import os
import sys
from collections import Counter

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import common
import numpy as np


class Mitsuba:
    def __init__(self, doc, a):
        import mitsuba as mi

        mi.set_variant(a.variant)
        import drjit as dr

        self.mi, self.jit = mi, "scalar" not in a.variant
        self.version = f"mitsuba {mi.__version__} {a.variant}"
        dr.set_thread_count(a.threads)
        if "llvm" in a.variant:
            self.version += (
                f" LLVM {os.path.basename(os.environ.get('DRJIT_LIBLLVM_PATH', 'default'))}"
            )
        self.doc = doc

        def path(f):
            return os.path.join(doc["dir"], f)

        T = mi.ScalarTransform4f

        def rgb(c):
            return {"type": "rgb", "value": [float(x) for x in c]}

        def bsdf(m):
            color = rgb(m["base_color"])
            if m["base_texture"]:
                color = {
                    "type": "bitmap",
                    "filename": path(doc["textures"][m["base_texture"]]["file"]),
                }
            if m["type"] == "diffuse":
                return {"type": "diffuse", "reflectance": color}
            if m["type"] == "glass":
                return {"type": "dielectric", "int_ior": m["ior"]}
            if m["type"] == "metal":
                return {
                    "type": "roughconductor",
                    "distribution": "ggx",
                    "alpha": m["roughness"] ** 2,
                    "specular_reflectance": color,
                }
            return {
                "type": "principled",
                "base_color": color,
                "roughness": m["roughness"],
                "metallic": m["metallic"],
                "eta": m["ior"],
            }

        def sided(m, material):
            """Materials that show on both sides, as ours do."""
            if not a.flat or m["type"] == "glass":
                return material
            return {"type": "twosided", "bsdf": material}

        sizes = (common.FULL, common.SMALL, common.QUALITY)
        self.sensor = {s: i for i, s in enumerate(sizes)}
        C = np.array(doc["camera"]["to_world"]) @ np.diag([-1.0, 1, -1, 1])
        d = {
            "type": "scene",
            "integrator": {
                "type": "path",
                "max_depth": doc["integrator"]["max_depth"],
                "rr_depth": 100000,
            },
        }
        for i, (w, h) in enumerate(sizes):
            d[f"sensor{i}"] = {
                "type": "perspective",
                "fov": doc["camera"]["fov_y_deg"],
                "fov_axis": "y",
                "to_world": T(C),
                "sampler": {"type": "independent"},
                "film": {
                    "type": "hdrfilm",
                    "width": w,
                    "height": h,
                    "pixel_format": "rgb",
                    "component_format": "float32",
                    "rfilter": {"type": "box"},
                },
            }
        if doc["environment"]:
            d["env"] = {
                "type": "envmap",
                "filename": path(doc["environment"]["file"]),
                "to_world": T(np.array([[0, 0, 1.0, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])),
            }
        for n, m in doc["materials"].items():
            d["mat_" + n] = sided(m, bsdf(m))

        def key(o):
            return (o["mesh"], o["material"])

        uses = Counter(key(o) for o in doc["objects"] if not o["emission"])
        for o in doc["objects"]:
            shape = {
                "type": "ply",
                "filename": path(doc["meshes"][o["mesh"]]["file"]),
                "flip_tex_coords": True,
                "face_normals": a.flat,
                "bsdf": {"type": "ref", "id": "mat_" + o["material"]},
            }
            M = T(np.array(o["to_world"]))
            if not o["emission"] and (
                a.instance_all or uses[key(o)] > 1 or o["name"] == doc["edit"]["object"]
            ):
                g = "group_{}_{}".format(*key(o))
                d.setdefault(g, {"type": "shapegroup", "shape": shape})
                d[o["name"]] = {
                    "type": "instance",
                    "group": {"type": "ref", "id": g},
                    "to_world": M,
                }
            else:
                shape["to_world"] = M
                if o["emission"]:
                    shape["emitter"] = {"type": "area", "radiance": rgb(o["emission"])}
                d[o["name"]] = shape
        order = sorted(
            d.items(), key=lambda kv: isinstance(kv[1], dict) and kv[1].get("type") == "instance"
        )
        self.scene = mi.load_dict(dict(order))
        self.params = mi.traverse(self.scene)
        self.frozen = {} if self.jit and not a.no_freeze else None

    def start(self, size, spp, seed):
        """A picture that may still be on its way."""
        mi, sensor = self.mi, self.sensor[size]
        if self.frozen is None:
            return mi.render(self.scene, sensor=sensor, spp=spp, seed=seed)
        f = self.frozen.get((size, spp))
        if f is None:  # record once, replay without tracing: its fastest way to redraw
            import drjit as dr

            f = self.frozen[size, spp] = dr.freeze(
                lambda scene, seed: mi.render(scene, sensor=sensor, spp=spp, seed=seed)
            )
        return f(self.scene, mi.UInt32(seed))

    def image(self, size, spp, seed):
        return np.array(self.start(size, spp, seed))[..., :3]

    render = image

    def edit(self, name, M):
        p = self.params
        p[name + ".to_world"] = type(p[name + ".to_world"])(M)
        p.update()


if __name__ == "__main__":
    common.main(
        Mitsuba,
        lambda p: (
            p.add_argument("--variant", default="llvm_ad_rgb"),
            p.add_argument("--no-freeze", action="store_true"),
            p.add_argument("--instance-all", action="store_true"),
            p.add_argument("--flat", action="store_true", help="two-sided, geometric normals"),
        ),
    )
