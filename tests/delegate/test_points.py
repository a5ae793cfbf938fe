"""Points: widths, primvars, motion, and bad input."""

import numpy as np
from encore.dump import dump
from pxr import Gf, Sdf, Usd, UsdGeom
from stages import kinds, meshes, translate

POINTS = [(0, 0, 0), (1, 0, 0), (2, 1, 0)]


def add_points(stage: Usd.Stage, path: str = "/World/Points") -> UsdGeom.Points:
    points = UsdGeom.Points.Define(stage, path)
    points.CreatePointsAttr(POINTS)
    return points


def widths(values: list[float], interpolation: str, points: UsdGeom.Points) -> None:
    points.CreateWidthsAttr(values)
    points.SetWidthsInterpolation(interpolation)


def test_points_and_widths(stage: Usd.Stage) -> None:
    widths([0.1, 0.2, 0.3], "vertex", add_points(stage))
    widths([0.5], "constant", add_points(stage, "/World/Same"))
    add_points(stage, "/World/None")
    found = meshes(translate(stage))
    assert found["/World/Points"]["shape"] == "points"
    np.testing.assert_array_equal(found["/World/Points"]["points"], POINTS)
    np.testing.assert_allclose(found["/World/Points"]["widths"]["values"], [0.1, 0.2, 0.3], rtol=1e-6)
    assert found["/World/Same"]["widths"]["interpolation"] == "constant"
    assert found["/World/None"]["widths"] is None


def test_the_primvar_of_widths_wins(stage: Usd.Stage) -> None:
    points = add_points(stage)
    widths([3], "constant", points)
    primvar = UsdGeom.PrimvarsAPI(points).CreatePrimvar("widths", Sdf.ValueTypeNames.FloatArray, "vertex")
    primvar.Set([1, 2])
    primvar.SetIndices([0, 1, 0])
    found = meshes(translate(stage))["/World/Points"]["widths"]
    assert found["values"].tolist() == [1, 2]
    assert found["indices"].tolist() == [0, 1, 0]


def test_points_have_a_colour_each(stage: Usd.Stage) -> None:
    points = add_points(stage)
    points.CreateDisplayColorAttr([(1, 0, 0), (0, 1, 0), (0, 0, 1)])
    UsdGeom.Primvar(points.GetDisplayColorAttr()).SetInterpolation("varying")
    found = meshes(translate(stage))["/World/Points"]
    assert found["display_color"]["values"].tolist() == [[1, 0, 0], [0, 1, 0], [0, 0, 1]]


def test_points_without_width_are_reported(stage: Usd.Stage) -> None:
    widths([0.1, 0, -0.3], "vertex", add_points(stage))
    widths([0], "constant", add_points(stage, "/World/Nothing"))
    translation = translate(stage)
    found = meshes(translation)
    assert list(found) == ["/World/Points"]
    np.testing.assert_allclose(found["/World/Points"]["widths"]["values"], [0.1, 0, 0], rtol=1e-6)
    assert {"bad widths", "points without width"} <= set(kinds(translation))


def test_no_points_are_reported(stage: Usd.Stage) -> None:
    UsdGeom.Points.Define(stage, "/World/Empty")
    add_points(stage)
    translation = translate(stage)
    assert list(meshes(translation)) == ["/World/Points"]
    assert "empty points" in kinds(translation)


def moving(stage: Usd.Stage) -> UsdGeom.Points:
    stage.SetTimeCodesPerSecond(24)
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.CreateShutterOpenAttr(0.0)
    camera.CreateShutterCloseAttr(0.5)
    return add_points(stage)


def test_points_move_by_samples(stage: Usd.Stage) -> None:
    points = moving(stage)
    points.GetPointsAttr().Set(POINTS, 0)
    points.GetPointsAttr().Set([(x, y, 2) for x, y, _ in POINTS], 1)
    keys = meshes(translate(stage, time=Usd.TimeCode(0)))["/World/Points"]["motion_points"]
    np.testing.assert_allclose(keys[-1] - keys[0], np.broadcast_to((0, 0, 1), (3, 3)), atol=1e-6)


def test_points_that_change_places_go_by_velocities(stage: Usd.Stage) -> None:
    points = moving(stage)
    points.GetPointsAttr().Set(POINTS, 0)
    points.GetPointsAttr().Set(POINTS[::-1], 1)
    points.CreateIdsAttr().Set([1, 2, 3], 0)
    points.GetIdsAttr().Set([3, 2, 1], 1)
    points.CreateVelocitiesAttr().Set([Gf.Vec3f(0, 24, 0)] * 3, 0)
    points.GetVelocitiesAttr().Set([Gf.Vec3f(0, 24, 0)] * 3, 1)
    keys = meshes(translate(stage, time=Usd.TimeCode(0)))["/World/Points"]["motion_points"]
    np.testing.assert_allclose(keys[-1] - keys[0], np.broadcast_to((0, 0.5, 0), (3, 3)), atol=1e-6)


def test_dump_says_what_points_are(stage: Usd.Stage) -> None:
    widths([0.25], "constant", add_points(stage))
    text = dump(translate(stage))
    assert "shape: points" in text
    assert "widths: constant" in text
    assert "basis" not in text and "scheme" not in text
