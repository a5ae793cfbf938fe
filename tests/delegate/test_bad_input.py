"""Broken stages: what can be rendered is, what cannot is reported with its path; --strict ends the run."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from encore import _core, cli
from encore.errors import ExitCode, StageError
from encore.render_index import Translation
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade, Vt
from stages import (
    SQUARE,
    add_chain,
    add_instance,
    add_material,
    add_point_instancer,
    add_square,
    add_strip,
    bind,
    instances,
    kinds,
    lights,
    material_name,
    meshes,
    new_stage,
    translate,
)

GOOD = "/World/Good"
BAD = "/World/Bad"


@pytest.fixture
def stage() -> Usd.Stage:
    """With one good square."""
    stage = new_stage()
    add_square(stage, GOOD)
    return stage


def assert_reported(
    stage: Usd.Stage, kind: str, path: str, *shown: str, says: str = "", broken: bool = True, **options: Any
) -> Translation:
    """The good square and what else is shown are rendered, and the rest is reported, strictly an error.

    kind: of the report, or how it starts. path: of its first prim. broken: whether strict fails.
    """
    translation = translate(stage, **options)
    assert sorted(instances(translation)) == sorted([GOOD, *shown])
    found = [r for r in translation.reports if r.kind.startswith(kind)]
    assert [r.path for r in found] == [path], translation.reports.lines()
    assert says in found[0].message
    if broken:
        with pytest.raises(StageError, match="Repair it"):
            translate(stage, strict=True, **options)
    else:
        translate(stage, strict=True, **options)
    return translation


# Composition


def write(folder: Path, name: str, text: str) -> str:
    (folder / name).write_text(f'#usda 1.0\n{text}\ndef Sphere "Good"\n{{\n}}\n', encoding="utf-8")
    return str(folder / name)


CYCLE = """def "A" (references = @./root.usda@</B>)
{
}
def "B" (references = @./root.usda@</A>)
{
}"""


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('def "Bad" (references = @missing.usda@</A>)\n{\n}', "missing.usda"),
        ('def "Bad" (payload = @missing.usda@)\n{\n}', "missing.usda"),
        ("(subLayers = [@missing.usda@])", "missing.usda"),
        ('def "Bad" (references = </Nowhere>)\n{\n}', "/Nowhere"),
        ('def "Bad" (references = @other.usda@)\n{\n}', "default"),
        ("(subLayers = [@root.usda@])", "cycle"),
        (CYCLE, "/A"),
        ('class "A" (inherits = </B>)\n{\n}\nclass "B" (inherits = </A>)\n{\n}', ""),
        ('def "A" (inherits = </A/B>)\n{\n  def "B"\n  {\n  }\n}', "/A"),
        ('def "Bad" (specializes = </Bad>)\n{\n}', "/Bad"),
        ('def "Bad" (references = @broken.usda@)\n{\n}', "broken.usda"),
    ],
    ids=[
        *("reference", "payload", "sublayer", "target", "default prim", "sublayers in a circle"),
        *(
            "references in a circle",
            "inherits in a circle",
            "a descendant",
            "itself",
            "a file that is no USD",
        ),
    ],
)
def test_broken_composition(tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, says: str) -> None:
    write(tmp_path, "other.usda", "")
    (tmp_path / "broken.usda").write_text("#usda 1.0\ndef {", encoding="utf-8")
    root = write(tmp_path, "root.usda", text)
    assert cli.main(["dump", root]) == ExitCode.OK
    shown = capsys.readouterr().out
    assert "instance /Good" in shown
    (report,) = [line for line in shown.splitlines() if line.startswith("report Error")][:1]
    assert says in report
    assert cli.main(["dump", root, "--strict"]) == ExitCode.STAGE
    assert "Repair it, or render without --strict" in capsys.readouterr().err


def test_a_class_that_does_not_exist_is_no_error(tmp_path: Path) -> None:
    """USD allows to inherit what is not there (yet)."""
    root = write(tmp_path, "root.usda", 'def "A" (inherits = </_class_that_is_nowhere>)\n{\n}')
    assert not translate(Usd.Stage.Open(root), strict=True).reports.has_errors


def test_an_empty_stage() -> None:
    with pytest.raises(StageError, match="no renderable prim"):
        translate(Usd.Stage.CreateInMemory())


def test_a_stage_of_overs_only(tmp_path: Path) -> None:
    stage = Usd.Stage.CreateInMemory()
    add_square(stage, "/A").GetPrim().SetSpecifier(Sdf.SpecifierOver)
    with pytest.raises(StageError, match="no renderable prim"):
        translate(stage)


def test_instance_proxies_cannot_be_overridden(stage: Usd.Stage) -> None:
    """Opinions below an instance are no part of what USD composes."""
    add_square(stage, "/Asset/Mesh")
    stage.GetPrimAtPath("/Asset").SetSpecifier(Sdf.SpecifierClass)
    add_instance(stage, "/World/Instance")
    spec = Sdf.CreatePrimInLayer(stage.GetRootLayer(), "/World/Instance/Mesh")
    spec.specifier = Sdf.SpecifierOver
    Sdf.AttributeSpec(spec, "doubleSided", Sdf.ValueTypeNames.Bool).default = True
    translation = translate(stage)
    assert sorted(instances(translation)) == [GOOD, "/World/Instance"]
    assert not any(m["double_sided"] for m in meshes(translation).values())


# Targets that do not exist


def test_a_material_that_does_not_exist(stage: Usd.Stage) -> None:
    mesh = add_square(stage, BAD)
    api = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
    api.GetDirectBindingRel() or api.GetPrim().CreateRelationship("material:binding")
    api.GetPrim().GetRelationship("material:binding").SetTargets(["/Nowhere"])
    translation = assert_reported(stage, "missing material", BAD, BAD, says="/Nowhere")
    assert material_name(translation, BAD) == "default"


def test_a_material_that_is_none(stage: Usd.Stage) -> None:
    mesh = add_square(stage, BAD)
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
    mesh.GetPrim().CreateRelationship("material:binding").SetTargets([GOOD])
    assert_reported(stage, "missing material", BAD, BAD, says=GOOD)


def test_prototypes_that_do_not_exist(stage: Usd.Stage) -> None:
    add_square(stage, f"{BAD}/A")
    add_point_instancer(stage, BAD, [f"{BAD}/A", "/Nowhere"], [0, 1, 0])
    assert_reported(stage, "missing prototype", BAD, f"{BAD}[0]", f"{BAD}[2]", says="/Nowhere")


@pytest.mark.parametrize("link", ["lightLink", "shadowLink"])
def test_links_to_what_does_not_exist(stage: Usd.Stage, link: str) -> None:
    light = UsdLux.SphereLight.Define(stage, "/World/Light")
    Usd.CollectionAPI(light.GetPrim(), link).CreateIncludesRel().SetTargets(["/Nowhere"])
    Usd.CollectionAPI(light.GetPrim(), link).CreateIncludeRootAttr(False)
    translation = translate(stage, strict=True)
    found = lights(translation)["/World/Light"]
    groups = found["lit_groups" if link == "lightLink" else "shadow_groups"]
    assert len(groups) and not any(groups), "it reaches nothing"


def test_a_geometry_light_of_nothing(stage: Usd.Stage) -> None:
    light = stage.DefinePrim("/World/Light", "GeometryLight")
    light.CreateRelationship("geometry").SetTargets(["/Nowhere"])
    assert_reported(stage, "GeometryLight without geometry", "/World/Light", says="/Nowhere", broken=False)


def test_a_camera_that_does_not_exist(stage: Usd.Stage) -> None:
    with pytest.raises(StageError, match="/Nowhere"):
        translate(stage, camera="/Nowhere")


def test_a_shader_connected_to_nothing(stage: Usd.Stage) -> None:
    material = add_material(stage, "/World/Material", roughness=0.5)
    bind(add_square(stage, BAD), material)
    shader = UsdShade.Shader.Get(stage, "/World/Material/Surface")
    color = shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    color.Set((1, 0, 0))
    color.GetAttr().SetConnections(["/Nowhere.outputs:rgb"])
    assert_reported(stage, "broken connection", "/World/Material", BAD, says="/Nowhere")


# Primvars


SIZES = {"constant": 1, "uniform": 3, "vertex": 8, "varying": 8, "faceVarying": 12}


@pytest.mark.parametrize("interpolation", [i for i in SIZES if i != "constant"])
@pytest.mark.parametrize("indexed", [False, True])
def test_primvars_of_wrong_length(stage: Usd.Stage, interpolation: str, indexed: bool) -> None:
    mesh = add_strip(stage, BAD)
    primvar = mesh.CreateDisplayColorPrimvar(interpolation)
    if indexed:
        primvar.Set([(1, 0, 0), (0, 1, 0)])
        primvar.SetIndices(Vt.IntArray([0, 1] * SIZES[interpolation]))
    else:
        primvar.Set([(1, 0, 0)] * (SIZES[interpolation] - 1))
    translation = assert_reported(stage, "bad primvar displayColor", BAD, BAD)
    assert material_name(translation, BAD) == "default"


@pytest.mark.parametrize("interpolation", SIZES)
@pytest.mark.parametrize("index", [-1, 2])
def test_indices_of_primvars_out_of_range(stage: Usd.Stage, interpolation: str, index: int) -> None:
    primvar = add_strip(stage, BAD).CreateDisplayColorPrimvar(interpolation)
    primvar.Set([(1, 0, 0), (0, 1, 0)])
    primvar.SetIndices(Vt.IntArray([index] * SIZES[interpolation]))
    assert_reported(stage, "bad primvar displayColor", BAD, BAD, says="out of range")


def test_an_interpolation_that_does_not_exist(stage: Usd.Stage) -> None:
    primvar = add_strip(stage, BAD).CreateDisplayColorPrimvar("vertex")
    primvar.Set([(1, 0, 0)])
    primvar.GetAttr().SetMetadata("interpolation", "nonsense")
    assert_reported(stage, "bad primvar displayColor", BAD, BAD, says="nonsense")


def test_normals_of_wrong_length(stage: Usd.Stage) -> None:
    add_square(stage, BAD).CreateNormalsAttr([(0, 0, 1)] * 3)
    translation = assert_reported(stage, "bad primvar normals", BAD, BAD)
    assert meshes(translation)[BAD]["normals"] is None


# Meshes


@pytest.mark.parametrize(
    ("attribute", "value"),
    [
        ("faceVertexIndices", [0, 1, 2, 4]),
        ("faceVertexIndices", [0, 1, 2, -1]),
        ("faceVertexIndices", [0, 1, 2]),
        ("faceVertexCounts", [-4]),
        ("faceVertexCounts", [4, 4]),
        ("faceVertexCounts", [2**31 - 1]),
        ("points", [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, math.nan, 0)]),
        ("points", [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, math.inf, 0)]),
        ("points", [(0, 0, 0)]),
    ],
)
@pytest.mark.parametrize("scheme", ["none", "catmullClark"])
def test_broken_topology_and_points(stage: Usd.Stage, attribute: str, value: Any, scheme: str) -> None:
    add_square(stage, BAD, scheme).GetPrim().GetAttribute(attribute).Set(value)
    assert_reported(stage, "bad mesh", BAD, says=attribute if attribute != "points" else "")


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"holeIndices": [7]}, "holeIndices"),
        ({"cornerIndices": [9], "cornerSharpnesses": [1.0]}, "cornerIndices"),
        ({"cornerIndices": [0, 1], "cornerSharpnesses": [1.0]}, "cornerSharpnesses"),
        ({"creaseIndices": [0, 9], "creaseLengths": [2], "creaseSharpnesses": [1.0]}, "creaseIndices"),
        ({"creaseIndices": [0, 1], "creaseLengths": [3], "creaseSharpnesses": [1.0]}, "creaseLengths"),
        ({"creaseIndices": [0, 1], "creaseLengths": [2], "creaseSharpnesses": []}, "creaseSharpnesses"),
        ({"creaseIndices": [0, 1], "creaseLengths": [-2], "creaseSharpnesses": [1.0]}, "creaseLengths"),
    ],
)
def test_broken_sharp_features(stage: Usd.Stage, values: dict[str, Any], says: str) -> None:
    mesh = add_square(stage, BAD, "catmullClark")
    for name, value in values.items():
        mesh.GetPrim().GetAttribute(name).Set(value)
    assert_reported(stage, "bad mesh", BAD, says=says)


def test_extreme_points_are_rendered(stage: Usd.Stage) -> None:
    """As long as numbers are finite they are the stage's business."""
    for name, size in (("Huge", 1e30), ("Tiny", 1e-30)):
        mesh = add_square(stage, f"/World/{name}")
        mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(np.array(SQUARE, np.float32) * np.float32(size)))
    translation = translate(stage, strict=True)
    translation.scene.validate()
    assert sorted(instances(translation)) == [GOOD, "/World/Huge", "/World/Tiny"]


def test_topology_that_changes_while_the_shutter_is_open(stage: Usd.Stage) -> None:
    mesh = add_square(stage, BAD)
    mesh.GetPointsAttr().Set([*SQUARE, (2, 2, 2)], 2)
    mesh.GetPointsAttr().Set(SQUARE, 1)
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.CreateShutterCloseAttr(1.5)
    translation = assert_reported(stage, "changing topology", BAD, BAD, broken=False, time=Usd.TimeCode(1))
    assert len(meshes(translation)[BAD]["points"]) == 4
    assert len(meshes(translation)[BAD]["motion_points"]) == 0


Retype = Callable[[Usd.Prim], None]


def retype(name: str, kind: str, value: Any) -> Retype:
    """Authors an attribute of the schema with another type."""

    def author(prim: Usd.Prim) -> None:
        prim.RemoveProperty(name)
        spec = prim.GetStage().GetRootLayer().GetPrimAtPath(prim.GetPath())
        Sdf.AttributeSpec(spec, name, getattr(Sdf.ValueTypeNames, kind)).default = value

    return author


@pytest.mark.parametrize(
    "damage",
    [
        retype("points", "Double3Array", Vt.Vec3dArray([Gf.Vec3d(*p) for p in SQUARE])),
        retype("points", "Half3Array", Vt.Vec3hArray([Gf.Vec3h(*p) for p in SQUARE])),
        retype("faceVertexCounts", "Int64Array", Vt.Int64Array([4])),
        retype("faceVertexIndices", "UIntArray", Vt.UIntArray([0, 1, 2, 3])),
    ],
    ids=["double3 points", "half3 points", "int64 counts", "uint indices"],
)
def test_numbers_of_another_precision(stage: Usd.Stage, damage: Retype) -> None:
    """They are used: nothing is lost by it."""
    damage(add_square(stage, BAD).GetPrim())
    translation = translate(stage, strict=True)
    np.testing.assert_array_equal(meshes(translation)[BAD]["points"], SQUARE)
    assert meshes(translation)[BAD]["face_vertex_indices"].tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (retype("points", "FloatArray", Vt.FloatArray([0, 1, 2, 3])), "points"),
        (retype("points", "StringArray", Vt.StringArray(["a"])), "points"),
        (retype("points", "Float3", Gf.Vec3f(1, 2, 3)), "points"),
        (retype("faceVertexCounts", "FloatArray", Vt.FloatArray([4.5])), "faceVertexCounts"),
        (retype("faceVertexCounts", "Int", 4), "faceVertexCounts"),
        (retype("faceVertexIndices", "StringArray", Vt.StringArray(["a"])), "faceVertexIndices"),
        (retype("holeIndices", "StringArray", Vt.StringArray(["a"])), "holeIndices"),
    ],
    ids=["float points", "string points", "one point", "float counts", "one count", "strings", "holes"],
)
def test_values_of_types_that_make_no_sense(stage: Usd.Stage, damage: Retype, says: str) -> None:
    damage(add_square(stage, BAD, "catmullClark").GetPrim())
    assert_reported(stage, "bad", BAD, says=says)


def test_a_subset_with_bad_indices(stage: Usd.Stage) -> None:
    mesh = add_strip(stage, BAD)
    subset = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).CreateMaterialBindSubset("one", [0, 99, -1])
    bind(subset, add_material(stage, "/World/Material"))
    translation = assert_reported(stage, "bad subset", f"{BAD}/one", BAD, says="2 of its indices")
    assert material_name(translation, BAD, 0) == "/World/Material"


# Transforms


@pytest.mark.parametrize(
    "matrix",
    [Gf.Matrix4d(0), Gf.Matrix4d().SetScale((1, 1, 0)), Gf.Matrix4d(math.nan), Gf.Matrix4d(math.inf)],
    ids=["zero", "flat", "NaN", "infinite"],
)
@pytest.mark.parametrize("above", [False, True], ids=["own", "inherited"])
def test_transforms_that_show_nothing(stage: Usd.Stage, matrix: Gf.Matrix4d, above: bool) -> None:
    group = UsdGeom.Xform.Define(stage, "/World/Group")
    mesh = add_square(stage, "/World/Group/Mesh")
    (group if above else mesh).AddTransformOp().Set(matrix)
    broken = not all(math.isfinite(x) for row in matrix for x in row)
    kind = "transform not finite" if broken else "singular transform"
    assert_reported(stage, kind, "/World/Group/Mesh", broken=broken)


def test_an_instance_with_a_singular_transform(stage: Usd.Stage) -> None:
    add_square(stage, "/Asset/Mesh")
    stage.GetPrimAtPath("/Asset").SetSpecifier(Sdf.SpecifierClass)
    for name, scale in (("A", 1), ("B", 0)):
        prim = add_instance(stage, f"/World/{name}")
        UsdGeom.Xformable(prim).AddScaleOp().Set((scale, 1, 1))
    assert_reported(stage, "singular transform", "/World/B", "/World/A", broken=False)


def test_an_op_that_does_not_exist(stage: Usd.Stage) -> None:
    """xformOpOrder names an attribute that is not there: USD leaves the op out."""
    mesh = add_square(stage, BAD)
    mesh.GetPrim().CreateAttribute("xformOpOrder", Sdf.ValueTypeNames.TokenArray).Set(
        ["xformOp:translate:nowhere"]
    )
    translation = translate(stage)
    np.testing.assert_array_equal(instances(translation)[BAD]["to_world"], np.eye(4))


# Instances


def test_instances_of_nothing(stage: Usd.Stage) -> None:
    """A prototype without geometry, and an instanceable prim without arcs, show nothing, and are no error."""
    UsdGeom.Xform.Define(stage, f"{BAD}/Empty")
    add_point_instancer(stage, BAD, [f"{BAD}/Empty"], [0, 0])
    stage.DefinePrim("/Asset", "Xform").SetSpecifier(Sdf.SpecifierClass)
    add_instance(stage, "/World/Instance")
    add_square(stage, "/World/NoArcs/Mesh")
    stage.GetPrimAtPath("/World/NoArcs").SetInstanceable(True)
    assert sorted(instances(translate(stage, strict=True))) == [GOOD, "/World/NoArcs/Mesh"]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("positions", Vt.Vec3fArray([(1, 0, 0)])),
        ("positions", Vt.Vec3fArray()),
        ("scales", Vt.Vec3fArray([(1, 1, 1)] * 5)),
        ("scales", Vt.Vec3fArray([(1, 1, 1)])),
        ("orientations", Vt.QuathArray([Gf.Quath(1)])),
        ("orientationsf", Vt.QuatfArray([Gf.Quatf(1)] * 2)),
    ],
)
def test_point_instancers_with_wrong_lengths(stage: Usd.Stage, name: str, value: Any) -> None:
    add_square(stage, f"{BAD}/A")
    instancer = add_point_instancer(stage, BAD, [f"{BAD}/A"], [0, 0, 0])
    instancer.GetPrim().GetAttribute(name).Set(value)
    assert_reported(stage, "bad instancer", BAD, says=f"{name} has {len(value)} values for 3 instances")


def test_lengths_that_change_while_the_shutter_is_open(stage: Usd.Stage) -> None:
    add_square(stage, f"{BAD}/A")
    instancer = add_point_instancer(stage, BAD, [f"{BAD}/A"], [0, 0, 0])
    scales = instancer.CreateScalesAttr()
    scales.Set([(1, 1, 1)] * 3, 1)
    scales.Set([(2, 2, 2)], 1.25)
    UsdGeom.Camera.Define(stage, "/World/Camera").CreateShutterCloseAttr(0.5)
    shown = [f"{BAD}[{i}]" for i in range(3)]
    assert_reported(stage, "instances that come or go", BAD, *shown, broken=False, time=Usd.TimeCode(1))


@pytest.mark.parametrize(("name", "count"), [("velocities", 1), ("angularVelocities", 2)])
def test_speeds_with_wrong_lengths_do_not_count(stage: Usd.Stage, name: str, count: int) -> None:
    add_square(stage, f"{BAD}/A")
    instancer = add_point_instancer(stage, BAD, [f"{BAD}/A"], [0, 0, 0])
    instancer.GetPrim().GetAttribute(name).Set(Vt.Vec3fArray([(1, 0, 0)] * count))
    UsdGeom.Camera.Define(stage, "/World/Camera").CreateShutterCloseAttr(0.5)
    stage.SetEndTimeCode(2)
    shown = [f"{BAD}[{i}]" for i in range(3)]
    translation = assert_reported(stage, "bad speeds", BAD, *shown, says=name, time=Usd.TimeCode(1))
    assert not any(len(i["motion"]) for i in instances(translation).values())


@pytest.mark.parametrize("index", [-1, 1])
def test_indices_of_prototypes_out_of_range(stage: Usd.Stage, index: int) -> None:
    add_square(stage, f"{BAD}/A")
    add_point_instancer(stage, BAD, [f"{BAD}/A"], [0, index, 0])
    assert_reported(stage, "bad protoIndices", BAD, f"{BAD}[0]", f"{BAD}[2]")


def test_not_finite_positions(stage: Usd.Stage) -> None:
    add_square(stage, f"{BAD}/A")
    instancer = add_point_instancer(stage, BAD, [f"{BAD}/A"], [0, 0, 0])
    instancer.GetPositionsAttr().Set([(0, 0, 0), (math.nan, 0, 0), (math.inf, 0, 0)])
    assert_reported(stage, "transform not finite", BAD, f"{BAD}[0]")


def test_point_instancers_in_each_other(stage: Usd.Stage) -> None:
    """One that is its own prototype, and two that are each other's."""
    add_square(stage, f"{BAD}/A")
    add_point_instancer(stage, BAD, [BAD, f"{BAD}/A"], [0, 1])
    add_point_instancer(stage, "/World/X", ["/World/Y"], [0])
    add_point_instancer(stage, "/World/Y", ["/World/X"], [0])
    translation = translate(stage)
    assert kinds(translation)["instancing cycle"] >= 1
    assert GOOD in instances(translation) and f"{BAD}[1]" in instances(translation)
    with pytest.raises(StageError, match="prototype of itself"):
        translate(stage, strict=True)


# Names and depths


def test_names_in_all_scripts(stage: Usd.Stage, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = ["Schöne_Fläche", "正方形", "квадрат", "𠮷野"]
    for name in names:
        bind(add_square(stage, f"/World/{name}"), add_material(stage, f"/World/Stoff_{name}"))
    translation = translate(stage, strict=True)
    assert sorted(instances(translation)) == sorted([GOOD, *(f"/World/{n}" for n in names)])
    assert material_name(translation, "/World/正方形") == "/World/Stoff_正方形"
    file = str(tmp_path / "größe.usda")
    stage.Export(file)
    assert cli.main(["dump", file, "--mask", "/World/正方形"]) == ExitCode.OK
    assert "instance /World/正方形" in capsys.readouterr().out


def test_a_namespace_of_10000_levels(stage: Usd.Stage) -> None:
    path = add_chain(stage, 10000)
    mesh = add_square(stage, f"{path}/Mesh")
    mesh.AddTranslateOp().Set((1, 2, 3))
    UsdGeom.Xformable(stage.GetPrimAtPath("/World/X")).AddTranslateOp().Set((1, 1, 1))
    found = instances(translate(stage, strict=True))
    assert found[f"{path}/Mesh"]["to_world"][3, :3].tolist() == [2, 3, 4]


# Other prims


@pytest.mark.parametrize(
    ("kind", "attribute", "value"),
    [
        ("SphereLight", "inputs:radius", -1.0),
        ("SphereLight", "inputs:intensity", math.nan),
        ("RectLight", "inputs:width", math.inf),
        ("DistantLight", "inputs:angle", math.nan),
        ("DomeLight", "inputs:exposure", math.inf),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value")  # infinity times 0
def test_lights_with_bad_values(stage: Usd.Stage, kind: str, attribute: str, value: float) -> None:
    stage.DefinePrim(BAD, kind).GetAttribute(attribute).Set(value)
    translation = translate(stage)
    translation.scene.validate()
    assert [r.path for r in translation.reports.errors] == [BAD]
    with pytest.raises(StageError, match=BAD):
        translate(stage, strict=True)


@pytest.mark.parametrize(
    ("kind", "attribute", "value"),
    [
        ("Sphere", "radius", -1.0),
        ("Sphere", "radius", math.nan),
        ("Cube", "size", math.inf),
        ("Cylinder", "height", math.nan),
        ("Cone", "radius", -2.0),
        ("Capsule", "axis", "W"),
    ],
)
def test_shapes_with_bad_values(stage: Usd.Stage, kind: str, attribute: str, value: Any) -> None:
    stage.DefinePrim(BAD, kind).GetAttribute(attribute).Set(value)
    translation = translate(stage)
    translation.scene.validate()
    assert [r.path for r in translation.reports if not r.kind.startswith("camera")][-1] == BAD


@pytest.mark.parametrize(
    ("attribute", "value"),
    [
        ("focalLength", math.nan),
        ("horizontalAperture", 0.0),
        ("clippingRange", Gf.Vec2f(math.nan, 1)),
        ("clippingRange", Gf.Vec2f(10, 1)),
        ("fStop", math.nan),
        ("focusDistance", math.inf),
        ("shutter:open", math.nan),
    ],
)
def test_cameras_with_bad_values(stage: Usd.Stage, attribute: str, value: Any) -> None:
    """Core refuses what no picture can be made with; the rest is reported."""
    camera = UsdGeom.Camera.Define(stage, BAD)
    camera.CreateFStopAttr(2.0)
    camera.CreateFocusDistanceAttr(5.0)
    camera.GetPrim().GetAttribute(attribute).Set(value)
    translation = translate(stage, time=Usd.TimeCode(1))
    try:
        translation.scene.validate()
    except _core.Error as refused:
        assert refused.kind == "scene" and BAD in str(refused)
    else:
        assert [r.path for r in translation.reports.errors] == [BAD]


@pytest.mark.parametrize(
    ("name", "value"),
    [("roughness", math.nan), ("diffuseColor", (math.inf, 0.0, 0.0)), ("opacity", -3.0), ("ior", 0.0)],
)
def test_materials_with_bad_values(stage: Usd.Stage, name: str, value: Any) -> None:
    material = add_material(stage, "/World/Material", **{name: value})
    bind(add_square(stage, BAD), material)
    translation = translate(stage)
    translation.scene.validate()
    assert BAD in instances(translation)
    assert any("/World/Material" in r.path for r in translation.reports), translation.reports.lines()


def _curves(stage: Usd.Stage, path: str) -> None:
    curves = UsdGeom.BasisCurves.Define(stage, path)
    curves.CreatePointsAttr([(i, 0, 0) for i in range(4)])
    curves.CreateCurveVertexCountsAttr([4])


def _subset(stage: Usd.Stage, path: str) -> None:
    add_strip(stage, str(Sdf.Path(path).GetParentPath()))
    subset = UsdGeom.Subset.Define(stage, path)
    subset.CreateFamilyNameAttr("materialBind")
    bind(subset, add_material(stage, "/World/Material"))


def _instancer(stage: Usd.Stage, path: str) -> None:
    add_square(stage, f"{path}/A")
    add_point_instancer(stage, path, [f"{path}/A"], [0, 0])


SETUPS: dict[str, Callable[[Usd.Stage, str], object]] = {
    "Mesh": add_strip,
    "BasisCurves": _curves,
    "Points": lambda s, p: UsdGeom.Points.Define(s, p).CreatePointsAttr([(0, 0, 0), (1, 0, 0)]),
    "PointInstancer": _instancer,
    "GeomSubset": _subset,
    **{
        name: lambda s, p, name=name: s.DefinePrim(p, name)
        for name in (
            *("Camera", "Sphere", "Cube", "Capsule_1", "Plane", "SphereLight", "RectLight", "DiskLight"),
            *("DistantLight", "CylinderLight", "DomeLight_1", "GeometryLight", "SkelRoot", "Skeleton"),
        )
    },
}
WRONG = {
    "String": "x",
    "Double": math.nan,
    "StringArray": Vt.StringArray(["a", "b"]),
    "IntArray": Vt.IntArray([7]),
    "Float3Array": Vt.Vec3fArray([(1, 2, 3)]),
}


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize("kind", SETUPS)
@pytest.mark.parametrize("type_name", WRONG)
def test_no_attribute_of_a_wrong_type_is_an_internal_error(kind: str, type_name: str) -> None:
    """A prim for each attribute of a type, in which that one is wrong. Cameras may be refused."""
    definition = Usd.SchemaRegistry().FindConcretePrimDefinition(kind)
    names = [n for n in definition.GetPropertyNames() if definition.GetSchemaAttributeSpec(n)]
    names += ["primvars:displayColor", "primvars:normals", "primvars:widths", "xformOp:translate"]
    stage = new_stage()
    add_square(stage, GOOD)
    paths = [f"/World/P{i}/Bad" for i in range(len(names))]
    for path, name in zip(paths, names, strict=True):
        SETUPS[kind](stage, path)
        if name == "xformOp:translate":
            order = stage.GetPrimAtPath(path).CreateAttribute("xformOpOrder", Sdf.ValueTypeNames.TokenArray)
            order.Set([name])
        retype(name, type_name, WRONG[type_name])(stage.GetPrimAtPath(path))
    if kind != "Camera":
        assert GOOD in instances(translate(stage))
        return
    for path in paths:
        try:
            translate(stage, camera=path).scene.validate()
        except (StageError, _core.Error) as refused:
            assert path in str(refused)
