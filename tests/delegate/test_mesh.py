"""Meshes: topology, subdivision rules, primvars, transforms, visibility, purpose, time, and bad input."""

import math
from pathlib import Path

import numpy as np
import pytest
from encore.adapters.context import SyncContext
from encore.adapters.mesh import read_mesh
from encore.adapters.primvars import Wanted
from encore.errors import StageError
from encore.report import Reports
from pxr import Gf, Sdf, Usd, UsdGeom, Vt
from stages import (
    SQUARE,
    add_chain,
    add_material,
    add_square,
    add_strip,
    bind,
    connect_reader,
    connect_texture,
    instances,
    kinds,
    meshes,
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
    data = read_mesh(mesh, {}, Wanted(), context)
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


def test_coordinates_of_another_type_are_reported(stage: Usd.Stage, tmp_path: Path) -> None:
    mesh = add_square(stage, "/World/Mesh")
    add_textured(stage, mesh, tmp_path)
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord3fArray, "constant")
    primvar.Set([(0, 0, 0)])
    translation = translate(stage)
    assert kinds(translation)["bad primvar st"] == 1
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


# Primvars that materials read


def bind_reader(
    stage: Usd.Stage, mesh: UsdGeom.Mesh, kind: str, name: str, target: str, fallback: object = None
) -> None:
    """Binds a material whose input `target` reads the primvar."""
    material = add_material(stage, "/World/Reading")
    connect_reader(stage, surface(material), kind, name, target, fallback)
    bind(mesh, material)


@pytest.mark.parametrize("interpolation", SIZES)
@pytest.mark.parametrize("indexed", [False, True])
def test_primvars_of_materials(stage: Usd.Stage, interpolation: str, indexed: bool) -> None:
    mesh = add_strip(stage, "/World/Mesh")
    bind_reader(stage, mesh, "float3", "tint", "diffuseColor")
    size = SIZES[interpolation]
    values = np.arange(3 * size, dtype=np.float32).reshape(size, 3)
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("tint", Sdf.ValueTypeNames.Color3fArray, interpolation)
    primvar.Set(Vt.Vec3fArray.FromNumpy(values[::-1].copy() if indexed else values))
    if indexed:
        primvar.SetIndices(Vt.IntArray(range(size - 1, -1, -1)))
    translation = translate(stage)
    (found,) = meshes(translation)["/World/Mesh"]["primvars"]
    assert (found["name"], found["interpolation"]) == ("tint", interpolation)
    flat = found["values"][found["indices"]] if indexed else found["values"]
    np.testing.assert_array_equal(flat[:, :3], values)
    assert (flat[:, 3] == 0).all()
    assert not kinds(translation).keys() - {"camera"}


@pytest.mark.parametrize(
    ("reader", "target", "kind", "value", "expected"),
    [
        ("float", "roughness", "FloatArray", [0.25], [0.25, 0, 0, 0]),
        ("float", "roughness", "Float", 0.25, [0.25, 0, 0, 0]),
        ("float", "roughness", "DoubleArray", [0.25], [0.25, 0, 0, 0]),
        ("float", "roughness", "HalfArray", [0.25], [0.25, 0, 0, 0]),
        ("int", "metallic", "IntArray", [1], [1, 0, 0, 0]),
        ("float3", "diffuseColor", "Float3", (1, 2, 3), [1, 2, 3, 0]),
        ("point", "emissiveColor", "Point3fArray", [(1, 2, 3)], [1, 2, 3, 0]),
        ("normal", "emissiveColor", "Normal3fArray", [(1, 2, 3)], [1, 2, 3, 0]),
        ("vector", "emissiveColor", "Vector3dArray", [(1, 2, 3)], [1, 2, 3, 0]),
        # More than is read is no harm.
        ("float3", "diffuseColor", "Color4fArray", [(1, 2, 3, 4)], [1, 2, 3, 4]),
    ],
)
def test_types_of_primvars(
    stage: Usd.Stage, reader: str, target: str, kind: str, value: object, expected: list[float]
) -> None:
    mesh = add_square(stage, "/World/Mesh")
    bind_reader(stage, mesh, reader, "x", target)
    type_name = getattr(Sdf.ValueTypeNames, kind)
    UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("x", type_name, "constant").Set(value)
    translation = translate(stage)
    (found,) = meshes(translation)["/World/Mesh"]["primvars"]
    assert found["values"].tolist() == [expected]
    assert not kinds(translation).keys() - {"camera"}
    translation.scene.validate()


@pytest.mark.parametrize(
    ("reader", "target", "kind", "value"),
    [
        ("float3", "diffuseColor", "FloatArray", [0.25]),
        ("float", "roughness", "StringArray", ["rough"]),
        ("float", "roughness", "Matrix4dArray", [Gf.Matrix4d(1)]),
        ("float3", "diffuseColor", "Float3Array", [(math.nan, 0, 0)]),
    ],
)
def test_primvars_that_a_material_cannot_read(
    stage: Usd.Stage, reader: str, target: str, kind: str, value: object
) -> None:
    mesh = add_square(stage, "/World/Mesh")
    bind_reader(stage, mesh, reader, "x", target)
    type_name = getattr(Sdf.ValueTypeNames, kind)
    UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("x", type_name, "constant").Set(value)
    translation = translate(stage)
    assert meshes(translation)["/World/Mesh"]["primvars"] == []
    assert kinds(translation)["bad primvar x"] == 1
    translation.scene.validate()


def test_missing_primvars_are_reported_where_nothing_replaces_them(stage: Usd.Stage) -> None:
    mesh = add_square(stage, "/World/Mesh")
    bind_reader(stage, mesh, "float", "x", "roughness")
    assert kinds(translate(stage))["missing primvar x"] == 1
    bind_reader(stage, mesh, "float", "x", "roughness", 0.75)
    assert "missing primvar x" not in kinds(translate(stage))


def test_normals_of_the_wrong_width_are_left_out(stage: Usd.Stage) -> None:
    """Twelve floats are no four normals."""
    mesh = add_square(stage, "/World/Mesh")
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("normals", Sdf.ValueTypeNames.FloatArray, "vertex")
    primvar.Set([0.0, 0, 1] * 4)
    translation = translate(stage)
    assert meshes(translation)["/World/Mesh"]["normals"] is None
    assert kinds(translation)["bad primvar normals"] == 1


def test_inherited_primvars_that_materials_read_are_the_instances(stage: Usd.Stage) -> None:
    """Those that fit; instances go on to share. Others tell instances apart where materials read them."""
    stage.CreateClassPrim("/Asset")
    bind_reader(stage, add_square(stage, "/Asset/Mesh"), "float", "wear", "roughness")
    for i in range(4):
        prim = stage.DefinePrim(f"/World/I{i}")
        prim.GetReferences().AddInternalReference("/Asset")
        prim.SetInstanceable(True)
        api = UsdGeom.PrimvarsAPI(prim)
        api.CreatePrimvar("id", Sdf.ValueTypeNames.Float).Set(float(i))
        api.CreatePrimvar("wear", Sdf.ValueTypeNames.Float).Set(float(i // 2))
    translation = translate(stage)
    assert translation.counts["prototypes"] == 1
    given = [translation.scene.instance(i)["primvars"] for i in range(4)]
    assert [[(p["name"], p["value"][0]) for p in primvars] for primvars in given] == [
        [("wear", i // 2)] for i in range(4)
    ]
    for i in range(4):
        wear = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(f"/World/I{i}")).GetPrimvar("wear")
        wear.GetAttr().SetMetadata("elementSize", 2)
    assert translate(stage).counts["prototypes"] == 2


# Sheets and solids

TETRAHEDRON = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
FACES = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]


def add_tetrahedron(stage: Usd.Stage, faces: list[tuple[int, ...]], split: bool = False) -> UsdGeom.Mesh:
    """split: every face has points of its own."""
    mesh = UsdGeom.Mesh.Define(stage, "/World/Mesh")
    points = [TETRAHEDRON[i] for face in faces for i in face] if split else TETRAHEDRON
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr([3] * len(faces))
    mesh.CreateFaceVertexIndicesAttr(list(range(3 * len(faces))) if split else [i for f in faces for i in f])
    mesh.CreateSubdivisionSchemeAttr("none")
    return mesh


@pytest.mark.parametrize(
    ("faces", "split", "thin"),
    [(FACES, False, False), (FACES, True, False), (FACES[:3], False, True), (FACES[:3], True, True)],
)
def test_closed_meshes_are_solids(
    stage: Usd.Stage, faces: list[tuple[int, ...]], split: bool, thin: bool
) -> None:
    mesh = add_tetrahedron(stage, faces, split)
    bind(mesh, add_material(stage, "/World/Glass", opacity=0.0))
    assert meshes(translate(stage))["/World/Mesh"]["thin_walled"] is thin


def test_zeros_of_either_sign_are_one_place(stage: Usd.Stage) -> None:
    mesh = add_tetrahedron(stage, FACES, split=True)
    points = np.array(mesh.GetPointsAttr().Get())
    points[:3][points[:3] == 0] = -0.0
    mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points))
    bind(mesh, add_material(stage, "/World/Glass", opacity=0.0))
    assert not meshes(translate(stage))["/World/Mesh"]["thin_walled"]


def test_holes_open_a_mesh(stage: Usd.Stage) -> None:
    mesh = add_tetrahedron(stage, FACES)
    mesh.GetSubdivisionSchemeAttr().Set("loop")
    bind(mesh, add_material(stage, "/World/Glass", opacity=0.0))
    assert not meshes(translate(stage))["/World/Mesh"]["thin_walled"]
    mesh.CreateHoleIndicesAttr([1])
    assert meshes(translate(stage))["/World/Mesh"]["thin_walled"]


def test_bodies_that_touch_along_an_edge_are_solids(stage: Usd.Stage) -> None:
    mesh = add_tetrahedron(stage, FACES)
    mesh.CreatePointsAttr([*TETRAHEDRON, (0, -1, 0), (0, 0, -1)])
    second = [(0, 4, 1), (0, 1, 5), (1, 4, 5), (4, 0, 5)]
    mesh.CreateFaceVertexCountsAttr([3] * 8)
    mesh.CreateFaceVertexIndicesAttr([i for f in (*FACES, *second) for i in f])
    bind(mesh, add_material(stage, "/World/Glass", opacity=0.0))
    assert not meshes(translate(stage))["/World/Mesh"]["thin_walled"]


@pytest.mark.parametrize("authored", [True, False])
def test_thin_walled_as_authored_above_the_mesh(stage: Usd.Stage, authored: bool) -> None:
    mesh = add_tetrahedron(stage, FACES if authored else FACES[:3])
    bind(mesh, add_material(stage, "/World/Glass", opacity=0.0))
    api = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World"))
    api.CreatePrimvar("encore:thinWalled", Sdf.ValueTypeNames.Bool).Set(authored)
    assert meshes(translate(stage))["/World/Mesh"]["thin_walled"] is authored


@pytest.mark.parametrize(
    ("inputs", "looked_at"),
    [
        ({"opacity": 0.5}, True),
        ({"opacity": 1.0}, False),
        ({"opacity": 0.5, "opacityMode": "presence"}, False),
        ({"opacity": 0.5, "opacityThreshold": 0.25}, False),
    ],
)
def test_only_what_transmits_is_looked_at(
    stage: Usd.Stage, inputs: dict[str, object], looked_at: bool
) -> None:
    bind(add_square(stage, "/World/Mesh"), add_material(stage, "/World/Material", **inputs))
    assert meshes(translate(stage))["/World/Mesh"]["thin_walled"] is looked_at


# Motion


def test_deforming_meshes_bring_points_and_normals_of_the_shutter(stage: Usd.Stage) -> None:
    mesh = add_square(stage, "/World/Mesh")
    points = np.array(SQUARE, np.float32)
    mesh.CreateNormalsAttr()
    mesh.SetNormalsInterpolation("faceVarying")
    for time, scale, normal in ((0.0, 1.0, (0, 0, 1)), (1.0, 3.0, (0, 1, 0))):
        mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points * scale), time)
        mesh.GetNormalsAttr().Set([normal] * 4, time)
    context = SyncContext(stage, Usd.TimeCode(0), Reports(), (0.0, 1.0))
    data = read_mesh(mesh, {}, Wanted(), context)
    assert data is not None and data.motion_points is not None and data.motion_normals is not None
    np.testing.assert_allclose(data.motion_points[[0, -1]], [points, points * 3])
    np.testing.assert_allclose(data.motion_normals[[0, -1], 0], [(0, 0, 1), (0, 1, 0)])
    assert len(data.motion_points) == len(data.motion_normals)
    moved = data.transformed(np.diag([2.0, 1.0, -1.0, 1.0]))
    np.testing.assert_allclose(moved.motion_points[-1], points * 3 * (2, 1, -1))
    np.testing.assert_allclose(moved.motion_normals[0, 0], (0, 0, -1))
    still = read_mesh(mesh, {}, Wanted(), SyncContext(stage, Usd.TimeCode(0), Reports()))
    assert still is not None and still.motion_points is None and still.motion_normals is None


def test_faces_that_are_cut_take_their_primvars_along(stage: Usd.Stage) -> None:
    mesh = add_strip(stage, "/World/Mesh")
    bind_reader(stage, mesh, "float", "x", "roughness")
    UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("x", Sdf.ValueTypeNames.FloatArray, "uniform").Set(
        [1.0, 2.0, 3.0]
    )
    normals = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "normals", Sdf.ValueTypeNames.Normal3fArray, UsdGeom.Tokens.faceVarying
    )
    for time in (0.0, 1.0):
        normals.Set([(float(i), time, 1) for i in range(12)], time)
        mesh.GetPointsAttr().Set(Vt.Vec3fArray([(x, y, time) for x in range(4) for y in range(2)]), time)
    found = UsdGeom.PrimvarsAPI(mesh).GetPrimvars()
    context = SyncContext(stage, Usd.TimeCode(0), Reports(), (0.0, 1.0))
    data = read_mesh(mesh, {str(p.GetPrimvarName()): p for p in found}, Wanted(primvars={"x": 1}), context)
    assert data is not None
    kept = data.without(np.array([False, True, False]))
    assert kept.primvars["x"].values[:, 0].tolist() == [1, 3]
    assert kept.normals is not None and kept.motion_normals is not None
    corners = [0, 1, 2, 3, 8, 9, 10, 11]
    assert kept.normals.values[:, 0].tolist() == corners
    assert kept.motion_normals[-1].tolist() == [[i, 1, 1] for i in corners]


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
    found = {r.kind: r.path for r in translation.reports}
    assert found["singular transform"] == "/World/Flat"
    assert found["transform not finite"] == "/World/Broken"


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


def test_a_deep_namespace(stage: Usd.Stage) -> None:
    path = add_chain(stage, 5000)
    mesh = add_square(stage, f"{path}/Mesh")
    mesh.AddTranslateOp().Set(Gf.Vec3d(1, 2, 3))
    assert instances(translate(stage))[f"{path}/Mesh"]["to_world"][3, :3].tolist() == [1, 2, 3]
