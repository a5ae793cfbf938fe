"""Small stages for tests of the translation, and what they must come to, found without it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio
from encore.render_index import RenderIndex, SyncOptions, Translation
from pxr import Sdf, Usd, UsdGeom, UsdShade, Vt

Points = npt.NDArray[np.float64]
SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]


def new_stage() -> Usd.Stage:
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.Xform.Define(stage, "/World")
    return stage


def translate(stage: Usd.Stage, **options: Any) -> Translation:
    return RenderIndex(stage, SyncOptions(**{"camera_light": False, **options})).sync()


def add_square(stage: Usd.Stage, path: str, scheme: str = "none") -> UsdGeom.Mesh:
    """One face in the xy plane, from the origin to (1, 1)."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(SQUARE)
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    mesh.CreateSubdivisionSchemeAttr(scheme)
    return mesh


def add_strip(stage: Usd.Stage, path: str, scheme: str = "none") -> UsdGeom.Mesh:
    """Three quads side by side along x."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr([(x, y, 0) for x in range(4) for y in range(2)])
    mesh.CreateFaceVertexCountsAttr([4, 4, 4])
    mesh.CreateFaceVertexIndicesAttr([i for x in (0, 2, 4) for i in (x, x + 2, x + 3, x + 1)])
    mesh.CreateSubdivisionSchemeAttr(scheme)
    return mesh


def add_material(stage: Usd.Stage, path: str, **inputs: Any) -> UsdShade.Material:
    """A UsdPreviewSurface with constant inputs."""
    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, f"{path}/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    for name, value in inputs.items():
        if isinstance(value, str):
            kind = Sdf.ValueTypeNames.Token
        elif isinstance(value, tuple):
            kind = Sdf.ValueTypeNames.Color3f
        else:
            kind = Sdf.ValueTypeNames.Int if isinstance(value, int) else Sdf.ValueTypeNames.Float
        shader.CreateInput(name, kind).Set(value)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    return material


def surface(material: UsdShade.Material) -> UsdShade.Shader:
    return UsdShade.Shader(material.GetPrim().GetChild("Surface"))


def bind(prim: Any, material: UsdShade.Material, strength: str = UsdShade.Tokens.fallbackStrength) -> None:
    UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(material, strength)


def add_instance(stage: Usd.Stage, path: str, source: str = "/Asset") -> Usd.Prim:
    """An Xform that shares what is below `source` with all others that do."""
    prim = UsdGeom.Xform.Define(stage, path).GetPrim()
    prim.GetReferences().AddInternalReference(source)
    prim.SetInstanceable(True)
    return prim


def add_chain(stage: Usd.Stage, depth: int) -> str:
    """A chain of so many Xforms below /World; the path of the last one."""
    path = "/World" + "/X" * depth
    layer = stage.GetRootLayer()
    with Sdf.ChangeBlock():
        Sdf.CreatePrimInLayer(layer, path)
        prim = layer.GetPrimAtPath(path)
        while prim.path != Sdf.Path("/World"):
            prim.specifier, prim.typeName = Sdf.SpecifierDef, "Xform"
            prim = prim.nameParent
    return path


def add_point_instancer(
    stage: Usd.Stage, path: str, prototypes: list[str], indices: list[int]
) -> UsdGeom.PointInstancer:
    """Instances at (10, 0, 0), (20, 0, 0), …"""
    instancer = UsdGeom.PointInstancer.Define(stage, path)
    instancer.CreatePrototypesRel().SetTargets(prototypes)
    instancer.CreateProtoIndicesAttr(indices)
    instancer.CreatePositionsAttr(Vt.Vec3fArray([(10.0 * (i + 1), 0, 0) for i in range(len(indices))]))
    return instancer


def meshes(translation: Translation) -> dict[str, dict[str, Any]]:
    scene = translation.scene
    return {m["path"]: m for m in (scene.mesh(i) for i in range(scene.mesh_count))}


def materials(translation: Translation) -> dict[str, dict[str, Any]]:
    scene = translation.scene
    return {m["path"]: m for m in (scene.material(i) for i in range(scene.material_count))}


def lights(translation: Translation) -> dict[str, dict[str, Any]]:
    scene = translation.scene
    return {m["path"]: m for m in (scene.light(i) for i in range(scene.light_count))}


def instances(translation: Translation) -> dict[str, dict[str, Any]]:
    scene = translation.scene
    found = [scene.instance(i) for i in range(scene.instance_count)]
    assert len({i["path"] for i in found}) == len(found), "paths of instances are unique"
    return {i["path"]: i for i in found}


def material_name(translation: Translation, instance: str, face: int = 0) -> str:
    """Path of the material that the first mesh of an instance shows on a face."""
    scene = translation.scene
    placed = instances(translation)[instance]
    index = placed["material"]
    if index < 0:
        mesh = scene.mesh(scene.prototype(placed["prototype"])["meshes"][0])
        index = mesh["material"]
        if mesh["face_materials"].size and mesh["face_materials"][face] >= 0:
            index = mesh["face_materials"][face]
    return str(scene.material(index)["path"])


def kinds(translation: Translation) -> dict[str, int]:
    """Reports: kind → prims."""
    return {report.kind: report.count for report in translation.reports}


def sorted_points(points: list[Points]) -> Points:
    """All points, in an order that depends on their places only."""
    rounded = np.round(np.concatenate(points), 3) + 0.0
    return rounded[np.lexsort(rounded.T)]


def placed_points(translation: Translation) -> Points:
    """World-space points of everything that the scene shows."""
    scene = translation.scene
    found = []
    for placed in (scene.instance(i) for i in range(scene.instance_count)):
        matrix = placed["to_world"]
        for index in scene.prototype(placed["prototype"])["meshes"]:
            points = scene.mesh(index)["points"].astype(np.float64)
            found.append(points @ matrix[:3, :3] + matrix[3, :3])
    return sorted_points(found)


def expected_points(stage: Usd.Stage) -> Points:
    """World-space points of all meshes, by walking the stage with nothing shared."""
    cache = UsdGeom.XformCache()
    found: list[Points] = []

    def walk(prim: Usd.Prim, parent: Points) -> None:
        if UsdGeom.Imageable(prim) and prim.GetAttribute("visibility").Get() == "invisible":
            return
        local, resets = cache.GetLocalTransformation(prim)
        inside(prim, np.array(local) if resets else np.array(local) @ parent)

    def inside(prim: Usd.Prim, matrix: Points) -> None:
        if prim.IsA(UsdGeom.Mesh):
            points = np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get(), dtype=np.float64)
            found.append(points @ matrix[:3, :3] + matrix[3, :3])
        if prim.IsA(UsdGeom.PointInstancer):
            instancer = UsdGeom.PointInstancer(prim)
            now = Usd.TimeCode.Default()
            masked = instancer.ComputeMaskAtTime(now) or [True] * len(instancer.GetProtoIndicesAttr().Get())
            matrices = instancer.ComputeInstanceTransformsAtTime(
                now, now, UsdGeom.PointInstancer.IncludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
            )
            targets = instancer.GetPrototypesRel().GetTargets()
            for shown, index, placed in zip(
                masked, instancer.GetProtoIndicesAttr().Get(), matrices, strict=True
            ):
                if shown:
                    inside(stage.GetPrimAtPath(targets[index]), np.array(placed) @ matrix)
            return
        for child in prim.GetFilteredChildren(Usd.TraverseInstanceProxies(Usd.PrimIsActive)):
            if child.HasDefiningSpecifier():
                walk(child, matrix)

    for prim in stage.GetPseudoRoot().GetChildren():
        walk(prim, np.eye(4))
    return sorted_points(found)


def write_image(path: Path, pixels: npt.NDArray[Any] | None = None) -> str:
    """An image file of pixels (h, w, channels) from 0 to 1, top row first, 8 bit but for EXR; else white."""
    values = np.ones((1, 1, 3)) if pixels is None else pixels
    height, width, channels = values.shape
    spec = oiio.ImageSpec(width, height, channels, "float" if path.suffix == ".exr" else "uint8")
    spec.attribute("oiio:UnassociatedAlpha", 1)
    output = oiio.ImageOutput.create(str(path))
    assert output and output.open(str(path), spec)
    assert output.write_image(values.astype(np.float32))
    output.close()
    return str(path)


def connect_texture(
    stage: Usd.Stage, shader: UsdShade.Shader, file: str, varname: str = "st", target: str = "diffuseColor"
) -> UsdShade.Shader:
    """Connects a UsdUVTexture, and the primvar that it reads, to an input of a surface; the texture."""
    path = shader.GetPath()
    reader = UsdShade.Shader.Define(stage, f"{path}_{target}_st")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(varname)
    reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    texture = UsdShade.Shader.Define(stage, f"{path}_{target}")
    texture.CreateIdAttr("UsdUVTexture")
    if file:
        texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(file))
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
    texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    shader.CreateInput(target, Sdf.ValueTypeNames.Color3f).ConnectToSource(texture.ConnectableAPI(), "rgb")
    return texture


def connect_reader(
    stage: Usd.Stage, shader: UsdShade.Shader, kind: str, name: str, target: str, fallback: Any = None
) -> UsdShade.Shader:
    """Connects a UsdPrimvarReader of a kind such as "float3" to an input of a surface; the reader."""
    reader = UsdShade.Shader.Define(stage, f"{shader.GetPath()}_{target}_reader")
    reader.CreateIdAttr(f"UsdPrimvarReader_{kind}")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(name)
    names = {"float": "Float", "int": "Int", "float2": "Float2", "float4": "Float4", "string": "String"}
    type_name = getattr(Sdf.ValueTypeNames, names.get(kind, "Float3"))
    if fallback is not None:
        reader.CreateInput("fallback", type_name).Set(fallback)
    reader.CreateOutput("result", type_name)
    wide = target in ("diffuseColor", "emissiveColor", "specularColor", "normal")
    wanted = Sdf.ValueTypeNames.Color3f if wide else Sdf.ValueTypeNames.Float
    shader.CreateInput(target, wanted).ConnectToSource(reader.ConnectableAPI(), "result")
    return reader


def square_with(stage: Usd.Stage, **inputs: Any) -> UsdShade.Material:
    """The material /World/Material with constant inputs, on the square /World/Mesh."""
    material = add_material(stage, "/World/Material", **inputs)
    bind(add_square(stage, "/World/Mesh"), material)
    return material
