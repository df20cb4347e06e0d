"""NaN and infinity in every number that the Python client takes."""

import heliograph as hg
import numpy as np
import pytest
from refusals import EYE, camera, check, dome, edited, entity, material, mesh, put, render

NAN, INF = float("nan"), float("inf")

# Where a number goes -> (the field that the message names, the call).
NUMBERS = {
    "pose": ("transform", lambda x: entity(transform=put(EYE, x))),
    "pose f32": ("transform", lambda x: entity(transform=put(EYE, x).astype("f4"))),
    "Pose.position": ("position", lambda x: entity(transform=hg.Pose((0, 0, x)))),
    "Pose.wxyz": ("wxyz", lambda x: entity(transform=hg.Pose(wxyz=(1, 0, 0, x)))),
    "Pose.xyzw": ("xyzw", lambda x: entity(transform=hg.Pose(xyzw=(1, 0, 0, x)))),
    "Pose.euler": ("euler", lambda x: entity(transform=hg.Pose(euler=(0, 0, x)))),
    "Pose.matrix3": ("matrix3", lambda x: entity(transform=hg.Pose(matrix3=put(np.eye(3), x)))),
    "Pose.scale": ("scale", lambda x: entity(transform=hg.Pose(scale=x))),
    "Pose.scale xyz": ("scale", lambda x: entity(transform=hg.Pose(scale=(1, 1, x)))),
    "key": ("keys", lambda x: entity(keys={0.0: EYE, x: EYE})),
    "keyed pose": ("keys", lambda x: entity(keys={0.0: EYE, 1.0: put(EYE, x)})),
    "look_at": ("eye", lambda x: lambda scene: hg.look_at((0, 0, x), (0, 0, 0))),
    "instances": (
        "transforms",
        lambda x: edited(lambda e: e.instances("thing", transforms=put([EYE, EYE], x))),
    ),
    "set_transforms": (
        "transforms",
        lambda x: edited(lambda e: e.set_transforms(["ball"], put([EYE], x))),
    ),
    "mesh positions": ("positions", lambda x: mesh(positions=put(np.eye(3), x))),
    "mesh times": (
        "times",
        lambda x: mesh(positions=np.zeros((2, 3, 3)), times=[0, x]),
    ),
    "mesh normals": ("normals", lambda x: mesh(normals=put(np.eye(3), x))),
    "mesh uvs": ("uvs", lambda x: mesh(uvs=put(np.zeros((3, 2)), x))),
    "mesh uvs1": ("uvs1", lambda x: mesh(uvs=np.zeros((3, 2)), uvs1=put(np.zeros((3, 2)), x))),
    "mesh colors": ("colors", lambda x: mesh(colors=put(np.zeros((3, 3)), x))),
    "mesh tangents": ("tangents", lambda x: mesh(tangents=put(np.ones((3, 4)), x))),
    "mesh indices": ("indices", lambda x: mesh(indices=put([[0, 1, 2]], x))),
    "mesh parts": ("parts", lambda x: mesh(parts=[x])),
    "mesh weights": (
        "weights",
        lambda x: mesh(joints=np.zeros((3, 4), "u2"), weights=put(np.ones((3, 4)), x)),
    ),
    "mesh morph_positions": (
        "morph_positions",
        lambda x: mesh(morph_positions=put(np.zeros((1, 3, 3)), x)),
    ),
    "mesh morph_normals": (
        "morph_normals",
        lambda x: mesh(
            morph_positions=np.zeros((1, 3, 3)), morph_normals=put(np.zeros((1, 3, 3)), x)
        ),
    ),
    "mesh keypoints": ("keypoints['tip']", lambda x: mesh(keypoints={"tip": (0, 0, x)})),
    "mesh symmetry": ("symmetries[0]", lambda x: mesh(symmetries=[put(EYE, x)])),
    "mesh axis": ("symmetries[0].axis", lambda x: mesh(symmetries=[{"axis": (0, 0, x)}])),
    "mesh offset": (
        "symmetries[0].offset",
        lambda x: mesh(symmetries=[{"axis": (0, 0, 1), "offset": (0, 0, x)}]),
    ),
    "base_color": ("base_color", lambda x: material(base_color=(0, 0, x))),
    "specular_color": ("specular_color", lambda x: material(specular_color=(0, 0, x))),
    "emission": ("emission", lambda x: material(emission=(0, 0, x))),
    **{
        name: (name, lambda x, name=name: material(**{name: (0, 0, x)}))
        for name in (
            "subsurface_radius",
            "subsurface_color",
            "attenuation_color",
            "medium_density",
            "medium_albedo",
        )
    },
    **{
        name: (name, lambda x, name=name: material(**{name: x}))
        for name in (
            "metallic",
            "roughness",
            "specular",
            "ior",
            "transmission",
            "alpha",
            "emission_strength",
            "alpha_cutoff",
            "subsurface",
            "attenuation_distance",
            "medium_anisotropy",
            "iridescence",
            "iridescence_ior",
            "iridescence_thickness",
            "diffuse_transmission",
            "dispersion",
            "priority",
        )
    },
    "Tex.factor": ("roughness", lambda x: material(roughness=hg.Tex("dots", factor=x))),
    "Tex.scale": ("roughness.scale", lambda x: material(roughness=hg.Tex("dots", scale=x))),
    "Tex.offset": ("roughness.offset", lambda x: material(roughness=hg.Tex("dots", offset=x))),
    "Tex.uv": (
        "normal_map.uv",
        lambda x: material(normal_map=hg.Tex("dots", uv=put(np.eye(3)[:2], x))),
    ),
    "texels": ("image", lambda x: edited(lambda e: e.texture("t", put(np.zeros((2, 2)), x)))),
    **{
        f"Light.{name}": (f"light.{name}", lambda x, name=name: entity(light=hg.Light(**{name: x})))
        for name in ("radiance", "power", "luminance", "lumen")
    },
    **{
        f"Light.{name}": (
            f"light.{name}",
            lambda x, name=name: entity(light=hg.Light(radiance=1, **{name: x})),
        )
        for name in ("color", "exposure", "temperature")
    },
    **{
        f"Camera.{name}": (
            f"camera.{name}",
            lambda x, name=name: entity(camera=camera(**{name: x})),
        )
        for name in ("width", "height", "fx", "fy", "cx", "cy", "rolling")
    },
    "Camera.shutter": ("camera.shutter", lambda x: entity(camera=camera(shutter=(0.0, x)))),
    "Camera.from_fov": ("fov", lambda x: lambda scene: hg.Camera.from_fov(x, 32, 24)),
    **{
        f"Camera.{name}": (
            f"camera.{name}",
            lambda x, name=name: entity(
                camera=camera(**{name: -1 if name == "far" and x == INF else x})
            ),
        )
        for name in ("aperture", "focus_distance", "blades", "blade_rotation", "near", "far")
    },
    "Camera.distortion": (
        "camera.distortion",
        lambda x: entity(camera=camera(distortion=(0, 0, 0, x))),
    ),
    "Camera.from_focal_length": (
        "focal_length",
        lambda x: lambda scene: hg.Camera.from_focal_length(x, 32, 24),
    ),
    "Camera.sensor_width": (
        "sensor_width",
        lambda x: lambda scene: hg.Camera.from_focal_length(50, 32, 24, sensor_width=x),
    ),
    "Camera.f_number": (
        "f_number",
        lambda x: lambda scene: hg.Camera.from_focal_length(50, 32, 24, f_number=x),
    ),
    "Camera.fisheye": ("fov", lambda x: lambda scene: hg.Camera.fisheye(x, 32, 24)),
    "Camera.equirectangular": (
        "fov",
        lambda x: lambda scene: hg.Camera.equirectangular(32, 24, fov=(1, x)),
    ),
    "Camera.from_intrinsics": (
        "K",
        lambda x: lambda scene: hg.Camera.from_intrinsics(put(np.eye(3), x), 32, 24),
    ),
    "Camera.orthographic": (
        "camera.fx",
        lambda x: entity(camera=hg.Camera.orthographic(x, 32, 24)),
    ),
    "skin": (
        "skin.inverse_binds",
        lambda x: entity(mesh="skinned", skin=(["bone"], put([EYE], x))),
    ),
    "morph_weights": ("morph_weights", lambda x: entity(mesh="morphed", morph_weights=[0, x])),
    "morph key": (
        "morph_weights",
        lambda x: entity(mesh="morphed", morph_weights={0.0: [0, 0], x: [1, 1]}),
    ),
    "label": ("label", lambda x: entity(label=x)),
    "part": ("part", lambda x: entity(label=3, part=x)),
    "dome color": ("color", lambda x: dome(color=(0, 0, x))),
    "dome intensity": ("intensity", lambda x: dome(intensity=x)),
    "dome rotation": ("rotation", lambda x: dome(rotation=x)),
    "dome matrix": ("rotation", lambda x: dome(rotation=put(np.eye(3), x))),
    "dome texels": ("image", lambda x: dome(image=put(np.zeros((2, 4, 3)), x).astype("f4"))),
    "time": ("time", lambda x: edited(lambda e: e.time(x))),
    "advance": ("dt", lambda x: edited(lambda e: e.advance(x))),
    "units": ("units", lambda x: edited(lambda e: e.import_file(__file__, units=x))),
    **{
        f"render {name}": (name, lambda x, name=name: render(**{name: x}))
        for name in (
            "spp",
            "seconds",
            "noise",
            "time",
            "frame_interval",
            "clamp",
            "clamp_indirect",
            "seed",
            "max_depth",
            "revision",
        )
    },
    "render size": ("size", lambda x: render(size=(x, 24))),
    "render canvas": ("labels.canvas", lambda x: render(labels={"canvas": x})),
    "render radius": ("labels.keypoint_radius", lambda x: render(labels={"keypoint_radius": x})),
    "sequence": ("time", lambda x: lambda scene: list(scene.render_sequence("cam", [x], spp=1))),
    "rays origins": ("origins", lambda x: lambda s: s.cast_rays([[0, 0, x]], (0, 0, 1))),
    "rays directions": ("directions", lambda x: lambda s: s.cast_rays([[0, 0, 0]], (0, 0, x))),
    "rays t_max": (
        "t_max",
        lambda x: lambda s: s.cast_rays([[0, 0, 0]], (0, 0, 1), t_max=NAN if x == INF else x),
    ),
    "pick": ("pixels", lambda x: lambda s: s.pick("cam", [[0, x]])),
    "sample count": ("count", lambda x: lambda s: s.sample_surface(["ball"], x)),
    "sample seed": ("seed", lambda x: lambda s: s.sample_surface(["ball"], 10, seed=x)),
}


@pytest.mark.parametrize("name", NUMBERS)
def test_a_number_must_be_finite(world, name):
    field, call = NUMBERS[name]
    for x in (NAN, INF, -INF):
        check(world, lambda scene, x=x: call(x)(scene), (hg.InvalidArgument, field))
