"""USD stages with cameras, lights and materials, of test_usd_looks.py; the others: stages.py."""

import math

from stages import BOUND, moved, preview, quad, textured


def mdl(name, module, inputs):
    return f"""
def Material "{name}"
{{
    token outputs:mdl:surface.connect = </{name}/S.outputs:out>
    def Shader "S"
    {{
        uniform token info:implementationSource = "sourceAsset"
        uniform asset info:mdl:sourceAsset = @{module}.mdl@
        uniform token info:mdl:sourceAsset:subIdentifier = "{module}"
        {inputs}
        token outputs:out
    }}
}}
"""


CAMERA = f"""
def Mesh "M"
{{{quad(z=-4)}
}}
def Camera "Cam"
{{
    float focalLength = 20
    float horizontalAperture = 20
    float verticalAperture = 10
    float2 clippingRange = (1, 1000)
}}
def Camera "Shifted"
{{
    float focalLength = 20
    float horizontalAperture = 20
    float verticalAperture = 10
    float horizontalApertureOffset = 2
    float2 clippingRange = (1, 1000)
}}
"""

_AT = moved((0, 0, 4))
# Text of a light, and the irradiance that it gives at the origin of a floor 4 m below.
LIGHTS = {
    "rectangle": (
        f'RectLight "L" {{ float inputs:intensity = 100\nfloat inputs:width = 0.2\n'
        f"float inputs:height = 0.2\n{_AT}\n}}",
        100 * 0.04 / 16,
    ),
    "sphere": (
        f'SphereLight "L" {{ float inputs:intensity = 25\nfloat inputs:exposure = 2\n'
        f"float inputs:radius = 0.1\n{_AT}\n}}",
        100 * math.pi * 0.01 / 16,
    ),
    "sphere, normalized": (
        f'SphereLight "L" {{ float inputs:intensity = 100\nbool inputs:normalize = 1\n'
        f"float inputs:radius = 0.3\n{_AT}\n}}",
        100 / (4 * 16),
    ),
    "disk": (
        f'DiskLight "L" {{ float inputs:intensity = 100\nfloat inputs:radius = 0.1\n{_AT}\n}}',
        100 * math.pi * 0.01 / 16.01,
    ),
    "cylinder": (
        f'CylinderLight "L" {{ float inputs:intensity = 100\nfloat inputs:radius = 0.02\n'
        f"float inputs:length = 0.2\n{_AT}\n}}",
        100 * 0.04 * 0.2 / 16,
    ),
    "distant": (
        'DistantLight "L" { float inputs:intensity = 10\nfloat inputs:angle = 10\n}',
        10 * math.pi * math.sin(math.radians(5)) ** 2,
    ),
    "distant, normalized": (
        'DistantLight "L" { float inputs:intensity = 10\nbool inputs:normalize = 1\n}',
        10.0,
    ),
    "dome": (
        'DomeLight "L" { float inputs:intensity = 1\nfloat inputs:exposure = 1\n'
        "color3f inputs:color = (1, 0.5, 0.25)\n}",
        (2 * math.pi, math.pi, 0.5 * math.pi),
    ),
}


_WHITE = "color3f inputs:diffuseColor = (1, 1, 1)\nfloat inputs:ior = 1"


def lit(kind):
    floor = f'def Mesh "Floor" ({BOUND})\n{{{quad("rel material:binding = </White>")}\n}}\n'
    return f"{floor}{preview('White', _WHITE)}\ndef {LIGHTS[kind][0]}\n"


IN_CENTIMETRES = f"""
def Mesh "Floor" ({BOUND})
{{{quad("rel material:binding = </White>", half=100)}
}}
{preview("White", _WHITE)}
def SphereLight "L"
{{
    float inputs:intensity = 100
    float inputs:radius = 10
    {moved((0, 0, 400))}
}}
"""

DOME = """
def DomeLight "Sky"
{
    float inputs:intensity = 2
    asset inputs:texture:file = @sky.png@
}
"""


def _bound(name, x):
    binding = f"rel material:binding = </{name}>"
    return f'def Mesh "M{name}" ({BOUND})\n{{{quad(binding, 0.1)}{moved((x, 0, 0))}\n}}\n'


_NAMES = ("Preview", "Omni", "Glass", "Mine")
MATERIALS = "".join(
    [
        *(_bound(name, 0.3 * i) for i, name in enumerate(_NAMES)),
        preview(
            "Preview",
            "float inputs:metallic = 1\nfloat inputs:roughness = 0.25\n"
            "float inputs:clearcoat = 0.5\ncolor3f inputs:emissiveColor = (1, 2, 3)",
        ),
        mdl(
            "Omni",
            "OmniPBR",
            "color3f inputs:diffuse_color_constant = (0.5, 0.4, 0.2)\n"
            "color3f inputs:diffuse_tint = (0.5, 0.5, 0.5)\n"
            "float inputs:reflection_roughness_constant = 0.3\n"
            "float inputs:metallic_constant = 0.9\nbool inputs:enable_emission = 1\n"
            "float inputs:emissive_intensity = 683",
        ),
        mdl("Glass", "OmniGlass", "float inputs:glass_ior = 1.3"),
        mdl("Mine", "MyOwn", ""),
    ]
)

LEFT_OUT = f"""
def NurbsCurves "Curves"
{{
    int[] curveVertexCounts = [2]
    point3f[] points = [(0, 0, 0), (1, 0, 0)]
}}
def Mesh "Ball"
{{
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0)]
}}
def Mesh "Broken"
{{
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 9]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0)]
}}
def SphereLight "Lamp" ( prepend apiSchemas = ["ShapingAPI"] )
{{
    asset inputs:shaping:ies:file = @lamp.ies@
}}
def Xform "Gone" ( references = @gone.usda@ )
{{
}}
def PhysicsRevoluteJoint "Hinge"
{{
}}
{textured(file="none.png")}
"""

# Numbers that are none, faces that are none, a prototype that contains itself.
BROKEN = """
def Xform "Zero"
{
    float3 xformOp:scale = (0, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:scale"]
    def Cube "C"
    {
    }
}
def Xform "Nan"
{
    double3 xformOp:translate = (nan, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Cube "Inf"
{
    double size = inf
}
def Mesh "NanPoints"
{
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (nan, 1, 0)]
}
def Mesh "Neg"
{
    int[] faceVertexCounts = [-3, 6]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0)]
}
def Mesh "Two"
{
    int[] faceVertexCounts = [2, 1, 0]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0)]
}
def Mesh "Flat"
{
    int[] faceVertexCounts = [3, 5]
    int[] faceVertexIndices = [0, 0, 0, 0, 0, 1, 1, 0]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0)]
    normal3f[] normals = [(0, 0, 1)] (interpolation = "vertex")
}
def Camera "Cam"
{
    float focalLength = nan
    float horizontalAperture = -3
    float2 clippingRange = (-1, -2)
}
def Camera "Cam2"
{
    float2 clippingRange = (-1, -2)
    float fStop = 1e-9
    float focusDistance = 1e30
}
def SphereLight "L"
{
    float inputs:radius = -1
    float inputs:intensity = -5
    color3f inputs:color = (-1, 1, 1)
}
def PointInstancer "I"
{
    point3f[] positions = [(0, 0, 0)]
    int[] protoIndices = [7]
}
def PointInstancer "Self"
{
    point3f[] positions = [(0, 0, 0)]
    int[] protoIndices = [0]
    rel prototypes = [</Self>]
}
"""

_TEXTURED = """
        asset inputs:diffuse_texture = @color.png@
        color3f inputs:diffuse_tint = (1, 0.5, 1)
        bool inputs:enable_ORM_texture = 1
        asset inputs:ORM_texture = @orm.png@
        """
OMNI_TEXTURES = f"""
def Mesh "M" ({BOUND})
{{{quad("rel material:binding = </Omni>")}
}}
{mdl("Omni", "OmniPBR", _TEXTURED)}
"""
