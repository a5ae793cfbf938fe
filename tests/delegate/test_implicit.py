"""Implicit shapes: extents, areas, volumes, normals, sharing."""

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from pxr import Sdf, Usd, UsdGeom
from stages import (
    add_material,
    bind,
    connect_reader,
    connect_texture,
    instances,
    kinds,
    material_name,
    meshes,
    surface,
    translate,
    write_image,
)

PI = math.pi
# Type, attributes, area, volume (None: not closed).
SHAPES = [
    ("Sphere", {"radius": 2.0}, 16 * PI, 32 / 3 * PI),
    ("Cube", {"size": 3.0}, 54.0, 27.0),
    ("Cylinder", {"radius": 2.0, "height": 5.0}, 28 * PI, 20 * PI),
    ("Cylinder_1", {"radiusBottom": 2.0, "radiusTop": 2.0, "height": 5.0}, 28 * PI, 20 * PI),
    ("Cylinder_1", {"radiusBottom": 4.0, "radiusTop": 1.0, "height": 4.0}, 42 * PI, 28 * PI),
    ("Cylinder_1", {"radiusBottom": 0.0, "radiusTop": 3.0, "height": 4.0}, 24 * PI, 12 * PI),
    ("Cone", {"radius": 3.0, "height": 4.0}, 24 * PI, 12 * PI),
    ("Capsule", {"radius": 1.0, "height": 3.0}, 10 * PI, 13 / 3 * PI),
    ("Capsule", {"radius": 1.0, "height": 0.0}, 4 * PI, 4 / 3 * PI),
    ("Capsule_1", {"radiusBottom": 2.0, "radiusTop": 1.0, "height": 1.0}, None, None),
    ("Plane", {"width": 3.0, "length": 2.0}, 6.0, None),
]


def define(
    stage: Usd.Stage, kind: str, attributes: dict[str, object], path: str = "/World/Shape"
) -> Usd.Prim:
    prim = stage.DefinePrim(path, kind)
    for name, value in attributes.items():
        prim.GetAttribute(name).Set(value)
    return prim


class Solid:
    """The one mesh of a scene in world space, as triangles."""

    def __init__(self, stage: Usd.Stage) -> None:
        translation = translate(stage)
        (placed,) = instances(translation).values()
        (mesh,) = meshes(translation).values()
        matrix = placed["to_world"]
        self.points = mesh["points"].astype(np.float64) @ matrix[:3, :3] + matrix[3, :3]
        self.mesh = mesh
        counts, indices = mesh["face_vertex_counts"], mesh["face_vertex_indices"]
        self.starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
        fans = [
            (start, start + i, start + i + 1)
            for start, count in zip(self.starts, counts, strict=True)
            for i in range(1, count - 1)
        ]
        self.corners = np.array(fans)
        self.triangles = self.points[indices[self.corners]]
        linear = np.linalg.inv(matrix[:3, :3]).T
        values = mesh["normals"]["values"].astype(np.float64) @ linear
        self.normals = (values / np.linalg.norm(values, axis=1, keepdims=True))[self.corners]

    @property
    def facets(self) -> npt.NDArray[np.float64]:
        """Twice the area, as vectors along the winding's normals."""
        a, b, c = np.moveaxis(self.triangles, 1, 0)
        return np.cross(b - a, c - a)

    @property
    def area(self) -> float:
        return float(np.linalg.norm(self.facets, axis=1).sum() / 2)

    @property
    def volume(self) -> float:
        return float((self.facets * self.triangles[:, 0]).sum() / 6)


@pytest.mark.parametrize(("kind", "attributes", "area", "volume"), SHAPES)
@pytest.mark.parametrize("axis", ["X", "Y", "Z"])
def test_shape(
    stage: Usd.Stage, kind: str, attributes: dict[str, object], area: float, volume: float, axis: str
) -> None:
    if kind in ("Sphere", "Cube") and axis != "Z":
        pytest.skip("has no axis")
    prim = define(stage, kind, attributes | ({} if kind in ("Sphere", "Cube") else {"axis": axis}))
    solid = Solid(stage)
    extent = np.array(
        UsdGeom.Boundable.ComputeExtentFromPlugins(UsdGeom.Boundable(prim), Usd.TimeCode.Default())
    )
    np.testing.assert_allclose([solid.points.min(axis=0), solid.points.max(axis=0)], extent, atol=2e-3)
    if area is not None:
        assert solid.area == pytest.approx(area, rel=2e-3)
        assert solid.area <= area * (1 + 1e-6), "inscribed"
    if volume is not None:
        assert solid.volume == pytest.approx(volume, rel=2e-3)
    # Normals agree with the winding, and are of unit length.
    facets = solid.facets / np.linalg.norm(solid.facets, axis=1, keepdims=True)
    assert (np.einsum("tci,ti->tc", solid.normals, facets) > 0.99).all()


@pytest.mark.parametrize(("kind", "attributes", "area", "volume"), [s for s in SHAPES if s[0] != "Plane"])
def test_closed(
    stage: Usd.Stage, kind: str, attributes: dict[str, object], area: float, volume: float
) -> None:
    """Every edge (by the positions of its ends) is there once in each direction."""
    define(stage, kind, attributes)
    solid = Solid(stage)
    counts, indices = solid.mesh["face_vertex_counts"], solid.mesh["face_vertex_indices"]
    following = np.arange(len(indices)) + 1
    following[solid.starts + counts - 1] = solid.starts
    _, places = np.unique(solid.mesh["points"], axis=0, return_inverse=True)
    places = places.ravel()
    edges = {(places[indices[i]], places[indices[j]]) for i, j in enumerate(following)}
    assert len(edges) == len(indices), "no edge twice in one direction"
    assert {(b, a) for a, b in edges} == edges


def test_sphere_normals_are_radial(stage: Usd.Stage) -> None:
    define(stage, "Sphere", {"radius": 3.0})
    solid = Solid(stage)
    corners = solid.points[solid.mesh["face_vertex_indices"]] / 3
    normals = solid.mesh["normals"]["values"]
    poles = np.abs(corners[:, 2]) > 1 - 1e-6
    np.testing.assert_allclose(normals[~poles], corners[~poles], atol=1e-6)


def test_plane_sides(stage: Usd.Stage) -> None:
    """Width and length lie as UsdGeomPlane says, and the normal is the axis."""
    prim = define(stage, "Plane", {"width": 3.0, "length": 2.0})
    for axis, size in (("X", (0, 2, 3)), ("Y", (3, 0, 2)), ("Z", (3, 2, 0))):
        prim.GetAttribute("axis").Set(axis)
        solid = Solid(stage)
        np.testing.assert_allclose(np.ptp(solid.points, axis=0), size, atol=1e-6)
        normal = solid.facets.sum(axis=0)
        assert np.argmax(np.abs(normal)) == "XYZ".index(axis) and normal.sum() > 0


def test_left_handed_shapes_turn_inside_out(stage: Usd.Stage) -> None:
    prim = define(stage, "Sphere", {})
    UsdGeom.Gprim(prim).CreateOrientationAttr("leftHanded")
    UsdGeom.Gprim(prim).CreateDoubleSidedAttr(True)
    solid = Solid(stage)
    assert solid.mesh["left_handed"] and solid.mesh["double_sided"]
    assert (np.einsum("tci,ti->tc", solid.normals, solid.facets) < 0).all()


def test_equal_shapes_share_their_geometry(stage: Usd.Stage) -> None:
    red, blue = add_material(stage, "/World/Red"), add_material(stage, "/World/Blue")
    for i, material in enumerate((red, blue, None)):
        prim = define(stage, "Sphere", {"radius": 1.0 + i}, f"/World/Sphere{i}")
        if material:
            bind(prim, material)
        else:
            UsdGeom.Gprim(prim).CreateDisplayColorAttr([(0, 1, 0)])
    translation = translate(stage)
    assert translation.counts["meshes"] == 1 and translation.counts["instances"] == 3
    names = [material_name(translation, f"/World/Sphere{i}") for i in range(3)]
    assert names == ["/World/Red", "/World/Blue", "displayColor(0, 1, 0)"]
    assert [i["to_world"][0, 0] for i in instances(translation).values()] == [1, 2, 3]


def test_st_when_a_material_reads_it(stage: Usd.Stage, tmp_path: Path) -> None:
    material = add_material(stage, "/World/Textured")
    connect_texture(stage, surface(material), write_image(tmp_path / "white.png"))
    prim = define(stage, "Sphere", {})
    bind(prim, material)
    (st,) = Solid(stage).mesh["texcoords"]
    assert st["interpolation"] == "faceVarying"
    assert st["values"].min() == 0 and st["values"].max() == 1
    points = Solid(stage)
    heights = points.points[points.mesh["face_vertex_indices"]][:, 2]
    np.testing.assert_allclose(np.sin((st["values"][:, 1] - 0.5) * PI), heights, atol=1e-6)


def test_shapes_are_solids_but_for_planes(stage: Usd.Stage) -> None:
    """As closed meshes are; primvars:encore:thinWalled decides otherwise."""
    glass = add_material(stage, "/World/Glass", opacity=0.0)
    for kind, attributes, _, _ in SHAPES:
        bind(define(stage, kind, attributes, f"/World/Shapes/{kind}"), glass)
    bubble = define(stage, "Sphere", {}, "/World/Shapes/Bubble")
    bind(bubble, glass)
    UsdGeom.PrimvarsAPI(bubble).CreatePrimvar("encore:thinWalled", Sdf.ValueTypeNames.Bool).Set(True)
    translation = translate(stage)
    scene = translation.scene
    thin = {
        path: scene.mesh(scene.prototype(placed["prototype"])["meshes"][0])["thin_walled"]
        for path, placed in instances(translation).items()
    }
    assert {path.rpartition("/")[2] for path, is_thin in thin.items() if is_thin} == {"Plane", "Bubble"}


def test_primvars_that_materials_read(stage: Usd.Stage) -> None:
    """Constant ones; shapes that bring some do not share."""
    material = add_material(stage, "/World/Material")
    connect_reader(stage, surface(material), "float", "wear", "roughness")
    for i in range(2):
        prim = define(stage, "Sphere", {}, f"/World/Sphere{i}")
        bind(prim, material)
        UsdGeom.PrimvarsAPI(prim).CreatePrimvar("wear", Sdf.ValueTypeNames.Float).Set(0.25 * (i + 1))
    found = meshes(translate(stage))
    assert [found[f"/World/Sphere{i}"]["primvars"][0]["values"].tolist() for i in range(2)] == [
        [[0.25, 0, 0, 0]],
        [[0.5, 0, 0, 0]],
    ]
    prim.RemoveProperty("primvars:wear")
    varying = UsdGeom.PrimvarsAPI(prim).CreatePrimvar("wear", Sdf.ValueTypeNames.FloatArray, "vertex")
    varying.Set([1.0, 2.0])
    assert kinds(translate(stage))["missing primvar wear"] == 1


@pytest.mark.parametrize(
    ("kind", "attributes"),
    [
        ("Sphere", {"radius": 0.0}),
        ("Sphere", {"radius": -1.0}),
        ("Cube", {"size": math.inf}),
        ("Cylinder", {"height": 0.0}),
        ("Cone", {"radius": 0.0}),
        ("Capsule", {"radius": 0.0}),
        ("Cylinder_1", {"radiusBottom": 0.0, "radiusTop": 0.0}),
        ("Plane", {"width": 0.0}),
    ],
)
def test_shapes_without_size_are_reported(stage: Usd.Stage, kind: str, attributes: dict[str, object]) -> None:
    define(stage, "Cube", {}, "/World/Good")
    define(stage, kind, attributes)
    translation = translate(stage)
    assert list(instances(translation)) == ["/World/Good"]
    assert kinds(translation)["bad implicit shape"] == 1
