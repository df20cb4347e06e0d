"""The banner as COLLADA: by hand, or laid out as Blender's exporter does. Used by
test_moving_collada.py."""

from __future__ import annotations

import numpy as np
from banner import TURN, Z_UP, Banner
from oracle import pose, rotation

MATERIAL = """<library_effects><effect id="fx"><profile_COMMON><technique sid="common"><phong>
<diffuse><color>0.8 0.1 0.2 1</color></diffuse><shininess><float>48</float></shininess></phong>
</technique></profile_COMMON></effect></library_effects><library_materials><material id="paint"
name="Paint"><instance_effect url="#fx"/></material></library_materials>"""
BOUND = """<bind_material><technique_common><instance_material symbol="paint" target="#paint"/>
</technique_common></bind_material>"""


def text(numbers) -> str:
    return " ".join(f"{n:.9g}" for n in np.ravel(numbers))


def floats(name: str, rows, stride: int) -> str:
    count = np.size(rows) // stride
    params = "".join(f'<param name="{axis}" type="float"/>' for axis in "XYZ"[:stride])
    if stride == 16:
        params = '<param name="TRANSFORM" type="float4x4"/>'
    return f"""<source id="{name}"><float_array id="{name}-array" count="{count * stride}">
        {text(rows)}</float_array><technique_common><accessor source="#{name}-array" count="{count}"
        stride="{stride}">{params}</accessor></technique_common></source>"""


def names(name: str, words: list[str], array: str = "Name_array") -> str:
    return f"""<source id="{name}"><{array} id="{name}-array" count="{len(words)}">
        {" ".join(words)}</{array}><technique_common><accessor source="#{name}-array"
        count="{len(words)}" stride="1"><param name="JOINT" type="name"/></accessor>
        </technique_common></source>"""


def takes(semantic: str, source: str, offset: int | None = None) -> str:
    at = "" if offset is None else f' offset="{offset}"'
    return f'<input semantic="{semantic}" source="#{source}"{at}/>'


def geometry(name: str, points, faces) -> str:
    return f"""<geometry id="{name}" name="sheet"><mesh>{floats(name + "-points", points, 3)}
        <vertices id="{name}-vertices">{takes("POSITION", name + "-points")}</vertices>
        <triangles count="{len(faces)}" material="paint">{takes("VERTEX", name + "-vertices", 0)}
        <p>{" ".join(map(str, np.ravel(faces)))}</p></triangles></mesh></geometry>"""


def animation(name: str, target: str, times, values) -> str:
    stride = np.size(values) // len(times)
    return f"""<animation id="{name}" name="{name}">{floats(name + "-in", times, 1)}
        {floats(name + "-out", values, stride)}
        {names(name + "-kind", ["LINEAR"] * len(times))}<sampler id="{name}-sampler">
        {takes("INPUT", name + "-in")}{takes("OUTPUT", name + "-out")}
        {takes("INTERPOLATION", name + "-kind")}</sampler>
        <channel source="#{name}-sampler" target="{target}"/></animation>"""


class Collada:
    """The document, with the axes and the unit that are asked for."""

    def __init__(self, up: str = "Y_UP", unit: float = 1.0) -> None:
        self.banner, self.up, self.unit = Banner(), up, unit
        self.turn = Z_UP[:3, :3] if up == "Z_UP" else np.eye(3)  # file from +Y up

    def points(self, points):
        return points @ self.turn.T / self.unit

    def joint(self, turned: float = 0.0, offset: float = 0.0):
        """A matrix below its parent in the file's coordinates."""
        return pose((offset / self.unit, 0, 0), rotation((1, 0, 0), turned))

    def skin(self, name: str, source: str) -> str:
        weights = self.banner.weights[:, :2]
        influences = [k for i in range(len(weights)) for k in (0, 2 * i, 1, 2 * i + 1)]
        return f"""<controller id="{name}"><skin source="#{source}">
            <bind_shape_matrix>{text(np.eye(4))}</bind_shape_matrix>
            {names(name + "-joints", ["lower", "upper"])}
            {floats(name + "-binds", [np.eye(4), np.eye(4)], 16)}
            {floats(name + "-weights", weights, 1)}
            <joints>{takes("JOINT", name + "-joints")}
            {takes("INV_BIND_MATRIX", name + "-binds")}</joints>
            <vertex_weights count="{len(weights)}">{takes("JOINT", name + "-joints", 0)}
            {takes("WEIGHT", name + "-weights", 1)}<vcount>{"2 " * len(weights)}</vcount>
            <v>{" ".join(map(str, influences))}</v></vertex_weights></skin></controller>"""

    def document(self, controllers: str, animations: str, nodes: str, clips: str = "") -> str:
        banner = self.banner
        target = geometry("wide", self.points(banner.points + banner.target), banner.faces)
        return f"""<?xml version="1.0" encoding="utf-8"?>
            <COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
            <asset><unit name="u" meter="{self.unit}"/><up_axis>{self.up}</up_axis></asset>
            {MATERIAL}<library_geometries>
            {geometry("sheet", self.points(banner.points), banner.faces)}{target}
            </library_geometries><library_controllers>{controllers}</library_controllers>
            <library_animations>{animations}</library_animations>{clips}<library_visual_scenes>
            <visual_scene id="Scene" name="Scene">{nodes}</visual_scene></library_visual_scenes>
            <scene><instance_visual_scene url="#Scene"/></scene></COLLADA>"""

    def by_hand(self) -> str:
        """A skin over a morph; a turn by its angle, and a weight."""
        morph = f"""<controller id="morph"><morph source="#sheet" method="NORMALIZED">
            {names("morph-targets", ["wide"], "IDREF_array")}{floats("morph-weights", [0.25], 1)}
            <targets>{takes("MORPH_TARGET", "morph-targets")}
            {takes("MORPH_WEIGHT", "morph-weights")}</targets></morph></controller>"""
        turn = animation("turn", "up/bend.ANGLE", [0, 1], [0, np.degrees(TURN)])
        weigh = animation("weigh", "morph/morph-weights(0)", [0, 1], [0, 1])
        nodes = f"""<node id="low" sid="lower"><translate>{0.2 / self.unit:.9g} 0 0</translate>
            <node id="up" sid="upper"><rotate sid="bend">1 0 0 0</rotate></node></node>
            <node id="banner"><translate>9 9 9</translate><instance_controller url="#skin">
            <skeleton>#low</skeleton>{BOUND}</instance_controller></node>"""
        return self.document(morph + self.skin("skin", "morph"), turn + weigh, nodes)

    def as_blender(self) -> str:
        """Bones with ids of the armature, matrices at every frame, a clip of the action."""
        times = np.linspace(0, 1, 25)
        keys = [self.joint(TURN * t) for t in times]
        name = "Armature_bow_upper_pose_matrix"
        bend = animation(name, "Armature_upper/transform", times, keys)
        container = f"""<animation id="action_container-Armature" name="Armature">{bend}
            </animation>"""
        clips = f"""<library_animation_clips><animation_clip id="bow" name="bow" start="0" end="1">
            <instance_animation url="#{name}"/></animation_clip></library_animation_clips>"""

        def matrix(m):
            return f'<matrix sid="transform">{text(m)}</matrix>'

        nodes = f"""<node id="Armature" name="Armature" type="NODE">{matrix(np.eye(4))}
            <node id="Armature_lower" name="lower" sid="lower" type="JOINT">
            {matrix(self.joint(offset=0.2))}<node id="Armature_upper" name="upper" sid="upper"
            type="JOINT">{matrix(np.eye(4))}<extra><technique profile="blender"><tip_z>1</tip_z>
            </technique></extra></node></node>
            <node id="Banner" name="Banner" type="NODE">{matrix(np.eye(4))}
            <instance_controller url="#Armature_Banner-skin"><skeleton>#Armature_lower</skeleton>
            {BOUND}</instance_controller></node></node>"""
        return self.document(self.skin("Armature_Banner-skin", "sheet"), container, nodes, clips)
