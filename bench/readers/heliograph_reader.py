"""Models as Heliograph has them, through a daemon: a reader of bench/models.py."""

import pathlib
import sys

import heliograph as hg
import numpy as np

sys.path.append(str(pathlib.Path(__file__).parents[1]))
import model_facts  # noqa: E402
from heliograph._wire.arrays import from_message  # noqa: E402

CLIENT = hg.connect(timeout=120)
SKIN = ["mesh.joints", "mesh.weights"]


def read(path):
    with CLIENT.create_scene() as scene:
        with scene.edit() as edit:
            asset = edit.import_file(path)
        entities = list(asset.entities)
        rows = scene.read(entities, ["entity", "world_pose"])
        entries = [row[0].entity for row in rows]
        worlds = [np.asarray(row[1], np.float64) for row in rows]
        textures = list(asset.textures.values())
        texels = scene.read(textures, ["texture.texels"]) if textures else []
        return {
            **surface(scene, list(zip(entities, entries, worlds, strict=True))),
            "materials": len(asset.materials),
            "textures": sorted(model_facts.mean_colour(row[0]) for row in texels),
            "joints": len({key(joint) for entry in entries for joint in entry.skin.joints}),
            "animations": len(asset.animations),
            "cameras": sum(entry.HasField("camera") for entry in entries),
            "lights": sum(entry.HasField("light") for entry in entries),
            "warnings": asset.warnings,
        }


def key(ref):
    return ref.name or ref.id


def surface(scene, things):
    """Surface of all triangles that are shown, at rest. things: (entity, its message, its pose)"""
    found = model_facts.Surface()
    shown = [thing for thing in things if is_shown(thing[1])]
    fields = ["mesh.positions", "mesh.indices", "mesh.morph_positions", *SKIN]
    owners = {key(entry.mesh): entity for entity, entry, _ in shown}
    meshes = {mesh: scene.read([entity], fields)[0] for mesh, entity in owners.items()}
    for _, entry, world in shown:
        positions, indices, morphs, joints, weights = meshes[key(entry.mesh)]
        positions = np.asarray(positions, np.float64)
        if entry.HasField("morph_weights") and morphs is not None:
            amounts = from_message(entry.morph_weights.weights)
            positions = positions + np.tensordot(np.atleast_2d(amounts)[0], morphs, 1)
        if entry.HasField("skin"):
            positions, world = skinned(scene, entry.skin, positions, joints, weights), None
        found.add(positions, indices, world)
    return found.facts()


def is_shown(entry):
    return key(entry.mesh) and (not entry.HasField("visible") or entry.visible)


def skinned(scene, skin, positions, joints, weights):
    """(V, 3) in the world: each vertex follows its joints."""
    poses = scene.read([scene.handle(key(joint)) for joint in skin.joints], ["world_pose"])
    poses = np.array([row[0] for row in poses], np.float64) @ from_message(skin.inverse_binds)
    points = np.concatenate([positions, np.ones((len(positions), 1))], 1)
    moved = np.einsum("vkij,vj->vki", poses[np.asarray(joints)], points)[..., :3]
    return (np.asarray(weights, np.float64)[..., None] * moved).sum(1)


if __name__ == "__main__":
    model_facts.serve(read)
