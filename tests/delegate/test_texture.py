"""Textures: nodes, files, colour spaces, coordinates, and files that cannot be read."""

import math
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from encore.adapters.texture import read_pixels
from encore.errors import StageError
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, UsdUtils
from stages import (
    add_material,
    add_square,
    bind,
    connect_texture,
    instances,
    kinds,
    materials,
    square_with,
    surface,
    translate,
    write_image,
)


def srgb_to_linear(encoded: float) -> float:
    """IEC 61966-2-1."""
    return encoded / 12.92 if encoded <= 0.04045 else ((encoded + 0.055) / 1.055) ** 2.4


def test_texture_node(stage: Usd.Stage, tmp_path: Path) -> None:
    material = square_with(stage)
    texture = connect_texture(stage, surface(material), write_image(tmp_path / "a.png"), "map1")
    texture.CreateInput("wrapS", Sdf.ValueTypeNames.Token).Set("mirror")
    texture.CreateInput("wrapT", Sdf.ValueTypeNames.Token).Set("clamp")
    texture.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set((1, 2, 3, 4))
    texture.CreateInput("bias", Sdf.ValueTypeNames.Float4).Set((0.1, 0.2, 0.3, 0.4))
    texture.CreateInput("fallback", Sdf.ValueTypeNames.Float4).Set((0.5, 0.5, 0.5, 1))
    found = materials(translate(stage))["/World/Material"]
    assert found["inputs"]["diffuse_color"]["node"] == 0
    assert found["inputs"]["diffuse_color"]["channel"] == 0
    (node,) = found["nodes"]
    assert node["kind"] == "texture" and node["texture"] == 0 and node["texcoord"] == "map1"
    assert (node["wrap_s"], node["wrap_t"]) == ("mirror", "clamp")
    assert node["scale"] == [1, 2, 3, 4]
    assert node["bias"] == pytest.approx([0.1, 0.2, 0.3, 0.4])
    assert node["fallback"] == [0.5, 0.5, 0.5, 1]
    assert node["st_transform"] == [1, 0, 0, 0, 1, 0]


def test_wrap_defaults_to_the_files_metadata_and_then_to_black(stage: Usd.Stage, tmp_path: Path) -> None:
    material = square_with(stage)
    texture = connect_texture(stage, surface(material), write_image(tmp_path / "a.png"))
    (node,) = materials(translate(stage))["/World/Material"]["nodes"]
    assert (node["wrap_s"], node["wrap_t"]) == ("black", "black")
    image = oiio.ImageBuf(oiio.ImageSpec(1, 1, 3, "float"))
    image.specmod().attribute("wrapmodes", "periodic,clamp")
    image.write(str(tmp_path / "b.exr"))
    texture.GetInput("file").Set(Sdf.AssetPath(str(tmp_path / "b.exr")))
    (node,) = materials(translate(stage))["/World/Material"]["nodes"]
    assert (node["wrap_s"], node["wrap_t"]) == ("repeat", "clamp")


def test_pixels_are_linear_and_bottom_up(stage: Usd.Stage, tmp_path: Path) -> None:
    material = square_with(stage)
    pixels = np.array([[[1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0.2, 0.4, 0.6], [0, 0, 0], [1, 1, 1]]])
    connect_texture(stage, surface(material), write_image(tmp_path / "a.png", pixels))
    found = translate(stage).scene.texture(0)["pixels"]
    assert found.shape == (2, 3, 4)
    np.testing.assert_allclose(found[1, :, :3], pixels[0], atol=1e-5)
    expected = [srgb_to_linear(v) for v in (0.2, 0.4, 0.6)]
    np.testing.assert_allclose(found[0, 0], [*expected, 1], atol=1e-5)


def test_white_is_exactly_1(tmp_path: Path) -> None:
    """More would make surfaces reflect more than they get."""
    levels = np.arange(256)[None, :, None] / 255 * np.ones(3)
    found = read_pixels(write_image(tmp_path / "a.png", levels), "auto")[0, :, 0]
    assert found[255] == 1 and found[0] == 0
    np.testing.assert_allclose(found, [srgb_to_linear(v) for v in levels[0, :, 0]], atol=1e-6)
    assert (np.diff(found) > 0).all()


@pytest.mark.parametrize(
    ("extension", "channels", "space", "linear"),
    [
        ("png", 3, "auto", False),
        ("png", 4, "auto", False),
        ("png", 1, "auto", True),
        ("png", 3, "raw", True),
        ("png", 1, "sRGB", False),
        ("exr", 3, "auto", True),
        ("exr", 3, "sRGB", False),
    ],
)
def test_color_spaces(tmp_path: Path, extension: str, channels: int, space: str, linear: bool) -> None:
    """auto: 8-bit images with three channels or more are sRGB, all others raw (UsdPreviewSurface)."""
    path = write_image(tmp_path / f"a.{extension}", np.full((1, 1, channels), 0.4))
    found = read_pixels(path, space)[0, 0]
    expected = 0.4 if linear else srgb_to_linear(0.4)
    np.testing.assert_allclose(found[:3], [expected] * 3, atol=1e-5)
    assert found[3] == pytest.approx(0.4 if channels == 4 else 1.0), "alpha is never encoded"


def test_two_channels_are_grey_and_alpha(tmp_path: Path) -> None:
    path = write_image(tmp_path / "a.png", np.array([[[0.6, 0.2]]]))
    np.testing.assert_allclose(read_pixels(path, "auto")[0, 0], [0.6, 0.6, 0.6, 0.2], atol=1e-6)


def test_alpha_is_not_multiplied_in(tmp_path: Path) -> None:
    path = write_image(tmp_path / "a.png", np.array([[[1.0, 0.6, 0.0, 0.2]]]))
    found = read_pixels(path, "raw")[0, 0]
    np.testing.assert_allclose(found, [1, 0.6, 0, 0.2], atol=1e-6)


def test_textures_are_read_once_per_file_and_space(stage: Usd.Stage, tmp_path: Path) -> None:
    file = write_image(tmp_path / "a.png")
    for i, space in enumerate(("auto", "auto", "raw")):
        material = add_material(stage, f"/World/M{i}")
        texture = connect_texture(stage, surface(material), file)
        texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set(space)
        bind(add_square(stage, f"/World/Mesh{i}"), material)
    assert translate(stage).counts["textures"] == 2


def test_textures_in_a_usdz(tmp_path: Path) -> None:
    write_image(tmp_path / "a.png", np.array([[[0.0, 1.0, 0.0]]]))
    stage = Usd.Stage.CreateNew(str(tmp_path / "scene.usda"))
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    material = square_with(stage)
    connect_texture(stage, surface(material), "./a.png")
    stage.Save()
    package = str(tmp_path / "scene.usdz")
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "scene.usda"), package)
    (tmp_path / "a.png").unlink()
    translation = translate(Usd.Stage.Open(package))
    assert not translation.reports.has_errors
    assert translation.scene.texture(0)["pixels"].tolist() == [[[0, 1, 0, 1]]]


def test_transform_2d(stage: Usd.Stage, tmp_path: Path) -> None:
    """in · scale, then turned anticlockwise, then moved."""
    material = square_with(stage)
    texture = connect_texture(stage, surface(material), write_image(tmp_path / "a.png"))
    reader = UsdShade.Shader(stage.GetPrimAtPath("/World/Material/Surface_diffuseColor_st"))
    node = UsdShade.Shader.Define(stage, "/World/Material/Transform")
    node.CreateIdAttr("UsdTransform2d")
    node.CreateInput("in", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
    node.CreateInput("scale", Sdf.ValueTypeNames.Float2).Set((2, 3))
    node.CreateInput("rotation", Sdf.ValueTypeNames.Float).Set(90.0)
    node.CreateInput("translation", Sdf.ValueTypeNames.Float2).Set((0.5, 0.25))
    node.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    texture.GetInput("st").ConnectToSource(node.ConnectableAPI(), "result")
    (found,) = materials(translate(stage))["/World/Material"]["nodes"]
    rows = np.array(found["st_transform"]).reshape(2, 3)
    # (1, 1) → (2, 3) → (-3, 2) → (-2.5, 2.25)
    np.testing.assert_allclose(rows @ [1, 1, 1], [-2.5, 2.25], atol=1e-6)
    np.testing.assert_allclose(rows @ [1, 0, 1], [0.5, 2.25], atol=1e-6)


def test_varname_through_the_materials_interface(stage: Usd.Stage, tmp_path: Path) -> None:
    material = square_with(stage)
    connect_texture(stage, surface(material), write_image(tmp_path / "a.png"))
    name = material.CreateInput("frame:stPrimvarName", Sdf.ValueTypeNames.Token)
    name.Set("uvmap")
    reader = UsdShade.Shader(stage.GetPrimAtPath("/World/Material/Surface_diffuseColor_st"))
    reader.GetInput("varname").ConnectToSource(name)
    (node,) = materials(translate(stage))["/World/Material"]["nodes"]
    assert node["texcoord"] == "uvmap"


def test_a_texture_without_a_reader_shows_one_point(stage: Usd.Stage, tmp_path: Path) -> None:
    material = square_with(stage)
    texture = connect_texture(stage, surface(material), write_image(tmp_path / "a.png"))
    texture.GetInput("st").ClearSources()
    texture.GetInput("st").Set(Gf.Vec2f(0.25, 0.75))
    translation = translate(stage)
    (node,) = materials(translation)["/World/Material"]["nodes"]
    assert node["texcoord"] == "" and node["st_transform"] == [0, 0, 0.25, 0, 0, 0.75]
    assert not kinds(translation).keys() - {"camera"}
    translation.scene.validate()


def test_emission_textures_share_the_coordinates(stage: Usd.Stage, tmp_path: Path) -> None:
    material = square_with(stage)
    file = write_image(tmp_path / "a.png")
    connect_texture(stage, surface(material), file, "st")
    connect_texture(stage, surface(material), file, "st", "emissiveColor")
    found = materials(translate(stage))["/World/Material"]
    assert [found["inputs"][n]["node"] for n in ("diffuse_color", "emissive_color")] == [0, 1]
    reader = UsdShade.Shader(stage.GetPrimAtPath("/World/Material/Surface_emissiveColor_st"))
    reader.GetInput("varname").Set("other")
    translation = translate(stage)
    assert kinds(translation)["several texcoords"] == 1
    assert materials(translation)["/World/Material"]["inputs"]["emissive_color"]["node"] == -1
    translation.scene.validate()


@pytest.mark.parametrize(
    ("file", "kind", "error"),
    [
        ("nothing.png", "missing texture", True),
        ("broken.png", "unreadable texture", True),
        ("", "no texture file", False),
        ("tiles.<UDIM>.png", "UDIM texture", False),
    ],
)
def test_textures_that_cannot_be_used(
    stage: Usd.Stage, tmp_path: Path, file: str, kind: str, error: bool
) -> None:
    (tmp_path / "broken.png").write_bytes(b"\x89PNG\r\n\x1a\n and no more")
    material = square_with(stage)
    texture = connect_texture(stage, surface(material), str(tmp_path / file) if file else "")
    texture.CreateInput("fallback", Sdf.ValueTypeNames.Float4).Set((0.5, 0.25, 0, 1))
    translation = translate(stage)
    assert kinds(translation)[kind] == 1
    (node,) = materials(translation)["/World/Material"]["nodes"]
    assert node["texture"] == -1 and node["fallback"] == [0.5, 0.25, 0, 1]
    assert "missing primvar st" not in kinds(translation)
    translation.scene.validate()
    if error:
        with pytest.raises(StageError, match=file):
            translate(stage, strict=True)
    else:
        translate(stage, strict=True)


def test_pixels_that_are_not_finite_count_as_0(stage: Usd.Stage, tmp_path: Path) -> None:
    material = square_with(stage)
    pixels = np.array([[[math.nan, 2.0, math.inf]]])
    connect_texture(stage, surface(material), write_image(tmp_path / "a.exr", pixels))
    translation = translate(stage)
    assert translation.scene.texture(0)["pixels"].tolist() == [[[0, 2, 0, 1]]]
    assert kinds(translation)["texture not finite"] == 1


def test_a_cycle_of_connections_ends(stage: Usd.Stage, tmp_path: Path) -> None:
    material = square_with(stage)
    texture = connect_texture(stage, surface(material), write_image(tmp_path / "a.png"))
    nodes = []
    for i in range(2):
        node = UsdShade.Shader.Define(stage, f"/World/Material/T{i}")
        node.CreateIdAttr("UsdTransform2d")
        node.CreateOutput("result", Sdf.ValueTypeNames.Float2)
        nodes.append(node)
    for i in range(2):
        source = nodes[1 - i].ConnectableAPI()
        nodes[i].CreateInput("in", Sdf.ValueTypeNames.Float2).ConnectToSource(source, "result")
    texture.GetInput("st").ConnectToSource(nodes[0].ConnectableAPI(), "result")
    translation = translate(stage)
    assert "/World/Mesh" in instances(translation)
