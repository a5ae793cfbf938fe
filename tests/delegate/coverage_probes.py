"""A small stage for every schema of docs/coverage.md, and a value for each of its attributes.

A probe is the name of an attribute and USD text that authors it, over a stage on which it matters.
"""

from __future__ import annotations

from typing import NamedTuple


class Schema(NamedTuple):
    """stage: text below /World. prim: the path of the prim that probes go on. time: None: the default."""

    stage: str
    prim: str
    probes: dict[str, str]
    time: float | None = None


_QUAD = """
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
"""
_STRIP = """
    point3f[] points = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0)]
    int[] faceVertexCounts = [4, 4]
    int[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 5, 4]
"""
_TEXTURED = """
def Material "look" {
    token outputs:surface.connect = </World/look/surface.outputs:surface>
    def Shader "surface" {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor.connect = </World/look/color.outputs:result>
        token outputs:surface
    }
    def Shader "color" {
        uniform token info:id = "UsdPrimvarReader_float3"
        string inputs:varname = "tint"
        float3 outputs:result
    }
}
def Material "plain" {
    token outputs:surface.connect = </World/plain/surface.outputs:surface>
    def Shader "surface" {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor = (1, 0, 0)
        token outputs:surface
        token outputs:displacement
    }
}
"""


def _mesh(name: str = "prim", more: str = "", body: str = _QUAD) -> str:
    return f'def Mesh "{name}" {{\n{body}\n{more}\n}}\n'


def _prim(kind: str, body: str, name: str = "prim", metadata: str = "") -> str:
    return f'def {kind} "{name}" {metadata}{{\n{body}\n}}\n'


def _applied(schema: str, more: str = "") -> str:
    return f'(prepend apiSchemas = ["{schema}"]\n{more}) '


def _same(kind: str, probes: dict[str, str], more: str = "") -> Schema:
    """A prim of a type, which is called /World/prim."""
    return Schema(f'def {kind} "prim" {{\n{more}\n}}\n' + _mesh("ground"), "/World/prim", probes)


_LOCAL = {
    "velocities": "vector3f[] velocities = [(0, 9, 0), (0, 9, 0), (0, 9, 0), (0, 9, 0)]",
    "accelerations": "vector3f[] accelerations = [(0, 9, 0), (0, 9, 0), (0, 9, 0), (0, 9, 0)]",
}
# The shutter is open for half a frame.
_CAMERA = 'def Camera "camera" { double shutter:open = 0\n double shutter:close = 0.5\n'
_STILL = """
    point3f[] points.timeSamples = { 0: [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)] }
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
"""

GEOM = {
    "Imageable": Schema(
        _mesh(),
        "/World/prim",
        {
            "visibility": 'token visibility = "invisible"',
            "purpose": 'uniform token purpose = "guide"',
            "proxyPrim": "rel proxyPrim = </World/ground>",
        },
    ),
    "Xformable": Schema(
        _mesh("prim", "float3 xformOp:scale = (2, 2, 2)"),
        "/World/prim",
        {"xformOpOrder": 'uniform token[] xformOpOrder = ["xformOp:scale"]'},
    ),
    "Boundable": Schema(_mesh(), "/World/prim", {"extent": "float3[] extent = [(0, 0, 0), (9, 9, 9)]"}),
    "Gprim": Schema(
        _mesh(),
        "/World/prim",
        {
            "primvars:displayColor": "color3f[] primvars:displayColor = [(1, 0, 0)]",
            "primvars:displayOpacity": "float[] primvars:displayOpacity = [0.5]",
            "doubleSided": "uniform bool doubleSided = 1",
            "orientation": 'uniform token orientation = "leftHanded"',
        },
    ),
    "PointBased": Schema(
        _CAMERA + "}\n" + _mesh("prim", 'uniform token subdivisionScheme = "none"', _STILL),
        "/World/prim",
        {
            "points": "point3f[] points = [(0, 0, 0), (2, 0, 0), (1, 1, 0), (0, 1, 0)]",
            "normals": "normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0.6, 0.8)]",
            "velocities": _LOCAL["velocities"].replace(" = ", ".timeSamples = { 0: ") + "}",
            "accelerations": _LOCAL["velocities"].replace(" = ", ".timeSamples = { 0: ")
            + "}\n"
            + _LOCAL["accelerations"].replace(" = ", ".timeSamples = { 0: ")
            + "}",
        },
        0.0,
    ),
    "Mesh": Schema(
        _mesh(
            "prim",
            """
            int[] cornerIndices = [0]
            float[] cornerSharpnesses = [1]
            int[] creaseIndices = [1, 4]
            int[] creaseLengths = [2]
            float[] creaseSharpnesses = [1]
            """,
            _STRIP,
        ),
        "/World/prim",
        {
            "cornerIndices": "int[] cornerIndices = [2]",
            "cornerSharpnesses": "float[] cornerSharpnesses = [2]",
            "creaseIndices": "int[] creaseIndices = [0, 1]",
            "creaseLengths": "int[] creaseLengths = [3]\nint[] creaseIndices = [0, 1, 2]",
            "creaseSharpnesses": "float[] creaseSharpnesses = [2]",
            "faceVaryingLinearInterpolation": 'token faceVaryingLinearInterpolation = "all"',
            "faceVertexCounts": "int[] faceVertexCounts = [4]\nint[] faceVertexIndices = [0, 1, 4, 3]",
            "faceVertexIndices": "int[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 5, 1]",
            "holeIndices": "int[] holeIndices = [0]",
            "interpolateBoundary": 'token interpolateBoundary = "edgeOnly"',
            "subdivisionScheme": 'uniform token subdivisionScheme = "bilinear"',
            "triangleSubdivisionRule": 'token triangleSubdivisionRule = "smooth"',
        },
    ),
    "GeomSubset": Schema(
        _TEXTURED
        + _prim(
            "Mesh",
            _STRIP
            + """
            def GeomSubset "prim" (prepend apiSchemas = ["MaterialBindingAPI"]) {
                uniform token elementType = "face"
                uniform token familyName = "materialBind"
                int[] indices = [0]
                rel material:binding = </World/plain>
            }
            """,
            "mesh",
        ),
        "/World/mesh/prim",
        {
            "indices": "int[] indices = [1]",
            "elementType": 'uniform token elementType = "point"',
            "familyName": 'uniform token familyName = "other"',
        },
    ),
    "Sphere": _same("Sphere", {"radius": "double radius = 2"}),
    "Cube": _same("Cube", {"size": "double size = 3"}),
    **{
        kind: _same(
            kind,
            {
                "axis": 'uniform token axis = "X"',
                "height": "double height = 3",
                "radius": "double radius = 0.25",
            },
        )
        for kind in ("Cylinder", "Cone", "Capsule")
    },
    **{
        kind: _same(
            kind,
            {
                "axis": 'uniform token axis = "X"',
                "height": "double height = 3",
                "radiusBottom": "double radiusBottom = 0.25",
                "radiusTop": "double radiusTop = 0.125",
            },
        )
        for kind in ("Cylinder_1", "Capsule_1")
    },
    "Plane": _same(
        "Plane",
        {"axis": 'uniform token axis = "X"', "length": "double length = 3", "width": "double width = 3"},
    ),
    "Curves": Schema(
        """
        def BasisCurves "prim" {
            uniform token type = "linear"
            int[] curveVertexCounts = [4]
            point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
            float[] widths = [0.1] (interpolation = "constant")
        }
        """,
        "/World/prim",
        {
            "curveVertexCounts": "int[] curveVertexCounts = [2, 2]",
            "widths": 'float[] widths = [0.1, 0.2, 0.1, 0.1] (interpolation = "vertex")',
        },
    ),
    "BasisCurves": Schema(
        """
        def BasisCurves "prim" {
            int[] curveVertexCounts = [4]
            point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
            float[] widths = [0.1] (interpolation = "constant")
        }
        """,
        "/World/prim",
        {
            "basis": 'uniform token basis = "catmullRom"',
            "type": 'uniform token type = "linear"',
            "wrap": 'uniform token wrap = "periodic"\nuniform token basis = "bspline"',
        },
    ),
    "Points": Schema(
        """
        def Points "prim" {
            point3f[] points = [(0, 0, 0), (1, 0, 0)]
            float[] widths = [0.1, 0.1]
        }
        """,
        "/World/prim",
        {"widths": "float[] widths = [0.1, 0.2]", "ids": "int64[] ids = [7, 8]"},
    ),
    "PointInstancer": Schema(
        _CAMERA
        + """}
        def PointInstancer "prim" {
            rel prototypes = [</World/prim/a>, </World/prim/b>]
            int[] protoIndices.timeSamples = { 0: [0, 1] }
            point3f[] positions.timeSamples = { 0: [(0, 0, 0), (5, 0, 0)] }
            quath[] orientations.timeSamples = { 0: [(1, 0, 0, 0), (1, 0, 0, 0)] }
            vector3f[] velocities.timeSamples = { 0: [(0, 1, 0), (0, 1, 0)] }
            def Sphere "a" {}
            def Cube "b" {}
        }
        """,
        "/World/prim",
        {
            "prototypes": "rel prototypes = [</World/prim/b>, </World/prim/a>]",
            "protoIndices": "int[] protoIndices.timeSamples = { 0: [0, 0] }",
            "positions": "point3f[] positions.timeSamples = { 0: [(0, 0, 0), (5, 5, 0)] }",
            "orientations": "quath[] orientations.timeSamples = { 0: [(1, 0, 0, 0), (0.6, 0.8, 0, 0)] }",
            "orientationsf": "quatf[] orientationsf.timeSamples = { 0: [(1, 0, 0, 0), (0.6, 0.8, 0, 0)] }",
            "scales": "float3[] scales = [(1, 1, 1), (2, 2, 2)]",
            "velocities": "vector3f[] velocities.timeSamples = { 0: [(9, 0, 0), (9, 0, 0)] }",
            "accelerations": "vector3f[] accelerations.timeSamples = { 0: [(90, 0, 0), (0, 0, 0)] }",
            "angularVelocities": "vector3f[] angularVelocities.timeSamples = { 0: [(900, 0, 0), (0, 0, 0)] }",
            "ids": "int64[] ids = [17, 18]",
            "invisibleIds": "int64[] invisibleIds = [1]",
        },
        0.0,
    ),
    "Camera": Schema(
        _CAMERA
        + """float fStop = 4
            float focusDistance = 5
            token projection = "perspective"
        }
        """
        + _prim(
            "Xform",
            """
            double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 1: (1, 0, 0), 2: (4, 0, 0) }
            uniform token[] xformOpOrder = ["xformOp:translate"]
            """
            + _mesh(),
            "moving",
        ),
        "/World/camera",
        {
            "projection": 'token projection = "orthographic"',
            "horizontalAperture": "float horizontalAperture = 30",
            "verticalAperture": "float verticalAperture = 30",
            "horizontalApertureOffset": "float horizontalApertureOffset = 3",
            "verticalApertureOffset": "float verticalApertureOffset = 3",
            "focalLength": "float focalLength = 35",
            "clippingRange": "float2 clippingRange = (2, 20)",
            "clippingPlanes": "float4[] clippingPlanes = [(1, 0, 0, 0)]",
            "fStop": "float fStop = 2",
            "focusDistance": "float focusDistance = 3",
            "shutter:open": "double shutter:open = -0.5",
            "shutter:close": "double shutter:close = 1",
            "stereoRole": 'uniform token stereoRole = "left"',
            "exposure": "float exposure = 1",
            "exposure:fStop": "float exposure:fStop = 2",
            "exposure:iso": "float exposure:iso = 200",
            "exposure:responsivity": "float exposure:responsivity = 2",
            "exposure:time": "float exposure:time = 2",
        },
        0.5,
    ),
    "BackPlateAPI": Schema(
        'def Camera "camera" (prepend apiSchemas = ["BackPlateAPI:a"]) { }\n' + _mesh(),
        "/World/camera",
        {
            f"backPlate:__INSTANCE_NAME__:{name}": f"{kind} backPlate:a:{name} = {value}"
            for names, kind, value in (
                ("image alpha:image depth:image", "asset", "@x.exr@"),
                ("depth:cameraSpaceOffset depth:minOffset depth:normalizingFactor", "float", "3"),
                ("luma:offset luma:power luma:slope", "color3f", "(3, 3, 3)"),
                ("rotateXYZ:tweak scale:tweak translate:tweak", "float3", "(3, 3, 3)"),
                ("plateVisibility", "token", '"invisible"'),
            )
            for name in names.split()
        },
    ),
    "MotionAPI": Schema(
        _prim("Xform", _mesh("mesh", _LOCAL["velocities"]), metadata=_applied("MotionAPI")),
        "/World/prim",
        {
            "motion:blurScale": "float motion:blurScale = 2",
            "motion:velocityScale": "float motion:velocityScale = 2",
            "motion:nonlinearSampleCount": "int motion:nonlinearSampleCount = 5",
        },
    ),
    "VisibilityAPI": Schema(
        _prim("Xform", _mesh("mesh"), metadata=_applied("VisibilityAPI")) + _mesh("ground"),
        "/World/prim",
        {
            "guideVisibility": 'uniform token guideVisibility = "visible"',
            "proxyVisibility": 'uniform token proxyVisibility = "invisible"',
            "renderVisibility": 'uniform token renderVisibility = "invisible"',
        },
    ),
    "GeomModelAPI": Schema(
        _prim("Xform", _mesh("mesh"), metadata=_applied("GeomModelAPI", 'kind = "component"')),
        "/World/prim",
        {
            "model:drawMode": 'uniform token model:drawMode = "bounds"',
            "model:applyDrawMode": "uniform bool model:applyDrawMode = 1",
            "model:cardGeometry": 'uniform token model:cardGeometry = "box"',
            **{
                f"model:cardTexture{side}": f"asset model:cardTexture{side} = @x.png@"
                for side in ("XNeg", "XPos", "YNeg", "YPos", "ZNeg", "ZPos")
            },
            "model:cardVisibility": 'uniform token model:cardVisibility = "front"',
            "model:drawModeColor": "uniform float3 model:drawModeColor = (1, 0, 0)",
        },
    ),
    **{kind: _same(kind, {}) for kind in ("Scope", "Xform")},
    "HermiteCurves": _same("HermiteCurves", {"tangents": "vector3f[] tangents = [(1, 0, 0)]"}),
    "NurbsCurves": _same(
        "NurbsCurves",
        {
            "knots": "double[] knots = [0, 1]",
            "order": "int[] order = [2]",
            "pointWeights": "double[] pointWeights = [1]",
            "ranges": "double2[] ranges = [(0, 1)]",
        },
    ),
    "NurbsPatch": _same(
        "NurbsPatch",
        {
            "pointWeights": "double[] pointWeights = [1]",
            "trimCurve:counts": "int[] trimCurve:counts = [1]",
            "trimCurve:knots": "double[] trimCurve:knots = [1]",
            "trimCurve:orders": "int[] trimCurve:orders = [1]",
            "trimCurve:points": "double3[] trimCurve:points = [(1, 1, 1)]",
            "trimCurve:ranges": "double2[] trimCurve:ranges = [(0, 1)]",
            "trimCurve:vertexCounts": "int[] trimCurve:vertexCounts = [1]",
            **{
                f"{d}{name}": text.replace("?", d)
                for d in "uv"
                for name, text in {
                    "Form": 'uniform token ?Form = "closed"',
                    "Knots": "double[] ?Knots = [0, 1]",
                    "Order": "int ?Order = 2",
                    "Range": "double2 ?Range = (0, 1)",
                    "VertexCount": "int ?VertexCount = 2",
                }.items()
            },
        },
    ),
    "TetMesh": _same(
        "TetMesh",
        {
            "surfaceFaceVertexIndices": "int3[] surfaceFaceVertexIndices = [(0, 1, 2)]",
            "tetVertexIndices": "int4[] tetVertexIndices = [(0, 1, 2, 3)]",
        },
    ),
}

_LOOK = _TEXTURED + _mesh("mesh", "rel material:binding = </World/plain>").replace(
    '"mesh" {', '"mesh" (prepend apiSchemas = ["MaterialBindingAPI"]) {'
)
SHADE = {
    "Material": Schema(
        _LOOK,
        "/World/plain",
        {
            "outputs:surface": "token outputs:surface.connect = </World/look/surface.outputs:surface>",
            "outputs:displacement": """
                token outputs:displacement.connect = </World/plain/surface.outputs:displacement>
                over "surface" {
                    float inputs:displacement = 0.5
                }
            """,
            "outputs:volume": "token outputs:volume.connect = </World/plain/surface.outputs:surface>",
        },
    ),
    "NodeDefAPI": Schema(
        _LOOK,
        "/World/plain/surface",
        {
            "info:id": 'uniform token info:id = "Unknown"',
            "info:implementationSource": """
                uniform token info:implementationSource = "sourceCode"
                uniform string info:glslfx:sourceCode = "x"
                uniform string info:encore:glsl:sourceCode = "void surface() { diffuseColor = vec3(1.0); }"
            """,
        },
    ),
    "CoordSysAPI": Schema(
        _prim("Xform", _mesh("mesh"), metadata=_applied("CoordSysAPI:a")),
        "/World/prim",
        {"coordSys:__INSTANCE_NAME__:binding": "rel coordSys:a:binding = </World/prim>"},
    ),
}


def _light(kind: str, probes: dict[str, str], more: str = "") -> Schema:
    return Schema(f'def {kind} "prim" {{\n{more}\n}}\n' + _mesh("ground"), "/World/prim", probes)


_SHADER_ID = {"light:shaderId": 'uniform token light:shaderId = "Own"'}
_DOME = {
    "inputs:texture:file": "asset inputs:texture:file = @TEXTURE@",
    "inputs:texture:format": 'token inputs:texture:format = "mirroredBall"\n'
    "asset inputs:texture:file = @TEXTURE@",
    "portals": "rel portals = </World/ground>",
    "guideRadius": "float guideRadius = 7",
    **_SHADER_ID,
}
_RADIUS = {"inputs:radius": "float inputs:radius = 2"}
LUX = {
    "LightAPI": _light(
        "SphereLight",
        {
            "inputs:color": "color3f inputs:color = (1, 0, 0)",
            "inputs:colorTemperature": "float inputs:colorTemperature = 3000\n"
            "bool inputs:enableColorTemperature = 1",
            "inputs:enableColorTemperature": "bool inputs:enableColorTemperature = 1\n"
            "float inputs:colorTemperature = 3000",
            "inputs:intensity": "float inputs:intensity = 3",
            "inputs:exposure": "float inputs:exposure = 3",
            "inputs:normalize": "bool inputs:normalize = 1",
            "inputs:diffuse": "float inputs:diffuse = 0.5",
            "inputs:specular": "float inputs:specular = 0.5",
            "collection:lightLink:includeRoot": "uniform bool collection:lightLink:includeRoot = 0",
            "collection:shadowLink:includeRoot": "uniform bool collection:shadowLink:includeRoot = 0",
            "light:filters": "rel light:filters = </World/ground>",
            **_SHADER_ID,
        },
    ),
    "DistantLight": _light(
        "DistantLight",
        {
            "inputs:angle": "float inputs:angle = 5",
            "inputs:intensity": "float inputs:intensity = 3",
            **_SHADER_ID,
        },
    ),
    "RectLight": _light(
        "RectLight",
        {
            "inputs:width": "float inputs:width = 3",
            "inputs:height": "float inputs:height = 3",
            "inputs:texture:file": "asset inputs:texture:file = @TEXTURE@",
            **_SHADER_ID,
        },
    ),
    "DiskLight": _light("DiskLight", {**_RADIUS, **_SHADER_ID}),
    "SphereLight": _light("SphereLight", {**_RADIUS, "treatAsPoint": "bool treatAsPoint = 1", **_SHADER_ID}),
    "CylinderLight": _light(
        "CylinderLight",
        {
            **_RADIUS,
            "inputs:length": "float inputs:length = 3",
            "treatAsLine": "bool treatAsLine = 1",
            **_SHADER_ID,
        },
    ),
    "DomeLight": _light("DomeLight", _DOME),
    "DomeLight_1": _light("DomeLight_1", {**_DOME, "poleAxis": 'uniform token poleAxis = "Z"'}),
    "GeometryLight": Schema(
        'def GeometryLight "prim" {\nrel geometry = </World/a>\n}\n' + _mesh("a") + _mesh("b"),
        "/World/prim",
        {"geometry": "rel geometry = </World/b>", **_SHADER_ID},
    ),
    "MeshLightAPI": Schema(
        _mesh("prim").replace('"prim" {', '"prim" (prepend apiSchemas = ["MeshLightAPI"]) {'),
        "/World/prim",
        {
            "light:materialSyncMode": 'uniform token light:materialSyncMode = "noMaterialResponse"',
            **_SHADER_ID,
        },
    ),
    "ShapingAPI": Schema(
        _prim(
            "SphereLight",
            "float inputs:shaping:cone:angle = 60\nfloat inputs:shaping:focus = 1",
            metadata=_applied("ShapingAPI"),
        )
        + _mesh("ground"),
        "/World/prim",
        {
            "inputs:shaping:cone:angle": "float inputs:shaping:cone:angle = 30",
            "inputs:shaping:cone:softness": "float inputs:shaping:cone:softness = 0.5",
            "inputs:shaping:focus": "float inputs:shaping:focus = 3",
            "inputs:shaping:focusTint": "color3f inputs:shaping:focusTint = (1, 0, 0)",
            "inputs:shaping:ies:file": "asset inputs:shaping:ies:file = @x.ies@",
            "inputs:shaping:ies:angleScale": "float inputs:shaping:ies:angleScale = 0.5",
            "inputs:shaping:ies:normalize": "bool inputs:shaping:ies:normalize = 1",
        },
    ),
    "ShadowAPI": Schema(
        _prim(
            "SphereLight",
            "float inputs:shadow:distance = 10\nfloat inputs:shadow:falloff = 1",
            metadata=_applied("ShadowAPI"),
        )
        + _mesh("ground"),
        "/World/prim",
        {
            "inputs:shadow:color": "color3f inputs:shadow:color = (1, 0, 0)",
            "inputs:shadow:distance": "float inputs:shadow:distance = 5",
            "inputs:shadow:enable": "bool inputs:shadow:enable = 0",
            "inputs:shadow:falloff": "float inputs:shadow:falloff = 2",
            "inputs:shadow:falloffGamma": "float inputs:shadow:falloffGamma = 2",
        },
    ),
    "PortalLight": _light(
        "PortalLight",
        {"inputs:width": "float inputs:width = 3", "inputs:height": "float inputs:height = 3", **_SHADER_ID},
    ),
    "PluginLight": _light("PluginLight", {}),
    "PluginLightFilter": _light("PluginLightFilter", {}),
    "LightFilter": _light(
        "LightFilter",
        {
            "collection:filterLink:includeRoot": "uniform bool collection:filterLink:includeRoot = 0",
            "lightFilter:shaderId": 'uniform token lightFilter:shaderId = "x"',
        },
    ),
    "VolumeLightAPI": Schema(
        'def Volume "prim" (prepend apiSchemas = ["VolumeLightAPI"]) { }\n' + _mesh("ground"),
        "/World/prim",
        {"light:materialSyncMode": 'uniform token light:materialSyncMode = "independent"', **_SHADER_ID},
    ),
    **{
        api: Schema(
            _prim("Xform", _mesh("mesh"), metadata=_applied(api)),
            "/World/prim",
            {
                "lightList": "rel lightList = </World/prim/mesh>",
                "lightList:cacheBehavior": 'token lightList:cacheBehavior = "ignore"',
            },
        )
        for api in ("LightListAPI", "ListAPI")
    },
}

_JOINTS = 'uniform token[] joints = ["a", "a/b"]'
_UNIT = "( (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1) )"
_UP = "( (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 1, 0, 1) )"
_TURNED = "(0.8, 0, 0, 0.6)"
_SKEL = f"""
def SkelRoot "root" (prepend apiSchemas = ["SkelBindingAPI"]) {{
    def Skeleton "skeleton" (prepend apiSchemas = ["SkelBindingAPI"]) {{
        {_JOINTS}
        uniform matrix4d[] bindTransforms = [{_UNIT}, {_UNIT}]
        uniform matrix4d[] restTransforms = [{_UNIT}, {_UP}]
        rel skel:animationSource = </World/root/animation>
    }}
    def SkelAnimation "animation" {{
        uniform token[] joints = ["a/b"]
        float3[] translations = [(0, 1, 0)]
        quatf[] rotations = [{_TURNED}]
        half3[] scales = [(1, 1, 1)]
        uniform token[] blendShapes = ["lift"]
        float[] blendShapeWeights = [0.5]
    }}
    def SkelAnimation "other" {{
        uniform token[] joints = ["a"]
        float3[] translations = [(0, 0, 5)]
        quatf[] rotations = [(1, 0, 0, 0)]
        half3[] scales = [(1, 1, 1)]
    }}
    def Skeleton "second" {{
        {_JOINTS}
        uniform matrix4d[] bindTransforms = [{_UNIT}, {_UNIT}]
        uniform matrix4d[] restTransforms = [{_UP}, {_UP}]
    }}
    def Mesh "mesh" (prepend apiSchemas = ["SkelBindingAPI"]) {{
        uniform token subdivisionScheme = "none"
        {_QUAD}
        normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)] (interpolation = "vertex")
        rel skel:skeleton = </World/root/skeleton>
        int[] primvars:skel:jointIndices = [0, 1, 0, 1, 0, 1, 0, 1] (
            interpolation = "vertex"; elementSize = 2)
        float[] primvars:skel:jointWeights = [0.5, 0.5, 1, 0, 0.25, 0.75, 0, 1] (
            interpolation = "vertex"; elementSize = 2)
        uniform token[] skel:blendShapes = ["lift"]
        rel skel:blendShapeTargets = </World/root/mesh/lift>
        def BlendShape "lift" {{
            uniform vector3f[] offsets = [(0, 0, 1)]
            uniform vector3f[] normalOffsets = [(0, 1, 0)]
            uniform int[] pointIndices = [2]
        }}
        def BlendShape "other" {{
            uniform vector3f[] offsets = [(0, 0, 3)]
            uniform int[] pointIndices = [1]
        }}
    }}
}}
"""
SKEL = {
    "Skeleton": Schema(
        _SKEL,
        "/World/root/skeleton",
        {
            "joints": 'uniform token[] joints = ["b", "a"]',
            "bindTransforms": f"uniform matrix4d[] bindTransforms = [{_UNIT}, {_UP}]",
            "restTransforms": f"uniform matrix4d[] restTransforms = [{_UP}, {_UP}]",
            "jointNames": 'uniform token[] jointNames = ["x", "y"]',
        },
    ),
    "SkelAnimation": Schema(
        _SKEL,
        "/World/root/animation",
        {
            "joints": 'uniform token[] joints = ["a"]',
            "translations": "float3[] translations = [(0, 2, 0)]",
            "rotations": "quatf[] rotations = [(1, 0, 0, 0)]",
            "scales": "half3[] scales = [(2, 2, 2)]",
            "blendShapes": 'uniform token[] blendShapes = ["other"]',
            "blendShapeWeights": "float[] blendShapeWeights = [1]",
        },
    ),
    "SkelBindingAPI": Schema(
        _SKEL,
        "/World/root/mesh",
        {
            "skel:skeleton": "rel skel:skeleton = </World/root/second>",
            "skel:joints": 'uniform token[] skel:joints = ["a/b", "a"]',
            "skel:blendShapes": 'uniform token[] skel:blendShapes = ["other"]',
            "skel:blendShapeTargets": "rel skel:blendShapeTargets = </World/root/mesh/other>",
            "primvars:skel:jointIndices": "int[] primvars:skel:jointIndices = [1, 0, 1, 0, 1, 0, 1, 0]",
            "primvars:skel:jointWeights": "float[] primvars:skel:jointWeights = [1, 0, 1, 0, 1, 0, 1, 0]",
            "primvars:skel:geomBindTransform": f"matrix4d primvars:skel:geomBindTransform = {_UP}",
            "primvars:skel:skinningMethod": 'uniform token primvars:skel:skinningMethod = "dualQuaternion"',
        },
    ),
    "BlendShape": Schema(
        _SKEL,
        "/World/root/mesh/lift",
        {
            "offsets": "uniform vector3f[] offsets = [(0, 0, 2)]",
            "normalOffsets": "uniform vector3f[] normalOffsets = [(1, 0, 0)]",
            "pointIndices": "uniform int[] pointIndices = [1]",
        },
    ),
}
# Where they matter to other prims than the rest of their schema.
OTHERS = {
    "skel:animationSource": Schema(
        _SKEL,
        "/World/root/skeleton",
        {"skel:animationSource": "rel skel:animationSource = </World/root/other>"},
    ),
    "light:materialSyncMode": Schema(
        'def Sphere "prim" (prepend apiSchemas = ["LightAPI"]) { }\n' + _mesh("ground"),
        "/World/prim",
        {"light:materialSyncMode": 'uniform token light:materialSyncMode = "independent"'},
    ),
}

PROBES = GEOM | SHADE | LUX | SKEL
