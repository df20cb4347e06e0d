"""USD stages that move, of test_usd.py."""

from stages import moved, quad

TURNING = """
def Cube "Turn"
{
    double size = 0.5
    float xformOp:rotateZ.timeSamples = { 0: 0, 24: 360 }
    double3 xformOp:translate = (1, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:rotateZ", "xformOp:translate"]
}
"""

_SKIN = 'prepend apiSchemas = ["SkelBindingAPI"]'
_ONE = "((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))"
_UP = "((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 1, 1))"
SKINNED = f"""
def SkelRoot "Arm" ({_SKIN})
{{{moved((1, 0, 0))}
    rel skel:skeleton = </Arm/Skel>
    def Skeleton "Skel" ({_SKIN})
    {{
        uniform token[] joints = ["a", "a/b"]
        uniform matrix4d[] bindTransforms = [{_ONE}, {_UP}]
        uniform matrix4d[] restTransforms = [{_ONE}, {_UP}]
        rel skel:animationSource = </Arm/Skel/Anim>
        def SkelAnimation "Anim"
        {{
            uniform token[] joints = ["a", "a/b"]
            uniform token[] blendShapes = ["lift"]
            float3[] translations = [(0, 0, 0), (0, 0, 1)]
            quatf[] rotations.timeSamples = {{
                0: [(1, 0, 0, 0), (1, 0, 0, 0)],
                24: [(1, 0, 0, 0), (0.70710678, 0, 0.70710678, 0)]
            }}
            half3[] scales = [(1, 1, 1), (1, 1, 1)]
            float[] blendShapeWeights = [0.5]
        }}
    }}
    def Mesh "Body" ({_SKIN})
    {{
        uniform token subdivisionScheme = "none"
        int[] faceVertexCounts = [4, 4]
        int[] faceVertexIndices = [0, 1, 2, 3, 4, 5, 6, 7]
        point3f[] points = [(-0.1, 0, 0), (0.1, 0, 0), (0.1, 0, 1), (-0.1, 0, 1),
                            (-0.1, 0, 1), (0.1, 0, 1), (0.1, 0, 2), (-0.1, 0, 2)]
        int[] primvars:skel:jointIndices = [0, 0, 0, 0, 1, 1, 1, 1] (
            elementSize = 1
            interpolation = "vertex"
        )
        float[] primvars:skel:jointWeights = [1, 1, 1, 1, 1, 1, 1, 1] (
            elementSize = 1
            interpolation = "vertex"
        )
        matrix4d primvars:skel:geomBindTransform = {_ONE}
    }}
    def Mesh "Face" ({_SKIN})
    {{{quad()}{moved((-1, 0, 0))}
        uniform token[] skel:blendShapes = ["lift"]
        rel skel:blendShapeTargets = [</Arm/Face/Lift>]
        def BlendShape "Lift"
        {{
            uniform vector3f[] offsets = [(0, 1, 0), (0, 1, 0)]
            uniform int[] pointIndices = [2, 3]
        }}
    }}
}}
"""
