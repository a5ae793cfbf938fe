"""Lens, orthographic film, exposure, clipping and motion: pixels that follow from geometry."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from encore.adapters.camera import ShutterOptions
from encore.render_index import RenderIndex, SyncOptions
from pxr import Gf, Usd, UsdGeom, UsdLux
from rendering import (
    add_camera,
    add_dome,
    add_material,
    add_mesh,
    assert_identical,
    bind,
    new_stage,
    render,
    rmse,
)

METHODS = ["reuse", "reference"]
BOX = {"filter": "box", "filter_radius_pixels": 0.5, "camera_light": False}


def glowing(stage: Usd.Stage, name: str = "Glow", radiance: float = 1.0) -> Any:
    return add_material(stage, name, diffuseColor=(0.0,) * 3, emissiveColor=(radiance,) * 3)


def square(stage: Usd.Stage, path: str, half: float, material: Any, z: float = 0.0) -> UsdGeom.Mesh:
    points = [(-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z)]
    return add_mesh(stage, path, points, [[0, 1, 2, 3]], material)


def lens(stage: Usd.Stage, diameter: float, focus: float) -> None:
    """A lens of this diameter in world units: focalLength is in tenths of them."""
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Camera"))
    camera.GetFocalLengthAttr().Set(10.0)
    camera.CreateFStopAttr(1.0 / diameter)
    camera.CreateFocusDistanceAttr(focus)


@pytest.mark.parametrize("method", METHODS)
def test_circle_of_confusion(method: str) -> None:
    """A point at twice the focus distance f spreads over a disk as wide as the lens, at its depth."""
    stage = new_stage()
    square(stage, "/World/Point", 0.06, glowing(stage, radiance=1000.0))
    add_camera(stage, (0, 0, 8), (0, 0, 0), 0.25)
    sharp = render(stage, 64, 64, method=method, samples=12, **BOX)["composite"][..., 0]
    lens(stage, 0.5, 4.0)
    blurred = render(stage, 64, 64, method=method, samples=12, **BOX)["composite"][..., 0]
    np.testing.assert_allclose(blurred.sum(), sharp.sum(), rtol=0.12)
    # At the point's depth the film is 4 units wide: 16 pixels to a unit; diameter 0.5 · (8 - 4) / 4.
    radius = 0.5 * 0.5 * 16
    y, x = np.mgrid[0:64, 0:64] + 0.5 - 32
    assert blurred[np.hypot(x, y) > radius + 2.5].sum() < 0.01 * blurred.sum()
    # Uniform over the disk: half of the light within radius / √2.
    inner = blurred[np.hypot(x, y) < radius / np.sqrt(2)].sum() / blurred.sum()
    assert abs(inner - 0.5) < 0.08
    lens(stage, 0.5, 8.0)
    focused = render(stage, 64, 64, method=method, samples=12, **BOX)["composite"][..., 0]
    assert rmse(focused, sharp) < 0.02 * sharp.max()


def test_disable_depth_of_field_is_a_pinhole() -> None:
    stage = new_stage()
    square(stage, "/World/Point", 0.5, glowing(stage))
    add_camera(stage, (0, 0, 8), (0, 0, 0), 0.25)
    lens(stage, 0.5, 4.0)
    with_lens = RenderIndex(stage, SyncOptions()).sync().scene.camera
    without = RenderIndex(stage, SyncOptions(depth_of_field=False)).sync().scene.camera
    assert with_lens["lens_radius"] == pytest.approx(0.25)
    assert with_lens["focus_distance"] == pytest.approx(4.0)
    assert without["lens_radius"] == 0


def test_orthographic_film() -> None:
    """A square of half the film's width covers the middle quarter, at any distance; depth is along -z."""
    for z in (0.0, -5.0):
        stage = new_stage()
        square(stage, "/World/Square", 1.0, glowing(stage), z)
        camera = add_camera(stage, (0, 0, 8), (0, 0, 0), 0.25)
        camera.CreateProjectionAttr(UsdGeom.Tokens.orthographic)
        camera.GetHorizontalApertureAttr().Set(40.0)  # tenths of a unit: 4 wide
        camera.GetVerticalApertureAttr().Set(40.0)
        image = render(stage, 16, 16, samples=4, **BOX)
        expected = np.zeros((16, 16))
        expected[4:12, 4:12] = 1
        np.testing.assert_allclose(image["composite"][..., 0], expected, atol=1e-4)
        np.testing.assert_allclose(image["depth"][4:12, 4:12], 8 - z, rtol=1e-5)


def test_exposure_doubles() -> None:
    stage = new_stage()
    square(stage, "/World/Square", 2.0, glowing(stage, radiance=0.25))
    camera = add_camera(stage, (0, 0, 8), (0, 0, 0), 0.1)
    once = render(stage, 8, 8, samples=2, **BOX)
    camera.CreateExposureAttr(1.0)
    twice = render(stage, 8, 8, samples=2, **BOX)
    np.testing.assert_allclose(twice["composite"], 2 * once["composite"])
    np.testing.assert_array_equal(twice["alpha"], once["alpha"])
    np.testing.assert_array_equal(sum(twice["layers"].values()), twice["composite"])


def test_clipping_planes_cut() -> None:
    """A plane x < 0 of the camera's space is cut away."""
    stage = new_stage()
    square(stage, "/World/Square", 4.0, glowing(stage))
    camera = add_camera(stage, (0, 0, 8), (0, 0, 0), 0.25)
    camera.CreateClippingPlanesAttr([Gf.Vec4f(1, 0, 0, 0)])
    image = render(stage, 16, 16, samples=4, **BOX)["composite"][..., 0]
    assert (image[:, :8] == 0).all() and (image[:, 8:] == 1).all()


# --- Motion -----------------------------------------------------------------------------------------


def shutter(stage: Usd.Stage, opens: float = 0.0, closes: float = 1.0) -> None:
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Camera"))
    camera.CreateShutterOpenAttr(opens)
    camera.CreateShutterCloseAttr(closes)


def move_right(prim: UsdGeom.Xformable, start: float) -> None:
    move = prim.AddTranslateOp()
    move.Set(Gf.Vec3d(start, 0, 0), 0)
    move.Set(Gf.Vec3d(start + 2, 0, 0), 1)


def moving_stage(how: str) -> Usd.Stage:
    """A square of half-width 1 that moves 2 units to the right from frame 0 to frame 1: by its transform, its
    points, its velocities, its parent, as an instance; or the camera moves to the left instead."""
    stage = new_stage()
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(1)
    stage.SetTimeCodesPerSecond(24)
    glow = glowing(stage)
    start = -1.0
    add_camera(stage, (0, 0, 8), (0, 0, 0), 0.5)
    if how == "camera":
        square(stage, "/World/Square", 1.0, glow)
        camera = UsdGeom.Xformable(stage.GetPrimAtPath("/World/Camera"))
        camera.ClearXformOpOrder()
        move = camera.AddTranslateOp()
        move.Set(Gf.Vec3d(1, 0, 8), 0)
        move.Set(Gf.Vec3d(-1, 0, 8), 1)
    elif how == "instance":
        stage.CreateClassPrim("/Proto")
        square(stage, "/Proto/Square", 1.0, None)
        holder = UsdGeom.Xform.Define(stage, "/World/Instance")
        holder.GetPrim().GetReferences().AddInternalReference("/Proto")
        holder.GetPrim().SetInstanceable(True)
        bind(holder, glow)
        move_right(holder, start)
    elif how == "parent":
        parent = UsdGeom.Xform.Define(stage, "/World/Parent")
        square(stage, "/World/Parent/Square", 1.0, glow)
        move_right(parent, start)
    elif how == "instancer":
        instancer = UsdGeom.PointInstancer.Define(stage, "/World/Instancer")
        square(stage, "/World/Instancer/Square", 1.0, glow)
        instancer.CreatePrototypesRel().AddTarget("/World/Instancer/Square")
        instancer.CreateProtoIndicesAttr([0])
        instancer.CreatePositionsAttr([Gf.Vec3f(start, 0, 0)])
        instancer.GetPositionsAttr().Set([Gf.Vec3f(start, 0, 0)], 0)
        instancer.CreateVelocitiesAttr([Gf.Vec3f(48, 0, 0)])
        instancer.GetVelocitiesAttr().Set([Gf.Vec3f(48, 0, 0)], 0)
    else:
        mesh = square(stage, "/World/Square", 1.0, glow)
        if how == "transform":
            move_right(mesh, start)
        else:
            points = np.array(mesh.GetPointsAttr().Get())
            moved = [Gf.Vec3f(*map(float, p)) for p in points + np.array((start, 0, 0))]
            mesh.GetPointsAttr().Set(moved, 0)
            if how == "points":
                mesh.GetPointsAttr().Set([p + Gf.Vec3f(2, 0, 0) for p in moved], 1)
            else:
                mesh.CreateVelocitiesAttr().Set([Gf.Vec3f(48, 0, 0)] * 4, 0)
    shutter(stage)
    return stage


WAYS = ["transform", "points", "velocities", "parent", "instance", "instancer", "camera"]


@pytest.mark.parametrize("how", WAYS)
@pytest.mark.parametrize("method", METHODS)
def test_coverage_of_a_moving_square(how: str, method: str) -> None:
    """A trapezium: the share of the shutter for which the square covers a pixel."""
    stage = moving_stage(how)
    # Film: 8 units wide at the square, 32 pixels.
    image = render(stage, 32, 8, method=method, samples=16, **BOX)
    x = (np.arange(32) + 0.5) / 4 - 4
    # The square's left edge is at x0 + 2 t, with x0 = -2.
    covered = np.clip((x + 2) / 2, 0, 1) - np.clip(x / 2, 0, 1)
    np.testing.assert_allclose(image["alpha"].mean(axis=0), covered, atol=0.04)
    np.testing.assert_allclose(image["composite"][..., 0].mean(axis=0), covered, atol=0.04)


def test_a_turning_thing_stays_round() -> None:
    """A bar that turns by 180 degrees about its middle sweeps a disk, not a line (rotation interpolated)."""
    stage = new_stage()
    glow = glowing(stage)
    add_camera(stage, (0, 0, 8), (0, 0, 0), 0.15)
    shutter(stage)
    points = [(-1, -0.05, 0), (1, -0.05, 0), (1, 0.05, 0), (-1, 0.05, 0)]
    for kind in ("rotate", "matrix"):
        stage.RemovePrim("/World/Bar")
        bar = add_mesh(stage, "/World/Bar", points, [[0, 1, 2, 3]], glow)
        if kind == "rotate":
            turn = bar.AddRotateZOp()
            turn.Set(0.0, 0)
            turn.Set(180.0, 1)
        else:
            matrix = bar.AddTransformOp()
            for i in range(3):
                rotation = Gf.Rotation(Gf.Vec3d(0, 0, 1), 60.0 * i)
                matrix.Set(Gf.Matrix4d().SetRotate(rotation), i / 2)
        alpha = render(stage, 48, 48, samples=10, **BOX)["alpha"]
        y, x = (np.mgrid[0:48, 0:48] + 0.5) / 20 - 1.2
        radius = np.hypot(x, y)
        ring = alpha[(radius > 0.6) & (radius < 0.9)]
        # A circle of radius r is covered 0.1 / (π r) of the time, over the half turn; matrices turn by 120.
        if kind == "rotate":
            np.testing.assert_allclose(ring.mean(), 2 * 0.1 / (2 * np.pi * 0.75), rtol=0.1)
            assert ring.min() > 0.3 * ring.mean()
        else:
            angle = np.degrees(np.arctan2(-y, x)) % 180
            inside = (radius > 0.6) & (radius < 0.9) & (angle > 10) & (angle < 110)
            outside = (radius > 0.6) & (radius < 0.9) & (angle > 135) & (angle < 165)
            assert alpha[outside].max() == 0
            swept = alpha[inside]
            assert swept.min() > 0.3 * swept.mean()


def test_a_closed_shutter_and_disabled_blur_are_sharp() -> None:
    stage = moving_stage("transform")
    shutter(stage, 0.0, 0.0)
    image = render(stage, 32, 8, samples=4, **BOX)["alpha"]
    assert set(np.unique(image)) == {0.0, 1.0}
    shutter(stage, 0.0, 1.0)
    index = RenderIndex(stage, SyncOptions(time=Usd.TimeCode(0), shutter=ShutterOptions(motion_blur=False)))
    assert not index.sync().scene.instance(0)["motion"]


@pytest.mark.parametrize("how", ["transform", "points", "camera"])
def test_blurred_frames_do_not_depend_on_memory_or_threads(how: str) -> None:
    stage = moving_stage(how)
    add_dome(stage)
    lens(stage, 0.5, 4.0)
    first = render(stage, 48, 32, samples=4, occlusion_samples=4, threads=1)
    second = render(stage, 48, 32, samples=4, occlusion_samples=4, threads=2, memory_budget_bytes=48 << 20)
    assert_identical(first, second)


@pytest.mark.parametrize("weights", [(0.0, 0.0), (0.5, 0.0), (0.0, 0.5)])
def test_reuse_over_time_agrees_with_the_reference(weights: tuple[float, float]) -> None:
    """A lit wall that turns while the shutter is open: means agree, and with time as a part of the distance
    the error does not grow."""
    stage = new_stage()
    grey = add_material(stage, "Grey", diffuseColor=(0.6, 0.6, 0.6))
    wall = square(stage, "/World/Wall", 1.0, grey)
    turn = wall.AddRotateYOp()
    turn.Set(-50.0, 0)
    turn.Set(50.0, 1)
    light = UsdLux.DistantLight.Define(stage, "/World/Light")
    light.AddRotateYOp().Set(45.0)
    light.CreateAngleAttr(0.0)
    light.CreateIntensityAttr(3.0)
    add_camera(stage, (0, 0, 8), (0, 0, 0), 0.15)
    shutter(stage)
    settings = {"samples": 8, "reuse_time_weight": weights[0], "reuse_direction_weight": weights[1]}
    reuse = [render(stage, 24, 24, seed=s, **settings, **BOX)["composite"] for s in range(3)]
    reference = render(stage, 24, 24, method="reference", samples=16, **BOX)["composite"]
    np.testing.assert_allclose(np.mean(reuse), reference.mean(), rtol=0.02)
