"""Lights: radiance after UsdLux's formulas, shapes in world space, and what is reported."""

import math
from pathlib import Path

import numpy as np
import pytest
from encore.adapters.light import TYPES
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux
from stages import add_square, kinds, lights, new_stage, translate, write_image

PI = math.pi


@pytest.fixture
def stage() -> Usd.Stage:
    stage = new_stage()
    add_square(stage, "/World/Mesh")
    return stage


def only_light(stage: Usd.Stage, **options: object) -> dict:
    (found,) = lights(translate(stage, **options)).values()
    return found


def test_emission(stage: Usd.Stage) -> None:
    light = UsdLux.RectLight.Define(stage, "/World/Light")
    light.CreateIntensityAttr(3.0)
    light.CreateExposureAttr(2.0)
    light.CreateColorAttr((1.0, 0.5, 0.25))
    light.CreateDiffuseAttr(0.5)
    light.CreateSpecularAttr(0.25)
    found = only_light(stage)
    assert found["radiance"] == (12, 6, 3)
    assert (found["diffuse"], found["specular"]) == (0.5, 0.25)


def test_color_temperature(stage: Usd.Stage) -> None:
    light = UsdLux.RectLight.Define(stage, "/World/Light")
    light.CreateColorTemperatureAttr(3000.0)
    assert only_light(stage)["radiance"] == (1, 1, 1)
    light.CreateEnableColorTemperatureAttr(True)
    red, green, blue = only_light(stage)["radiance"]
    assert (red, green, blue) == pytest.approx(tuple(UsdLux.BlackbodyTemperatureAsRgb(3000.0)))
    assert red > green > blue


def test_rect(stage: Usd.Stage) -> None:
    light = UsdLux.RectLight.Define(stage, "/World/Light")
    light.CreateWidthAttr(4.0)
    light.CreateHeightAttr(2.0)
    light.AddTranslateOp().Set((1, 2, 3))
    light.AddRotateXOp().Set(90)
    light.AddScaleOp().Set((1, 3, 1))
    found = only_light(stage)
    assert found["centre"] == (1, 2, 3)
    np.testing.assert_allclose(found["half_u"], [2, 0, 0], atol=1e-6)
    np.testing.assert_allclose(found["half_v"], [0, 0, 3], atol=1e-6)
    light.CreateNormalizeAttr(True)
    assert only_light(stage)["radiance"] == pytest.approx((1 / 24,) * 3), "by world-space area"


@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1), (1, 1, -1), (-1, -1, -1)])
def test_rect_emits_along_its_own_minus_z(stage: Usd.Stage, scale: tuple[int, int, int]) -> None:
    light = UsdLux.RectLight.Define(stage, "/World/Light")
    light.AddRotateYOp().Set(30)
    light.AddScaleOp().Set(Gf.Vec3f(scale))
    found = only_light(stage)
    emits = -np.cross(found["half_u"], found["half_v"])
    matrix = UsdGeom.XformCache().GetLocalToWorldTransform(light.GetPrim())
    assert np.dot(emits, matrix.TransformDir(Gf.Vec3d(0, 0, -1))) > 0


def test_sphere(stage: Usd.Stage) -> None:
    light = UsdLux.SphereLight.Define(stage, "/World/Light")
    light.CreateRadiusAttr(0.5)
    light.AddTranslateOp().Set((1, 2, 3))
    light.AddScaleOp().Set((4, 4, 4))
    light.CreateNormalizeAttr(True)
    translation = translate(stage)
    (found,) = lights(translation).values()
    assert found["centre"] == (1, 2, 3) and found["radius"] == pytest.approx(2)
    assert found["radiance"] == pytest.approx((1 / (16 * PI),) * 3)
    assert "stretched SphereLight" not in kinds(translation)
    light.GetOrderedXformOps()[1].Set((8, 4, 2))
    translation = translate(stage)
    assert lights(translation)["/World/Light"]["radius"] == pytest.approx(2)
    assert kinds(translation)["stretched SphereLight"] == 1


def test_distant(stage: Usd.Stage) -> None:
    light = UsdLux.DistantLight.Define(stage, "/World/Light")
    light.AddRotateXOp().Set(-90)
    light.AddScaleOp().Set((3, 3, 3))
    found = only_light(stage)
    np.testing.assert_allclose(found["direction"], [0, -1, 0], atol=1e-6)
    assert found["angle_radians"] == pytest.approx(math.radians(0.53))
    assert found["radiance"] == (50000,) * 3
    # What a surface that faces it receives.
    assert 50000 * PI * math.sin(found["angle_radians"] / 2) ** 2 == pytest.approx(3.36, abs=0.01)


@pytest.mark.parametrize(
    ("degrees", "size"),
    [(0.0, 1.0), (0.53, PI * math.sin(math.radians(0.265)) ** 2), (180.0, PI), (360.0, 2 * PI)],
)
def test_normalized_distant_lights_give_irradiance(stage: Usd.Stage, degrees: float, size: float) -> None:
    light = UsdLux.DistantLight.Define(stage, "/World/Light")
    light.CreateAngleAttr(degrees)
    light.CreateIntensityAttr(2.0)
    assert only_light(stage)["radiance"] == (2, 2, 2)
    light.CreateNormalizeAttr(True)
    assert only_light(stage)["radiance"] == pytest.approx((2 / size,) * 3)


@pytest.mark.parametrize("kind", [UsdLux.DomeLight, UsdLux.DomeLight_1])
def test_dome(stage: Usd.Stage, kind: type) -> None:
    light = kind.Define(stage, "/World/Light")
    light.CreateIntensityAttr(0.5)
    light.CreateNormalizeAttr(True)
    found = only_light(stage)
    assert found["kind"] == "dome" and found["texture"] == -1
    assert found["radiance"] == (0.5, 0.5, 0.5), "normalize is ignored"


def axes(found: dict) -> list[list[float]]:
    return np.round([found[f"axis_{n}"] for n in "xyz"], 6).tolist()


def test_the_dome_stands_on_its_own_y(stage: Usd.Stage) -> None:
    """Local +Y is the top of the image, +Z its middle (the OpenEXR specification)."""
    UsdLux.DomeLight.Define(stage, "/World/Light").AddRotateYOp().Set(90)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    assert axes(only_light(stage)) == [[0, 0, -1], [0, 1, 0], [1, 0, 0]]


@pytest.mark.parametrize(
    ("up", "pole", "top", "middle"),
    [
        ("Y", "scene", [0, 1, 0], [0, 0, 1]),
        ("Z", "scene", [0, 0, 1], [0, -1, 0]),
        ("Z", "Y", [0, 1, 0], [0, 0, 1]),
        ("Y", "Z", [0, 0, 1], [0, -1, 0]),
    ],
)
def test_the_pole_axis(stage: Usd.Stage, up: str, pole: str, top: list, middle: list) -> None:
    UsdGeom.SetStageUpAxis(stage, up)
    UsdLux.DomeLight_1.Define(stage, "/World/Light").CreatePoleAxisAttr(pole)
    assert axes(only_light(stage)) == [[1, 0, 0], top, middle]


def test_stretched_domes_are_only_rotated(stage: Usd.Stage) -> None:
    light = UsdLux.DomeLight.Define(stage, "/World/Light")
    light.AddScaleOp().Set((3, 3, 3))
    assert axes(only_light(stage)) == np.eye(3).tolist()
    light.GetOrderedXformOps()[0].Set((1, 1, -2))
    translation = translate(stage)
    (found,) = lights(translation).values()
    frame = np.array([found[f"axis_{n}"] for n in "xyz"])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-6)
    assert np.linalg.det(frame) > 0
    assert kinds(translation)["stretched DomeLight"] == 1


@pytest.mark.parametrize("kind", [UsdLux.DomeLight, UsdLux.RectLight])
def test_textures(stage: Usd.Stage, kind: type, tmp_path: Path) -> None:
    light = kind.Define(stage, "/World/Light")
    light.CreateTextureFileAttr(write_image(tmp_path / "sky.exr"))
    translation = translate(stage)
    (found,) = lights(translation).values()
    assert translation.scene.texture(found["texture"])["path"] == str(tmp_path / "sky.exr")
    assert found["format"] == "latlong"


@pytest.mark.parametrize("name", ["mirroredBall", "angular", "cubeMapVerticalCross", "latlong"])
def test_formats_of_dome_textures(stage: Usd.Stage, name: str, tmp_path: Path) -> None:
    light = UsdLux.DomeLight.Define(stage, "/World/Light")
    light.CreateTextureFileAttr(write_image(tmp_path / "sky.exr"))
    light.CreateTextureFormatAttr(name)
    assert only_light(stage)["format"] == name
    light.GetTextureFormatAttr().Set("octahedral")
    translation = translate(stage)
    assert lights(translation)["/World/Light"]["format"] == "latlong"
    assert kinds(translation)["bad texture:format"] == 1


def test_a_missing_texture_leaves_the_plain_colour(stage: Usd.Stage) -> None:
    light = UsdLux.DomeLight.Define(stage, "/World/Light")
    light.CreateTextureFileAttr("nothing.exr")
    translation = translate(stage)
    (found,) = lights(translation).values()
    assert found["texture"] == -1 and found["radiance"] == (1, 1, 1)
    assert kinds(translation)["missing texture"] == 1 and translation.reports.has_errors


def test_disk(stage: Usd.Stage) -> None:
    light = UsdLux.DiskLight.Define(stage, "/World/Light")
    light.CreateRadiusAttr(2.0)
    light.AddTranslateOp().Set((1, 2, 3))
    light.AddScaleOp().Set((1, 3, 5))
    found = only_light(stage)
    assert found["kind"] == "disk" and found["centre"] == (1, 2, 3)
    assert found["half_u"] == (2, 0, 0) and found["half_v"] == (0, 6, 0)
    light.CreateNormalizeAttr(True)
    assert only_light(stage)["radiance"] == pytest.approx((1 / (12 * PI),) * 3)


def test_cylinder(stage: Usd.Stage) -> None:
    light = UsdLux.CylinderLight.Define(stage, "/World/Light")
    light.CreateRadiusAttr(0.5)
    light.CreateLengthAttr(4.0)
    light.AddRotateZOp().Set(90)
    light.AddScaleOp().Set((3, 2, 2))
    translation = translate(stage)
    (found,) = lights(translation).values()
    assert found["kind"] == "cylinder" and found["radius"] == pytest.approx(1)
    np.testing.assert_allclose(found["half_u"], [0, 6, 0], atol=1e-6)
    assert "stretched CylinderLight" not in kinds(translation)
    light.CreateNormalizeAttr(True)
    assert only_light(stage)["radiance"] == pytest.approx((1 / (2 * PI * 12),) * 3), "without caps"
    light.GetOrderedXformOps()[1].Set((3, 1, 4))
    translation = translate(stage)
    assert lights(translation)["/World/Light"]["radius"] == pytest.approx(1)
    assert kinds(translation)["stretched CylinderLight"] == 1


def test_hints_to_have_no_size_are_noted(stage: Usd.Stage) -> None:
    UsdLux.SphereLight.Define(stage, "/World/Point").CreateTreatAsPointAttr(True)
    UsdLux.CylinderLight.Define(stage, "/World/Line").CreateTreatAsLineAttr(True)
    translation = translate(stage)
    assert {"treatAsPoint", "treatAsLine"} <= kinds(translation).keys()
    assert lights(translation)["/World/Point"]["radius"] == 0.5


# Shaping and shadows


def test_shaping(stage: Usd.Stage) -> None:
    light = UsdLux.SphereLight.Define(stage, "/World/Light")
    light.AddRotateXOp().Set(-90)
    light.AddScaleOp().Set((2, 2, 2))
    shaping = UsdLux.ShapingAPI.Apply(light.GetPrim())
    found = only_light(stage)
    assert found["shaped"] and found["cone_angle_radians"] == pytest.approx(PI / 2), "the schema's fallback"
    shaping.CreateShapingConeAngleAttr(30.0)
    shaping.CreateShapingConeSoftnessAttr(0.25)
    shaping.CreateShapingFocusAttr(3.0)
    shaping.CreateShapingFocusTintAttr((0.5, 0, 0))
    found = only_light(stage)
    np.testing.assert_allclose(found["shaping_axis"], [0, -1, 0], atol=1e-6)
    assert found["cone_angle_radians"] == pytest.approx(math.radians(30))
    assert (found["cone_softness"], found["focus"], found["focus_tint"]) == (0.25, 3, (0.5, 0, 0))
    shaping.GetShapingConeSoftnessAttr().Set(7.0)
    shaping.GetShapingFocusAttr().Set(-1.0)
    found = only_light(stage)
    assert (found["cone_softness"], found["focus"]) == (1, 0)


def test_shaping_that_changes_nothing(stage: Usd.Stage) -> None:
    for name in ("RectLight", "DiskLight", "SphereLight", "DistantLight"):
        prim = stage.DefinePrim(f"/World/{name}", name)
        shaping = UsdLux.ShapingAPI.Apply(prim)
        if name == "SphereLight":
            shaping.CreateShapingConeAngleAttr(180.0)
            shaping.CreateShapingFocusAttr(5.0)
            shaping.CreateShapingFocusTintAttr((1, 1, 1))
    translation = translate(stage)
    assert not any(light["shaped"] for light in lights(translation).values())
    assert kinds(translation).keys() == {"camera"}


def test_attributes_of_a_schema_that_is_not_applied(stage: Usd.Stage) -> None:
    prim = UsdLux.SphereLight.Define(stage, "/World/Light").GetPrim()
    prim.CreateAttribute("inputs:shaping:focus", Sdf.ValueTypeNames.Float).Set(2.0)
    found = only_light(stage)
    assert found["focus"] == 2 and found["cone_angle_radians"] == pytest.approx(PI), "no cone of its own"


def test_distant_lights_have_no_shape(stage: Usd.Stage) -> None:
    prim = UsdLux.DistantLight.Define(stage, "/World/Light").GetPrim()
    UsdLux.ShapingAPI.Apply(prim).CreateShapingConeAngleAttr(20.0)
    translation = translate(stage)
    assert not lights(translation)["/World/Light"]["shaped"]
    assert kinds(translation)["shaping of a distant light"] == 1


def test_shadows(stage: Usd.Stage) -> None:
    prim = UsdLux.RectLight.Define(stage, "/World/Light").GetPrim()
    shadow = UsdLux.ShadowAPI.Apply(prim)
    plain = only_light(stage)
    assert plain["shadow_enable"] and plain["shadow_distance"] == plain["shadow_falloff"] == -1
    shadow.CreateShadowEnableAttr(False)
    shadow.CreateShadowColorAttr((0.25, 0, 0.5))
    shadow.CreateShadowDistanceAttr(3.0)
    shadow.CreateShadowFalloffAttr(2.0)
    shadow.CreateShadowFalloffGammaAttr(0.5)
    found = only_light(stage)
    assert not found["shadow_enable"] and found["shadow_color"] == (0.25, 0, 0.5)
    assert (found["shadow_distance"], found["shadow_falloff"], found["shadow_falloff_gamma"]) == (3, 2, 0.5)
    shadow.GetShadowFalloffAttr().Set(5.0)
    assert only_light(stage)["shadow_falloff"] == 3, "within the distance"
    shadow.GetShadowDistanceAttr().Set(-1.0)
    assert only_light(stage)["shadow_falloff"] == -1, "no distance, no zone in it"


def test_numbers_that_are_not_finite_are_ignored(stage: Usd.Stage) -> None:
    prim = UsdLux.SphereLight.Define(stage, "/World/Light").GetPrim()
    UsdLux.ShapingAPI.Apply(prim).CreateShapingConeAngleAttr(math.nan)
    UsdLux.ShadowAPI.Apply(prim).CreateShadowColorAttr((math.inf, 0, 0))
    translation = translate(stage)
    (found,) = lights(translation).values()
    assert not found["shaped"] and found["shadow_color"] == (0, 0, 0)
    assert {"bad shaping:cone:angle", "bad shadow:color"} <= kinds(translation).keys()


@pytest.mark.parametrize(("value", "expected"), [(7, 7), (0, 0), (-3, 0), (10**6, 0)])
def test_samples(stage: Usd.Stage, value: int, expected: int) -> None:
    prim = UsdLux.RectLight.Define(stage, "/World/Light").GetPrim()
    assert only_light(stage)["samples"] == 0
    prim.CreateAttribute("encore:samples", Sdf.ValueTypeNames.Int).Set(value)
    translation = translate(stage)
    assert lights(translation)["/World/Light"]["samples"] == expected
    assert ("bad encore:samples" in kinds(translation)) == (value not in (7, 0))


def test_invisible_lights_are_off(stage: Usd.Stage) -> None:
    UsdLux.RectLight.Define(stage, "/World/On")
    UsdLux.RectLight.Define(stage, "/World/Off").CreateVisibilityAttr("invisible")
    assert list(lights(translate(stage))) == ["/World/On"]


def test_time_samples(stage: Usd.Stage) -> None:
    attribute = UsdLux.RectLight.Define(stage, "/World/Light").CreateIntensityAttr()
    attribute.Set(1.0, 1)
    attribute.Set(3.0, 2)
    assert only_light(stage, time=Usd.TimeCode(1.5))["radiance"] == (2, 2, 2)


def test_the_camera_light(stage: Usd.Stage) -> None:
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.AddRotateYOp().Set(90)
    found = only_light(stage, camera_light=True)
    assert found["kind"] == "distant" and found["angle_radians"] == 0
    assert found["radiance"] == pytest.approx((PI, PI, PI)), "a white diffuse surface that faces it shows 1"
    np.testing.assert_allclose(found["direction"], [-1, 0, 0], atol=1e-6)
    assert lights(translate(stage, camera_light=False)) == {}
    UsdLux.RectLight.Define(stage, "/World/Light").CreateIntensityAttr(0.0)
    assert list(lights(translate(stage, camera_light=True))) == ["/World/Light"]


@pytest.mark.parametrize(
    "case",
    ["width", "height", "radius", "length", "angle", "intensity", "exposure", "color", "kelvin", "diffuse"],
)
def test_lights_that_cannot_emit_are_reported(stage: Usd.Stage, case: str) -> None:
    rect = UsdLux.RectLight.Define(stage, "/World/Light")
    prim = rect.GetPrim()
    if case in ("width", "height"):
        prim.GetAttribute(f"inputs:{case}").Set(0.0 if case == "width" else -1.0)
    elif case in ("intensity", "exposure", "diffuse"):
        prim.GetAttribute(f"inputs:{case}").Set(math.nan if case == "intensity" else math.inf)
    elif case == "color":
        rect.CreateColorAttr((math.nan, 0, 0))
    elif case == "kelvin":
        rect.CreateEnableColorTemperatureAttr(True)
        rect.CreateColorTemperatureAttr(math.nan)
    elif case == "radius":
        prim.SetTypeName("SphereLight")
        UsdLux.SphereLight(prim).CreateRadiusAttr(-1.0)
    elif case == "length":
        prim.SetTypeName("CylinderLight")
        UsdLux.CylinderLight(prim).CreateLengthAttr(0.0)
    else:
        prim.SetTypeName("DistantLight")
        UsdLux.DistantLight(prim).CreateAngleAttr(math.nan)
    translation = translate(stage)
    assert lights(translation) == {}
    assert kinds(translation)["bad light"] == 1
    assert translation.reports.has_errors


@pytest.mark.parametrize("name", sorted(TYPES))
@pytest.mark.parametrize("scale", [0.0, math.nan])
def test_singular_transforms(stage: Usd.Stage, name: str, scale: float) -> None:
    prim = stage.DefinePrim("/World/Light", name)
    matrix = Gf.Matrix4d(scale)
    matrix[3, 3] = 1
    UsdGeom.Xformable(prim).AddTransformOp().Set(matrix)
    translation = translate(stage)
    assert lights(translation) == {}
    assert kinds(translation)["bad light"] == 1


@pytest.mark.parametrize(("width", "intensity"), [(1e-12, 1.0), (1.0, 3e38)])
def test_what_single_precision_cannot_hold_is_reported(
    stage: Usd.Stage, width: float, intensity: float
) -> None:
    light = UsdLux.RectLight.Define(stage, "/World/Light")
    light.CreateWidthAttr(width)
    light.CreateHeightAttr(1e-6 if width < 1 else 1.0)
    light.CreateIntensityAttr(intensity)
    light.CreateExposureAttr(10.0)
    translation = translate(stage)
    assert lights(translation) == {} and kinds(translation)["bad light"] == 1


def test_unsupported_lights_are_reported_by_name(stage: Usd.Stage) -> None:
    for name in ("PortalLight", "PluginLight"):
        stage.DefinePrim(f"/World/{name}", name)
    stage.DefinePrim("/World/AnotherPortal", "PortalLight")
    found = kinds(translate(stage))
    assert found["unsupported PortalLight"] == 2 and found["unsupported PluginLight"] == 1


def test_unsupported_attributes_are_reported(stage: Usd.Stage) -> None:
    prim = UsdLux.SphereLight.Define(stage, "/World/Light").GetPrim()
    shaping = UsdLux.ShapingAPI.Apply(prim)
    shaping.CreateShapingConeAngleAttr(180.0)
    shaping.CreateShapingIesFileAttr("lamp.ies")
    UsdLux.LightAPI(prim).CreateFiltersRel().AddTarget("/World/Filter")
    dome = UsdLux.DomeLight.Define(stage, "/World/Dome")
    dome.CreatePortalsRel().AddTarget("/World/Portal")
    found = kinds(translate(stage))
    assert found.keys() - {"camera"} == {"light shaping:ies:file", "light filters", "portals"}


def test_plugin_lights_are_not_taken_for_others(stage: Usd.Stage) -> None:
    prim = stage.DefinePrim("/World/Light", "PluginLight")
    prim.CreateAttribute("light:shaderId", Sdf.ValueTypeNames.Token).Set("Something")
    assert kinds(translate(stage))["unsupported PluginLight"] == 1
