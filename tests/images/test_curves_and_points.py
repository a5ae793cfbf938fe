"""Curves and points look like the meshes that they could be, and cover as much as their widths say."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom
from rendering import (
    add_area_light,
    add_camera,
    add_dome,
    add_material,
    add_plane,
    assert_identical,
    bind,
    new_stage,
    render,
    rmse,
    save_evidence,
)

SETTINGS = {"samples": 4, "occlusion_samples": 16, "light_samples": 4, "seed": 3}
LOOKS: dict[str, dict[str, Any]] = {
    "matte": {"diffuseColor": (0.7, 0.4, 0.2)},
    "glass": {"opacity": 0.0, "ior": 1.5, "roughness": 0.0, "diffuseColor": (0.0, 0.0, 0.0)},
    "mirror": {"metallic": 1.0, "roughness": 0.05, "diffuseColor": (0.9, 0.8, 0.6)},
}


def lit_stage() -> Usd.Stage:
    """A floor at y = -1 under a dome and an area light, seen from the front."""
    stage = new_stage()
    add_dome(stage, 0.5)
    add_area_light(stage)
    add_camera(stage, (0, 0.4, 6), (0, 0, 0), 0.3)
    add_plane(stage, "/World/Floor", 8, add_material(stage, "Floor", diffuseColor=(0.5, 0.5, 0.5)), -1)
    return stage


def add_point(stage: Usd.Stage, width: float = 2, path: str = "/World/Shape") -> UsdGeom.Points:
    points = UsdGeom.Points.Define(stage, path)
    points.CreatePointsAttr([(0, 0, 0)])
    points.CreateWidthsAttr([width])
    points.SetWidthsInterpolation("constant")
    return points


def add_sphere(stage: Usd.Stage) -> UsdGeom.Sphere:
    sphere = UsdGeom.Sphere.Define(stage, "/World/Shape")
    sphere.CreateRadiusAttr(1)
    return sphere


def add_curve(
    stage: Usd.Stage, points: list[tuple[float, float, float]], width: float, path: str = "/World/Shape"
) -> UsdGeom.BasisCurves:
    curves = UsdGeom.BasisCurves.Define(stage, path)
    curves.CreateTypeAttr("linear")
    curves.CreatePointsAttr(points)
    curves.CreateCurveVertexCountsAttr([len(points)])
    curves.CreateWidthsAttr([width])
    curves.SetWidthsInterpolation("constant")
    return curves


def assert_alike(name: str, a: dict[str, Any], b: dict[str, Any], tolerance: float) -> None:
    """Means agree, and so do pixels but for noise and outlines."""
    x, y = a["composite"][..., :3], b["composite"][..., :3]
    try:
        np.testing.assert_allclose(x.mean(axis=(0, 1)), y.mean(axis=(0, 1)), rtol=0.02)
        assert rmse(x, y) < tolerance
    except AssertionError:
        save_evidence(name, found=x, expected=y)
        raise


# The vertices that a mirror's grids happen to have see the light or not: those of mesh and sphere are others.
METHODS = [
    *((look, "reuse") for look in LOOKS),
    ("glass", "reference"),
    ("matte", "vertex"),
    ("glass", "vertex"),
]


@pytest.mark.parametrize(("look", "method"), METHODS)
def test_a_point_is_a_sphere(look: str, method: str) -> None:
    found = {}
    for kind, add in (("point", add_point), ("sphere", add_sphere)):
        stage = lit_stage()
        bind(add(stage), add_material(stage, "Look", **LOOKS[look]))
        found[kind] = render(stage, **SETTINGS, method=method)
    assert_alike(f"point_{look}_{method}", found["point"], found["sphere"], 0.06)


def test_a_point_of_half_grey_in_a_white_world_is_half_grey() -> None:
    stage = new_stage()
    add_dome(stage, 1.0)
    add_camera(stage, (0, 0, 6), (0, 0, 0), 0.1)  # inside of the sphere's outline
    bind(add_point(stage), add_material(stage, "Grey", diffuseColor=(0.5, 0.5, 0.5)))
    found = render(stage, 32, 32, samples=2, occlusion_samples=16)
    np.testing.assert_allclose(found["composite"][..., :3], 0.5, atol=2e-3)
    np.testing.assert_array_equal(np.asarray(found["alpha"]), 1)


def test_a_point_is_blurred_as_a_sphere() -> None:
    found = {}
    for kind in ("point", "sphere"):
        stage = lit_stage()
        camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Camera"))
        camera.CreateShutterOpenAttr(0.0)
        camera.CreateShutterCloseAttr(1.0)
        stage.SetStartTimeCode(0)
        stage.SetEndTimeCode(1)
        if kind == "point":
            shape: Any = add_point(stage)
            shape.GetPointsAttr().Set([(-0.5, 0, 0)], 0)
            shape.GetPointsAttr().Set([(0.5, 0.3, 0)], 1)
        else:
            shape = add_sphere(stage)
            operation = shape.AddTranslateOp()
            operation.Set(Gf.Vec3d(-0.5, 0, 0), 0)
            operation.Set(Gf.Vec3d(0.5, 0.3, 0), 1)
        bind(shape, add_material(stage, "Look", **LOOKS["matte"]))
        found[kind] = render(stage, **SETTINGS)
    assert_alike("moving_point", found["point"], found["sphere"], 0.06)


@pytest.mark.parametrize("look", LOOKS)
def test_a_straight_curve_is_a_cylinder(look: str) -> None:
    found = {}
    for kind in ("curve", "cylinder"):
        stage = lit_stage()
        if kind == "curve":
            shape: Any = add_curve(stage, [(-3, 0, 0), (0, 0, 0), (3, 0, 0)], 1)
        else:
            shape = UsdGeom.Cylinder.Define(stage, "/World/Shape")
            shape.CreateAxisAttr("X")
            shape.CreateHeightAttr(6)
            shape.CreateRadiusAttr(0.5)
        bind(shape, add_material(stage, "Look", **LOOKS[look]))
        found[kind] = render(stage, **SETTINGS)
    assert_alike(f"curve_{look}", found["curve"], found["cylinder"], 0.06)


def test_a_ribbon_is_a_rectangle_and_has_two_sides() -> None:
    for z in (1, -1):
        stage = new_stage()
        add_dome(stage, 1.0)
        add_camera(stage, (0, 0, 6), (0, 0, 0), 0.3)
        ribbon = add_curve(stage, [(0, -9, 0), (0, 9, 0)], 1)
        ribbon.CreateNormalsAttr([(0, 0, z)])
        ribbon.SetNormalsInterpolation("constant")
        bind(ribbon, add_material(stage, "Grey", diffuseColor=(0.5, 0.5, 0.5)))
        found = render(stage, 36, 36, samples=8, occlusion_samples=16)
        # The film is 3.6 wide: the ribbon covers ten columns.
        assert np.asarray(found["alpha"]).sum() == pytest.approx(360, rel=0.005)
        np.testing.assert_allclose(found["composite"][18, 18, :3], 0.5, atol=2e-3)


@pytest.mark.parametrize("turn", [0.0, 0.4, 0.9, 1.3])
def test_hair_covers_its_width(turn: float) -> None:
    """A quarter of a pixel wide, in directions that have nothing to do with its three sides."""
    stage = new_stage()
    add_dome(stage, 1.0)
    add_camera(stage, (0, 0, 6), (0, 0, 0), 0.3)
    x, y = np.cos(turn), np.sin(turn)
    add_curve(stage, [(-x, -y, 0.3), (x, y, -0.3)], 0.025)
    found = render(stage, 36, 36, samples=16, occlusion_samples=1, max_bounces=0)
    # 3.6 across 36 pixels at z = 0; to first order perspective evens out.
    expected = 2 * 0.025 * 100
    assert np.asarray(found["alpha"]).sum() == pytest.approx(expected, rel=0.13)


def test_curves_and_points_do_not_depend_on_memory() -> None:
    def stage() -> Usd.Stage:
        made = lit_stage()
        bind(add_point(made, 1.2), add_material(made, "Glass", **LOOKS["glass"]))
        curve = add_curve(made, [(-2, 0, 0.5), (0, 1, 0.5), (2, 0, 0.5)], 0.3, "/World/Curve")
        bind(curve, add_material(made, "Mirror", **LOOKS["mirror"]))
        return made

    large = render(stage(), 96, 96, samples=2)
    small = render(stage(), 96, 96, samples=2, memory_budget_bytes=1 << 26)
    assert_identical(large, small)
