"""Materials whose pixels are known: networks, presence, glass, displacement, normal maps, GLSL."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade
from rendering import (
    add_camera,
    add_dome,
    add_image,
    add_material,
    add_mesh,
    add_texcoords,
    bind,
    connect,
    new_stage,
    render,
    surface,
    write_exr,
)

METHODS = ["reuse", "reference"]


def wall(
    stage: Usd.Stage,
    path: str,
    material: UsdShade.Material | None,
    z: float = 0.0,
    half: float = 1.0,
    scheme: str = "none",
) -> UsdGeom.Mesh:
    """A square that faces +z, with st from (0, 0) to (1, 1)."""
    points = [(-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z)]
    mesh = add_mesh(stage, path, points, [[0, 1, 2, 3]], material, scheme)
    add_texcoords(mesh, [(0, 0), (1, 0), (1, 1), (0, 1)])
    return mesh


def facing_stage() -> Usd.Stage:
    """A camera on +z that sees the square [-1, 1]² in the plane z = 0."""
    stage = new_stage()
    add_camera(stage, (0, 0, 4), (0, 0, 0), 0.25)
    return stage


# --- Energy ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("roughness", [0.0, 0.2, 0.5, 1.0])
@pytest.mark.parametrize(
    "inputs",
    [
        {"metallic": 1.0, "ior": 1.5},
        {"metallic": 0.0, "ior": 1.5},
        {"metallic": 0.0, "ior": 1.5, "clearcoat": 1.0, "clearcoatRoughness": 0.3},
        {"metallic": 0.5, "ior": 2.5, "clearcoat": 0.5},
        {"metallic": 0.0, "ior": 1.5, "opacity": 0.0},
        {"useSpecularWorkflow": 1, "specularColor": (1.0, 1.0, 1.0)},
    ],
    ids=["metal", "plastic", "coated", "mixed", "glass", "specular"],
)
def test_a_white_furnace_loses_nothing(inputs: dict[str, Any], roughness: float) -> None:
    """A white ball in a white sky: 1, whatever its looks."""
    stage = new_stage()
    add_dome(stage)
    look = add_material(stage, "White", diffuseColor=(1.0, 1.0, 1.0), roughness=roughness, **inputs)
    bind(UsdGeom.Sphere.Define(stage, "/World/Ball"), look)
    add_camera(stage, (0, 0, 4), (0, 0, 0), 0.2)
    settings = {"samples": 8, "occlusion_samples": 64, "light_samples": 64, "max_bounces": 64}
    settings["roughness_limit"] = 1.0 if "opacity" in inputs else 0.3  # inside of glass there are no lights
    image = render(stage, 16, 16, dome_light_visible=True, **settings)["composite"]
    noise = 0.02 if "opacity" in inputs and roughness > 0 else 0.001
    assert 0.98 - noise <= image.mean() <= 1.002 + noise, image.mean()


# --- Presence, cut-outs and glass -------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_presence_is_coverage(method: str) -> None:
    """Sheets of presence one half: 1 - 0.5ⁿ of alpha, and the light of what is there."""
    stage = facing_stage()
    look = add_material(stage, "Half", emissiveColor=(1.0, 1.0, 1.0), diffuseColor=(0.0,) * 3, opacity=0.5)
    surface(look).CreateInput("opacityMode", Sdf.ValueTypeNames.Token).Set("presence")
    for i in range(3):
        wall(stage, f"/World/Sheet{i}", look, z=-0.1 * i, half=2.0)
        image = render(stage, 8, 8, method=method, samples=16, camera_light=False)
        np.testing.assert_allclose(image["alpha"].mean(), 1 - 0.5 ** (i + 1), atol=0.01)
        np.testing.assert_allclose(image["composite"].mean(), 1 - 0.5 ** (i + 1), atol=0.01)


@pytest.mark.parametrize("method", METHODS)
def test_cut_out_by_texture(tmp_path: Path, method: str) -> None:
    """The right half is opaque; what lies behind the left half shows at its own depth."""
    pixels = np.zeros((16, 16, 3), np.float32)
    pixels[:, 8:] = 1.0
    stage = facing_stage()
    leaf = add_material(stage, "Leaf", emissiveColor=(1.0, 0.0, 0.0), opacityThreshold=0.5)
    image = add_image(leaf, "Mask", write_exr(tmp_path / "mask.exr", pixels))
    connect(leaf, "opacity", image, "r", Sdf.ValueTypeNames.Float)
    wall(stage, "/World/Leaf", leaf)
    wall(stage, "/World/Back", add_material(stage, "Blue", emissiveColor=(0.0, 0.0, 1.0)), z=-2, half=3)
    result = render(stage, 16, 16, method=method, samples=3, camera_light=False)
    composite, depth = result["composite"], result["depth"]
    np.testing.assert_allclose(composite[:, :6], np.broadcast_to([0, 0, 1], (16, 6, 3)), atol=1e-3)
    np.testing.assert_allclose(composite[:, 10:], np.broadcast_to([1, 0, 0], (16, 6, 3)), atol=1e-3)
    np.testing.assert_allclose(depth[:, :6], 6, rtol=1e-4)
    np.testing.assert_allclose(depth[:, 10:], 4, rtol=1e-4)
    assert (result["alpha"] == 1).all()


def test_thin_glass_does_not_bend_and_solid_glass_does() -> None:
    """An edge behind glass under 45 degrees: a sheet leaves it in its place, a slab shifts it."""
    places = {}
    for kind in ("none", "sheet", "slab"):
        stage = new_stage()
        black = add_material(stage, "Dark", diffuseColor=(0.0, 0.0, 0.0))
        light = add_material(stage, "Light", emissiveColor=(1.0, 1.0, 1.0), diffuseColor=(0.0,) * 3)
        add_mesh(
            stage, "/World/L", [(-9, -9, -3), (0, -9, -3), (0, 9, -3), (-9, 9, -3)], [[0, 1, 2, 3]], black
        )
        add_mesh(stage, "/World/R", [(0, -9, -3), (9, -9, -3), (9, 9, -3), (0, 9, -3)], [[0, 1, 2, 3]], light)
        glass = add_material(
            stage, "Glass", diffuseColor=(1.0, 1.0, 1.0), opacity=0.0, ior=1.5, roughness=0.0
        )
        if kind == "sheet":
            add_mesh(
                stage,
                "/World/Pane",
                [(-4, -4, 4), (4, -4, -4), (4, 4, -4), (-4, 4, 4)],
                [[0, 1, 2, 3]],
                glass,
            )
        elif kind == "slab":
            slab = UsdGeom.Cube.Define(stage, "/World/Slab")
            slab.AddRotateYOp().Set(45.0)
            slab.AddScaleOp().Set((4, 4, 0.5))
            bind(slab, glass)
        add_camera(stage, (0, 0, 20), (0, 0, 0), 0.06)
        settings = {"samples": 8, "camera_light": False, "filter": "box", "filter_radius_pixels": 0.5}
        image = render(stage, 64, 4, max_bounces=8, **settings)["composite"][..., 0].mean(axis=0)
        # Where the bright side begins: what is dark of the whole, each side by its own brightness.
        bright = np.median(image[-8:])
        places[kind] = float((image / bright).clip(0, 1).sum())
    assert abs(places["sheet"] - places["none"]) < 0.3
    # Snell: a plate of thickness 1 at 45 degrees shifts by sin 45 (1 - cos 45 / sqrt(n² - sin² 45)).
    shift = np.sin(np.pi / 4) * (1 - np.cos(np.pi / 4) / np.sqrt(1.5**2 - 0.5))
    pixels_per_unit = 64 / (2 * 0.06 * 20)
    assert abs(abs(places["slab"] - places["none"]) - shift * pixels_per_unit) < 1.5


# --- Patterns ---------------------------------------------------------------------------------------


def test_udim_tiles(tmp_path: Path) -> None:
    for tile, color in ((1001, (1, 0, 0)), (1002, (0, 1, 0)), (1011, (0, 0, 1))):
        write_exr(tmp_path / f"tile.{tile}.exr", np.broadcast_to(np.float32(color), (4, 4, 3)))
    stage = facing_stage()
    look = add_material(stage, "Tiles", diffuseColor=(0.0,) * 3)
    image = add_image(look, "Image", str(tmp_path / "tile.<UDIM>.exr"), fallback=(0.25, 0.25, 0.25, 1))
    connect(look, "emissiveColor", image, "rgb", Sdf.ValueTypeNames.Color3f)
    mesh = wall(stage, "/World/Wall", look)
    UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").Set([Gf.Vec2f(*p) for p in ((0, 0), (2, 0), (2, 2), (0, 2))])
    picture = render(stage, 16, 16, samples=2, camera_light=False)["composite"]
    quarters = [picture[10:14, 2:6], picture[10:14, 10:14], picture[2:6, 2:6], picture[2:6, 10:14]]
    expected = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.25, 0.25, 0.25)]
    for quarter, color in zip(quarters, expected, strict=True):
        np.testing.assert_allclose(quarter.mean(axis=(0, 1)), color, atol=2e-3)


def test_two_sets_of_texture_coordinates_and_a_primvar(tmp_path: Path) -> None:
    """Emission by one set, opacity by another, and a factor from a primvar."""
    ramp = np.zeros((1, 256, 3), np.float32)
    ramp[0, :, 0] = (np.arange(256) + 0.5) / 256
    file = write_exr(tmp_path / "ramp.exr", ramp)
    stage = facing_stage()
    look = add_material(stage, "Two", diffuseColor=(0.0,) * 3)
    emission = add_image(look, "Emission", file, "st")
    connect(look, "emissiveColor", emission, "rgb", Sdf.ValueTypeNames.Color3f)
    rough = add_image(look, "Roughness", file, "other")
    connect(look, "roughness", rough, "r", Sdf.ValueTypeNames.Float)
    mesh = wall(stage, "/World/Wall", look)
    add_texcoords(mesh, [(0, 0), (0, 1), (1, 1), (1, 0)], "other")
    image = render(stage, 16, 16, samples=2, camera_light=False)["composite"][..., 0].mean(axis=0)
    np.testing.assert_allclose(image[1:-1], ((np.arange(16) + 0.5) / 16)[1:-1], atol=0.01)


def test_color_from_a_primvar_reader() -> None:
    stage = facing_stage()
    look = add_material(stage, "Reader", diffuseColor=(0.0,) * 3)
    reader = UsdShade.Shader.Define(stage, look.GetPath().AppendChild("Reader"))
    reader.CreateIdAttr("UsdPrimvarReader_float3")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("tint")
    connect(look, "emissiveColor", reader, "result", Sdf.ValueTypeNames.Float3)
    mesh = wall(stage, "/World/Wall", look)
    tint = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "tint", Sdf.ValueTypeNames.Float3Array, UsdGeom.Tokens.vertex
    )
    tint.Set([Gf.Vec3f(0, 0, 0.5), Gf.Vec3f(1, 0, 0.5), Gf.Vec3f(1, 1, 0.5), Gf.Vec3f(0, 1, 0.5)])
    image = render(stage, 16, 16, samples=2, camera_light=False)["composite"]
    ramp = (np.arange(16) + 0.5) / 16
    np.testing.assert_allclose(image[1:-1, 1:-1, 0].mean(axis=0), ramp[1:-1], atol=0.01)
    np.testing.assert_allclose(image[1:-1, 1:-1, 1].mean(axis=1), ramp[::-1][1:-1], atol=0.01)
    np.testing.assert_allclose(image[..., 2][1:-1, 1:-1], 0.5, atol=0.01)


@pytest.mark.parametrize("method", METHODS)
def test_normal_map_turns_the_surface(tmp_path: Path, method: str) -> None:
    """A map that leans by 40 degrees towards +s, under a light along the view, and one from +x."""
    lean = np.radians(40)
    normal = np.array([np.sin(lean), 0, np.cos(lean)])
    file = write_exr(tmp_path / "normal.exr", np.broadcast_to((normal + 1) / 2, (4, 4, 3)))
    stage = facing_stage()
    look = add_material(stage, "Bumpy", diffuseColor=(0.5, 0.5, 0.5))
    image = add_image(look, "Normal", file, scale=(2, 2, 2, 1), bias=(-1, -1, -1, 0))
    connect(look, "normal", image, "rgb", Sdf.ValueTypeNames.Normal3f)
    wall(stage, "/World/Wall", look)
    light = UsdLux.DistantLight.Define(stage, "/World/Light")
    light.CreateAngleAttr(0.0)
    light.CreateIntensityAttr(1.0)
    turn = light.AddRotateYOp()
    for degrees, cosine in ((0, np.cos(lean)), (60, np.cos(lean - np.radians(60)))):
        turn.Set(float(degrees))
        picture = render(stage, 8, 8, method=method, samples=2, light_samples=1, camera_light=False)
        np.testing.assert_allclose(picture["composite"][2:6, 2:6], 0.5 / np.pi * cosine, rtol=0.01)


def glsl(material: UsdShade.Material, code: str, terminal: str = "surface") -> UsdShade.Shader:
    stage = material.GetPrim().GetStage()
    shader = UsdShade.Shader.Define(stage, material.GetPath().AppendChild(f"Own{terminal}"))
    shader.GetPrim().CreateAttribute("info:implementationSource", Sdf.ValueTypeNames.Token).Set("sourceCode")
    shader.GetPrim().CreateAttribute("info:glsl:sourceCode", Sdf.ValueTypeNames.String).Set(code)
    output = shader.CreateOutput(terminal, Sdf.ValueTypeNames.Token)
    if terminal == "surface":
        material.CreateSurfaceOutput().ConnectToSource(output)
    else:
        material.CreateDisplacementOutput().ConnectToSource(output)
    return shader


def test_displacement_moves_the_surface(tmp_path: Path) -> None:
    """A wall pushed towards the camera by a constant, and by a texture on one half."""
    stage = facing_stage()
    look = add_material(stage, "Pushed", emissiveColor=(1.0, 1.0, 1.0), displacement=0.5)
    material = look
    material.CreateDisplacementOutput().ConnectToSource(
        surface(look).CreateOutput("displacement", Sdf.ValueTypeNames.Token)
    )
    wall(stage, "/World/Wall", look, half=1.5)
    depth = render(stage, 8, 8, samples=2)["depth"]
    np.testing.assert_allclose(depth, 3.5, rtol=1e-4)

    pixels = np.zeros((64, 64, 3), np.float32)
    pixels[:, 32:] = 1.0
    stage = facing_stage()
    look = add_material(stage, "Stepped", emissiveColor=(1.0, 1.0, 1.0))
    image = add_image(look, "Height", write_exr(tmp_path / "height.exr", pixels), scale=(0.75, 1, 1, 1))
    connect(look, "displacement", image, "r", Sdf.ValueTypeNames.Float)
    look.CreateDisplacementOutput().ConnectToSource(
        surface(look).CreateOutput("displacement", Sdf.ValueTypeNames.Token)
    )
    wall(stage, "/World/Wall", look, half=1.5)
    depth = render(stage, 16, 16, samples=2)["depth"]
    np.testing.assert_allclose(depth[:, 1:5], 4, rtol=1e-3)
    np.testing.assert_allclose(depth[:, 11:15], 3.25, rtol=1e-3)


def test_a_displaced_ball_has_no_cracks() -> None:
    """Radius + displacement, in front of a bright wall: no spark of it may be seen through the ball."""
    stage = facing_stage()
    look = add_material(stage, "Ball", diffuseColor=(0.0, 0.0, 0.0), displacement=0.2)
    look.CreateDisplacementOutput().ConnectToSource(
        surface(look).CreateOutput("displacement", Sdf.ValueTypeNames.Token)
    )
    cube = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    add_mesh(stage, "/World/Ball", cube, faces, look, "catmullClark")
    wall(stage, "/World/Sky", add_material(stage, "Sky", emissiveColor=(1e6,) * 3), z=-3, half=9)
    image = render(stage, 48, 48, samples=6, camera_light=False, filter="box", filter_radius_pixels=0.5)
    assert (image["composite"][18:30, 18:30] == 0).all()


def test_own_glsl_surface_with_parameters_and_textures(tmp_path: Path) -> None:
    """The contract of docs/glsl.md, from a string: a parameter, a connected texture, texture coordinates."""
    ramp = np.zeros((1, 256, 3), np.float32)
    ramp[0, :, 0] = (np.arange(256) + 0.5) / 256
    stage = facing_stage()
    look = UsdShade.Material.Define(stage, "/World/Looks/Own")
    code = """
void surface(in SurfacePoint point, inout Surface surface) {
  surface.diffuseColor = vec3(0.0);
  surface.emissiveColor = tint * image.r + vec3(0.0, 0.0, point.uv.y);
  surface.ior = 1.0;
}
"""
    shader = glsl(look, code)
    shader.CreateInput("tint", Sdf.ValueTypeNames.Color3f).Set((1.0, 0.5, 0.0))
    image = add_image(look, "Image", write_exr(tmp_path / "ramp.exr", ramp))
    shader.CreateInput("image", Sdf.ValueTypeNames.Float3).ConnectToSource(
        image.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    )
    wall(stage, "/World/Wall", look)
    picture = render(stage, 16, 16, samples=2, camera_light=False)["composite"][1:-1, 1:-1]
    x = ((np.arange(16) + 0.5) / 16)[1:-1]
    np.testing.assert_allclose(picture[..., 0].mean(axis=0), x, atol=0.01)
    np.testing.assert_allclose(picture[..., 1].mean(axis=0), x / 2, atol=0.01)
    np.testing.assert_allclose(picture[..., 2].mean(axis=1), x[::-1], atol=0.01)


@pytest.mark.parametrize("eye", [0.0, 0.5])
def test_position_in_glsl_is_that_of_the_world(eye: float) -> None:
    """Wherever the camera stands: the wall glows where x is above 0."""
    stage = new_stage()
    add_camera(stage, (eye, 0, 4), (eye, 0, 0), 0.25)
    look = UsdShade.Material.Define(stage, "/World/Looks/Own")
    code = """
void surface(in SurfacePoint point, inout Surface surface) {
  surface.diffuseColor = vec3(0.0);
  surface.emissiveColor = vec3(step(0.0, point.position.x));
  surface.ior = 1.0;
}
"""
    glsl(look, code)
    wall(stage, "/World/Wall", look, half=2.0)
    settings = {"filter": "box", "filter_radius_pixels": 0.5, "camera_light": False}
    picture = render(stage, 16, 4, samples=2, shading_rate=16.0, **settings)["composite"][..., 0].mean(axis=0)
    edge = 8 - round(8 * eye)
    assert (picture[: edge - 1] == 0).all() and (picture[edge + 1 :] == 1).all()


def test_materials_that_vary_do_not_change_their_neighbours(tmp_path: Path) -> None:
    """The left wall is constant, the right one textured: the left one's pixels stay what they are alone."""
    pictures = []
    for textured in (False, True):
        stage = facing_stage()
        left = add_material(stage, "Left", diffuseColor=(0.4, 0.3, 0.2), roughness=0.4, ior=1.5)
        add_mesh(
            stage, "/World/Left", [(-1, -1, 0), (-0.2, -1, 0), (-0.2, 1, 0), (-1, 1, 0)], [[0, 1, 2, 3]], left
        )
        if textured:
            right = add_material(stage, "Right")
            image = add_image(
                right, "Image", write_exr(tmp_path / "a.exr", np.random.default_rng(1).random((8, 8, 3)))
            )
            connect(right, "diffuseColor", image, "rgb", Sdf.ValueTypeNames.Color3f)
            mesh = add_mesh(
                stage,
                "/World/Right",
                [(0.2, -1, 0), (1, -1, 0), (1, 1, 0), (0.2, 1, 0)],
                [[0, 1, 2, 3]],
                right,
            )
            add_texcoords(mesh, [(0, 0), (1, 0), (1, 1), (0, 1)])
        add_dome(stage)
        pictures.append(render(stage, 32, 32, samples=2, occlusion_samples=8)["composite"][:, :12])
    np.testing.assert_array_equal(pictures[0], pictures[1])
