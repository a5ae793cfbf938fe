"""Scenes that are small, large, far away, thin or degenerate. Reuse, tracing and dicing must hold."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, UsdGeom, UsdLux
from rendering import (
    CUBE,
    CUBE_FACES,
    add_camera,
    add_dome,
    add_material,
    add_mesh,
    add_plane,
    new_stage,
    render,
    total,
)

SETTINGS = {"samples": 3, "occlusion_samples": 8, "light_samples": 4}


def scene(scale: float = 1.0, offset: tuple[float, float, float] = (0, 0, 0)):
    """A rounded cube on a plane under a dome and a rectangle, all of it scaled, then moved."""
    stage = new_stage()
    world = UsdGeom.Xform.Get(stage, "/World")
    world.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*offset))
    world.AddScaleOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(scale))
    add_dome(stage, 0.5)
    grey = add_material(stage, "Grey", diffuseColor=(0.5, 0.5, 0.5))
    red = add_material(stage, "Red", diffuseColor=(0.8, 0.2, 0.1), ior=1.5, roughness=0.0)
    add_plane(stage, "/World/Plane", 20, grey)
    cube = add_mesh(stage, "/World/Cube", CUBE, CUBE_FACES, red, "catmullClark")
    UsdGeom.Xformable(cube).AddTranslateOp().Set((0, 0.5, 0))
    light = UsdLux.RectLight.Define(stage, "/World/Light")
    light.CreateIntensityAttr(8)
    light.AddTranslateOp().Set((1, 3, 1))
    light.AddRotateXOp().Set(-90)
    add_camera(stage, (1.5, 2, 3), (0, 0.4, 0), 0.4)
    return stage


@pytest.fixture(scope="module")
def plain() -> np.ndarray:
    return render(scene(), 48, 48, **SETTINGS)["composite"]


@pytest.mark.parametrize("scale", [1e-5, 1e-3, 1e3, 1e6])
def test_scale_does_not_matter(plain: np.ndarray, scale: float) -> None:
    result = render(scene(scale), 48, 48, **SETTINGS)
    assert result["statistics"]["non_finite_samples"] == 0
    difference = np.abs(result["composite"] - plain).mean()
    assert difference < 0.004 * plain.mean()


# What depends on footprints, distances or extents must not depend on the unit of length.
CONTROLS = [
    {"footprint_reuse": "metric"},
    {"footprint_reuse": "octaves"},
    {"max_reuse_distance": 1.0},
    {"world_space_parameters": True},
    {"search": "cells"},
    {"search": "groups"},
    {"method": "decoupled"},
    {"method": "vertex"},
]


@pytest.mark.parametrize("control", CONTROLS, ids=str)
def test_scale_does_not_matter_to_controls(control: dict) -> None:
    unit = render(scene(), 48, 48, **SETTINGS, **control)
    for scale in (1e-5, 1e6):
        result = render(scene(scale), 48, 48, **SETTINGS, **control)
        assert result["statistics"]["non_finite_samples"] == 0
        assert np.abs(result["composite"] - unit["composite"]).mean() < 0.004 * unit["composite"].mean()
        shades = total(result, "shading_evaluations"), total(unit, "shading_evaluations")
        assert abs(shades[0] / shades[1] - 1) < 0.01


@pytest.mark.parametrize("offset", [(1e4, 0, 0), (-3e5, 2e5, 1e5), (1e7, 1e7, -1e7)])
def test_distance_from_the_origin_does_not_matter(
    plain: np.ndarray, offset: tuple[float, float, float]
) -> None:
    result = render(scene(1.0, offset), 48, 48, **SETTINGS)
    difference = np.abs(result["composite"] - plain).mean()
    assert difference < 0.004 * plain.mean()


def test_mirrored_instance_is_the_mirror_image() -> None:
    images = []
    for sign in (1, -1):
        stage = scene()
        cube = UsdGeom.Xformable(stage.GetPrimAtPath("/World/Cube"))
        cube.AddRotateYOp().Set(30.0 * sign)
        cube.AddScaleOp().Set((sign, 1, 1))
        cube.AddTranslateOp(opSuffix="side").Set((0.4, 0, 0))
        UsdLux.RectLight.Get(stage, "/World/Light").GetPrim().SetActive(False)
        stage.RemovePrim("/World/Camera")
        add_camera(stage, (0, 2, 3), (0, 0.4, 0), 0.4)
        images.append(render(stage, 48, 48, **{**SETTINGS, "occlusion_samples": 32})["composite"])
    # Random numbers differ, so compare means over 4 × 4 pixels.
    blocks = [image.reshape(12, 4, 12, 4, 3).mean(axis=(1, 3)) for image in (images[0], images[1][:, ::-1])]
    assert np.abs(blocks[0] - blocks[1]).max() < 0.06 * blocks[0].max()
    assert np.abs(blocks[0] - blocks[1]).mean() < 0.006 * blocks[0].mean()


def test_zero_area_and_needle_faces_do_no_harm() -> None:
    stage = scene()
    points = [
        (0, 0.2, 0),
        (0, 0.2, 0),
        (0, 0.2, 0),
        (0, 0.2, 0),
        (1, 0.2, 1),
        (1, 0.2 + 1e-7, 1),
        (3, 0.2, 3),
    ]
    add_mesh(stage, "/World/Bad", points, [[0, 1, 2], [0, 1, 4, 3], [0, 4, 5], [4, 5, 6], [0, 4, 6]])
    add_mesh(stage, "/World/BadCage", points, [[0, 1, 4, 3], [4, 5, 6]], scheme="catmullClark")
    result = render(stage, 32, 32, **SETTINGS)
    assert np.isfinite(result["composite"]).all()
    assert result["statistics"]["non_finite_samples"] == 0


def test_primitives_far_below_a_pixel_fall_back_to_one_shade_per_pixel_and_primitive() -> None:
    """§2.3: samples that find no neighbour are shaded once per (primitive, pixel)."""
    stage = new_stage()
    add_dome(stage)
    n = 150
    x, z = np.meshgrid(np.linspace(-2, 2, n + 1), np.linspace(-2, 2, n + 1))
    points = np.stack([x, 0 * x, z], axis=-1).reshape(-1, 3)
    faces = [
        [i * (n + 1) + j, (i + 1) * (n + 1) + j, (i + 1) * (n + 1) + j + 1, i * (n + 1) + j + 1]
        for i in range(n)
        for j in range(n)
    ]
    add_mesh(stage, "/World/Dust", points, faces, add_material(stage, "White", diffuseColor=(1.0, 1.0, 1.0)))
    add_camera(stage, (0, 4, 0), (0, 0, 0), 0.45, up=(0, 0, -1))
    result = render(stage, 32, 32, samples=8, shading_rate=0.5, occlusion_samples=4)
    np.testing.assert_allclose(result["composite"], 1.0, atol=1e-6)
    layer = result["statistics"]["layers"]["direct"]
    assert layer["failed_samples"] > 0.9 * 32 * 32 * 64
    # Every pixel sees about 4.2 × 4.2 faces and parts of one more in each direction.
    assert layer["reshading_evaluations"] < 32 * 32 * 5.5**2
    assert layer["reshading_evaluations"] > 32 * 32 * 4.0**2


def test_plane_to_the_horizon() -> None:
    stage = new_stage()
    add_dome(stage)
    add_plane(stage, "/World/Plane", 1e7, add_material(stage, "White", diffuseColor=(1.0, 1.0, 1.0)))
    add_camera(stage, (0, 1, 0), (0, 0.9, -1), 0.5)
    result = render(stage, 48, 48, **SETTINGS, dome_light_visible=True)
    np.testing.assert_allclose(result["composite"], 1.0, atol=1e-5)


def test_coincident_planes_do_not_leave_holes() -> None:
    stage = new_stage()
    add_dome(stage)
    white = add_material(stage, "White", diffuseColor=(1.0, 1.0, 1.0))
    add_plane(stage, "/World/A", 10, white)
    add_plane(stage, "/World/B", 10, white)
    add_camera(stage, (0, 4, 1), (0, 0, 0), 0.3)
    result = render(stage, 32, 32, **SETTINGS)
    # Which of the two is hit is arbitrary; either is white under an open sky.
    np.testing.assert_allclose(result["composite"], 1.0, atol=1e-5)


def test_long_thin_plank_reuses_along_its_length_without_failing() -> None:
    stage = new_stage()
    add_dome(stage)
    points = [(-50, 0, 0.01), (50, 0, 0.01), (50, 0, -0.01), (-50, 0, -0.01)]
    white = add_material(stage, "White", diffuseColor=(1.0, 1.0, 1.0))
    add_mesh(stage, "/World/Plank", points, [[0, 1, 2, 3]], white)
    add_camera(stage, (0, 2, 2), (0, 0, 0), 0.5)
    result = render(stage, 48, 48, **SETTINGS)
    lit = result["alpha"] > 0
    assert lit.any()
    np.testing.assert_allclose(result["composite"][lit][:, 0], result["alpha"][lit], atol=1e-5)
