"""Primvars of instances: per instance of PointInstancers, and those that native instances pass down."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from encore.dump import dump
from encore.render_index import Translation
from pxr import Sdf, Usd, UsdGeom, UsdShade, Vt
from stages import (
    add_instance,
    add_material,
    add_point_instancer,
    add_square,
    bind,
    connect_reader,
    connect_texture,
    instances,
    kinds,
    material_name,
    materials,
    meshes,
    surface,
    translate,
    write_image,
)

Types = Sdf.ValueTypeNames
RED, GREEN, BLUE = (1, 0, 0), (0, 1, 0), (0, 0, 1)


def set_primvar(
    prim: Any, name: str, kind: Sdf.ValueTypeName, interpolation: str, value: Any
) -> UsdGeom.Primvar:
    primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(name, kind, interpolation)
    primvar.Set(value)
    return primvar


def set_color(prim: Any, value: Any, interpolation: str = "constant") -> UsdGeom.Primvar:
    return set_primvar(prim, "displayColor", Types.Color3fArray, interpolation, value)


def given(translation: Translation) -> dict[str, dict[str, tuple[tuple[float, ...], bool]]]:
    """Per instance: name → (value, wins)."""
    return {
        path: {p["name"]: (p["value"], p["wins"]) for p in instance["primvars"]}
        for path, instance in instances(translation).items()
    }


def complaints(translation: Translation) -> list[str]:
    return [line for line in translation.reports.lines() if not line.startswith("Note")]


def add_reader(stage: Usd.Stage, kind: str, name: str, fallback: Any = None) -> UsdShade.Material:
    """/World/Material, whose diffuseColor or roughness is a primvar."""
    material = add_material(stage, "/World/Material")
    target = "diffuseColor" if kind == "float3" else "roughness"
    connect_reader(stage, surface(material), kind, name, target, fallback)
    return material


@pytest.fixture
def instancer(stage: Usd.Stage) -> UsdGeom.PointInstancer:
    """/World/PI with three instances of the square /World/PI/Protos/Square."""
    add_square(stage, "/World/PI/Protos/Square")
    return add_point_instancer(stage, "/World/PI", ["/World/PI/Protos/Square"], [0, 0, 0])


# PointInstancer


@pytest.mark.parametrize("interpolation", ["vertex", "varying", "uniform", "faceVarying"])
def test_display_color_per_instance(
    stage: Usd.Stage, instancer: UsdGeom.PointInstancer, interpolation: str
) -> None:
    set_color(instancer, [RED, GREEN, BLUE], interpolation)
    translation = translate(stage)
    assert translation.counts["prototypes"] == translation.counts["meshes"] == 1
    assert given(translation) == {
        "/World/PI[0]": {"displayColor": ((1, 0, 0, 0), True)},
        "/World/PI[1]": {"displayColor": ((0, 1, 0, 0), True)},
        "/World/PI[2]": {"displayColor": ((0, 0, 1, 0), True)},
    }
    name = material_name(translation, "/World/PI[0]")
    assert materials(translation)[name]["nodes"][0]["kind"] == "displayColor"
    assert "  primvar displayColor: (0, 1, 0, 0) over the meshes' own\n" in dump(translation)


def test_indexed_and_masked(stage: Usd.Stage, instancer: UsdGeom.PointInstancer) -> None:
    set_color(instancer, [RED, BLUE], "vertex").SetIndices(Vt.IntArray([1, 0, 1]))
    instancer.CreateInvisibleIdsAttr([0])
    assert given(translate(stage)) == {
        "/World/PI[1]": {"displayColor": ((1, 0, 0, 0), True)},
        "/World/PI[2]": {"displayColor": ((0, 0, 1, 0), True)},
    }


def test_each_prototype_has_its_own_instances_values(
    stage: Usd.Stage, instancer: UsdGeom.PointInstancer
) -> None:
    add_square(stage, "/World/PI/Protos/Other")
    instancer.GetPrototypesRel().AddTarget("/World/PI/Protos/Other")
    instancer.GetProtoIndicesAttr().Set([1, 0, 1])
    set_color(instancer, [RED, GREEN, BLUE], "vertex")
    values = {path: v["displayColor"][0][:3] for path, v in given(translate(stage)).items()}
    assert values == {"/World/PI[0]": RED, "/World/PI[1]": GREEN, "/World/PI[2]": BLUE}


@pytest.mark.parametrize(
    ("kind", "values", "expected"),
    [
        ("FloatArray", [1, 2, 3], (2, 0, 0, 0)),
        ("HalfArray", [1, 2, 3], (2, 0, 0, 0)),
        ("DoubleArray", [1, 2, 3], (2, 0, 0, 0)),
        ("IntArray", [1, 2, 3], (2, 0, 0, 0)),
        ("Float2Array", [(1, 2), (3, 4), (5, 6)], (3, 4, 0, 0)),
        ("TexCoord2fArray", [(1, 2), (3, 4), (5, 6)], (3, 4, 0, 0)),
        ("Color3fArray", [(1, 2, 3), (4, 5, 6), (7, 8, 9)], (4, 5, 6, 0)),
        ("Vector3dArray", [(1, 2, 3), (4, 5, 6), (7, 8, 9)], (4, 5, 6, 0)),
        ("Color4fArray", [(1, 2, 3, 4), (5, 6, 7, 8), (9, 1, 2, 3)], (5, 6, 7, 8)),
    ],
)
def test_types(
    stage: Usd.Stage,
    instancer: UsdGeom.PointInstancer,
    kind: str,
    values: list[Any],
    expected: tuple[float, ...],
) -> None:
    bind(instancer, add_reader(stage, "float", "wear"))
    set_primvar(instancer, "wear", getattr(Types, kind), "vertex", values)
    translation = translate(stage)
    assert given(translation)["/World/PI[1]"] == {"wear": (expected, True)}
    assert not complaints(translation), "the mesh need not have it"


def test_what_no_material_reads_is_left_out(stage: Usd.Stage, instancer: UsdGeom.PointInstancer) -> None:
    bind(instancer, add_reader(stage, "float", "wear"))
    set_primvar(instancer, "unread", Types.FloatArray, "vertex", [1, 2, 3])
    set_color(instancer, [RED, GREEN, BLUE], "vertex")
    translation = translate(stage)
    assert all(not values for values in given(translation).values())
    assert "missing primvar wear" in kinds(translation)


def test_texture_coordinates_per_instance(
    stage: Usd.Stage, instancer: UsdGeom.PointInstancer, tmp_path: Any
) -> None:
    material = add_material(stage, "/World/Material")
    connect_texture(stage, surface(material), write_image(tmp_path / "a.png"), "place")
    bind(instancer, material)
    set_primvar(instancer, "place", Types.Float2Array, "vertex", [(0, 0), (0.25, 0.5), (1, 1)])
    translation = translate(stage)
    assert given(translation)["/World/PI[1]"] == {"place": ((0.25, 0.5, 0, 0), True)}
    assert not complaints(translation)


def test_per_instance_values_win_over_the_meshes_own(
    stage: Usd.Stage, instancer: UsdGeom.PointInstancer
) -> None:
    mesh = stage.GetPrimAtPath("/World/PI/Protos/Square")
    set_color(mesh, [RED])
    set_color(instancer, [GREEN, GREEN, BLUE], "vertex")
    translation = translate(stage)
    assert given(translation)["/World/PI[2]"]["displayColor"] == ((0, 0, 1, 0), True)


def test_constant_primvars_of_an_instancer_reach_the_prototypes_below_it(
    stage: Usd.Stage, instancer: UsdGeom.PointInstancer
) -> None:
    add_square(stage, "/World/Library/Square")
    instancer.GetPrototypesRel().AddTarget("/World/Library/Square")
    instancer.GetProtoIndicesAttr().Set([0, 1, 0])
    set_color(instancer, [RED])
    translation = translate(stage)
    assert all(not values for values in given(translation).values())
    assert material_name(translation, "/World/PI[0]") == "displayColor(1, 0, 0)"
    assert material_name(translation, "/World/PI[1]") == "default"


def test_a_single_uniform_value_is_for_all_instances(
    stage: Usd.Stage, instancer: UsdGeom.PointInstancer
) -> None:
    set_color(instancer, [RED], "uniform")
    values = [v["displayColor"][0] for v in given(translate(stage)).values()]
    assert values == [(1, 0, 0, 0)] * 3


@pytest.mark.parametrize(
    ("kind", "interpolation", "value", "what"),
    [
        ("FloatArray", "vertex", [1, 2], "2 values for 3 instances"),
        ("FloatArray", "uniform", [1, 2], "2 values for 3 instances"),
        ("FloatArray", "vertex", [1, 2, float("nan")], "NaN"),
        ("StringArray", "vertex", ["a", "b", "c"], "type string"),
        ("Matrix4dArray", "vertex", None, "type matrix4d"),
    ],
)
def test_bad_primvars(
    stage: Usd.Stage,
    instancer: UsdGeom.PointInstancer,
    kind: str,
    interpolation: str,
    value: Any,
    what: str,
) -> None:
    bind(instancer, add_reader(stage, "float", "wear", fallback=0.5))
    value = Vt.Matrix4dArray(3) if value is None else value
    set_primvar(instancer, "wear", getattr(Types, kind), interpolation, value)
    translation = translate(stage)
    assert translation.counts["instances"] == 3
    assert all(not values for values in given(translation).values())
    (report,) = [r for r in translation.reports if r.kind == "bad primvar wear"]
    assert what in report.message and report.path == "/World/PI"


def test_indices_out_of_range(stage: Usd.Stage, instancer: UsdGeom.PointInstancer) -> None:
    set_color(instancer, [RED, BLUE], "vertex").SetIndices(Vt.IntArray([0, 1, 2]))
    translation = translate(stage)
    assert "bad primvar displayColor" in kinds(translation)
    assert all(not values for values in given(translation).values())


def test_too_few_floats_for_a_material(stage: Usd.Stage, instancer: UsdGeom.PointInstancer) -> None:
    bind(instancer, add_reader(stage, "float3", "tint"))
    set_primvar(instancer, "tint", Types.Float2Array, "vertex", [(1, 2)] * 3)
    translation = translate(stage)
    assert "bad primvar tint" in kinds(translation)
    assert all(not values for values in given(translation).values())


def test_nested_instancers_multiply(stage: Usd.Stage) -> None:
    """The inner one wins where both say something; each has what only it says."""
    add_square(stage, "/World/PI/Protos/Inner/Protos/Square")
    inner = add_point_instancer(
        stage, "/World/PI/Protos/Inner", ["/World/PI/Protos/Inner/Protos/Square"], [0, 0]
    )
    inner.GetPositionsAttr().Set([(0, 1, 0), (0, 2, 0)])
    outer = add_point_instancer(stage, "/World/PI", ["/World/PI/Protos/Inner"], [0, 0, 0])
    material = add_reader(stage, "float", "wear")
    connect_reader(stage, surface(material), "float", "dirt", "metallic")
    connect_reader(stage, surface(material), "float", "rust", "clearcoat")
    bind(outer, material)
    set_primvar(outer, "wear", Types.FloatArray, "vertex", [1, 2, 3])
    set_primvar(outer, "dirt", Types.FloatArray, "vertex", [4, 5, 6])
    set_primvar(inner, "wear", Types.FloatArray, "vertex", [7, 8])
    set_primvar(inner, "rust", Types.FloatArray, "vertex", [9, 10])
    translation = translate(stage)
    found = {}
    for instance in instances(translation).values():
        x, y = instance["to_world"][3, :2]
        found[round(x / 10), round(y)] = {p["name"]: p["value"][0] for p in instance["primvars"]}
    expected = {(x, y): {"wear": 6 + y, "dirt": 3 + x, "rust": 8 + y} for x in (1, 2, 3) for y in (1, 2)}
    assert found == expected


def test_a_displacement_cannot_read_instances(stage: Usd.Stage, instancer: UsdGeom.PointInstancer) -> None:
    material = add_reader(stage, "float", "wear")
    shader = surface(material)
    connect_reader(stage, shader, "float", "height", "displacement")
    material.CreateDisplacementOutput().ConnectToSource(shader.ConnectableAPI(), "displacement")
    bind(instancer, material)
    for name in ("wear", "height"):
        set_primvar(instancer, name, Types.FloatArray, "vertex", [1, 2, 3])
    translation = translate(stage)
    (report,) = [r for r in translation.reports if r.kind == "displacement by instance"]
    assert "height" in report.message and report.path == "/World/PI/Protos/Square"
    assert "wear" in given(translation)["/World/PI[0]"]


def test_prototypes_of_all_shapes(stage: Usd.Stage) -> None:
    protos = "/World/PI/Protos"
    UsdGeom.Sphere.Define(stage, f"{protos}/Sphere")
    curves = UsdGeom.BasisCurves.Define(stage, f"{protos}/Curves")
    curves.CreateTypeAttr("linear")
    curves.CreateCurveVertexCountsAttr([2])
    curves.CreatePointsAttr([(0, 0, 0), (0, 1, 0)])
    points = UsdGeom.Points.Define(stage, f"{protos}/Points")
    points.CreatePointsAttr([(0, 0, 0), (0, 1, 0)])
    targets = [f"{protos}/{name}" for name in ("Sphere", "Curves", "Points")]
    set_color(add_point_instancer(stage, "/World/PI", targets, [0, 1, 2]), [RED, GREEN, BLUE], "vertex")
    values = [v["displayColor"][0][:3] for v in given(translate(stage)).values()]
    assert values == [RED, GREEN, BLUE]


# Native instances


def add_asset(stage: Usd.Stage) -> None:
    stage.CreateClassPrim("/Asset")
    add_square(stage, "/Asset/A")
    set_color(add_square(stage, "/Asset/Own"), [BLUE])


def test_instances_that_differ_in_color_share_a_prototype(stage: Usd.Stage) -> None:
    add_asset(stage)
    colors = [(i / 50, 0, 1 - i / 50) for i in range(50)]
    for i, color in enumerate(colors):
        set_color(add_instance(stage, f"/World/I{i}"), [color])
    add_instance(stage, "/World/Plain")
    translation = translate(stage)
    assert translation.counts["prototypes"] == 1 and translation.counts["meshes"] == 2
    found = given(translation)
    for i, color in enumerate(colors):
        value, wins = found[f"/World/I{i}"]["displayColor"]
        np.testing.assert_allclose(value, (*color, 0), rtol=1e-6)
        assert not wins, "the meshes' own is stronger"
    assert found["/World/Plain"] == {}
    assert meshes(translation)["/World/I0/Own"]["display_color"]["values"].tolist() == [[0, 0, 1]]


def test_only_what_fits_is_the_instances(stage: Usd.Stage) -> None:
    """Arrays, edge lengths and the like still tell prototypes apart."""
    add_asset(stage)
    for i in range(4):
        prim = add_instance(stage, f"/World/I{i}")
        set_primvar(prim, "encore:targetEdgeLength", Types.Float, "constant", 1.0 + i // 2)
        set_color(prim, [(0, 0, i / 4)])
    translation = translate(stage)
    assert translation.counts["prototypes"] == 2
    lengths = {m["target_edge_length_world"] for m in meshes(translation).values()}
    assert lengths == {1, 2}


def test_what_materials_read_by_name_is_inherited(stage: Usd.Stage) -> None:
    add_asset(stage)
    bind(stage.GetPrimAtPath("/World"), add_reader(stage, "float3", "tint"))
    own = stage.GetPrimAtPath("/Asset/Own")
    set_primvar(own, "tint", Types.Float3, "constant", (9, 9, 9))
    for i in range(3):
        prim = add_instance(stage, f"/World/I{i}")
        set_primvar(prim, "tint", Types.Float3, "constant", (i, 0, 1))
    set_primvar(stage.GetPrimAtPath("/World"), "tint", Types.Float3, "constant", (7, 7, 7))
    add_instance(stage, "/World/I3")
    translation = translate(stage)
    assert translation.counts["prototypes"] == 1
    values = [v["tint"] for v in given(translation).values()]
    assert values == [((i, 0, 1, 0), False) for i in range(3)] + [((7, 7, 7, 0), False)]
    assert [p["name"] for p in meshes(translation)["/World/I0/Own"]["primvars"]] == ["tint"]
    assert not meshes(translation)["/World/I0/A"]["primvars"]
    assert not complaints(translation)


def test_nested_native_instances_inherit_from_the_inner_one(stage: Usd.Stage) -> None:
    add_asset(stage)
    stage.CreateClassPrim("/Group")
    set_color(add_instance(stage, "/Group/Red"), [RED])
    add_instance(stage, "/Group/Plain")
    for i, color in enumerate((GREEN, BLUE)):
        set_color(add_instance(stage, f"/World/G{i}", "/Group"), [color])
    translation = translate(stage)
    assert translation.counts["prototypes"] == 1
    found = {path: v["displayColor"][0][:3] for path, v in given(translation).items()}
    assert found == {
        "/World/G0/Red": RED,
        "/World/G0/Plain": GREEN,
        "/World/G1/Red": RED,
        "/World/G1/Plain": BLUE,
    }


def test_a_point_instancer_in_native_instances(stage: Usd.Stage) -> None:
    """Prototypes below it inherit from their own native instance; those elsewhere do not."""
    stage.CreateClassPrim("/Asset")
    add_square(stage, "/Library/Square")
    stage.GetPrimAtPath("/Library").SetSpecifier(Sdf.SpecifierOver)
    add_square(stage, "/Asset/PI/Protos/Square")
    targets = ["/Asset/PI/Protos/Square", "/Library/Square"]
    inner = add_point_instancer(stage, "/Asset/PI", targets, [0, 1])
    bind(stage.GetPrimAtPath("/World"), add_reader(stage, "float", "wear", fallback=0.25))
    for i in range(2):
        prim = add_instance(stage, f"/World/I{i}")
        set_primvar(prim, "wear", Types.Float, "constant", float(i + 1))
    found = {(path.split("/")[2], tuple(v.items())) for path, v in given(translate(stage)).items()}
    assert found == {
        ("I0", (("wear", ((1, 0, 0, 0), False)),)),
        ("I1", (("wear", ((2, 0, 0, 0), False)),)),
        ("I0", ()),
        ("I1", ()),
    }
    set_primvar(inner, "wear", Types.FloatArray, "vertex", [5, 6])
    values = {v["wear"] for v in given(translate(stage)).values()}
    assert values == {((5, 0, 0, 0), True), ((6, 0, 0, 0), True)}


def test_native_instances_in_a_point_instancer(stage: Usd.Stage) -> None:
    """Per-instance primvars win over those that are inherited, however deep."""
    add_asset(stage)
    prim = add_instance(stage, "/World/PI/Protos/I")
    set_color(prim, [RED])
    instancer = add_point_instancer(stage, "/World/PI", ["/World/PI/Protos/I"], [0, 0])
    translation = translate(stage)
    assert [v["displayColor"] for v in given(translation).values()] == [((1, 0, 0, 0), False)] * 2
    set_color(instancer, [GREEN, BLUE], "vertex")
    translation = translate(stage)
    values = [v["displayColor"] for v in given(translation).values()]
    assert values == [((0, 1, 0, 0), True), ((0, 0, 1, 0), True)]


# displayOpacity


def test_constant_opacity_is_presence(stage: Usd.Stage) -> None:
    mesh = add_square(stage, "/World/Mesh")
    set_color(mesh, [RED])
    set_primvar(mesh, "displayOpacity", Types.FloatArray, "constant", [0.25])
    translation = translate(stage)
    material = materials(translation)[material_name(translation, "/World/Mesh")]
    assert material["inputs"]["opacity"] == {"value": 0.25, "node": -1, "channel": 0}
    assert material["opacity_mode"] == "presence"
    assert not meshes(translation)["/World/Mesh"]["primvars"] and not complaints(translation)


def test_opaque_and_invisible(stage: Usd.Stage) -> None:
    for name, opacity in (("Opaque", [1.0] * 4), ("Clear", [0.0])):
        mesh = add_square(stage, f"/World/{name}")
        kind = "vertex" if len(opacity) > 1 else "constant"
        set_primvar(mesh, "displayOpacity", Types.FloatArray, kind, opacity)
    translation = translate(stage)
    assert list(instances(translation)) == ["/World/Opaque"]
    assert material_name(translation, "/World/Opaque") == "default"
    assert not meshes(translation)["/World/Opaque"]["primvars"]


def test_opacity_that_varies(stage: Usd.Stage) -> None:
    mesh = add_square(stage, "/World/Mesh")
    set_primvar(mesh, "displayOpacity", Types.FloatArray, "vertex", [0, 0.5, 1, 1])
    translation = translate(stage)
    (primvar,) = meshes(translation)["/World/Mesh"]["primvars"]
    assert primvar["name"] == "displayOpacity" and primvar["values"][1].tolist() == [0.5, 0, 0, 0]
    material = materials(translation)[material_name(translation, "/World/Mesh")]
    node = material["nodes"][material["inputs"]["opacity"]["node"]]
    assert node["primvar"] == "displayOpacity" and node["fallback"][0] == 1


def test_opacity_per_instance(stage: Usd.Stage, instancer: UsdGeom.PointInstancer) -> None:
    set_primvar(instancer, "displayOpacity", Types.FloatArray, "vertex", [1, 0.5, 0])
    translation = translate(stage)
    values = [v["displayOpacity"][0][0] for v in given(translation).values()]
    assert values == [1, 0.5, 0]
    assert materials(translation)[material_name(translation, "/World/PI[0]")]["opacity_mode"] == "presence"


def test_opacity_of_what_has_a_material_is_the_materials(stage: Usd.Stage) -> None:
    mesh = add_square(stage, "/World/Mesh")
    set_primvar(mesh, "displayOpacity", Types.FloatArray, "constant", [0.25])
    bind(mesh, add_material(stage, "/World/Material"))
    translation = translate(stage)
    assert material_name(translation, "/World/Mesh") == "/World/Material"
    assert not meshes(translation)["/World/Mesh"]["primvars"]
