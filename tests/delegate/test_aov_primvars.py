"""Primvars that images show: meshes have them, whatever their materials read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from encore.render_index import RenderIndex, SyncOptions, Translation
from pxr import Sdf, Usd, UsdGeom, Vt
from stages import add_instance, add_material, add_point_instancer, add_square, bind, meshes, translate

WEAR = (("wear", 1),)


@pytest.fixture
def square(stage: Usd.Stage) -> UsdGeom.Mesh:
    """With a grey material, st, and wear by point."""
    mesh = add_square(stage, "/World/Square")
    bind(mesh, add_material(stage, "/World/Grey", diffuseColor=(0.5, 0.5, 0.5)))
    api = UsdGeom.PrimvarsAPI(mesh)
    api.CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex").Set(
        [(0, 0), (1, 0), (1, 1), (0, 1)]
    )
    api.CreatePrimvar("wear", Sdf.ValueTypeNames.FloatArray, "vertex").Set([0.0, 1.0, 2.0, 3.0])
    return mesh


def names(translation: Translation, path: str = "/World/Square") -> list[str]:
    return sorted(primvar["name"] for primvar in meshes(translation)[path]["primvars"])


def test_only_what_is_asked_for_is_read(square: UsdGeom.Mesh) -> None:
    stage = square.GetPrim().GetStage()
    assert names(translate(stage)) == []
    found = translate(stage, aov_primvars=(*WEAR, ("st", 2), ("nowhere", 3)))
    assert names(found) == ["st", "wear"]
    assert not found.reports.has_errors
    wear = next(p for p in meshes(found)["/World/Square"]["primvars"] if p["name"] == "wear")
    assert wear["values"][:, 0].tolist() == [0, 1, 2, 3]


def test_display_color_stays_where_no_material_reads_it(square: UsdGeom.Mesh) -> None:
    stage = square.GetPrim().GetStage()
    square.CreateDisplayColorAttr(Vt.Vec3fArray([(0.25, 0.5, 0.75)]))
    for asked, kept in (((), False), ((("displayColor", 3),), True)):
        color = meshes(translate(stage, aov_primvars=asked))["/World/Square"]["display_color"]
        assert (color is not None and len(color["values"]) > 0) == kept


def test_a_frame_that_asks_for_more_reads_more(square: UsdGeom.Mesh) -> None:
    index = RenderIndex(square.GetPrim().GetStage(), SyncOptions(camera_light=False))
    for asked, expected in (((), []), (WEAR, ["wear"]), ((("st", 2),), ["st"]), ((), [])):
        index.options = replace(index.options, aov_primvars=asked)
        assert names(index.sync()) == expected


def test_implicit_shapes_that_differ_in_it_do_not_share(stage: Usd.Stage) -> None:
    for name, value in (("A", 1.0), ("B", 2.0)):
        cube = UsdGeom.Cube.Define(stage, f"/World/{name}")
        UsdGeom.PrimvarsAPI(cube).CreatePrimvar("wear", Sdf.ValueTypeNames.Float, "constant").Set(value)
    assert len(meshes(translate(stage))) == 1
    found = meshes(translate(stage, aov_primvars=WEAR))
    values = {path: float(mesh["primvars"][0]["values"][0, 0]) for path, mesh in found.items()}
    assert values == {"/World/A": 1.0, "/World/B": 2.0}


def test_inherited_ones_tell_instances_apart(stage: Usd.Stage) -> None:
    UsdGeom.Cube.Define(stage, "/Prototype/Cube")
    for name, value in (("A", 1.0), ("B", 2.0)):
        prim = add_instance(stage, f"/World/{name}", "/Prototype")
        UsdGeom.PrimvarsAPI(prim).CreatePrimvar("wear", Sdf.ValueTypeNames.Float, "constant").Set(value)
    scene = translate(stage, aov_primvars=WEAR).scene
    shown = set()
    for i in range(scene.instance_count):
        instance = scene.instance(i)
        own = [float(p["value"][0]) for p in instance.get("primvars", [])]
        mesh = scene.mesh(scene.prototype(instance["prototype"])["meshes"][0])
        shown |= set(own or [float(p["values"][0, 0]) for p in mesh["primvars"]])
    assert shown == {1.0, 2.0}


def test_point_instancers_give_theirs(stage: Usd.Stage) -> None:
    instancer = add_point_instancer(stage, "/World/Many", ["/World/Many/Cube"], [0, 0, 0])
    UsdGeom.Cube.Define(stage, "/World/Many/Cube")
    wear = UsdGeom.PrimvarsAPI(instancer).CreatePrimvar("wear", Sdf.ValueTypeNames.FloatArray, "vertex")
    wear.Set([1.0, 2.0, 3.0])
    scene = translate(stage, aov_primvars=WEAR).scene
    values = [float(scene.instance(i)["primvars"][0]["value"][0]) for i in range(scene.instance_count)]
    assert np.allclose(sorted(values), [1, 2, 3])
