"""Meshes: topology, subdivision rules, primvars, transforms, visibility, purpose, time, and bad input."""

import math
from pathlib import Path

import numpy as np
import pytest
from encore.adapters.context import SyncContext
from encore.adapters.mesh import read_mesh
from encore.errors import StageError
from encore.report import Reports
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, Vt
from stages import (
    SQUARE,
    add_material,
    add_square,
    add_strip,
    bind,
    connect_texture,
    instances,
    kinds,
    meshes,
    new_stage,
    surface,
    translate,
    write_image,
)


def test_topology_points_and_rules(stage: Usd.Stage) -> None:
    mesh = add_strip(stage, "/World/Mesh", "catmullClark")
    mesh.CreateOrientationAttr("leftHanded")
    mesh.CreateDoubleSidedAttr(True)
    mesh.CreateInterpolateBoundaryAttr("edgeOnly")
    mesh.CreateFaceVaryingLinearInterpolationAttr("boundaries")
    mesh.CreateTriangleSubdivisionRuleAttr("smooth")
    mesh.CreateHoleIndicesAttr([1])
    mesh.CreateCornerIndicesAttr([0, 7])
    mesh.CreateCornerSharpnessesAttr([1.5, 10])
    mesh.CreateCreaseIndicesAttr([2, 3, 4, 5])
    mesh.CreateCreaseLengthsAttr([2, 2])
    mesh.CreateCreaseSharpnessesAttr([2.5, 10])
    found = meshes(translate(stage))["/World/Mesh"]
    assert found["scheme"] == "catmullClark"
    assert found["left_handed"] and found["double_sided"]
    assert found["interpolate_boundary"] == "edgeOnly"
    assert found["face_varying"] == "boundaries"
    assert found["triangle_subdivision"] == "smooth"
    assert found["hole_indices"].tolist() == [1]
    assert found["corner_indices"].tolist() == [0, 7]
    assert found["corner_sharpnesses"].tolist() == [1.5, 10]
    assert found["crease_indices"].tolist() == [2, 3, 4, 5]
    assert found["crease_lengths"].tolist() == [2, 2]
    assert found["crease_sharpnesses"].tolist() == [2.5, 10]
    assert found["face_vertex_counts"].tolist() == [4, 4, 4]
    assert found["face_vertex_indices"].tolist() == [0, 2, 3, 1, 2, 4, 5, 3, 4, 6, 7, 5]
    np.testing.assert_array_equal(found["points"], np.array(mesh.GetPointsAttr().Get()))


def test_what_is_not_authored_is_usds_fallback(stage: Usd.Stage) -> None:
    mesh = UsdGeom.Mesh.Define(stage, "/World/Mesh")
    mesh.CreatePointsAttr(SQUARE)
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    found = meshes(translate(stage))["/World/Mesh"]
    assert found["scheme"] == mesh.GetSubdivisionSchemeAttr().Get()
    assert found["interpolate_boundary"] == mesh.GetInterpolateBoundaryAttr().Get()
    assert found["face_varying"] == mesh.GetFaceVaryingLinearInterpolationAttr().Get()
    assert found["triangle_subdivision"] == mesh.GetTriangleSubdivisionRuleAttr().Get()
    assert found["double_sided"] == mesh.GetDoubleSidedAttr().Get()
    assert not found["left_handed"]


@pytest.mark.parametrize("scheme", ["none", "catmullClark", "loop", "bilinear"])
def test_every_scheme(stage: Usd.Stage, scheme: str) -> None:
    mesh = add_square(stage, "/World/Mesh", scheme)
    mesh.CreateFaceVertexCountsAttr([3, 3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 0, 2, 3])
    assert meshes(translate(stage))["/World/Mesh"]["scheme"] == scheme


def test_points_are_not_copied_in_python(stage: Usd.Stage) -> None:
    mesh = add_square(stage, "/World/Mesh")
    context = SyncContext(stage, Usd.TimeCode.Default(), Reports())
    data = read_mesh(mesh, {}, (), False, context)
    assert data is not None
    for array in (data.points, data.face_vertex_counts, data.face_vertex_indices):
        assert not array.flags.owndata, "a view of USD's own array"


def test_normals_primvar_wins_over_attribute(stage: Usd.Stage) -> None:
    mesh = add_square(stage, "/World/Mesh")
    mesh.CreateNormalsAttr([(0, 0, 1)] * 4)
    found = meshes(translate(stage))["/World/Mesh"]["normals"]
    assert found["interpolation"] == "vertex" and found["values"].tolist() == [[0, 0, 1]] * 4
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "normals", Sdf.ValueTypeNames.Normal3fArray, UsdGeom.Tokens.faceVarying
    )
    primvar.Set([(0, 1, 0), (1, 0, 0)])
    primvar.SetIndices(Vt.IntArray([0, 1, 1, 0]))
    found = meshes(translate(stage))["/World/Mesh"]["normals"]
    assert found["interpolation"] == "faceVarying"
    assert found["values"].tolist() == [[0, 1, 0], [1, 0, 0]]
    assert found["indices"].tolist() == [0, 1, 1, 0]


def test_normals_of_a_subdivision_surface_are_not_read(stage: Usd.Stage) -> None:
    add_square(stage, "/World/Mesh", "catmullClark").CreateNormalsAttr([(0, 0, 1)] * 4)
    assert meshes(translate(stage))["/World/Mesh"]["normals"] is None


SIZES = {"constant": 1, "uniform": 3, "vertex": 8, "varying": 8, "faceVarying": 12}


def add_textured(stage: Usd.Stage, mesh: UsdGeom.Mesh, folder: Path, name: str = "st") -> None:
    """Binds a material with a diffuse texture that reads `name` (a file of one white pixel)."""
    material = add_material(stage, "/World/Textured")
    connect_texture(stage, surface(material), write_image(folder / "white.png"), name)
    bind(mesh, material)


@pytest.mark.parametrize("interpolation", SIZES)
@pytest.mark.parametrize("indexed", [False, True])
def test_texture_coordinates(stage: Usd.Stage, tmp_path: Path, interpolation: str, indexed: bool) -> None:
    mesh = add_strip(stage, "/World/Mesh")
    add_textured(stage, mesh, tmp_path)
    size = SIZES[interpolation]
    values = np.arange(2 * size, dtype=np.float32).reshape(size, 2)
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, interpolation)
    primvar.Set(Vt.Vec2fArray.FromNumpy(values[::-1].copy() if indexed else values))
    if indexed:
        primvar.SetIndices(Vt.IntArray(range(size - 1, -1, -1)))
    translation = translate(stage)
    (found,) = meshes(translation)["/World/Mesh"]["texcoords"]
    assert (found["name"], found["interpolation"]) == ("st", interpolation)
    flat = found["values"][found["indices"]] if indexed else found["values"]
    np.testing.assert_array_equal(flat, values)
    assert not kinds(translation).keys() - {"camera"}


@pytest.mark.parametrize("kind", ["Float2", "TexCoord2d", "TexCoord2h"])
def test_texture_coordinates_of_other_types(stage: Usd.Stage, tmp_path: Path, kind: str) -> None:
    mesh = add_square(stage, "/World/Mesh")
    add_textured(stage, mesh, tmp_path, "map1")
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "map1", getattr(Sdf.ValueTypeNames, f"{kind}Array"), "vertex"
    )
    primvar.Set([(0, 0), (0.5, 0), (0.5, 1), (0, 1)])
    (found,) = meshes(translate(stage))["/World/Mesh"]["texcoords"]
    assert found["values"].dtype == np.float32
    assert found["values"].tolist() == [[0, 0], [0.5, 0], [0.5, 1], [0, 1]]


def test_only_the_coordinates_that_are_read(stage: Usd.Stage, tmp_path: Path) -> None:
    mesh = add_square(stage, "/World/Mesh")
    api = UsdGeom.PrimvarsAPI(mesh)
    for name in ("st", "uv"):
        api.CreatePrimvar(name, Sdf.ValueTypeNames.TexCoord2fArray, "constant").Set([(0, 0)])
    assert meshes(translate(stage))["/World/Mesh"]["texcoords"] == []
    add_textured(stage, mesh, tmp_path, "uv")
    assert [t["name"] for t in meshes(translate(stage))["/World/Mesh"]["texcoords"]] == ["uv"]


def test_missing_coordinates_are_reported(stage: Usd.Stage, tmp_path: Path) -> None:
    mesh = add_square(stage, "/World/Mesh")
    add_textured(stage, mesh, tmp_path)
    translation = translate(stage)
    assert kinds(translation)["missing primvar st"] == 1
    assert meshes(translation)["/World/Mesh"]["texcoords"] == []


@pytest.mark.parametrize(
    ("values", "indices"),
    [
        ([(1, 0, 0)] * 3, None),
        ([(1, 0, 0)], [0, 0, 0]),
        ([(1, 0, 0)], [0, 0, 0, 7]),
        ([(math.nan, 0, 0)] * 4, None),
    ],
    ids=["too short", "too few indices", "index out of range", "NaN"],
)
def test_a_bad_primvar_is_left_out_and_reported(
    stage: Usd.Stage, values: list[tuple[float, float, float]], indices: list[int] | None
) -> None:
    mesh = add_square(stage, "/World/Mesh")
    primvar = mesh.CreateDisplayColorPrimvar("vertex")
    primvar.Set(values)
    if indices:
        primvar.SetIndices(Vt.IntArray(indices))
    translation = translate(stage)
    assert meshes(translation)["/World/Mesh"]["display_color"] is None
    assert kinds(translation)["bad primvar displayColor"] == 1
    assert translation.reports.has_errors
    with pytest.raises(StageError, match="displayColor"):
        translate(stage, strict=True)


def test_a_long_primvar_is_cut(stage: Usd.Stage) -> None:
    mesh = add_square(stage, "/World/Mesh")
    mesh.CreateDisplayColorPrimvar("vertex").Set([(i / 8, 0, 0) for i in range(7)])
    translation = translate(stage)
    found = meshes(translation)["/World/Mesh"]["display_color"]["values"]
    assert found[:, 0].tolist() == [0, 0.125, 0.25, 0.375]
    assert kinds(translation)["long primvar displayColor"] == 1


def test_edge_lengths_are_inherited(stage: Usd.Stage) -> None:
    for path in ("/World/A", "/World/A/B", "/World/A/C"):
        add_square(stage, path)

    for path, length in (("/World", 0.5), ("/World/A/C", 0.125)):
        api = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(path))
        api.CreatePrimvar("encore:targetEdgeLength", Sdf.ValueTypeNames.Float).Set(length)
    found = meshes(translate(stage))
    assert found["/World/A"]["target_edge_length_world"] == 0.5
    assert found["/World/A/B"]["target_edge_length_world"] == 0.5
    assert found["/World/A/C"]["target_edge_length_world"] == 0.125


def test_a_negative_edge_length_is_ignored(stage: Usd.Stage) -> None:
    mesh = add_square(stage, "/World/Mesh")
    api = UsdGeom.PrimvarsAPI(mesh)
    api.CreatePrimvar("encore:targetEdgeLength", Sdf.ValueTypeNames.Float).Set(-1.0)
    translation = translate(stage)
    assert meshes(translation)["/World/Mesh"]["target_edge_length_world"] == 0.0
    assert kinds(translation)["bad primvar encore:targetEdgeLength"] == 1


def test_transforms_are_composed_in_double(stage: Usd.Stage) -> None:
    UsdGeom.Xformable(stage.GetPrimAtPath("/World")).AddTranslateOp().Set((1e9, 0, 0))
    mesh = add_square(stage, "/World/Mesh")
    mesh.AddTranslateOp().Set((0.125, 2, 3))
    mesh.AddScaleOp().Set((2, 2, -2))
    matrix = instances(translate(stage))["/World/Mesh"]["to_world"]
    expected = UsdGeom.XformCache().GetLocalToWorldTransform(mesh.GetPrim())
    np.testing.assert_array_equal(matrix, np.array(expected))
    assert matrix[3, 0] == 1e9 + 0.125


def test_reset_xform_stack(stage: Usd.Stage) -> None:
    UsdGeom.Xformable(stage.GetPrimAtPath("/World")).AddTranslateOp().Set((5, 0, 0))
    mesh = add_square(stage, "/World/Mesh")
    mesh.AddTranslateOp().Set((0, 1, 0))
    mesh.SetResetXformStack(True)
    matrix = instances(translate(stage))["/World/Mesh"]["to_world"]
    assert matrix[3, :3].tolist() == [0, 1, 0]


def test_a_singular_transform_is_reported_and_left_out(stage: Usd.Stage) -> None:
    add_square(stage, "/World/Seen")
    add_square(stage, "/World/Flat").AddScaleOp().Set((1, 0, 1))
    add_square(stage, "/World/Broken").AddTranslateOp().Set((math.nan, 0, 0))
    translation = translate(stage)
    assert list(instances(translation)) == ["/World/Seen"]
    assert kinds(translation)["singular transform"] == 2


def test_visibility_is_inherited(stage: Usd.Stage) -> None:
    for path in ("/World/Seen", "/World/Hidden/Child", "/World/Hidden/Deep/Child"):
        add_square(stage, path)
    UsdGeom.Xform.Define(stage, "/World/Hidden").MakeInvisible()
    assert list(meshes(translate(stage))) == ["/World/Seen"]


def test_inactive_and_abstract_prims_are_not_there(stage: Usd.Stage) -> None:
    add_square(stage, "/World/Seen")
    add_square(stage, "/World/Off").GetPrim().SetActive(False)
    stage.CreateClassPrim("/Class")
    add_square(stage, "/Class/Mesh")
    add_square(stage, "/Over/Mesh")
    stage.GetPrimAtPath("/Over").SetSpecifier(Sdf.SpecifierOver)
    assert list(meshes(translate(stage))) == ["/World/Seen"]


def test_purposes(stage: Usd.Stage) -> None:
    for purpose in ("default", "render", "proxy", "guide"):
        add_square(stage, f"/World/{purpose}").CreatePurposeAttr(purpose)
    UsdGeom.Xform.Define(stage, "/World/Group").CreatePurposeAttr("render")
    add_square(stage, "/World/Group/Inherits")
    add_square(stage, "/World/Group/Own").CreatePurposeAttr("guide")
    assert set(meshes(translate(stage))) == {"/World/default", "/World/proxy"}
    found = set(meshes(translate(stage, purposes=("default", "render"))))
    assert found == {"/World/default", "/World/render", "/World/Group/Inherits"}


def test_time_samples(stage: Usd.Stage) -> None:
    mesh = add_square(stage, "/World/Mesh")
    points = np.array(SQUARE, dtype=np.float32)
    mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points), 1)
    mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points * 3), 3)
    translate_op = mesh.AddTranslateOp()
    translate_op.Set((0, 0, 0), 1)
    translate_op.Set((4, 0, 0), 3)
    translation = translate(stage, time=Usd.TimeCode(2))
    np.testing.assert_allclose(meshes(translation)["/World/Mesh"]["points"], points * 2)
    assert instances(translation)["/World/Mesh"]["to_world"][3, 0] == 2


def test_visibility_may_vary_with_time(stage: Usd.Stage) -> None:
    add_square(stage, "/World/Seen")
    attribute = add_square(stage, "/World/Blinks").CreateVisibilityAttr()
    attribute.Set("invisible", 1)
    attribute.Set("inherited", 2)
    assert set(meshes(translate(stage, time=Usd.TimeCode(1)))) == {"/World/Seen"}
    assert set(meshes(translate(stage, time=Usd.TimeCode(2)))) == {"/World/Seen", "/World/Blinks"}


@pytest.mark.parametrize(
    ("attribute", "value", "says"),
    [
        ("faceVertexIndices", [0, 1, 2, 9], "faceVertexIndices"),
        ("faceVertexIndices", [0, 1, 2, -1], "faceVertexIndices"),
        ("faceVertexCounts", [5], "faceVertexCounts"),
        ("faceVertexCounts", [2, 2], "faceVertexCounts"),
        ("points", [(0, 0, 0), (math.nan, 0, 0), (1, 1, 0), (0, 1, 0)], "not finite"),
        ("subdivisionScheme", "octahedral", "subdivisionScheme"),
    ],
)
def test_a_bad_mesh_is_left_out_and_reported(
    stage: Usd.Stage, attribute: str, value: object, says: str
) -> None:
    add_square(stage, "/World/Good")
    add_square(stage, "/World/Bad").GetPrim().GetAttribute(attribute).Set(value)
    translation = translate(stage)
    assert list(meshes(translation)) == ["/World/Good"]
    (report,) = translation.reports.errors
    assert (report.kind, report.path) == ("bad mesh", "/World/Bad")
    assert says in report.message
    with pytest.raises(StageError, match="/World/Bad"):
        translate(stage, strict=True)


def test_an_empty_mesh_is_reported(stage: Usd.Stage) -> None:
    add_square(stage, "/World/Good")
    UsdGeom.Mesh.Define(stage, "/World/Empty")
    translation = translate(stage)
    assert list(meshes(translation)) == ["/World/Good"]
    assert kinds(translation)["empty mesh"] == 1


def test_what_is_unsupported_is_reported_once_per_kind() -> None:
    stage = new_stage()
    mesh = add_square(stage, "/World/Mesh")
    UsdLux.MeshLightAPI.Apply(mesh.GetPrim())
    for i in range(3):
        UsdGeom.BasisCurves.Define(stage, f"/World/Curves{i}")
    UsdGeom.Points.Define(stage, "/World/Points")
    UsdGeom.NurbsPatch.Define(stage, "/World/Patch")
    UsdGeom.TetMesh.Define(stage, "/World/Tets")
    stage.DefinePrim("/World/Volume", "Volume")
    mesh.CreateDisplayOpacityAttr([0.5])
    indices = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("skel:jointIndices", Sdf.ValueTypeNames.IntArray)
    indices.Set([0])
    UsdGeom.ModelAPI.Apply(stage.GetPrimAtPath("/World")).CreateModelDrawModeAttr("cards")
    translation = translate(stage)
    found = kinds(translation)
    assert found["unsupported BasisCurves"] == 3
    expected = {"Points", "NurbsPatch", "TetMesh", "Volume", "MeshLightAPI"}
    assert {k.removeprefix("unsupported ") for k in found if k.startswith("unsupported ")} - {
        "BasisCurves"
    } == expected
    assert {"displayOpacity", "skinning", "draw mode"} <= found.keys()
    lines = [line for line in translation.reports.lines() if "BasisCurves" in line]
    assert len(lines) == 1 and "/World/Curves0" in lines[0] and "3 prims" in lines[0]


def test_unsupported_geometry_of_another_purpose_is_not_reported(stage: Usd.Stage) -> None:
    add_square(stage, "/World/Mesh")
    UsdGeom.BasisCurves.Define(stage, "/World/Guides").CreatePurposeAttr("guide")
    assert "unsupported BasisCurves" not in kinds(translate(stage))


def test_a_deep_namespace(stage: Usd.Stage) -> None:
    path = "/World" + "/X" * 5000
    layer = stage.GetRootLayer()
    with Sdf.ChangeBlock():
        Sdf.CreatePrimInLayer(layer, path)
        prim = layer.GetPrimAtPath(path)
        while prim.path != Sdf.Path("/World"):
            prim.specifier, prim.typeName = Sdf.SpecifierDef, "Xform"
            prim = prim.nameParent
    mesh = add_square(stage, f"{path}/Mesh")
    mesh.AddTranslateOp().Set(Gf.Vec3d(1, 2, 3))
    assert instances(translate(stage))[f"{path}/Mesh"]["to_world"][3, :3].tolist() == [1, 2, 3]
