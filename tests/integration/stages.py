"""USD stages as text, of test_usd.py. Metres and +Z up unless a test sets another."""

import itertools
import math

import heliograph as hg

_NUMBERS = itertools.count()
ABOVE = hg.look_at((0, 0, 2), (0, 0, 0), up=(0, 1, 0))  # x to the right, y up in its image


def written(folder, body, *metadata):
    """A file of its own: pxr keeps layers that are open."""
    own = metadata or ("metersPerUnit = 1", 'upAxis = "Z"')
    if not any("metersPerUnit" in line for line in own):
        own = (*own, "metersPerUnit = 1", 'upAxis = "Z"')
    path = folder / f"stage{next(_NUMBERS)}.usda"
    path.write_text("#usda 1.0\n(\n" + "\n".join(own) + "\n)\n" + body)
    return path


def put(scene, path, **options):
    """Imports a file and a camera above it that sees x and y from -1 to 1 in 64 pixels."""
    with scene.edit() as edit:
        asset = edit.import_usd(path, name="it", **options)
        edit.entity("above", camera=hg.Camera.orthographic(32, 64, 64), transform=ABOVE)
    return asset


def moved(at, op="translate", kind="double3"):
    return f"""
        {kind} xformOp:{op} = {at}
        uniform token[] xformOpOrder = ["xformOp:{op}"]"""


def quad(inside="", half=1.0, z=0.0):
    """A square about the origin that faces +Z, uv once over it."""
    corners = ", ".join(f"({x * half}, {y * half}, {z})" for x, y in _CORNERS)
    return f"""
        uniform token subdivisionScheme = "none"
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [{corners}]
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")
        {inside}"""


_CORNERS = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
BOUND = 'prepend apiSchemas = ["MaterialBindingAPI"]'


def preview(name, inputs, more=""):
    return f"""
def Material "{name}"
{{
    token outputs:surface.connect = </{name}/S.outputs:surface>
    def Shader "S"
    {{
        uniform token info:id = "UsdPreviewSurface"
        {inputs}
        token outputs:surface
    }}
    {more}
}}
"""


NESTED = """
def Xform "A"
{
    double3 xformOp:translate = (10, 20, 30)
    float3 xformOp:rotateXYZ = (20, 30, 40)
    float3 xformOp:scale = (1, 2, 0.5)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"]
    def Scope "Between"
    {
        def Xform "B"
        {
            matrix4d xformOp:transform = ((0, 1, 0, 0), (-1, 0, 0, 0), (0, 0, 1, 0), (5, 6, 7, 1))
            uniform token[] xformOpOrder = ["xformOp:transform"]
            def Xform "Away"
            {
                double3 xformOp:translate = (-50, 0, 0)
                uniform token[] xformOpOrder = ["!resetXformStack!", "xformOp:translate"]
            }
        }
        def Mesh "M"
        {
            uniform token subdivisionScheme = "none"
            int[] faceVertexCounts = [3, 3]
            int[] faceVertexIndices = [0, 1, 2, 0, 2, 3]
            point3f[] points = [(0, 0, 0), (4, 0, 0), (4, 4, 0), (0, 0, 4)]
        }
    }
}
"""

TILES = f"""
def Mesh "Tiles" ({BOUND})
{{
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4, 4, 4]
    int[] faceVertexIndices = [0, 1, 5, 4, 1, 2, 6, 5, 2, 3, 7, 6]
    point3f[] points = [(-1, -0.5, 0), (-0.5, -0.5, 0), (0.5, -0.5, 0), (1, -0.5, 0),
                        (-1, 0.5, 0), (-0.5, 0.5, 0), (0.5, 0.5, 0), (1, 0.5, 0)]
    rel material:binding = </Green>
    def GeomSubset "left" ({BOUND})
    {{
        uniform token elementType = "face"
        uniform token familyName = "materialBind"
        int[] indices = [0]
        rel material:binding = </Red>
    }}
    def GeomSubset "right" ({BOUND})
    {{
        uniform token elementType = "face"
        uniform token familyName = "materialBind"
        int[] indices = [2]
        rel material:binding = </Blue>
    }}
}}
{preview("Red", "color3f inputs:diffuseColor = (0.8, 0.1, 0.1)")}
{preview("Green", "color3f inputs:diffuseColor = (0.1, 0.7, 0.2)")}
{preview("Blue", "color3f inputs:diffuseColor = (0.1, 0.2, 0.9)")}
"""


def colored(kind, left, right):
    """Two squares side by side, with displayColor from left to right."""
    values = {
        "vertex": [left, None, right, left, None, right],
        "faceVarying": [left, None, None, left, None, right, right, None],
        "indexed": [left, None, right],
        "uniform": [left, right],
    }[kind]
    middle = tuple((a + b) / 2 for a, b in zip(left, right, strict=True))
    listed = ", ".join(str(value or middle) for value in values)
    interpolation = "faceVarying" if kind == "indexed" else kind
    indices = "int[] primvars:displayColor:indices = [0, 1, 1, 0, 1, 2, 2, 1]"
    return f"""
def Mesh "Two"
{{
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4, 4]
    int[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 5, 4]
    point3f[] points = [(-1, -1, 0), (0, -1, 0), (1, -1, 0), (-1, 1, 0), (0, 1, 0), (1, 1, 0)]
    color3f[] primvars:displayColor = [{listed}] (interpolation = "{interpolation}")
    {indices if kind == "indexed" else ""}
}}
"""


def textured(transform="", texture="", file="tex.png"):
    nodes = f"""
    def Shader "T"
    {{
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @{file}@
        token inputs:wrapS = "repeat"
        token inputs:wrapT = "repeat"
        token inputs:sourceColorSpace = "raw"
        {texture}
        float2 inputs:st.connect = </Look/X.outputs:result>
        float3 outputs:rgb
    }}
    def Shader "X"
    {{
        uniform token info:id = "UsdTransform2d"
        {transform}
        float2 inputs:in.connect = </Look/R.outputs:result>
        float2 outputs:result
    }}
    def Shader "R"
    {{
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "st"
        float2 outputs:result
    }}"""
    look = preview("Look", "color3f inputs:diffuseColor.connect = </Look/T.outputs:rgb>", nodes)
    return f'def Mesh "M" ({BOUND})\n{{{quad("rel material:binding = </Look>")}\n}}\n{look}'


# An arrow head whose fourth corner points inwards, and one of 5 corners beside it; clockwise.
ARROW = """
def Mesh "Arrow"
{
    uniform token subdivisionScheme = "none"
    uniform token orientation = "leftHanded"
    int[] faceVertexCounts = [4, 5]
    int[] faceVertexIndices = [0, 3, 2, 1, 4, 8, 7, 6, 5]
    point3f[] points = [(-0.9, -0.9, 0), (-0.5, 0, 0), (-0.1, -0.9, 0), (-0.5, 0.9, 0),
                        (0.1, -0.9, 0), (0.9, -0.9, 0), (0.9, 0.9, 0),
                        (0.5, -0.5, 0), (0.1, 0.9, 0)]
}
"""
ARROW_AREA = 0.5 * 0.8 * (1.8 - 0.9) + (0.8 * 1.8 - 0.5 * 0.8 * 1.4)


def cage(creases):
    """A cube of side 2 as a subdivision surface; corners by the bits of x, y, z."""
    corners = ", ".join(f"({x}, {y}, {z})" for z in (-1, 1) for y in (-1, 1) for x in (-1, 1))
    return f"""
def Mesh "Cage"
{{
    int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
    int[] faceVertexIndices = [0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4,
                               2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5]
    point3f[] points = [{corners}]
    {creases}
}}
"""


SHAPES = """
def Cube "Cube"
{
    double size = 1
}
def Sphere "Sphere"
{
    double radius = 0.5
}
def Cylinder "Cylinder"
{
    double radius = 0.5
    double height = 2
    token axis = "X"
}
def Cone "Cone"
{
    double radius = 0.5
    double height = 2
    token axis = "Y"
}
def Capsule "Capsule"
{
    double radius = 0.5
    double height = 2
}
def Plane "Plane"
{
    double width = 1
    double length = 2
}
def Plane "PlaneX"
{
    double width = 1
    double length = 2
    token axis = "X"
}
"""
AREAS = {
    "/Cube": 6.0,
    "/Sphere": math.pi,
    "/Cylinder": 2 * math.pi * 0.5 * 2 + 2 * math.pi * 0.25,
    "/Cone": math.pi * 0.5 * math.hypot(0.5, 2) + math.pi * 0.25,
    "/Capsule": 2 * math.pi * 0.5 * 2 + math.pi,
    "/Plane": 2.0,
    "/PlaneX": 2.0,
}

INSTANCES = """
def Xform "Left" (
    instanceable = true
    references = </Kept>
)
{
}
def Xform "Right" (
    instanceable = true
    references = </Kept>
)
{
    double3 xformOp:translate = (1, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
class Xform "Kept"
{
    def Sphere "Ball"
    {
        double radius = 0.1
    }
}
def PointInstancer "Many"
{
    point3f[] positions = [(0, 0, 1), (1, 0, 1), (2, 0, 1), (3, 0, 1), (4, 0, 1)]
    int[] protoIndices = [0, 0, 0, 1, 2]
    int64[] invisibleIds = [1]
    rel prototypes = [</Many/Cube>, </Many/Pair>, </Many/Others/Cube>]
    def Scope "Others"
    {
        def Cube "Cube"
        {
            double size = 0.2
        }
    }
    def Cube "Cube"
    {
        double size = 0.1
    }
    def Xform "Pair"
    {
        def Cube "Lower"
        {
            double size = 0.1
        }
        def Cube "Upper"
        {
            double size = 0.1
            double3 xformOp:translate = (0, 0, 0.5)
            uniform token[] xformOpOrder = ["xformOp:translate"]
        }
    }
}
"""


def _square(name, at, color, more=""):
    return f"""
def Mesh "{name}"
{{{quad(half=0.3)}
    color3f[] primvars:displayColor = [{color}]
    {more}{moved(at)}
}}
"""


CHOICES = f"""
def Xform "Choice" (
    variants = {{
        string look = "red"
    }}
    prepend variantSets = "look"
)
{{
    variantSet "look" = {{
        "red" {{{_square("Red", (-0.5, 0.5, 0), (0.8, 0.1, 0.1))}}}
        "blue" {{{_square("Blue", (-0.5, 0.5, 0), (0.1, 0.2, 0.9))}}}
    }}
}}
def Scope "Off"
{{
    token visibility = "invisible"
    {_square("Hidden", (0.5, 0.5, 0), (1, 1, 1))}
}}
{_square("Proxy", (-0.5, -0.5, 0), (0.1, 0.7, 0.2), 'uniform token purpose = "proxy"')}
def "Far" ( prepend payload = @./far.usda@ )
{{{moved((20, 0, 0))}
}}
"""

SEMANTICS = """
def Cube "New" ( prepend apiSchemas = ["SemanticsLabelsAPI:class"] )
{
    double size = 0.5
    token[] semantics:labels:class = ["bolt", "metal"]
}
def Cube "Old"
{
    double size = 0.5
    string semantic:Semantics:params:semanticType = "class"
    string semantic:Semantics:params:semanticData = "nut"
    double3 xformOp:translate = (0.7, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
