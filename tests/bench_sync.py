"""How long a stage of many meshes takes to sync, at first and after edits, and whether that grows linearly.

    python tests/bench_sync.py [--prims N ...] [--edits]

Stages are made in memory: every mesh small, of its own, below an Xform of its own, every other one bound to
one of a few materials, the rest with a displayColor.
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Callable
from typing import Any

from encore.render_index import RenderIndex
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

ROW = 1000  # meshes side by side, and below one group


def make_stage(prims: int) -> Usd.Stage:
    """/World/G<group>/X<n>/Mesh, and /World/Looks."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.Xform.Define(stage, "/World")
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.AddTranslateOp().Set((ROW / 2, ROW / 2, 2 * ROW))
    looks = [_material(stage, i) for i in range(4)]
    layer = stage.GetRootLayer()
    with Sdf.ChangeBlock():
        for i in range(prims):
            _mesh(layer, i, looks[i // 2 % 4].GetPath() if i % 2 else None)
    return stage


def mesh_path(number: int) -> str:
    return f"/World/G{number // ROW}/X{number}/Mesh"


def _material(stage: Usd.Stage, number: int) -> UsdShade.Material:
    path = f"/World/Looks/Look{number}"
    material, shader = UsdShade.Material.Define(stage, path), UsdShade.Shader.Define(stage, f"{path}/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set((0.2 * number, 0.5, 0.5))
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    return material


def _mesh(layer: Sdf.Layer, number: int, look: Sdf.Path | None) -> None:
    path = Sdf.Path(mesh_path(number))
    names = {path: "Mesh", path.GetParentPath(): "Xform", path.GetParentPath().GetParentPath(): "Xform"}
    for name, kind in names.items():
        prim = Sdf.CreatePrimInLayer(layer, name)
        prim.specifier, prim.typeName = Sdf.SpecifierDef, kind
    xform, mesh = layer.GetPrimAtPath(path.GetParentPath()), layer.GetPrimAtPath(path)
    types = Sdf.ValueTypeNames
    _attribute(xform, "xformOp:translate", types.Double3, Gf.Vec3d(number % ROW, number // ROW, 0))
    _attribute(xform, "xformOpOrder", types.TokenArray, Vt.TokenArray(["xformOp:translate"]), True)
    corners = [(0, 0, 0), (0.8, 0, 0), (0.8, 0.8, 0), (0, 0.8, 0.001 * (number % 777))]
    _attribute(mesh, "points", types.Point3fArray, Vt.Vec3fArray([Gf.Vec3f(*c) for c in corners]))
    _attribute(mesh, "faceVertexCounts", types.IntArray, Vt.IntArray([4]))
    _attribute(mesh, "faceVertexIndices", types.IntArray, Vt.IntArray([0, 1, 2, 3]))
    _attribute(mesh, "subdivisionScheme", types.Token, "none", True)
    colour = Vt.Vec3fArray([Gf.Vec3f(number % 10 / 10, 0.5, 0.5)])
    _attribute(mesh, "primvars:displayColor", types.Color3fArray, colour)
    if look is not None:
        mesh.SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=["MaterialBindingAPI"]))
        Sdf.RelationshipSpec(mesh, "material:binding").targetPathList.explicitItems = [look]


def _attribute(prim: Sdf.PrimSpec, name: str, kind: Any, value: Any, uniform: bool = False) -> None:
    variability = Sdf.VariabilityUniform if uniform else Sdf.VariabilityVarying
    Sdf.AttributeSpec(prim, name, kind, variability).default = value


# What is changed on the stage between two syncs.
EDITS: dict[str, Callable[[Usd.Stage], object]] = {
    "nothing": lambda stage: None,
    "a material": lambda stage: (
        UsdShade.Shader.Get(stage, "/World/Looks/Look0/Surface").GetInput("diffuseColor").Set((1, 0, 0))
    ),
    "points of a mesh": lambda stage: stage.GetAttributeAtPath(f"{mesh_path(0)}.points").Set(
        Vt.Vec3fArray([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    ),
    "a transform": lambda stage: stage.GetAttributeAtPath("/World/G0/X0.xformOp:translate").Set((1, 1, 1)),
    "a removed mesh": lambda stage: stage.RemovePrim(mesh_path(0)),
}


def measure(index: RenderIndex, what: str, prims: int) -> None:
    started, used = time.perf_counter(), time.process_time()
    index.sync()
    seconds, cpu = time.perf_counter() - started, time.process_time() - used
    counts = index.last_sync
    print(
        f"{prims:8} {what:18} {seconds:8.3f} s {1e6 * seconds / prims:8.1f} µs per prim  ({cpu:.3f} s CPU; "
        f"{counts.rprims_read} rprims and {counts.materials_read} materials read, "
        f"{counts.prims_walked} prims walked)",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--prims", type=int, nargs="+", default=[1000, 10_000, 100_000])
    parser.add_argument("--edits", action="store_true", help="also after edits")
    arguments = parser.parse_args()
    for prims in arguments.prims:
        stage = make_stage(prims)
        index = RenderIndex(stage)
        measure(index, "all", prims)
        for what, edit in EDITS.items() if arguments.edits else ():
            edit(stage)
            measure(index, what, prims)
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")


if __name__ == "__main__":
    main()
