"""What instances say looks like what meshes of their own would."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdShade
from rendering import add_camera, add_dome, add_mesh, new_stage, render

COLORS = [(0.9, 0.1, 0.1), (0.1, 0.9, 0.1), (0.1, 0.1, 0.9)]
OPACITIES = [1.0, 0.5, 0.25]
SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
SETTINGS = {"samples": 4, "occlusion_samples": 1, "light_samples": 1, "max_bounces": 1}
Types = Sdf.ValueTypeNames


def set_primvar(prim: Any, name: str, kind: Any, interpolation: str, value: Any) -> None:
    UsdGeom.PrimvarsAPI(prim).CreatePrimvar(name, kind, interpolation).Set(value)


def stage_with(form: str, reader: bool) -> Usd.Stage:
    """Three squares side by side: meshes of their own, native instances, or those of a PointInstancer.

    reader: the colour is read by name by a material; else it is displayColor, with displayOpacity.
    """
    stage = new_stage()
    add_dome(stage, 1.0)
    add_camera(stage, (1.6, 0.5, 4), (1.6, 0.5, 0), 0.45)
    name = "tint" if reader else "displayColor"

    def give(prim: Any, interpolation: str, which: slice) -> None:
        set_primvar(prim, name, Types.Color3fArray, interpolation, COLORS[which])
        if not reader:
            set_primvar(prim, "displayOpacity", Types.FloatArray, interpolation, OPACITIES[which])

    if form == "point":
        add_mesh(stage, "/World/PI/Protos/Square", SQUARE, [[0, 1, 2, 3]])
        instancer = UsdGeom.PointInstancer.Define(stage, "/World/PI")
        instancer.CreatePrototypesRel().SetTargets(["/World/PI/Protos/Square"])
        instancer.CreateProtoIndicesAttr([0, 0, 0])
        instancer.CreatePositionsAttr([(1.1 * i, 0, 0) for i in range(3)])
        give(instancer, "vertex", slice(3))
    elif form == "native":
        stage.CreateClassPrim("/Asset")
        add_mesh(stage, "/Asset/Square", SQUARE, [[0, 1, 2, 3]])
    for i in range(3 if form != "point" else 0):
        path = f"/World/Square{i}"
        if form == "native":
            prim = UsdGeom.Xform.Define(stage, path).GetPrim()
            prim.GetReferences().AddInternalReference("/Asset")
            prim.SetInstanceable(True)
        else:
            prim = add_mesh(stage, path, SQUARE, [[0, 1, 2, 3]]).GetPrim()
        UsdGeom.Xformable(prim).AddTranslateOp().Set((1.1 * i, 0, 0))
        give(prim, "constant", slice(i, i + 1))
    if reader:
        bind_reader(stage, name)
    return stage


def bind_reader(stage: Usd.Stage, name: str) -> None:
    material = UsdShade.Material.Define(stage, "/World/Material")
    shader = UsdShade.Shader.Define(stage, "/World/Material/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    source = UsdShade.Shader.Define(stage, "/World/Material/Reader")
    source.CreateIdAttr("UsdPrimvarReader_float3")
    source.CreateInput("varname", Types.String).Set(name)
    source.CreateOutput("result", Types.Float3)
    shader.CreateInput("diffuseColor", Types.Color3f).ConnectToSource(source.ConnectableAPI(), "result")
    shader.CreateInput("ior", Types.Float).Set(1.0)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath("/World")).Bind(material)


@pytest.mark.parametrize("reader", [False, True])
@pytest.mark.parametrize("form", ["native", "point"])
def test_instances_look_like_meshes(form: str, reader: bool) -> None:
    """Bit for bit: the order of the instances is the same, and so are all random numbers."""
    shared, own = (render(stage_with(f, reader), 96, 96, **SETTINGS) for f in (form, "meshes"))
    np.testing.assert_array_equal(shared["composite"], own["composite"])
    np.testing.assert_array_equal(shared["alpha"], own["alpha"])


def test_opacity_covers_as_much_as_it_says() -> None:
    """Squares at x 0, 1.1 and 2.2 seen straight on: their coverage is their opacity."""
    found = render(stage_with("point", False), 96, 96, **{**SETTINGS, "samples": 16})
    alpha, image = np.asarray(found["alpha"]).reshape(96, 96), found["composite"]
    for i, (color, opacity) in enumerate(zip(COLORS, OPACITIES, strict=True)):
        # The film is 2 × 4 × 0.45 wide, around x = 1.6.
        column = int(48 + (1.1 * i + 0.5 - 1.6) / 3.6 * 96)
        where = (slice(44, 52), slice(column - 4, column + 4))
        assert alpha[where].mean() == pytest.approx(opacity, abs=0.02)
        shade = image[where].reshape(-1, image.shape[-1])[:, :3].mean(axis=0) / opacity
        np.testing.assert_allclose(shade, np.array(color), atol=0.05)
