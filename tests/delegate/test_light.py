"""Lights: radiance after UsdLux's formulas, shapes in world space, and what is reported."""

import math

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux
from stages import add_square, kinds, lights, new_stage, translate

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
    assert only_light(stage)["kind"] == "dome"
    assert only_light(stage)["radiance"] == (0.5, 0.5, 0.5)
    light.CreateTextureFileAttr("sky.exr")
    assert kinds(translate(stage))["light texture:file"] == 1


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


@pytest.mark.parametrize("case", ["width", "radius", "angle", "intensity", "color"])
def test_lights_that_cannot_emit_are_reported(stage: Usd.Stage, case: str) -> None:
    rect = UsdLux.RectLight.Define(stage, "/World/Light")
    if case == "width":
        rect.CreateWidthAttr(0.0)
    elif case == "intensity":
        rect.CreateIntensityAttr(math.inf)
    elif case == "color":
        rect.CreateColorAttr((math.nan, 0, 0))
    elif case == "radius":
        rect.GetPrim().SetTypeName("SphereLight")
        UsdLux.SphereLight(rect.GetPrim()).CreateRadiusAttr(-1.0)
    else:
        rect.GetPrim().SetTypeName("DistantLight")
        UsdLux.DistantLight(rect.GetPrim()).CreateAngleAttr(math.nan)
    translation = translate(stage)
    assert lights(translation) == {}
    assert kinds(translation)["bad light"] == 1
    assert translation.reports.has_errors


def test_unsupported_lights_are_reported_by_name(stage: Usd.Stage) -> None:
    for name in ("CylinderLight", "DiskLight", "GeometryLight", "PortalLight"):
        stage.DefinePrim(f"/World/{name}", name)
    stage.DefinePrim("/World/AnotherDisk", "DiskLight")
    found = kinds(translate(stage))
    assert found["unsupported DiskLight"] == 2
    assert {
        "unsupported CylinderLight",
        "unsupported GeometryLight",
        "unsupported PortalLight",
    } <= found.keys()


def test_unsupported_attributes_are_reported(stage: Usd.Stage) -> None:
    light = UsdLux.RectLight.Define(stage, "/World/Light")
    prim = light.GetPrim()
    shaping, shadow = UsdLux.ShapingAPI.Apply(prim), UsdLux.ShadowAPI.Apply(prim)
    assert not kinds(translate(stage)).keys() - {"camera"}, "applied, but nothing authored"
    shaping.CreateShapingConeAngleAttr(90.0)
    shadow.CreateShadowColorAttr((0, 0, 0))
    shadow.CreateShadowDistanceAttr(-1.0)
    assert not kinds(translate(stage)).keys() - {"camera"}, "authored, but neutral"
    shaping.CreateShapingConeAngleAttr(40.0)
    shaping.CreateShapingFocusAttr(2.0)
    shadow.CreateShadowEnableAttr(False)
    shadow.CreateShadowColorAttr((1, 0, 0))
    light.CreateTextureFileAttr("gel.exr")
    api = UsdLux.LightAPI(prim)
    api.GetLightLinkCollectionAPI().CreateExcludesRel().AddTarget("/World/Mesh")
    api.CreateFiltersRel().AddTarget("/World/Filter")
    found = kinds(translate(stage))
    assert found.keys() - {"camera"} == {
        "light shaping:cone:angle",
        "light shaping:focus",
        "light shadow:enable",
        "light shadow:color",
        "light texture:file",
        "light lightLink",
        "light filters",
    }


def test_plugin_lights_are_not_taken_for_others(stage: Usd.Stage) -> None:
    prim = stage.DefinePrim("/World/Light", "PluginLight")
    prim.CreateAttribute("light:shaderId", Sdf.ValueTypeNames.Token).Set("Something")
    assert kinds(translate(stage))["unsupported PluginLight"] == 1
