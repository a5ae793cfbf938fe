"""Edits of instancers and instances: what is synced again is what a fresh translation gives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from encore.dump import dump
from encore.render_index import RenderIndex, SyncOptions
from pxr import Sdf, Usd, UsdGeom, UsdShade, Vt
from stages import add_instance, add_material, add_point_instancer, add_square, bind, connect_reader, surface

Types = Sdf.ValueTypeNames


def primvar(
    stage: Usd.Stage, path: str, name: str, kind: Any, interpolation: str, value: Any
) -> UsdGeom.Primvar:
    made = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(path)).CreatePrimvar(name, kind, interpolation)
    made.Set(value)
    return made


def build(stage: Usd.Stage) -> None:
    """A PointInstancer with colours, and native instances with colours, in one material that reads `wear`."""
    add_square(stage, "/World/PI/Protos/A")
    add_square(stage, "/World/PI/Protos/B").AddTranslateOp().Set((0, 2, 0))
    add_point_instancer(stage, "/World/PI", ["/World/PI/Protos/A", "/World/PI/Protos/B"], [0, 1, 0])
    primvar(
        stage, "/World/PI", "displayColor", Types.Color3fArray, "vertex", [(1, 0, 0), (0, 1, 0), (0, 0, 1)]
    )
    stage.CreateClassPrim("/Asset")
    add_square(stage, "/Asset/Square")
    for i in range(3):
        add_instance(stage, f"/World/I{i}")
        primvar(stage, f"/World/I{i}", "displayColor", Types.Color3fArray, "constant", [(i / 3, 0, 1)])
        primvar(stage, f"/World/I{i}", "wear", Types.Float, "constant", float(i))
        primvar(stage, f"/World/I{i}", "tint", Types.Float, "constant", float(10 * i))
    primvar(stage, "/World/PI", "wear", Types.FloatArray, "vertex", [1, 2, 3])
    primvar(stage, "/World/PI", "tint", Types.FloatArray, "vertex", [4, 5, 6])
    material = add_material(stage, "/World/Material")
    connect_reader(stage, surface(material), "float", "wear", "roughness")


def reader(stage: Usd.Stage) -> UsdShade.Shader:
    return UsdShade.Shader(stage.GetPrimAtPath("/World/Material/Surface_roughness_reader"))


def colors(stage: Usd.Stage, path: str) -> UsdGeom.Primvar:
    return UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(path)).GetPrimvar("displayColor")


def bind_all(stage: Usd.Stage) -> None:
    bind(stage.GetPrimAtPath("/World"), UsdShade.Material(stage.GetPrimAtPath("/World/Material")))


EDITS: dict[str, Callable[[Usd.Stage], object]] = {
    "values": lambda s: colors(s, "/World/PI").Set([(1, 1, 0), (0, 1, 1), (1, 0, 1)]),
    "interpolation": lambda s: colors(s, "/World/PI").SetInterpolation("constant"),
    "wrong length": lambda s: colors(s, "/World/PI").Set([(1, 1, 0)]),
    "blocked": lambda s: colors(s, "/World/PI").GetAttr().Block(),
    "indexed": lambda s: colors(s, "/World/PI").SetIndices(Vt.IntArray([0, 0, 1])),
    "an instance's value": lambda s: colors(s, "/World/I1").Set([(0.5, 0.5, 0.5)]),
    "an instance's value that does not fit": lambda s: colors(s, "/World/I1").Set([(1, 0, 0), (0, 1, 0)]),
    "no value": lambda s: s.GetPrimAtPath("/World/I2").RemoveProperty("primvars:displayColor"),
    "a new value above": lambda s: primvar(
        s, "/World", "displayOpacity", Types.FloatArray, "constant", [0.5]
    ),
    "a prototype's own value": lambda s: primvar(
        s, "/World/PI/Protos/A", "displayColor", Types.Color3fArray, "constant", [(0, 0, 0)]
    ),
    "in the class": lambda s: primvar(
        s, "/Asset/Square", "displayColor", Types.Color3fArray, "constant", [(0, 0, 0)]
    ),
    "a material": bind_all,
    "a material that reads something else": lambda s: (
        bind_all(s),
        reader(s).GetInput("varname").Set("tint"),
    ),
    "mask": lambda s: UsdGeom.PointInstancer(s.GetPrimAtPath("/World/PI")).CreateInvisibleIdsAttr([1]),
    "inactive ids": lambda s: UsdGeom.PointInstancer(s.GetPrimAtPath("/World/PI")).DeactivateId(0),
    "prototypes": lambda s: s.GetPrimAtPath("/World/PI").GetAttribute("protoIndices").Set([1, 1, 1]),
    "inactive prototype": lambda s: s.GetPrimAtPath("/World/PI/Protos/B").SetActive(False),
    "visibility": lambda s: UsdGeom.Imageable(s.GetPrimAtPath("/World/I1")).MakeInvisible(),
    "no instance any more": lambda s: s.GetPrimAtPath("/World/I0").SetInstanceable(False),
}


@pytest.mark.parametrize("bound", [False, True])
@pytest.mark.parametrize("edit", EDITS)
def test_edits_come_to_what_a_fresh_translation_gives(stage: Usd.Stage, edit: str, bound: bool) -> None:
    build(stage)
    if bound:
        bind_all(stage)
    options = SyncOptions(camera_light=False)
    index = RenderIndex(stage, options)
    before = dump(index.sync())
    EDITS[edit](stage)
    after = dump(index.sync())
    assert after == dump(RenderIndex(stage, options).sync())
    seen_by_materials = edit not in ("a material",) or not bound
    if not bound and seen_by_materials:
        assert after != before, "the edit is seen"


def test_colours_over_time(stage: Usd.Stage) -> None:
    build(stage)
    for time in (1, 2):
        colors(stage, "/World/PI").Set([(time / 2, 0, 0)] * 3, time)
        colors(stage, "/World/I1").Set([(0, time / 2, 0)], time)
    options = SyncOptions(camera_light=False)
    index = RenderIndex(stage, options)
    found = [dump(index.sync(Usd.TimeCode(time))) for time in (1, 2, 1)]
    assert found[0] == found[2] != found[1]
    for time, text in ((1, found[0]), (2, found[1])):
        assert text == dump(RenderIndex(stage, options).sync(Usd.TimeCode(time)))
