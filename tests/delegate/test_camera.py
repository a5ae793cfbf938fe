"""Cameras: which one, its film window, the image's size, and the automatic one."""

import math

import numpy as np
import pytest
from encore import _core
from encore.errors import StageError
from pxr import Gf, Sdf, Usd, UsdGeom, UsdUtils
from stages import add_square, kinds, new_stage, translate


@pytest.fixture
def stage() -> Usd.Stage:
    stage = new_stage()
    add_square(stage, "/World/Mesh")
    return stage


def add_camera(stage: Usd.Stage, path: str = "/World/Camera") -> UsdGeom.Camera:
    camera = UsdGeom.Camera.Define(stage, path)
    camera.CreateHorizontalApertureAttr(40.0)
    camera.CreateVerticalApertureAttr(20.0)
    camera.CreateFocalLengthAttr(50.0)
    return camera


def test_film_window_and_transform(stage: Usd.Stage) -> None:
    camera = add_camera(stage)
    camera.CreateHorizontalApertureOffsetAttr(5.0)
    camera.CreateVerticalApertureOffsetAttr(-10.0)
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.5, 100))
    camera.AddTranslateOp().Set((1, 2, 3))
    camera.AddRotateYOp().Set(90)
    translation = translate(stage, width=800)
    found = translation.scene.camera
    assert translation.camera_path == found["path"] == "/World/Camera"
    assert (translation.width, translation.height, translation.camera_aspect) == (800, 400, 2)
    np.testing.assert_allclose(found["half_tangent"], [0.4, 0.2], rtol=1e-6)
    np.testing.assert_allclose(found["centre_tangent"], [0.1, -0.2], rtol=1e-6)
    assert (found["near_clip"], found["far_clip"]) == (0.5, 100)
    expected = UsdGeom.XformCache().GetLocalToWorldTransform(camera.GetPrim())
    np.testing.assert_array_equal(found["to_world"], np.array(expected))


def test_clipping_distances_are_world_units(stage: Usd.Stage) -> None:
    camera = add_camera(stage)
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.5, 100))
    camera.AddScaleOp().Set((2, 2, 2))
    found = translate(stage).scene.camera
    assert (found["near_clip"], found["far_clip"]) == (1, 200)


def test_a_given_height_keeps_the_horizontal_aperture_and_square_pixels(stage: Usd.Stage) -> None:
    add_camera(stage)
    translation = translate(stage, width=100, height=100)
    assert (translation.width, translation.height) == (100, 100)
    np.testing.assert_allclose(translation.scene.camera["half_tangent"], [0.4, 0.4], rtol=1e-6)


@pytest.mark.parametrize(("aperture", "height"), [(15.2908, 700), (20.955, 960), (0.0, 960), (0.001, 1)])
def test_height_from_the_aspect_ratio(stage: Usd.Stage, aperture: float, height: int) -> None:
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.CreateVerticalApertureAttr(aperture)
    assert translate(stage, width=960).height == height


def test_the_only_camera_is_used_and_the_choice_reported(stage: Usd.Stage) -> None:
    add_camera(stage)
    translation = translate(stage)
    assert translation.camera_path == "/World/Camera"
    assert kinds(translation)["camera"] == 1 and not translation.reports.has_errors


def test_main_cam_is_used_among_several(stage: Usd.Stage) -> None:
    for name in ("Left", UsdUtils.GetPrimaryCameraName(), "Right"):
        add_camera(stage, f"/World/{name}")
    assert translate(stage).camera_path == "/World/main_cam"


def test_among_several_without_main_cam_the_stage_is_framed(stage: Usd.Stage) -> None:
    for name in ("Left", "Right"):
        add_camera(stage, f"/World/{name}")
    translation = translate(stage)
    assert translation.camera_path == ""
    assert "2 cameras" in translation.reports.lines()[0]


@pytest.mark.parametrize("name", ["/World/Rig/Right", "Right"])
def test_cameras_by_path_and_name(stage: Usd.Stage, name: str) -> None:
    for path in ("/World/main_cam", "/World/Rig/Left", "/World/Rig/Right"):
        add_camera(stage, path)
    assert translate(stage, camera=name).camera_path == "/World/Rig/Right"


@pytest.mark.parametrize("name", ["/World/Nothing", "Nothing", "/World/Mesh", "not a path!"])
def test_an_unknown_camera_is_an_error_that_lists_those_there_are(stage: Usd.Stage, name: str) -> None:
    add_camera(stage, "/World/Left")
    with pytest.raises(StageError, match="/World/Left") as error:
        translate(stage, camera=name)
    assert error.value.where == name


def test_a_camera_in_an_invisible_group_still_sees(stage: Usd.Stage) -> None:
    add_camera(stage, "/World/Hidden/Camera")
    UsdGeom.Imageable(stage.GetPrimAtPath("/World/Hidden")).MakeInvisible()
    assert translate(stage).camera_path == "/World/Hidden/Camera"


def test_orthographic_windows_are_in_scene_units(stage: Usd.Stage) -> None:
    """Apertures are in tenths of scene units (UsdGeomCamera)."""
    camera = add_camera(stage)
    camera.CreateProjectionAttr("orthographic")
    camera.CreateHorizontalApertureOffsetAttr(5.0)
    found = translate(stage, width=100).scene.camera
    assert found["projection"] == "orthographic"
    np.testing.assert_allclose(found["half_tangent"], [2, 1], rtol=1e-6)
    np.testing.assert_allclose(found["centre_tangent"], [0.5, 0], rtol=1e-6)


def test_a_focal_length_of_0_is_refused_by_core(stage: Usd.Stage) -> None:
    add_camera(stage).CreateFocalLengthAttr(0.0)
    translation = translate(stage)
    with pytest.raises(_core.Error, match="/World/Camera"):
        translation.scene.validate()


def test_the_lens(stage: Usd.Stage) -> None:
    camera = add_camera(stage)
    camera.CreateFocusDistanceAttr(7.0)
    assert translate(stage).scene.camera["lens_radius"] == 0, "fStop 0 is a pinhole"
    camera.CreateFStopAttr(2.0)
    found = translate(stage)
    assert found.scene.camera["lens_radius"] == pytest.approx(50 / 10 / 2 / 2)
    assert found.scene.camera["focus_distance"] == 7 and found.lens
    assert found.scene.camera["aperture_blades"] == 0
    prim = camera.GetPrim()
    prim.CreateAttribute("encore:apertureBlades", Sdf.ValueTypeNames.Int).Set(6)
    prim.CreateAttribute("encore:apertureRotation", Sdf.ValueTypeNames.Float).Set(30.0)
    found = translate(stage).scene.camera
    assert found["aperture_blades"] == 6
    assert found["aperture_rotation_radians"] == pytest.approx(math.radians(30))
    sharp = translate(stage, depth_of_field=False)
    assert sharp.scene.camera["lens_radius"] == 0 and not sharp.lens


@pytest.mark.parametrize("focus", [0.0, -1.0, math.nan])
def test_a_lens_without_a_focus(stage: Usd.Stage, focus: float) -> None:
    camera = add_camera(stage)
    camera.CreateFStopAttr(2.0)
    camera.CreateFocusDistanceAttr(focus)
    translation = translate(stage)
    assert translation.scene.camera["lens_radius"] == 0
    assert kinds(translation)["bad lens"] == 1 and translation.reports.has_errors


@pytest.mark.parametrize("blades", [-1, 65])
def test_bad_blades(stage: Usd.Stage, blades: int) -> None:
    camera = add_camera(stage)
    camera.CreateFStopAttr(2.0)
    camera.CreateFocusDistanceAttr(1.0)
    camera.GetPrim().CreateAttribute("encore:apertureBlades", Sdf.ValueTypeNames.Int).Set(blades)
    translation = translate(stage)
    assert translation.scene.camera["aperture_blades"] == 0
    assert kinds(translation)["bad encore:apertureBlades"] == 1


def test_clipping_planes(stage: Usd.Stage) -> None:
    camera = add_camera(stage)
    camera.CreateClippingPlanesAttr([(0, 0, 1, 1), (0, 0, 0, 3), (1, 0, 0, -2)])
    translation = translate(stage)
    planes = [tuple(p) for p in translation.scene.camera["clipping_planes"]]
    assert planes == [(0, 0, 1, 1), (1, 0, 0, -2)]
    assert kinds(translation)["bad clipping plane"] == 1


def test_exposure(stage: Usd.Stage) -> None:
    camera = add_camera(stage)
    assert translate(stage).scene.camera["exposure_scale"] == 1
    camera.CreateExposureAttr(3.0)
    assert translate(stage).scene.camera["exposure_scale"] == 8
    if hasattr(camera, "CreateExposureTimeAttr"):
        camera.CreateExposureTimeAttr(0.5)
        camera.CreateExposureFStopAttr(2.0)
        expected = camera.ComputeLinearExposureScale()
        assert expected == pytest.approx(1)
        assert translate(stage).scene.camera["exposure_scale"] == pytest.approx(expected)
    camera.GetExposureAttr().Set(math.inf)
    translation = translate(stage)
    assert translation.scene.camera["exposure_scale"] == 1
    assert kinds(translation)["bad exposure"] == 1


def test_time_samples(stage: Usd.Stage) -> None:
    camera = add_camera(stage)
    operation = camera.AddTranslateOp()
    operation.Set((0, 0, 0), 1)
    operation.Set((0, 0, 10), 2)
    camera.GetFocalLengthAttr().Set(50.0, 1)
    camera.GetFocalLengthAttr().Set(100.0, 2)
    found = translate(stage, time=Usd.TimeCode(1.5)).scene.camera
    assert found["to_world"][3, 2] == 5
    assert found["half_tangent"][0] == pytest.approx(20 / 75)


# The automatic camera


def projected(translation: object) -> np.ndarray:
    """NDC of the corners of the stage's box (±1, ±2, ±3), in the order of their signs."""
    camera = translation.scene.camera
    corners = np.array([(x, y, z, 1) for x in (-1, 1) for y in (-2, 2) for z in (-3, 3)], dtype=float)
    seen = corners @ np.linalg.inv(camera["to_world"])
    assert (seen[:, 2] < 0).all(), "in front of the camera"
    return seen[:, :2] / -seen[:, 2:3] / np.array(camera["half_tangent"])


def framed_stage(up: str) -> Usd.Stage:
    stage = new_stage()
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.Cube.Define(stage, "/World/Box").AddScaleOp().Set((1, 2, 3))
    return stage


def test_the_stage_is_framed_from_the_front() -> None:
    translation = translate(framed_stage("Y"))
    matrix = translation.scene.camera["to_world"]
    assert matrix[:3, :3].tolist() == np.eye(3).tolist()
    # The circle around the front face fills the width of the default camera's view.
    half = math.radians(Gf.Camera().GetFieldOfView(Gf.Camera.FOVHorizontal) / 2)
    assert matrix[3, 2] == pytest.approx(math.hypot(1, 2) / math.tan(half) + 3)
    assert np.abs(projected(translation)[:, 0]).max() < 1
    assert translation.height == 700


def test_the_stage_is_framed_from_the_front_with_z_up() -> None:
    translation = translate(framed_stage("Z"))
    matrix = translation.scene.camera["to_world"]
    np.testing.assert_allclose(-matrix[2, :3], [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(matrix[1, :3], [0, 0, 1], atol=1e-12)
    half = math.radians(Gf.Camera().GetFieldOfView(Gf.Camera.FOVHorizontal) / 2)
    assert -matrix[3, 1] == pytest.approx(math.hypot(1, 3) / math.tan(half) + 2)


@pytest.mark.parametrize("size", [1e-6, 1e9])
def test_nothing_is_clipped_at_any_size(size: float) -> None:
    stage = new_stage()
    UsdGeom.Cube.Define(stage, "/World/Box").CreateSizeAttr(size)
    translation = translate(stage)
    camera = translation.scene.camera
    distance = camera["to_world"][3, 2]
    assert camera["near_clip"] < distance - size / 2 and camera["far_clip"] > distance + size / 2


def test_only_wanted_purposes_are_framed() -> None:
    stage = framed_stage("Y")
    UsdGeom.Cube.Define(stage, "/World/Huge").CreateSizeAttr(1000.0)
    UsdGeom.Imageable(stage.GetPrimAtPath("/World/Huge")).CreatePurposeAttr("guide")
    assert np.abs(projected(translate(stage))).max() > 0.3


def test_a_deactivated_camera_is_none() -> None:
    stage = Usd.Stage.CreateInMemory()
    add_square(stage, "/square")
    UsdGeom.Camera.Define(stage, "/camera").GetPrim().SetActive(False)
    with pytest.raises(StageError, match="there is no such camera"):
        translate(stage, camera="/camera")
