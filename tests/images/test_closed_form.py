"""Scenes whose pixels are known without rendering them."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import UsdGeom, UsdLux
from rendering import (
    add_camera,
    add_dome,
    add_material,
    add_mesh,
    add_plane,
    bind,
    new_stage,
    render,
    save_evidence,
)

METHODS = ["reuse", "reference"]


def plane_points(size: int, height: float, half_tangent: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (x, z) on y = 0 under the pixel centres of a camera that looks straight down, up = -z."""
    ndc = (np.arange(size) + 0.5) / size * 2 - 1
    x, z = np.meshgrid(ndc * height * half_tangent, ndc * height * half_tangent)
    return x, z


def look_down(stage, height: float = 4.0, half_tangent: float = 0.5) -> None:
    add_camera(stage, (0, height, 0), (0, 0, 0), half_tangent, up=(0, 0, -1))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("shape", ["smooth polygons", "subdivision surface", "facets"])
def test_white_diffuse_furnace_stays_white(method: str, shape: str) -> None:
    """Convex, so that nothing of it is hidden from the dome."""
    stage = new_stage()
    add_dome(stage)
    white = add_material(stage, "White", diffuseColor=(1.0, 1.0, 1.0))
    if shape == "smooth polygons":
        bind(UsdGeom.Sphere.Define(stage, "/World/Ball"), white)
    else:
        cage = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
        faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
        scheme = "none" if shape == "facets" else "catmullClark"
        add_mesh(stage, "/World/Cube", cage, faces, white, scheme)
    add_camera(stage, (0.6, 0.9, 4), (0, 0, 0), 0.5)
    image = render(stage, 48, 48, method=method, samples=3, occlusion_samples=4, dome_light_visible=True)
    np.testing.assert_allclose(image["composite"], 1.0, atol=2e-6)
    assert (image["normal"] != 0).any(axis=-1).mean() > 0.15


@pytest.mark.parametrize("method", METHODS)
def test_glass_and_mirror_in_a_white_dome_neither_gain_nor_lose(method: str) -> None:
    stage = new_stage()
    add_dome(stage)
    glass = UsdGeom.Sphere.Define(stage, "/World/Glass")
    bind(glass, add_material(stage, "Glass", opacity=0.0, ior=1.5, roughness=0.0))
    mirror = UsdGeom.Sphere.Define(stage, "/World/Mirror")
    bind(mirror, add_material(stage, "Mirror", diffuseColor=(1.0, 1.0, 1.0), metallic=1.0, roughness=0.0))
    UsdGeom.Xformable(mirror).AddTranslateOp().Set((2.5, 0, 0))
    coated = UsdGeom.Sphere.Define(stage, "/World/Coated")
    bind(
        coated,
        add_material(stage, "Coated", diffuseColor=(1.0, 1.0, 1.0), ior=1.5, roughness=0.0, clearcoat=1.0),
    )
    UsdGeom.Xformable(coated).AddTranslateOp().Set((-2.5, 0, 0))
    add_camera(stage, (0, 0, 9), (0, 0, 0), 0.55)
    image = render(stage, 60, 60, method=method, samples=8, max_bounces=24, dome_light_visible=True)[
        "composite"
    ]
    # Energy never grows: in the mean over a pixel's samples, whose paths differ by chance.
    assert image.mean() < 1 + 1e-3
    assert image.mean() > 1 - 5e-3
    assert image.max() < 1.5


@pytest.mark.parametrize("method", METHODS)
def test_open_plane_is_not_occluded(method: str) -> None:
    stage = new_stage()
    add_dome(stage)
    add_plane(stage, "/World/Plane", 100, add_material(stage, "Grey", diffuseColor=(0.5, 0.5, 0.5)))
    look_down(stage)
    image = render(stage, 32, 32, method=method, samples=2, occlusion_samples=16)
    np.testing.assert_allclose(image["composite"], 0.5, atol=1e-6)
    np.testing.assert_array_equal(image["alpha"], 1.0)


@pytest.mark.parametrize("method", METHODS)
def test_occlusion_beside_a_wall_matches_its_form_factor(method: str) -> None:
    """A wall of height h at distance d, long enough to be endless: F = (1 - d / sqrt(d² + h²)) / 2."""
    stage = new_stage()
    add_dome(stage)
    white = add_material(stage, "White", diffuseColor=(1.0, 1.0, 1.0))
    black = add_material(stage, "Black", diffuseColor=(0.0, 0.0, 0.0))
    add_plane(stage, "/World/Plane", 100, white)
    h = 1.5
    wall = [(-3, 0, 500), (-3, 0, -500), (-3, h, -500), (-3, h, 500)]
    add_mesh(stage, "/World/Wall", wall, [[0, 1, 2, 3]], black)
    look_down(stage)
    image = render(stage, 40, 40, method=method, samples=4, occlusion_samples=256)["composite"][..., 1]
    x, _ = plane_points(40, 4.0, 0.5)
    d = x + 3
    expected = 1 - 0.5 * (1 - d / np.hypot(d, h))
    error = image.mean(axis=0) - expected.mean(axis=0)
    assert np.abs(error).max() < 0.006, save_evidence("wall", image=image, expected=expected)


def lambert_irradiance(corners: np.ndarray, x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Irradiance at (x, 0, z), normal +y, under a polygon of radiance 1 (Lambert 1760)."""
    p = np.stack([x, np.zeros_like(x), z], axis=-1)
    rays = corners[:, None, None, :] - p
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    total = np.zeros_like(x)
    for a, b in zip(rays, np.roll(rays, -1, axis=0), strict=True):
        angle = np.arccos(np.clip((a * b).sum(-1), -1, 1))
        axis = np.cross(a, b)
        total += angle * axis[..., 1] / np.linalg.norm(axis, axis=-1)
    return np.abs(total) / 2


@pytest.mark.parametrize("method", METHODS)
def test_irradiance_under_a_rect_light_matches_lamberts_formula(method: str) -> None:
    stage = new_stage()
    add_plane(stage, "/World/Plane", 100, add_material(stage, "White", diffuseColor=(1.0, 1.0, 1.0)))
    light = UsdLux.RectLight.Define(stage, "/World/Light")
    light.CreateWidthAttr(2.0)
    light.CreateHeightAttr(1.0)
    light.CreateIntensityAttr(5.0)
    light.AddTranslateOp().Set((0.5, 1.5, 0.25))
    light.AddRotateXOp().Set(-90)
    look_down(stage)
    image = render(stage, 40, 40, method=method, samples=4, light_samples=64)["composite"][..., 1]
    x, z = plane_points(40, 4.0, 0.5)
    corners = np.array([(-0.5, 1.5, -0.25), (1.5, 1.5, -0.25), (1.5, 1.5, 0.75), (-0.5, 1.5, 0.75)])
    expected = 5.0 * lambert_irradiance(corners, x, z) / np.pi
    evidence = f"{method}: {save_evidence('lambert', image=image, expected=expected)}"
    assert abs(image.mean() / expected.mean() - 1) < 3e-3, evidence
    assert np.sqrt(np.mean((image / expected - 1) ** 2)) < 0.03, evidence


def test_glass_slab_shifts_the_background_by_snells_amount() -> None:
    """A slab of thickness t tilted by a shifts a ray by t · sin(a - b) / cos(b), sin b = sin a / ior."""
    stage = new_stage()
    black = add_material(stage, "Black", diffuseColor=(0.0, 0.0, 0.0))
    glow = add_material(stage, "Glow", diffuseColor=(0.0, 0.0, 0.0), emissiveColor=(1.0, 1.0, 1.0))
    add_mesh(
        stage,
        "/World/Left",
        [(-50, -50, -5), (0, -50, -5), (0, 50, -5), (-50, 50, -5)],
        [[0, 1, 2, 3]],
        black,
    )
    add_mesh(
        stage, "/World/Right", [(0, -50, -5), (50, -50, -5), (50, 50, -5), (0, 50, -5)], [[0, 1, 2, 3]], glow
    )
    add_dome(stage, 1e-6)
    slab = UsdGeom.Cube.Define(stage, "/World/Slab")
    slab.CreateSizeAttr(1.0)
    tilt, thickness, ior = 40.0, 1.2, 1.5
    slab.AddRotateYOp().Set(tilt)
    slab.AddScaleOp().Set((60, 60, thickness))
    bind(slab, add_material(stage, "Glass", opacity=0.0, ior=ior, roughness=0.0))
    # Far away and narrow, so that all rays are nearly parallel.
    half = 0.002
    add_camera(stage, (0, 0, 1000), (0, 0, 0), half)
    size = 64
    image = render(stage, size, size, method="reuse", samples=6, max_bounces=2)["layers"]["refraction"][
        ..., 1
    ]
    a = np.radians(tilt)
    b = np.arcsin(np.sin(a) / ior)
    shift = thickness * np.sin(a - b) / np.cos(b)
    row = image.mean(axis=0)
    lit = row > row.max() / 2
    edge_pixels = np.argmax(lit) + 0.5 - (row[np.argmax(lit)] / row.max() - 0.5)
    edge_x = (edge_pixels / size * 2 - 1) * half * 1005
    # Seen along -z through a slab turned about +y, the edge moves by the shift, to one side.
    assert abs(abs(edge_x) - shift) < 2 * half * 1005 * 1.5 / size, (edge_x, shift)
    # Two interfaces at this tilt: the bright side transmits (1 - F)² and no more than 1.
    cos_a, cos_b = np.cos(a), np.cos(b)
    fresnel = 0.5 * (
        ((cos_a - ior * cos_b) / (cos_a + ior * cos_b)) ** 2
        + ((ior * cos_a - cos_b) / (ior * cos_a + cos_b)) ** 2
    )
    assert abs(row.max() - (1 - fresnel) ** 2) < 0.03
    assert row.min() < 0.01


@pytest.mark.parametrize("roughness", [0.0, 0.2, 0.5, 1.0])
@pytest.mark.parametrize("metallic", [0.0, 1.0])
def test_energy_never_grows_in_a_furnace(roughness: float, metallic: float) -> None:
    stage = new_stage()
    add_dome(stage)
    look = add_material(
        stage, "Look", diffuseColor=(1.0, 1.0, 1.0), metallic=metallic, roughness=roughness, ior=1.5
    )
    bind(UsdGeom.Sphere.Define(stage, "/World/Ball"), look)
    add_camera(stage, (0, 0, 4), (0, 0, 0), 0.3)
    image = render(stage, 32, 32, samples=6, dome_light_visible=True)["composite"]
    assert image.mean() < 1.004
    assert image.mean() > 0.5
