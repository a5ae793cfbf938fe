"""BasisCurves: kinds, counts, widths, normals, primvars, motion, and bad input."""

import numpy as np
import pytest
from encore.adapters.curve_counts import segment_counts
from encore.dump import dump
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux
from stages import add_material, bind, connect_reader, kinds, meshes, surface, translate

POINTS = [(0, 0, 0), (1, 0, 0), (2, 1, 0), (3, 1, 0)]


def add_curves(
    stage: Usd.Stage,
    basis: str = "bezier",
    wrap: str = "nonperiodic",
    counts: tuple[int, ...] = (4,),
    path: str = "/World/Curves",
) -> UsdGeom.BasisCurves:
    """Curves one above the other."""
    curves = UsdGeom.BasisCurves.Define(stage, path)
    if basis == "linear":
        curves.CreateTypeAttr("linear")
    else:
        curves.CreateBasisAttr(basis)
    curves.CreateWrapAttr(wrap)
    curves.CreateCurveVertexCountsAttr(list(counts))
    curves.CreatePointsAttr([(i, i % 2, z) for z, count in enumerate(counts) for i in range(count)])
    return curves


@pytest.mark.parametrize("wrap", ["nonperiodic", "periodic", "pinned"])
@pytest.mark.parametrize("basis", ["linear", "bezier", "bspline", "catmullRom"])
def test_kind_and_segments_are_usds(stage: Usd.Stage, basis: str, wrap: str) -> None:
    counts = (6, 9) if (basis, wrap) == ("bezier", "periodic") else (4, 7)
    curves = add_curves(stage, basis, wrap, counts)
    found = meshes(translate(stage))["/World/Curves"]
    assert (found["shape"], found["basis"], found["wrap"]) == ("curves", basis, wrap)
    assert found["face_vertex_counts"].tolist() == list(counts)
    np.testing.assert_array_equal(found["points"], np.array(curves.GetPointsAttr().Get()))
    segments = segment_counts(np.array(counts, np.int32), basis, wrap)
    assert segments.tolist() == list(curves.ComputeSegmentCounts(Usd.TimeCode.Default()))


def test_tubes_have_no_normals_and_ribbons_do(stage: Usd.Stage) -> None:
    add_curves(stage, path="/World/Tube")
    ribbon = add_curves(stage, path="/World/Ribbon")
    ribbon.CreateNormalsAttr([(0, 0, 1), (0, 1, 0)])
    ribbon.SetNormalsInterpolation("varying")
    found = meshes(translate(stage))
    assert found["/World/Tube"]["normals"] is None
    assert found["/World/Ribbon"]["normals"]["interpolation"] == "varying"
    assert found["/World/Ribbon"]["normals"]["values"].tolist() == [[0, 0, 1], [0, 1, 0]]


def test_widths_of_every_interpolation(stage: Usd.Stage) -> None:
    values = {"constant": [0.5], "uniform": [1, 2], "varying": [1, 2, 3, 4, 5], "vertex": list(range(11))}
    for interpolation, widths in values.items():
        curves = add_curves(stage, counts=(4, 7), path=f"/World/{interpolation}")
        curves.CreateWidthsAttr(widths)
        curves.SetWidthsInterpolation(interpolation)
    add_curves(stage, path="/World/None")
    found = meshes(translate(stage))
    for interpolation, widths in values.items():
        primvar = found[f"/World/{interpolation}"]["widths"]
        assert primvar["interpolation"] == interpolation
        assert primvar["values"].tolist() == widths
    assert found["/World/None"]["widths"] is None


def test_the_primvar_of_widths_wins(stage: Usd.Stage) -> None:
    curves = add_curves(stage)
    curves.CreateWidthsAttr([3])
    primvar = UsdGeom.PrimvarsAPI(curves).CreatePrimvar("widths", Sdf.ValueTypeNames.FloatArray, "varying")
    primvar.Set([0.5, 0.25])
    found = meshes(translate(stage))["/World/Curves"]["widths"]
    assert (found["interpolation"], found["values"].tolist()) == ("varying", [0.5, 0.25])


def test_one_width_is_good_for_all(stage: Usd.Stage) -> None:
    add_curves(stage).CreateWidthsAttr([0.5])  # its interpolation falls back to vertex
    translation = translate(stage)
    assert meshes(translation)["/World/Curves"]["widths"]["interpolation"] == "constant"
    assert not {kind for kind in kinds(translation) if "width" in kind}


def test_bad_widths_are_reported(stage: Usd.Stage) -> None:
    negative = add_curves(stage, path="/World/Negative")
    negative.CreateWidthsAttr([1, -1, 2, -2])
    negative.SetWidthsInterpolation("vertex")
    short = add_curves(stage, path="/World/Short")
    short.CreateWidthsAttr([0.5, 1, 2])
    short.SetWidthsInterpolation("vertex")
    translation = translate(stage)
    found = meshes(translation)
    assert found["/World/Negative"]["widths"]["values"].tolist() == [1, 0, 2, 0]
    assert found["/World/Short"]["widths"]["interpolation"] == "constant"
    assert found["/World/Short"]["widths"]["values"].tolist() == [0.5]
    assert {"bad widths", "bad primvar widths"} <= set(kinds(translation))


def test_primvars_go_by_segments(stage: Usd.Stage) -> None:
    curves = add_curves(stage, counts=(4, 7))
    curves.CreateDisplayColorAttr([(1, 0, 0), (0, 1, 0)])
    UsdGeom.Primvar(curves.GetDisplayColorAttr()).SetInterpolation("uniform")
    api = UsdGeom.PrimvarsAPI(curves)
    api.CreatePrimvar("rough", Sdf.ValueTypeNames.FloatArray, "varying").Set([0.1, 0.2, 0.3, 0.4, 0.5])
    found = meshes(translate(stage))["/World/Curves"]
    assert found["display_color"]["interpolation"] == "uniform"
    material = add_material(stage, "/World/Material")
    connect_reader(stage, surface(material), "float", "rough", "roughness")
    bind(curves, material)
    found = meshes(translate(stage))["/World/Curves"]
    (rough,) = found["primvars"]
    assert (rough["name"], rough["interpolation"]) == ("rough", "varying")
    np.testing.assert_allclose(rough["values"][:, 0], [0.1, 0.2, 0.3, 0.4, 0.5], rtol=1e-6)


@pytest.mark.parametrize(
    ("basis", "wrap", "counts"),
    [
        ("bezier", "nonperiodic", (5,)),
        ("bezier", "periodic", (4,)),
        ("bspline", "nonperiodic", (3,)),
        ("linear", "nonperiodic", (1,)),
        ("catmullRom", "pinned", (1,)),
    ],
)
def test_wrong_counts_are_reported(stage: Usd.Stage, basis: str, wrap: str, counts: tuple[int, ...]) -> None:
    add_curves(stage, basis, wrap, counts)
    add_curves(stage, path="/World/Good")
    translation = translate(stage)
    assert list(meshes(translation)) == ["/World/Good"]
    assert "bad curves" in kinds(translation)


def test_curves_that_do_not_fit_their_points_are_reported(stage: Usd.Stage) -> None:
    add_curves(stage).CreateCurveVertexCountsAttr([4, 4])
    add_curves(stage, path="/World/Good")
    translation = translate(stage)
    assert list(meshes(translation)) == ["/World/Good"]
    assert "bad curves" in kinds(translation)
    assert any("/World/Curves" in line for line in translation.reports.lines())


def test_points_move_by_samples_and_by_velocities(stage: Usd.Stage) -> None:
    sampled = add_curves(stage, path="/World/Sampled")
    points = np.array(sampled.GetPointsAttr().Get())
    sampled.GetPointsAttr().Set(points, 0)
    sampled.GetPointsAttr().Set(points + np.array([0, 0, 2], np.float32), 1)
    thrown = add_curves(stage, path="/World/Thrown")
    thrown.GetPointsAttr().Set(points, 0)
    thrown.CreateVelocitiesAttr().Set([Gf.Vec3f(24, 0, 0)] * 4, 0)
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.CreateShutterOpenAttr(0.0)
    camera.CreateShutterCloseAttr(0.5)
    stage.SetTimeCodesPerSecond(24)
    translation = translate(stage, time=Usd.TimeCode(0))
    found = meshes(translation)
    for path, change in (("/World/Sampled", (0, 0, 1)), ("/World/Thrown", (0.5, 0, 0))):
        keys = found[path]["motion_points"]
        assert len(keys) == 2
        np.testing.assert_allclose(keys[1] - keys[0], np.broadcast_to(change, (4, 3)), atol=1e-6)


def test_dump_says_what_curves_are(stage: Usd.Stage) -> None:
    curves = add_curves(stage, "catmullRom", "pinned")
    curves.CreateWidthsAttr([0.25])
    text = dump(translate(stage))
    for line in ("shape: curves", "basis: catmullRom", "wrap: pinned", "widths: constant"):
        assert line in text
    assert "scheme" not in text


def test_what_curves_cannot_be_is_reported(stage: Usd.Stage) -> None:
    curves = add_curves(stage)
    material = add_material(stage, "/World/Material", displacement=0.5)
    material.CreateDisplacementOutput().ConnectToSource(surface(material).ConnectableAPI(), "displacement")
    bind(curves, material)
    points = UsdGeom.Points.Define(stage, "/World/Points")
    points.CreatePointsAttr([(0, 0, 0)])
    UsdLux.MeshLightAPI.Apply(points.GetPrim())
    translation = translate(stage)
    assert {"/World/Curves", "/World/Points"} == set(meshes(translation))
    assert {"displacement of curves", "light of points"} <= set(kinds(translation))
    assert not translation.scene.light_count
