"""Lights whose irradiance is known in closed form, and what steers them: shaping, linking, shadows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade
from rendering import add_camera, add_dome, add_material, add_mesh, add_plane, new_stage, render, write_exr

ALBEDO = 0.5
PI = np.pi


def floor_stage(size: float = 8.0) -> Usd.Stage:
    """A diffuse floor seen from above the light's height, in the middle of the picture."""
    stage = new_stage()
    add_plane(stage, "/World/Floor", size, add_material(stage, "Grey", diffuseColor=(ALBEDO,) * 3))
    add_camera(stage, (0, 0.5, 0), (0, 0, 0), 0.02, up=(0, 0, -1))
    return stage


def irradiance(stage: Usd.Stage, **settings: Any) -> np.ndarray:
    """Of the floor at the origin, by colour."""
    given = {"samples": 2, "light_samples": 512, "occlusion_samples": 512, "shading_rate": 4.0, **settings}
    image = render(stage, 8, 8, camera_light=False, **given)
    assert image["statistics"]["non_finite_samples"] == 0
    return image["composite"].mean(axis=(0, 1)) * PI / ALBEDO


def above(light: Any, height: float) -> Any:
    light.AddTranslateOp().Set((0, height, 0))
    light.AddRotateXOp().Set(-90)  # shines down
    return light


def straight_down(stage: Usd.Stage, intensity: float) -> UsdLux.DistantLight:
    """A distant light without an extent."""
    light = UsdLux.DistantLight.Define(stage, "/World/Light")
    light.AddRotateXOp().Set(-90)
    light.CreateAngleAttr(0.0)
    light.CreateIntensityAttr(intensity)
    return light


def test_disk() -> None:
    stage = floor_stage()
    light = above(UsdLux.DiskLight.Define(stage, "/World/Light"), 2.0)
    light.CreateRadiusAttr(0.7)
    light.CreateIntensityAttr(5.0)
    np.testing.assert_allclose(irradiance(stage), PI * 5 * 0.49 / (0.49 + 4), rtol=0.01)


def test_normalized_disk_keeps_its_power() -> None:
    stage = floor_stage()
    light = above(UsdLux.DiskLight.Define(stage, "/World/Light"), 2.0)
    light.CreateRadiusAttr(0.7)
    light.CreateIntensityAttr(5.0)
    light.CreateNormalizeAttr(True)
    np.testing.assert_allclose(irradiance(stage), 5 / (0.49 + 4), rtol=0.01)


def test_sphere() -> None:
    stage = floor_stage()
    light = UsdLux.SphereLight.Define(stage, "/World/Light")
    light.AddTranslateOp().Set((0, 2, 0))
    light.CreateRadiusAttr(0.5)
    light.CreateIntensityAttr(3.0)
    np.testing.assert_allclose(irradiance(stage), PI * 3 * 0.25 / 4, rtol=0.01)


def test_long_cylinder_is_a_line() -> None:
    """An infinite line of radius r at height h: E = 2 r L / h · π / 2 for r much below h."""
    stage = floor_stage()
    light = UsdLux.CylinderLight.Define(stage, "/World/Light")
    light.AddTranslateOp().Set((0, 2, 0))
    light.CreateRadiusAttr(0.02)
    light.CreateLengthAttr(200.0)
    light.CreateIntensityAttr(10.0)
    expected = PI * 10 * 0.02 / 2
    np.testing.assert_allclose(irradiance(stage, light_samples=4096), expected, rtol=0.03)


def test_distant_light_with_an_angle() -> None:
    stage = floor_stage()
    light = UsdLux.DistantLight.Define(stage, "/World/Light")
    light.AddRotateXOp().Set(-90)
    light.CreateAngleAttr(20.0)
    light.CreateIntensityAttr(4.0)
    np.testing.assert_allclose(irradiance(stage), PI * 4 * np.sin(np.radians(10)) ** 2, rtol=0.01)


def test_mesh_light_equals_rect_light() -> None:
    """Two triangles as a MeshLightAPI, and a rect of the same size."""
    results = []
    for kind in ("rect", "mesh"):
        stage = floor_stage()
        if kind == "rect":
            light = above(UsdLux.RectLight.Define(stage, "/World/Light"), 2.0)
            light.CreateIntensityAttr(6.0)
        else:
            black = add_material(stage, "Black", diffuseColor=(0.0, 0.0, 0.0))
            points = [(-0.5, 2, -0.5), (0.5, 2, -0.5), (0.5, 2, 0.5), (-0.5, 2, 0.5)]
            mesh = add_mesh(stage, "/World/Light", points, [[0, 1, 2, 3]], black)
            api = UsdLux.MeshLightAPI.Apply(mesh.GetPrim())
            UsdLux.LightAPI(api).CreateIntensityAttr(6.0)
        results.append(irradiance(stage))
    np.testing.assert_allclose(results[1], results[0], rtol=0.02)
    assert results[0].min() > 0.5


def dome_with(stage: Usd.Stage, file: str, intensity: float = 1.0) -> UsdLux.DomeLight:
    dome = UsdLux.DomeLight.Define(stage, "/World/Dome")
    dome.CreateIntensityAttr(intensity)
    dome.CreateTextureFileAttr(file)
    return dome


def test_constant_dome_texture_equals_a_plain_dome(tmp_path: Path) -> None:
    file = write_exr(tmp_path / "white.exr", np.ones((16, 32, 3)))
    stage = floor_stage()
    dome_with(stage, file, 0.7)
    np.testing.assert_allclose(irradiance(stage), 0.7 * PI, rtol=0.01)


@pytest.mark.parametrize(("degrees", "share"), [(0.0, 1.0), (180.0, 0.0), (90.0, 0.5)])
def test_dome_texture_turns_with_its_light(tmp_path: Path, degrees: float, share: float) -> None:
    """A wall that faces +x sees the half of the sky that is bright there (OpenEXR's latlong convention:
    the middle column looks along +z, a quarter further left along +x)."""
    pixels = np.zeros((32, 64, 3), np.float32)
    pixels[:, :32] = (1.0, 0.5, 0.25)
    file = write_exr(tmp_path / "half.exr", pixels)
    stage = new_stage()
    grey = add_material(stage, "Grey", diffuseColor=(ALBEDO,) * 3)
    wall = [(0, -4, 4), (0, -4, -4), (0, 4, -4), (0, 4, 4)]
    add_mesh(stage, "/World/Wall", wall, [[0, 1, 2, 3]], grey)
    add_camera(stage, (0.5, 0, 0), (0, 0, 0), 0.02)
    dome_with(stage, file).AddRotateYOp().Set(degrees)
    expected = share * PI * np.array([1.0, 0.5, 0.25])
    np.testing.assert_allclose(irradiance(stage), expected, rtol=0.02, atol=0.04)


def test_bright_spot_in_a_dome_is_found(tmp_path: Path) -> None:
    """A sun of one pixel: importance sampling leaves little noise."""
    pixels = np.full((64, 128, 3), 0.01, np.float32)
    pixels[10, 40] = 20000
    file = write_exr(tmp_path / "sun.exr", pixels)
    stage = floor_stage()
    dome_with(stage, file)
    polar = PI * 10.5 / 64
    spot = 20000 * np.cos(polar) * np.sin(polar) * (PI / 64) * (2 * PI / 128)
    images = [irradiance(stage, occlusion_samples=32, seed=seed) for seed in range(3)]
    np.testing.assert_allclose(images, spot + 0.01 * PI, rtol=0.05)


def test_textured_rect(tmp_path: Path) -> None:
    """Far away, a rect lights by the mean of its image."""
    pixels = np.zeros((8, 8, 3), np.float32)
    pixels[:4] = (2.0, 0.0, 0.0)
    pixels[4:] = (0.0, 0.0, 1.0)
    stage = floor_stage()
    light = above(UsdLux.RectLight.Define(stage, "/World/Light"), 5.0)
    light.CreateIntensityAttr(10.0)
    light.CreateTextureFileAttr(write_exr(tmp_path / "rect.exr", pixels))
    red, green, blue = irradiance(stage)
    assert green == 0
    plain = floor_stage()
    above(UsdLux.RectLight.Define(plain, "/World/Light"), 5.0).CreateIntensityAttr(10.0)
    np.testing.assert_allclose([red, blue], irradiance(plain)[:2] * [1.0, 0.5], rtol=0.02)


def test_shaping_cone_and_focus() -> None:
    stage = floor_stage()
    light = above(UsdLux.SphereLight.Define(stage, "/World/Light"), 2.0)
    light.CreateRadiusAttr(0.05)
    light.CreateIntensityAttr(100.0)
    plain = irradiance(stage)
    shaping = UsdLux.ShapingAPI.Apply(light.GetPrim())
    shaping.CreateShapingConeAngleAttr(30.0)
    np.testing.assert_allclose(irradiance(stage), plain, rtol=0.01)  # straight below: inside
    light.GetPrim().GetAttribute("xformOp:rotateX").Set(-30.0)  # 60 degrees off
    assert (irradiance(stage) == 0).all()
    shaping.CreateShapingConeAngleAttr(90.0)
    shaping.CreateShapingFocusAttr(2.0)
    focused = irradiance(stage)
    np.testing.assert_allclose(focused, plain * 0.5**2, rtol=0.03)  # cos(60°) to the power of focus


def test_shadow_can_be_switched_off_and_coloured() -> None:
    stage = floor_stage()
    blocker = [(-0.4, 1, -0.4), (0.4, 1, -0.4), (0.4, 1, 0.4), (-0.4, 1, 0.4)]
    add_mesh(stage, "/World/Blocker", blocker, [[0, 1, 2, 3]])
    light = straight_down(stage, 2.0)
    assert (irradiance(stage) == 0).all()
    shadow = UsdLux.ShadowAPI.Apply(light.GetPrim())
    shadow.CreateShadowColorAttr((0.25, 0.5, 0.0))
    np.testing.assert_allclose(irradiance(stage), [0.5, 1.0, 0.0], atol=0.01)
    shadow.CreateShadowDistanceAttr(0.9)  # the blocker is 1 away
    np.testing.assert_allclose(irradiance(stage), 2.0, rtol=0.01)
    shadow.CreateShadowDistanceAttr(-1.0)
    shadow.CreateShadowEnableAttr(False)
    np.testing.assert_allclose(irradiance(stage), 2.0, rtol=0.01)


def two_halves() -> tuple[Usd.Stage, UsdLux.DistantLight]:
    stage = new_stage()
    grey = add_material(stage, "Grey", diffuseColor=(ALBEDO,) * 3)
    for name, x in (("Left", -1.0), ("Right", 1.0)):
        points = [(x - 1, 0, 2), (x + 1, 0, 2), (x + 1, 0, -2), (x - 1, 0, -2)]
        add_mesh(stage, f"/World/{name}", points, [[0, 1, 2, 3]], grey)
    light = straight_down(stage, 1.0)
    add_camera(stage, (0, 4, 0), (0, 0, 0), 0.2, up=(0, 0, -1))
    return stage, light


def test_light_linking() -> None:
    stage, light = two_halves()
    api = UsdLux.LightAPI(light)
    api.GetLightLinkCollectionAPI().CreateExcludesRel().AddTarget("/World/Left")
    image = render(stage, 16, 16, camera_light=False, samples=2)["composite"]
    assert (image[:, :7] == 0).all()
    np.testing.assert_allclose(image[:, 9:], ALBEDO / PI, rtol=0.01)


def test_shadow_linking() -> None:
    """Blockers over both halves; only the left one casts this light's shadow."""
    stage, light = two_halves()
    for name, x in (("BlockLeft", -1.0), ("BlockRight", 1.0)):
        points = [(x - 1, 6, 2), (x + 1, 6, 2), (x + 1, 6, -2), (x - 1, 6, -2)]
        add_mesh(stage, f"/World/{name}", points, [[0, 1, 2, 3]])
    api = UsdLux.LightAPI(light)
    api.GetShadowLinkCollectionAPI().CreateExcludesRel().AddTarget("/World/BlockRight")
    image = render(stage, 16, 16, camera_light=False, samples=2)["composite"]
    assert (image[:, :7] == 0).all()
    np.testing.assert_allclose(image[:, 9:], ALBEDO / PI, rtol=0.01)


def test_many_lights_are_shared_out_without_bias() -> None:
    """Forty lights of very different strength: by importance, and with all of their rays."""
    stage = floor_stage()
    rng = np.random.default_rng(5)
    for i in range(40):
        light = UsdLux.SphereLight.Define(stage, f"/World/Light{i}")
        light.CreateRadiusAttr(0.1)
        light.CreateIntensityAttr(float(10 ** rng.uniform(-1, 2)))
        light.AddTranslateOp().Set(tuple(float(v) for v in rng.uniform((-3, 0.5, -3), (3, 3, 3))))
    everything = irradiance(stage, light_samples=64, most_light_samples=1 << 20)
    chosen = np.mean(
        [irradiance(stage, light_samples=64, most_light_samples=32, seed=seed) for seed in range(8)], axis=0
    )
    np.testing.assert_allclose(chosen, everything, rtol=0.02)


def test_occlusion_distance() -> None:
    stage = floor_stage()
    add_dome(stage)
    lid = [(-9, 1, -9), (9, 1, -9), (9, 1, 9), (-9, 1, 9)]
    add_mesh(stage, "/World/Lid", lid, [[0, 1, 2, 3]])
    dark = irradiance(stage)
    assert dark.max() < 0.05 * PI
    np.testing.assert_allclose(irradiance(stage, occlusion_distance_world=0.5), PI, rtol=0.01)


def test_transmitting_sheets_dim_shadow_rays() -> None:
    """Presence of a half, twice, between floor and light: a quarter passes."""
    stage = floor_stage()
    straight_down(stage, 1.0)
    half = add_material(stage, "Half", diffuseColor=(0.0, 0.0, 0.0), opacity=0.5)
    shader = UsdShade.Shader(stage.GetPrimAtPath("/World/Looks/Half/Surface"))
    shader.CreateInput("opacityMode", Sdf.ValueTypeNames.Token).Set("presence")
    for i in range(2):
        points = [(-2, 1 + i, 2), (2, 1 + i, 2), (2, 1 + i, -2), (-2, 1 + i, -2)]
        add_mesh(stage, f"/World/Sheet{i}", points, [[0, 1, 2, 3]], half)
    np.testing.assert_allclose(irradiance(stage), 0.25, rtol=0.01)


def test_glass_pane_passes_light_by_its_transmittance() -> None:
    """One thin sheet of ior 1.5 straight above: 1 - 2R / (1 + R) with R = 0.04; or nothing, when asked."""
    stage = floor_stage()
    straight_down(stage, 1.0)
    glass = add_material(stage, "Glass", diffuseColor=(1.0, 1.0, 1.0), opacity=0.0, ior=1.5, roughness=0.0)
    pane = [(-2, 1, 2), (2, 1, 2), (2, 1, -2), (-2, 1, -2)]
    add_mesh(stage, "/World/Pane", pane, [[0, 1, 2, 3]], glass)
    np.testing.assert_allclose(irradiance(stage), (1 - 0.04) / (1 + 0.04), rtol=0.005)
    assert (irradiance(stage, glass_shadows="opaque") == 0).all()


def test_light_inside_a_closed_box_lights_nothing_outside() -> None:
    stage = floor_stage()
    box = UsdGeom.Cube.Define(stage, "/World/Box")
    box.AddTranslateOp().Set(Gf.Vec3d(0, 2, 0))
    light = UsdLux.SphereLight.Define(stage, "/World/Light")
    light.AddTranslateOp().Set((0, 2, 0))
    light.CreateIntensityAttr(50.0)
    assert (irradiance(stage) == 0).all()
