"""Motion over the shutter: what moves, how exactly, with how few keys, and what stays still."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from encore.adapters.matrix_motion import blend, compose
from encore.adapters.motion import MOST_KEYS, TOLERANCE, interpolate, resample, uniform
from encore.render_index import Translation
from pxr import Gf, Usd, UsdGeom, UsdLux, Vt
from stages import (
    add_instance,
    add_point_instancer,
    add_square,
    instances,
    kinds,
    lights,
    meshes,
    new_stage,
    translate,
)

OPEN, CLOSE = -0.25, 0.5
SHUTTER = np.array([OPEN, CLOSE])


@pytest.fixture
def stage() -> Usd.Stage:
    stage = new_stage()
    stage.SetTimeCodesPerSecond(24)
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.CreateShutterOpenAttr(OPEN)
    camera.CreateShutterCloseAttr(CLOSE)
    return stage


def at(stage: Usd.Stage, time: float = 10, **options: Any) -> Translation:
    return translate(stage, time=Usd.TimeCode(time), **options)


def motion(translation: Translation, path: str) -> np.ndarray:
    return np.array(instances(translation)[path]["motion"])


def exact(stage: Usd.Stage, path: str, time: float) -> np.ndarray:
    """What USD says of a transform at a time."""
    return np.array(UsdGeom.XformCache(time).GetLocalToWorldTransform(stage.GetPrimAtPath(path)))


def assert_follows(
    keys: np.ndarray, truth: Callable[[float], np.ndarray], tolerance: float, time: float = 10
) -> None:
    """Linear interpolation between keys is the truth everywhere, to within a distance."""
    fractions = np.linspace(0, 1, 229)
    expected = np.array([truth(time + OPEN + f * (CLOSE - OPEN)) for f in fractions])
    np.testing.assert_allclose(interpolate(keys, fractions), expected, atol=tolerance)


# Resampling


def test_a_straight_motion_needs_two_keys() -> None:
    keys = resample(lambda t: np.stack([t, 2 * t, 0 * t], -1)[:, None], [0, 1], matrices=False)
    np.testing.assert_array_equal(keys, [[[0, 0, 0]], [[1, 2, 0]]])


def test_what_stays_has_none() -> None:
    assert resample(lambda t: np.full((len(t), 5, 3), 1e6), [0, 1], matrices=False) is None


@pytest.mark.parametrize("breaks", [[0, 0.2, 1], [0, 1 / 3, 1], [0, 0.1, 0.35, 1], [0, 0.123456, 1]])
def test_corners_are_kept(breaks: list[float]) -> None:
    heights = [0.0, 1.0, -1.0, 0.5][: len(breaks)]

    def path(t: np.ndarray) -> np.ndarray:
        return np.interp(t, breaks, heights)[:, None, None] * np.array([1.0, 0, 0])

    keys = resample(path, breaks, matrices=False, linear=True)
    fine = np.linspace(0, 1, 1009)
    assert len(keys) <= MOST_KEYS
    allowed = TOLERANCE * np.ptp(heights) if len(keys) < MOST_KEYS else 0.02
    assert np.abs(interpolate(keys, fine) - path(fine)).max() <= allowed
    if breaks == [0, 0.2, 1]:
        assert len(keys) == 6


@pytest.mark.parametrize("turns", [0.01, 0.25, 1, 2, 8])
def test_turns_are_not_hidden_by_even_keys(turns: float) -> None:
    def wheel(t: np.ndarray) -> np.ndarray:
        angle = 2 * np.pi * turns * t
        points = np.stack([np.cos(angle), np.sin(angle), 0 * t], -1)
        return points[:, None]

    keys = resample(wheel, [0, 1], matrices=False)
    fine = np.linspace(0, 1, 1009)
    worst = np.linalg.norm(interpolate(keys, fine) - wheel(fine), axis=-1).max()
    if turns <= 2:
        assert worst <= 1.5 * TOLERANCE * min(2, 2 * np.pi * turns)
    else:
        assert len(keys) == MOST_KEYS and worst < 0.02


# Matrices


def rotation(degrees: float, axis: tuple[float, float, float] = (0, 0, 1)) -> Gf.Matrix4d:
    return Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(*axis), degrees))


def test_matrices_are_blended_by_their_parts() -> None:
    first, second = np.array(rotation(20)), np.array(rotation(140))
    first[:3, :3] *= 2
    second[:3, :3] *= 4
    first[3, :3], second[3, :3] = (1, 2, 3), (3, 2, 1)
    half = blend(first, second, 0.5)
    np.testing.assert_allclose(half[:3, :3], 3 * np.array(rotation(80))[:3, :3], atol=1e-12)
    np.testing.assert_allclose(half[3], [2, 2, 2, 1])
    for weight, end in ((0, first), (1, second)):
        np.testing.assert_allclose(blend(first, second, weight), end, atol=1e-12)


def test_a_mirror_that_both_have_stays() -> None:
    mirror = np.diag([-1.0, 1, 1, 1])
    first, second = mirror @ np.array(rotation(0)), mirror @ np.array(rotation(90))
    half = blend(first, second, 0.5)
    np.testing.assert_allclose(half, mirror @ np.array(rotation(45)), atol=1e-12)


@pytest.mark.parametrize("bad", [np.diag([-1.0, 1, 1, 1]), np.diag([0.0, 1, 1, 1]), np.full((4, 4), np.nan)])
def test_what_has_no_parts_is_left_to_usd(bad: np.ndarray) -> None:
    assert blend(np.eye(4), bad, 0.5) is None


def test_moving_things_in_moving_things() -> None:
    def turn(t: float, degrees: float) -> np.ndarray:
        return np.array(rotation(degrees * t))

    inner, outer = (
        resample(lambda times, d=d: np.array([turn(t, d) for t in times]), [0, 1])[None] for d in (30.0, 50.0)
    )
    keys = compose(np.eye(4)[None], inner, np.eye(4)[None], outer)[0]
    for t in np.linspace(0, 1, 57):
        np.testing.assert_allclose(interpolate(keys, np.array([t]))[0], turn(t, 80), atol=3e-3)


def test_each_inner_place_at_each_outer_one() -> None:
    inner, outer = np.stack([np.eye(4)] * 2), np.stack([np.eye(4)] * 3)
    inner[:, 3, 0], outer[:, 3, 0] = (1, 2), (10, 20, 30)
    keys = np.repeat(inner[:, None], 2, axis=1)
    keys[:, 1, 3, 1] = 5
    both = compose(inner, keys, outer, None)
    assert both.shape == (6, 2, 4, 4)
    assert both[:, 0, 3, 0].tolist() == [11, 12, 21, 22, 31, 32]
    assert (both[:, 1, 3, 1] == 5).all()
    assert compose(inner, None, outer, None) is None


# Transforms of the stage


def test_a_moving_mesh(stage: Usd.Stage) -> None:
    op = add_square(stage, "/World/Mesh").AddTranslateOp()
    op.Set((0, 0, 0), 9)
    op.Set((2, 0, 0), 11)
    add_square(stage, "/World/Still")
    translation = at(stage)
    assert translation.shutter == (OPEN, CLOSE)
    np.testing.assert_allclose(motion(translation, "/World/Mesh")[:, 3, 0], 1 + SHUTTER)
    assert instances(translation)["/World/Mesh"]["to_world"][3, 0] == 1
    assert not len(motion(translation, "/World/Still"))
    assert not len(at(stage, 20).scene.instance(0)["motion"]), "held after the last sample"


def test_usds_own_samples_are_followed(stage: Usd.Stage) -> None:
    op = add_square(stage, "/World/Mesh").AddTranslateOp()
    for time, x in ((9, 0), (9.8, 3), (10.1, -2), (10.23, 4), (10.6, 1)):
        op.Set((x, x * x, 0), time)
    keys = motion(at(stage), "/World/Mesh")
    assert_follows(keys, lambda t: exact(stage, "/World/Mesh", t), 0.15)


def test_rotations_do_not_shrink(stage: Usd.Stage) -> None:
    add_square(stage, "/World/Wheel").AddRotateZOp()
    op = UsdGeom.Xformable(stage.GetPrimAtPath("/World/Wheel")).GetOrderedXformOps()[0]
    op.Set(0.0, 10)
    op.Set(360.0, 11)
    keys = motion(at(stage), "/World/Wheel")
    assert_follows(keys, lambda t: exact(stage, "/World/Wheel", t), 2.5e-3)


def test_matrix_samples_turn_instead_of_shrinking(stage: Usd.Stage) -> None:
    op = add_square(stage, "/World/Wheel").AddTransformOp()
    op.Set(rotation(0), 9.5)
    op.Set(rotation(120), 10.5)
    keys = motion(at(stage), "/World/Wheel")
    assert_follows(keys, lambda t: np.array(rotation(120 * max(0.0, t - 9.5))), 2.5e-3)


def test_matrix_samples_among_other_ops(stage: Usd.Stage) -> None:
    mesh = add_square(stage, "/World/Mesh")
    mesh.AddTranslateOp().Set((5, 0, 0))
    op = mesh.AddTransformOp()
    op.Set(rotation(0), 9)
    op.Set(rotation(90), 11)
    mesh.AddScaleOp().Set((1, 2, 1))
    middle = at(stage).scene
    keys = np.array(next(i for i in map(middle.instance, range(middle.instance_count)))["motion"])
    expected = np.diag([1.0, 2, 1, 1]) @ np.array(rotation(45 * (1 + OPEN)))
    expected[3, 0] += 5
    np.testing.assert_allclose(keys[0], expected, atol=1e-6)


def test_motion_is_inherited_and_reset(stage: Usd.Stage) -> None:
    rig = UsdGeom.Xform.Define(stage, "/World/Rig")
    for op, values in ((rig.AddTranslateOp(), ((0, 0, 0), (4, 0, 0))), (rig.AddRotateYOp(), (0.0, 40.0))):
        for time, value in zip((9, 11), values, strict=True):
            op.Set(value, time)
    UsdGeom.Xform.Define(stage, "/World/Rig/Arm").AddTranslateOp().Set((3, 0, 0))
    spin = add_square(stage, "/World/Rig/Arm/Spinning").AddRotateZOp()
    spin.Set(0.0, 9)
    spin.Set(90.0, 11)
    add_square(stage, "/World/Rig/Arm/Riding").AddTranslateOp().Set((0, 1, 0))
    add_square(stage, "/World/Rig/Arm/Reset").SetResetXformStack(True)
    UsdGeom.Sphere.Define(stage, "/World/Rig/Ball").CreateRadiusAttr(2.0)
    translation = at(stage)
    for name in ("Spinning", "Riding"):
        path = f"/World/Rig/Arm/{name}"
        assert_follows(motion(translation, path), lambda t, p=path: exact(stage, p, t), 5e-3)
    assert not len(motion(translation, "/World/Rig/Arm/Reset"))
    ball = motion(translation, "/World/Rig/Ball")
    size = instances(translation)["/World/Rig/Ball"]["to_world"]
    shape = size @ np.linalg.inv(exact(stage, "/World/Rig/Ball", 10))
    assert_follows(ball, lambda t: shape @ exact(stage, "/World/Rig/Ball", t), 0.02)


def test_native_instances_below_moving_parents(stage: Usd.Stage) -> None:
    stage.CreateClassPrim("/Asset")
    add_square(stage, "/Asset/Body")
    wheel = add_square(stage, "/Asset/Wheel")
    wheel.AddTranslateOp().Set((0, -1, 0))
    spin = wheel.AddRotateZOp()
    spin.Set(0.0, 9)
    spin.Set(100.0, 11)
    rig = UsdGeom.Xform.Define(stage, "/World/Rig")
    drive = rig.AddTranslateOp()
    drive.Set((0, 0, 0), 9)
    drive.Set((8, 0, 0), 11)
    for parent in ("/World/Rig", "/World"):
        add_instance(stage, f"{parent}/Car")
    translation = at(stage)
    found = instances(translation)
    assert set(found) == {f"{p}/Car{s}" for p in ("/World/Rig", "/World") for s in ("", "/Wheel")}
    assert translation.counts["prototypes"] == 2
    np.testing.assert_allclose(motion(translation, "/World/Rig/Car")[:, 3, 0], 4 + 4 * SHUTTER)
    assert not len(motion(translation, "/World/Car")), "only its wheel moves"
    for parent in ("/World/Rig", "/World"):
        path = f"{parent}/Car/Wheel"
        assert_follows(motion(translation, path), lambda t, p=path: exact(stage, p, t), 8e-3)


def test_the_camera_moves(stage: Usd.Stage) -> None:
    add_square(stage, "/World/Mesh")
    op = UsdGeom.Xformable(stage.GetPrimAtPath("/World/Camera")).AddTranslateOp()
    op.Set((0, 0, 0), 9)
    op.Set((0, 0, 2), 11)
    translation = at(stage)
    np.testing.assert_allclose(np.array(translation.scene.camera["motion"])[:, 3, 2], 1 + SHUTTER)
    assert translation.scene.camera["to_world"][3, 2] == 1


def test_lights_stay_and_say_so(stage: Usd.Stage) -> None:
    add_square(stage, "/World/Mesh")
    op = UsdLux.SphereLight.Define(stage, "/World/Light").AddTranslateOp()
    op.Set((0, 0, 0), 9)
    op.Set((0, 0, 2), 11)
    translation = at(stage)
    assert lights(translation)["/World/Light"]["centre"] == (0, 0, 1)
    assert kinds(translation)["moving light"] == 1


def test_a_scale_through_0_is_not_blurred(stage: Usd.Stage) -> None:
    op = add_square(stage, "/World/Mesh").AddScaleOp()
    op.Set((0, 0, 0), 9.75)
    op.Set((1, 1, 1), 10)
    translation = at(stage)
    assert not len(motion(translation, "/World/Mesh"))
    assert kinds(translation)["singular motion"] == 1


# Point instancers


def add_instancer(stage: Usd.Stage) -> UsdGeom.PointInstancer:
    add_square(stage, "/World/PI/Proto")
    return add_point_instancer(stage, "/World/PI", ["/World/PI/Proto"], [0, 0])


def test_instances_by_samples(stage: Usd.Stage) -> None:
    attribute = add_instancer(stage).GetPositionsAttr()
    attribute.Set(Vt.Vec3fArray([(0, 0, 0), (5, 0, 0)]), 9)
    attribute.Set(Vt.Vec3fArray([(2, 0, 0), (5, 0, 0)]), 11)
    translation = at(stage)
    np.testing.assert_allclose(motion(translation, "/World/PI[0]")[:, 3, 0], 1 + SHUTTER)
    assert not len(motion(translation, "/World/PI[1]")), "it stays"


def test_instances_by_velocities(stage: Usd.Stage) -> None:
    instancer = add_instancer(stage)
    instancer.GetPositionsAttr().Set(Vt.Vec3fArray([(0, 0, 0), (5, 0, 0)]), 10)
    instancer.CreateVelocitiesAttr().Set(Vt.Vec3fArray([(24, 0, 0), (0, 48, 0)]), 10)
    instancer.CreateOrientationsAttr().Set(Vt.QuathArray([Gf.Quath(1)] * 2), 10)
    instancer.CreateAngularVelocitiesAttr().Set(Vt.Vec3fArray([(0, 0, 24 * 60), (0, 0, 0)]), 10)
    translation = at(stage)
    keys = motion(translation, "/World/PI[0]")
    np.testing.assert_allclose(keys[[0, -1], 3, 0], SHUTTER, atol=1e-6)
    angle = math.radians(60 * CLOSE)
    np.testing.assert_allclose(keys[-1, 0, :2], [math.cos(angle), math.sin(angle)], atol=2e-3)
    np.testing.assert_allclose(motion(translation, "/World/PI[1]")[[0, -1], 3, 1], 2 * SHUTTER, atol=1e-6)


def test_instances_that_come_or_go(stage: Usd.Stage) -> None:
    instancer = add_instancer(stage)
    instancer.GetPositionsAttr().Set(Vt.Vec3fArray([(0, 0, 0), (5, 0, 0)]), 9)
    instancer.GetPositionsAttr().Set(Vt.Vec3fArray([(0, 0, 0)]), 10.25)
    instancer.GetProtoIndicesAttr().Set([0, 0], 9)
    instancer.GetProtoIndicesAttr().Set([0], 10.25)
    translation = at(stage)
    assert len(instances(translation)) == 2
    assert not any(len(i["motion"]) for i in instances(translation).values())


def test_a_moving_instancer_and_a_moving_prototype(stage: Usd.Stage) -> None:
    instancer = add_instancer(stage)
    drive, lift = (
        UsdGeom.Xformable(p).AddTranslateOp() for p in (instancer, stage.GetPrimAtPath("/World/PI/Proto"))
    )
    for op, end in ((drive, (2, 0, 0)), (lift, (0, 6, 0))):
        op.Set((0, 0, 0), 9)
        op.Set(end, 11)
    keys = motion(at(stage), "/World/PI[1]")
    np.testing.assert_allclose(keys[:, 3, 0], 21 + SHUTTER)
    np.testing.assert_allclose(keys[:, 3, 1], 3 + 3 * SHUTTER)


# Points


def points_of(translation: Translation) -> np.ndarray:
    (mesh,) = meshes(translation).values()
    return np.array(mesh["motion_points"])


def test_points_by_samples(stage: Usd.Stage) -> None:
    attribute = add_square(stage, "/World/Mesh").GetPointsAttr()
    base = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], np.float32)
    for time, z in ((9, 0), (10, 4), (11, -2)):
        attribute.Set(Vt.Vec3fArray.FromNumpy(base + np.float32([0, 0, z])), time)
    translation = at(stage)
    keys = points_of(translation)
    assert keys.dtype == np.float32 and len(keys) == 4, "the corner is at a third of the interval"
    for key, time in zip(keys, uniform(4) * (CLOSE - OPEN) + OPEN, strict=True):
        np.testing.assert_allclose(
            key, base + np.array([0, 0, 4 + (4 if time < 0 else -6) * time]), atol=1e-5
        )
    assert not len(instances(translation)["/World/Mesh"]["motion"])


@pytest.mark.parametrize("acceleration", [0.0, 24.0 * 24])
def test_points_by_velocities(stage: Usd.Stage, acceleration: float) -> None:
    mesh = add_square(stage, "/World/Mesh")
    base = np.array(mesh.GetPointsAttr().Get())
    mesh.GetPointsAttr().Set(mesh.GetPointsAttr().Get(), 10)
    mesh.CreateVelocitiesAttr().Set(Vt.Vec3fArray([(0, 0, 24)] * 4), 10)
    if acceleration:
        mesh.CreateAccelerationsAttr().Set(Vt.Vec3fArray([(0, 0, acceleration)] * 4), 10)
    keys = points_of(at(stage))
    assert len(keys) == 2 if not acceleration else len(keys) > 4
    for key, time in zip(keys, uniform(len(keys)) * (CLOSE - OPEN) + OPEN, strict=True):
        height = time + acceleration / 576 * time * time / 2
        np.testing.assert_allclose(key, base + np.array([0, 0, height]), atol=1e-5)


def test_topology_that_changes(stage: Usd.Stage) -> None:
    mesh = add_square(stage, "/World/Mesh")
    square = mesh.GetPointsAttr().Get()
    for name, before, after in (
        ("points", square, Vt.Vec3fArray([(0, 0, 1), (1, 0, 1), (0, 1, 1)])),
        ("faceVertexCounts", [4], [3]),
        ("faceVertexIndices", [0, 1, 2, 3], [0, 1, 2]),
    ):
        mesh.GetPrim().GetAttribute(name).Set(before, 10)
        mesh.GetPrim().GetAttribute(name).Set(after, 10.25)
    translation = at(stage)
    assert not len(points_of(translation))
    assert kinds(translation)["changing topology"] == 1
    for time, count in ((10, 4), (10.25, 3)):
        mesh.CreateVelocitiesAttr().Set(Vt.Vec3fArray([(0, 0, 24)] * count), time)
    translation = at(stage)
    np.testing.assert_allclose(points_of(translation)[:, 0, 2], SHUTTER, atol=1e-6)
    assert "changing topology" not in kinds(translation)


def test_normals_move_with_the_points(stage: Usd.Stage) -> None:
    mesh = add_square(stage, "/World/Mesh")
    base = mesh.GetPointsAttr().Get()
    for time, shift in ((9, 0), (11, 1)):
        mesh.GetPointsAttr().Set(Vt.Vec3fArray([p + Gf.Vec3f(shift, 0, 0) for p in base]), time)
        mesh.CreateNormalsAttr().Set(Vt.Vec3fArray([(shift, 0, 1)] * 4), time)
    (found,) = meshes(at(stage)).values()
    normals = np.array(found["motion_normals"])
    assert len(normals) == len(found["motion_points"]) == 2
    np.testing.assert_allclose(normals[:, 0, 0], 0.5 + SHUTTER / 2)


# When nothing is blurred


def animated(stage: Usd.Stage) -> None:
    op = add_square(stage, "/World/Mesh").AddTranslateOp()
    op.Set((0, 0, 0), 9)
    op.Set((2, 0, 0), 11)


def no_motion(translation: Translation) -> bool:
    return not any(len(i["motion"]) for i in instances(translation).values())


def test_an_instant_is_not_blurred(stage: Usd.Stage) -> None:
    animated(stage)
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Camera"))
    camera.GetShutterOpenAttr().Set(0.5)
    translation = at(stage)
    assert no_motion(translation)
    assert instances(translation)["/World/Mesh"]["to_world"][3, 0] == 1


def test_a_shutter_that_closes_before_it_opens(stage: Usd.Stage) -> None:
    animated(stage)
    UsdGeom.Camera(stage.GetPrimAtPath("/World/Camera")).GetShutterOpenAttr().Set(1.0)
    translation = at(stage)
    assert no_motion(translation) and translation.shutter == (0, 0)
    (report,) = translation.reports.errors
    assert report.kind == "bad shutter" and report.path == "/World/Camera"


def test_flags(stage: Usd.Stage) -> None:
    from encore.adapters.camera import ShutterOptions

    animated(stage)
    assert no_motion(at(stage, shutter=ShutterOptions(motion_blur=False)))
    wide = at(stage, shutter=ShutterOptions(opens=-1.0, closes=1.0))
    np.testing.assert_allclose(motion(wide, "/World/Mesh")[:, 3, 0], [0, 2])


def test_the_default_time_and_stages_without_a_camera_stand_still(stage: Usd.Stage) -> None:
    animated(stage)
    assert no_motion(translate(stage))
    stage.RemovePrim("/World/Camera")
    assert no_motion(at(stage))


def test_held_values_do_not_move(stage: Usd.Stage) -> None:
    animated(stage)
    stage.SetInterpolationType(Usd.InterpolationTypeHeld)
    assert no_motion(at(stage))


def test_still_prims_are_not_asked_for_their_motion(stage: Usd.Stage, monkeypatch: Any) -> None:
    """A stage without samples costs nothing: no prim is asked whether it moves."""
    add_square(stage, "/World/Mesh").AddTranslateOp().Set((1, 0, 0))

    def fail(*arguments: Any) -> bool:
        raise AssertionError("asked")

    monkeypatch.setattr(UsdGeom.Xformable, "TransformMightBeTimeVarying", fail)
    assert no_motion(at(stage))
