"""Textures: nodes, files, colour spaces, coordinates, and files that cannot be read."""

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio
import pytest
from encore.adapters.context import SyncContext
from encore.adapters.image import HALF_MAX, read_header, read_pixels
from encore.adapters.texture import Textures
from encore.errors import AssetError, StageError
from encore.report import Reports
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, UsdUtils
from stages import (
    add_material,
    add_square,
    bind,
    connect_texture,
    instances,
    kinds,
    materials,
    meshes,
    square_with,
    surface,
    translate,
    write_image,
)


def srgb_to_linear(encoded: float) -> float:
    """IEC 61966-2-1."""
    return encoded / 12.92 if encoded <= 0.04045 else ((encoded + 0.055) / 1.055) ** 2.4


def textures_of(stage: Usd.Stage, reports: Reports) -> Textures:
    textures = Textures()
    textures.begin(SyncContext(stage, Usd.TimeCode.Default(), reports))
    return textures


class Recorder:
    """Asks for textures as materials do, and reads their pixels as the renderer does later."""

    def __init__(self, stage: Usd.Stage) -> None:
        self.reports = Reports()
        self.textures = textures_of(stage, self.reports)

    def index(self, file: str, space: str = "auto") -> int:
        return self.textures.index(Sdf.AssetPath(file), space, Sdf.Path("/World/Material/Texture"))

    def pixels(self, file: str, space: str = "auto") -> npt.NDArray[np.float16]:
        index = self.index(file, space)
        found, header = self.textures.pixels(index), self.textures.header(index)
        assert header and found.shape == (header.height, header.width, 4) and found.dtype == np.float16
        return found

    @property
    def kinds(self) -> set[str]:
        return {report.kind for report in self.reports}


@pytest.fixture
def recorder(stage: Usd.Stage) -> Recorder:
    return Recorder(stage)


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


def test_pixels_are_linear_and_bottom_up(recorder: Recorder, tmp_path: Path) -> None:
    pixels = np.array([[[1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0.2, 0.4, 0.6], [0, 0, 0], [1, 1, 1]]])
    found = recorder.pixels(write_image(tmp_path / "a.png", pixels))
    assert found.shape == (2, 3, 4)
    np.testing.assert_allclose(found[1, :, :3], pixels[0], atol=1e-5)
    expected = [srgb_to_linear(v) for v in (0.2, 0.4, 0.6)]
    np.testing.assert_allclose(found[0, 0], [*expected, 1], rtol=2**-11)


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
    packed = Usd.Stage.Open(package)
    translation = translate(packed)
    assert not translation.reports.has_errors
    assert translation.counts["textures"] == 1
    asset = packed.GetPrimAtPath("/World/Material/Surface_diffuseColor").GetAttribute("inputs:file").Get()
    assert "[" in asset.resolvedPath
    assert Recorder(packed).pixels(asset.resolvedPath).tolist() == [[[0, 1, 0, 1]]]


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


def test_textures_may_read_several_sets_of_coordinates(stage: Usd.Stage, tmp_path: Path) -> None:
    material = square_with(stage)
    file = write_image(tmp_path / "a.png")
    connect_texture(stage, surface(material), file, "st")
    connect_texture(stage, surface(material), file, "other", "emissiveColor")
    api = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World/Mesh"))
    for name in ("st", "other", "third"):
        api.CreatePrimvar(name, Sdf.ValueTypeNames.TexCoord2fArray, "constant").Set([(0, 0)])
    translation = translate(stage)
    found = materials(translation)["/World/Material"]
    nodes = [found["nodes"][found["inputs"][n]["node"]] for n in ("diffuse_color", "emissive_color")]
    assert [n["texcoord"] for n in nodes] == ["st", "other"]
    assert translation.counts["textures"] == 1
    assert [t["name"] for t in meshes(translation)["/World/Mesh"]["texcoords"]] == ["other", "st"]
    translation.scene.validate()


@pytest.mark.parametrize(
    ("file", "kind", "error"),
    [
        ("nothing.png", "missing texture", True),
        ("broken.png", "unreadable texture", True),
        ("", "no texture file", False),
        ("tiles.<UDIM>.png", "missing texture", True),
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


def test_pixels_that_half_floats_cannot_hold(recorder: Recorder, tmp_path: Path) -> None:
    pixels = np.array([[[math.nan, 2.0, math.inf], [1e6, -math.inf, 0.5]]])
    found = recorder.pixels(write_image(tmp_path / "a.exr", pixels))
    assert found.tolist() == [[[0, 2, HALF_MAX, 1], [HALF_MAX, -HALF_MAX, 0.5, 1]]]
    assert recorder.kinds == {"texture not finite", "texture too bright"}
    (not_finite,) = recorder.reports.errors
    assert "1 pixels" in not_finite.message and not_finite.path == "/World/Material/Texture"


def test_textures_are_read_when_asked_for(recorder: Recorder, tmp_path: Path) -> None:
    file = write_image(tmp_path / "a.png")
    assert recorder.index(file) == 0
    write_image(tmp_path / "a.png", np.zeros((1, 1, 3)))
    assert recorder.pixels(file).tolist() == [[[0, 0, 0, 1]]], "not read before"
    Path(file).unlink()
    with pytest.raises(AssetError, match=r"/World/Material/Texture: the texture .*a\.png cannot be read"):
        recorder.textures.pixels(0)


@pytest.mark.parametrize("extension", ["png", "jpg", "exr", "tif", "hdr", "bmp", "tga"])
def test_truncated_files_are_found_before_rendering(
    recorder: Recorder, tmp_path: Path, extension: str
) -> None:
    rng = np.random.default_rng(1)
    pixels = rng.random((64, 64, 3)).astype(np.float32)
    path = tmp_path / f"a.{extension}"
    spec = oiio.ImageSpec(64, 64, 3, "float" if extension in ("exr", "hdr") else "uint8")
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec) and output.write_image(pixels)
    output.close()
    header = read_header(str(path))
    assert (header.width, header.height) == (64, 64)
    assert recorder.index(str(path)) == 0 and not recorder.kinds
    cut = tmp_path / f"cut.{extension}"
    cut.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    assert recorder.index(str(cut)) == -1
    assert recorder.kinds == {"unreadable texture"}


def test_damage_inside_of_a_file_ends_the_frame_with_its_name(recorder: Recorder, tmp_path: Path) -> None:
    path = write_image(tmp_path / "a.png", np.random.default_rng(1).random((64, 64, 3)))
    data = bytearray(Path(path).read_bytes())
    data[len(data) // 2 : len(data) // 2 + 64] = bytes(64)
    Path(path).write_bytes(data)
    assert recorder.index(path) == 0
    with pytest.raises(AssetError, match=r"a\.png cannot be read"):
        recorder.textures.pixels(0)


def test_a_tiled_file_with_levels(recorder: Recorder, tmp_path: Path) -> None:
    pixels = np.random.default_rng(1).random((48, 80, 3)).astype(np.float32)
    source = oiio.ImageBuf(oiio.ImageSpec(80, 48, 3, "float"))
    source.set_pixels(oiio.ROI(0, 80, 0, 48, 0, 1, 0, 3), pixels)
    path = str(tmp_path / "a.tx")
    config = oiio.ImageSpec()
    assert oiio.ImageBufAlgo.make_texture(oiio.MakeTxTexture, source, path, config)
    found = recorder.pixels(path, "raw")
    assert found.shape == (48, 80, 4)
    np.testing.assert_allclose(found[::-1, :, :3], pixels, rtol=1e-3, atol=1e-4)


def test_the_display_window_counts(recorder: Recorder, tmp_path: Path) -> None:
    """What lies outside of the data window is black; what lies outside of the display window is not seen."""
    spec = oiio.ImageSpec(4, 3, 3, "float")
    spec.x, spec.y = -1, 1
    spec.full_x, spec.full_y, spec.full_width, spec.full_height = 0, 0, 5, 3
    values = np.arange(12, dtype=np.float32).reshape(3, 4, 1) * np.ones(3, np.float32) + 1
    path = tmp_path / "a.exr"
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec) and output.write_image(values)
    output.close()
    found = recorder.pixels(str(path))[::-1, :, 0]
    assert found.tolist() == [[0, 0, 0, 0, 0], [2, 3, 4, 0, 0], [6, 7, 8, 0, 0]]


def test_sizes_of_nothing_and_of_one_pixel(recorder: Recorder, tmp_path: Path) -> None:
    assert recorder.pixels(write_image(tmp_path / "a.png")).tolist() == [[[1, 1, 1, 1]]]
    empty = tmp_path / "empty.png"
    empty.write_bytes(b"")
    assert recorder.index(str(empty)) == -1
    # A PNG that says 0 × 0.
    data = bytearray((tmp_path / "a.png").read_bytes())
    data[16:24] = bytes(8)
    (tmp_path / "zero.png").write_bytes(data)
    assert recorder.index(str(tmp_path / "zero.png")) == -1
    assert recorder.kinds == {"unreadable texture"}


@pytest.mark.parametrize(
    ("space", "white", "red"),
    [
        ("lin_rec709_scene", (1, 1, 1), (1, 0, 0)),
        ("data", (1, 1, 1), (1, 0, 0)),
        # Published matrices: AP1 → Rec.709 with Bradford adaptation; Rec.2020 → Rec.709 (ITU-R BT.2087).
        ("lin_ap1_scene", (1, 1, 1), (1.70505, -0.13026, -0.02400)),
        ("ACEScg", (1, 1, 1), (1.70505, -0.13026, -0.02400)),
        ("lin_rec2020_scene", (1, 1, 1), (1.6605, -0.1246, -0.0182)),
        ("srgb_rec709_scene", (1, 1, 1), (1, 0, 0)),
        ("g22_rec709_scene", (1, 1, 1), (1, 0, 0)),
    ],
)
def test_named_color_spaces(
    tmp_path: Path, space: str, white: tuple[float, ...], red: tuple[float, ...]
) -> None:
    path = write_image(tmp_path / "a.exr", np.array([[[1.0, 1, 1], [1, 0, 0], [0.5, 0.5, 0.5]]]))
    found = read_pixels(path, space)[0, :, :3]
    np.testing.assert_allclose(found[:2], [white, red], atol=1e-3)
    middle = {"srgb_rec709_scene": srgb_to_linear(0.5), "g22_rec709_scene": 0.5**2.2}.get(space, 0.5)
    np.testing.assert_allclose(found[2], [middle] * 3, atol=1e-4)


def test_color_space_metadata_of_the_file_attribute(stage: Usd.Stage, tmp_path: Path) -> None:
    """It counts where sourceColorSpace says nothing else, and what it names must exist."""
    material = square_with(stage)
    file = write_image(tmp_path / "a.png")
    texture = connect_texture(stage, surface(material), file)
    attribute = texture.GetInput("file").GetAttr()
    for i, space in enumerate(("lin_rec709_scene", "raw")):
        other = connect_texture(stage, surface(add_material(stage, f"/World/M{i}")), file)
        other.GetInput("file").GetAttr().SetColorSpace("lin_rec709_scene")
        if i:
            other.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set(space)
        bind(add_square(stage, f"/World/Mesh{i}"), stage_material(stage, f"/World/M{i}"))
    translation = translate(stage)
    assert translation.counts["textures"] == 3, "auto, linear by metadata, raw"
    attribute.SetColorSpace("no such space")
    assert kinds(translate(stage))["color space"] == 1
    texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("nonsense")
    assert kinds(translate(stage))["sourceColorSpace"] == 1


def stage_material(stage: Usd.Stage, path: str) -> UsdShade.Material:
    return UsdShade.Material(stage.GetPrimAtPath(path))


def test_udim_tiles(stage: Usd.Stage, tmp_path: Path) -> None:
    """Tiles by number, -1 where there is none; a broken one is its fallback."""
    for tile in (1001, 1003, 1011):
        write_image(tmp_path / f"t.{tile}.png", np.full((tile - 1000, 1, 3), 0.5))
    (tmp_path / "t.1002.png").write_bytes(b"no image")
    material = square_with(stage)
    texture = connect_texture(stage, surface(material), str(tmp_path / "t.<UDIM>.png"))
    texture.CreateInput("wrapS", Sdf.ValueTypeNames.Token).Set("repeat")
    translation = translate(stage)
    (node,) = materials(translation)["/World/Material"]["nodes"]
    assert len(node["udim"]) == 11
    sizes = {i: translation.scene.texture(t)["height"] for i, t in enumerate(node["udim"]) if t >= 0}
    assert sizes == {0: 1, 2: 3, 10: 11}
    assert node["texture"] == node["udim"][0]
    assert kinds(translation)["unreadable texture"] == 1
    translation.scene.validate()


def test_udim_tiles_beside_a_layer(tmp_path: Path) -> None:
    """Patterns are relative to the layer that names them."""
    (tmp_path / "maps").mkdir()
    write_image(tmp_path / "maps" / "t.1002.png")
    stage = Usd.Stage.CreateNew(str(tmp_path / "asset.usda"))
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    connect_texture(stage, surface(square_with(stage)), "./maps/t.<UDIM>.png")
    stage.Save()
    (tmp_path / "shot").mkdir()
    outer = Usd.Stage.CreateNew(str(tmp_path / "shot" / "shot.usda"))
    outer.OverridePrim("/World").GetReferences().AddReference("../asset.usda")
    translation = translate(outer)
    (node,) = materials(translation)["/World/Material"]["nodes"]
    assert node["udim"] == [-1, 0]
    assert "missing texture" not in kinds(translation)


def test_light_textures(recorder: Recorder, tmp_path: Path) -> None:
    path = Sdf.Path("/World/Dome")
    assert recorder.textures.light_texture(None, "auto", path) == -1
    assert recorder.textures.light_texture(Sdf.AssetPath(""), "auto", path) == -1
    assert not recorder.kinds, "a light without a texture is no error"
    file = Sdf.AssetPath(write_image(tmp_path / "sky.exr"))
    assert recorder.textures.light_texture(file, "auto", path) == 0
    assert recorder.textures.light_texture(file, "auto", path) == 0
    assert recorder.textures.light_texture(Sdf.AssetPath("nothing.exr"), "auto", path) == -1
    assert recorder.kinds == {"missing texture"}


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
    assert kinds(translation)["cyclic network"] == 1


def test_a_missing_file_is_not_looked_for_in_the_working_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "stage").mkdir()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "only_here.png").write_bytes(b"")
    stage = Usd.Stage.CreateNew(str(tmp_path / "stage" / "s.usda"))
    prim = stage.DefinePrim("/Texture", "Shader")
    prim.CreateAttribute("inputs:file", Sdf.ValueTypeNames.Asset).Set("./only_here.png")
    monkeypatch.chdir(tmp_path / "elsewhere")
    reports = Reports()
    textures = textures_of(stage, reports)
    assert textures.index(prim.GetAttribute("inputs:file").Get(), "raw", prim.GetPath()) == -1
    assert "missing texture" in {r.kind for r in reports}


def test_a_file_that_is_no_asset_is_reported() -> None:
    reports = Reports()
    stage = Usd.Stage.CreateInMemory()
    textures = textures_of(stage, reports)
    assert textures.index("abc.png", "raw", Sdf.Path("/T")) == -1  # type: ignore[arg-type]
    assert "bad texture file" in {r.kind for r in reports}
