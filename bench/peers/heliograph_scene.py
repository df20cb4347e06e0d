"""A neutral scene in Heliograph, built through its Python client. Used by the scripts of bench/."""

import os

import common
import heliograph as hg


class Heliograph:
    """The scene in a daemon, with one camera for each size that is measured."""

    def __init__(self, client, doc, args=None):
        info = client.info()
        self.version = f"heliograph {info.version} {info.backend} {info.cpu_features}"
        self.scene = client.create_scene()
        self.options = {
            "planes": ["beauty"],
            "labels": False,
            "max_depth": doc["integrator"]["max_depth"],
            "roulette": False,
            "filter": "box",
            "progress": False,
        }
        self.doc = doc
        with self.scene.edit() as edit:
            self.add_shared(edit)
            self.add_objects(edit)

    def path(self, name):
        return os.path.join(self.doc["dir"], name)

    def add_shared(self, edit):
        doc = self.doc
        self.textures = {
            name: edit.texture(f"texture/{name}", self.path(t["file"]))
            for name, t in doc["textures"].items()
        }
        self.materials = {
            name: edit.material(f"material/{name}", **self.parameters(m))
            for name, m in doc["materials"].items()
        }
        self.meshes = {}
        for name, mesh in doc["meshes"].items():
            positions, normals, uvs, indices = common.read_ply(self.path(mesh["file"]))
            if doc.get("flat"):
                normals = None
            self.meshes[name] = edit.mesh(
                f"mesh/{name}", positions=positions, normals=normals, uvs=uvs, indices=indices
            )
        if doc["environment"]:
            edit.dome(self.path(doc["environment"]["file"]))

    def parameters(self, m):
        color = self.textures[m["base_texture"]] if m["base_texture"] else m["base_color"]
        if m["type"] == "diffuse":
            return {"base_color": color, "specular": 0.0}
        if m["type"] == "glass":
            return {"base_color": 1.0, "transmission": 1.0, "roughness": 0.0, "ior": m["ior"]}
        if m["type"] == "metal":
            return {"base_color": color, "metallic": 1.0, "roughness": m["roughness"]}
        return {
            "base_color": color,
            "roughness": m["roughness"],
            "metallic": m["metallic"],
            "ior": m["ior"],
        }

    def add_objects(self, edit):
        for o in self.doc["objects"]:
            light = {"light": hg.Light(radiance=1.0, color=o["emission"])} if o["emission"] else {}
            edit.entity(
                o["name"],
                mesh=self.meshes[o["mesh"]],
                material=self.materials[o["material"]],
                transform=o["to_world"],
                static=not self.doc.get("all_move") and o["name"] != self.doc["edit"]["object"],
                **light,
            )
        camera = self.doc["camera"]
        self.cameras = {}
        for size in (common.FULL, common.SMALL, common.QUALITY):
            lens = hg.Camera.from_fov(camera["fov_y_deg"], *size, axis="y", degrees=True)
            name = "camera/{}x{}".format(*size)
            self.cameras[size] = edit.entity(name, camera=lens, transform=camera["to_world"])

    def render(self, size, spp, seed):
        return self.scene.render(self.cameras[size], spp=spp, seed=seed, **self.options)["beauty"]

    def image(self, size, spp, seed):
        return self.render(size, spp, seed)[..., :3]

    def edit(self, name, matrix):
        with self.scene.edit() as edit:
            edit.update(name, transform=matrix)
