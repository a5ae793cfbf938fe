"""Materials: constants, textures, bindings, cut-outs, fallbacks, and what is reported."""

import math
from pathlib import Path

import numpy as np
import pytest
from encore.adapters.texture import read_pixels
from encore.errors import StageError
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, UsdUtils
from stages import (
    add_material,
    add_square,
    add_strip,
    bind,
    connect_texture,
    instances,
    kinds,
    material_name,
    materials,
    meshes,
    new_stage,
    surface,
    translate,
    write_image,
)


def srgb_to_linear(encoded: float) -> float:
    """IEC 61966-2-1."""
    return encoded / 12.92 if encoded <= 0.04045 else ((encoded + 0.055) / 1.055) ** 2.4


def square_with(stage: Usd.Stage, **inputs: object) -> UsdShade.Material:
    material = add_material(stage, "/World/Material", **inputs)
    bind(add_square(stage, "/World/Mesh"), material)
    return material


CONSTANTS = {
    "diffuseColor": (0.1, 0.2, 0.3),
    "emissiveColor": (1.0, 2.0, 3.0),
    "specularColor": (0.5, 0.25, 0.125),
    "metallic": 0.25,
    "roughness": 0.75,
    "clearcoat": 0.5,
    "clearcoatRoughness": 0.125,
    "opacity": 0.5,
    "ior": 1.25,
}
SNAKE = {
    "diffuseColor": "diffuse_color",
    "emissiveColor": "emissive_color",
    "specularColor": "specular_color",
}
SNAKE["clearcoatRoughness"] = "clearcoat_roughness"


def test_constant_inputs(stage: Usd.Stage) -> None:
    square_with(stage, **CONSTANTS, useSpecularWorkflow=1)
    translation = translate(stage)
    found = materials(translation)["/World/Material"]
    assert found["use_specular_workflow"] is True
    for name, value in CONSTANTS.items():
        source = found["inputs"][SNAKE.get(name, name)]
        assert source["node"] == -1
        np.testing.assert_allclose(source["value"], value, rtol=1e-6)
    assert material_name(translation, "/World/Mesh") == "/World/Material"


def test_defaults_are_the_specifications(stage: Usd.Stage) -> None:
    square_with(stage)
    found = materials(translate(stage))["/World/Material"]
    values = {name: source["value"] for name, source in found["inputs"].items()}
    assert values == {
        "diffuse_color": pytest.approx((0.18, 0.18, 0.18)),
        "emissive_color": (0, 0, 0),
        "specular_color": (0, 0, 0),
        "metallic": 0,
        "roughness": 0.5,
        "clearcoat": 0,
        "clearcoat_roughness": pytest.approx(0.01),
        "opacity": 1,
        "ior": 1.5,
    }


def test_constants_through_interfaces(stage: Usd.Stage) -> None:
    material = square_with(stage)
    graph = UsdShade.NodeGraph.Define(stage, "/World/Material/Graph")
    outer = material.CreateInput("tint", Sdf.ValueTypeNames.Color3f)
    outer.Set((0.9, 0.8, 0.7))
    inner = graph.CreateInput("tint", Sdf.ValueTypeNames.Color3f)
    inner.ConnectToSource(outer)
    surface(material).CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(inner)
    surface(material).CreateInput("roughness", Sdf.ValueTypeNames.Float).ConnectToSource(
        material.CreateInput("rough", Sdf.ValueTypeNames.Float)
    )
    material.GetInput("rough").Set(0.25)
    found = materials(translate(stage))["/World/Material"]["inputs"]
    assert found["diffuse_color"]["value"] == pytest.approx((0.9, 0.8, 0.7))
    assert found["roughness"]["value"] == 0.25


def test_the_surface_may_come_through_a_node_graph(stage: Usd.Stage) -> None:
    material = UsdShade.Material.Define(stage, "/World/Material")
    graph = UsdShade.NodeGraph.Define(stage, "/World/Material/Graph")
    shader = UsdShade.Shader.Define(stage, "/World/Material/Graph/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("ior", Sdf.ValueTypeNames.Float).Set(2.0)
    output = graph.CreateOutput("out", Sdf.ValueTypeNames.Token)
    output.ConnectToSource(shader.ConnectableAPI(), "surface")
    material.CreateSurfaceOutput().ConnectToSource(output)
    bind(add_square(stage, "/World/Mesh"), material)
    assert materials(translate(stage))["/World/Material"]["inputs"]["ior"]["value"] == 2


def test_time_samples(stage: Usd.Stage) -> None:
    material = square_with(stage, roughness=0.0)
    attribute = surface(material).GetInput("roughness").GetAttr()
    attribute.Set(0.0, 1)
    attribute.Set(1.0, 5)
    found = materials(translate(stage, time=Usd.TimeCode(2)))["/World/Material"]
    assert found["inputs"]["roughness"]["value"] == 0.25


@pytest.mark.parametrize(
    ("name", "value", "kind", "used"),
    [
        ("roughness", math.nan, "bad roughness", 0.5),
        ("diffuseColor", (0.0, math.inf, 0.0), "bad diffuseColor", (0.18, 0.18, 0.18)),
        ("ior", 0.0, "bad ior", 1.5),
        ("ior", -1.0, "bad ior", 1.5),
    ],
)
def test_bad_constants(stage: Usd.Stage, name: str, value: object, kind: str, used: object) -> None:
    square_with(stage, **{name: value})
    translation = translate(stage)
    found = materials(translation)["/World/Material"]["inputs"][SNAKE.get(name, name)]
    assert found["value"] == pytest.approx(used)
    assert kinds(translation)[kind] == 1
    translation.scene.validate()


def test_inputs_that_are_not_supported_are_reported(stage: Usd.Stage, tmp_path: Path) -> None:
    material = square_with(stage, displacement=0.5, normal=(0.0, 0.0, 1.0))
    shader = surface(material)
    texture = connect_texture(stage, shader, write_image(tmp_path / "a.png"))
    texture.CreateOutput("r", Sdf.ValueTypeNames.Float)
    for name in ("roughness", "occlusion"):
        shader.CreateInput(name, Sdf.ValueTypeNames.Float).ConnectToSource(texture.ConnectableAPI(), "r")
    shader.GetInput("roughness").Set(0.625)
    shader.CreateInput("opacityMode", Sdf.ValueTypeNames.Token).Set("presence")
    shader.CreateInput("opacity", Sdf.ValueTypeNames.Float).Set(0.5)
    translation = translate(stage)
    expected = {"connected roughness", "input occlusion", "input displacement", "opacityMode"}
    assert expected <= kinds(translation).keys()
    assert "input normal" not in kinds(translation), "a neutral value has no effect to miss"
    found = materials(translation)["/World/Material"]["inputs"]["roughness"]
    assert found["node"] == -1 and found["value"] == 0.625, "what is authored beside the connection"


# Textures


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
    import OpenImageIO as oiio

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


# Bindings


def test_direct_bindings_are_inherited(stage: Usd.Stage) -> None:
    outer, inner = add_material(stage, "/World/Outer"), add_material(stage, "/World/Inner")
    for path in ("/World/G/A", "/World/G/B"):
        add_square(stage, path)
    bind(stage.GetPrimAtPath("/World/G"), outer)
    bind(stage.GetPrimAtPath("/World/G/B"), inner)
    translation = translate(stage)
    assert material_name(translation, "/World/G/A") == "/World/Outer"
    assert material_name(translation, "/World/G/B") == "/World/Inner"
    bind(stage.GetPrimAtPath("/World/G"), outer, UsdShade.Tokens.strongerThanDescendants)
    assert material_name(translate(stage), "/World/G/B") == "/World/Outer"


def test_collection_bindings(stage: Usd.Stage) -> None:
    red = add_material(stage, "/World/Red")
    for path in ("/World/A", "/World/B"):
        add_square(stage, path)
    world = stage.GetPrimAtPath("/World")
    collection = Usd.CollectionAPI.Apply(world, "some")
    collection.IncludePath("/World/B")
    UsdShade.MaterialBindingAPI.Apply(world).Bind(collection, red, "some")
    translation = translate(stage)
    assert material_name(translation, "/World/A") == "default"
    assert material_name(translation, "/World/B") == "/World/Red"


def test_purposes_of_bindings(stage: Usd.Stage) -> None:
    full, preview = add_material(stage, "/World/Full"), add_material(stage, "/World/Preview")
    api = UsdShade.MaterialBindingAPI.Apply(add_square(stage, "/World/Mesh").GetPrim())
    api.Bind(full, materialPurpose=UsdShade.Tokens.full)
    api.Bind(preview, materialPurpose=UsdShade.Tokens.preview)
    assert material_name(translate(stage), "/World/Mesh") == "/World/Full"
    translation = translate(stage, material_purposes=("preview",))
    assert material_name(translation, "/World/Mesh") == "/World/Preview"


def subset(mesh: UsdGeom.Mesh, name: str, faces: list[int], material: UsdShade.Material | None) -> None:
    api = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
    found = api.CreateMaterialBindSubset(name, faces)
    if material:
        bind(found, material)


def test_subsets(stage: Usd.Stage) -> None:
    red, blue, grey = (add_material(stage, f"/World/{n}") for n in ("Red", "Blue", "Grey"))
    mesh = add_strip(stage, "/World/Mesh")
    bind(mesh, grey)
    subset(mesh, "left", [0], red)
    subset(mesh, "right", [2, 99, -1], blue)
    other = UsdGeom.Subset.CreateGeomSubset(mesh, "other", UsdGeom.Tokens.face, [1], "components")
    bind(other, blue)
    translation = translate(stage)
    names = [material_name(translation, "/World/Mesh", face) for face in range(3)]
    assert names == ["/World/Red", "/World/Grey", "/World/Blue"]
    assert kinds(translation)["bad subset"] == 1


def test_subsets_inside_of_instances(stage: Usd.Stage) -> None:
    stage.CreateClassPrim("/Asset")
    mesh = add_strip(stage, "/Asset/Mesh")
    subset(mesh, "left", [0], add_material(stage, "/Asset/Red"))
    for i in range(2):
        prim = stage.DefinePrim(f"/World/I{i}")
        prim.GetReferences().AddInternalReference("/Asset")
        prim.SetInstanceable(True)
    translation = translate(stage)
    assert translation.counts["meshes"] == 1
    for i in range(2):
        assert material_name(translation, f"/World/I{i}", 0).endswith("/Red")
        assert material_name(translation, f"/World/I{i}", 1) == "default"


# Cut-outs


@pytest.mark.parametrize(
    ("opacity", "threshold", "seen"), [(0.3, 0.5, False), (0.5, 0.5, True), (0.3, 0.0, True)]
)
def test_cut_out_meshes(stage: Usd.Stage, opacity: float, threshold: float, seen: bool) -> None:
    add_square(stage, "/World/Other")
    square_with(stage, opacity=opacity, opacityThreshold=threshold)
    translation = translate(stage)
    assert ("/World/Mesh" in instances(translation)) == seen
    if seen:
        found = materials(translation)["/World/Material"]["inputs"]["opacity"]["value"]
        assert found == pytest.approx(1.0 if threshold else opacity), "a mask does not transmit"
    assert not translation.reports.has_errors


@pytest.mark.parametrize("scheme", ["none", "catmullClark"])
def test_cut_out_faces(stage: Usd.Stage, scheme: str) -> None:
    mesh = add_strip(stage, "/World/Mesh", scheme)
    mesh.CreateDisplayColorPrimvar("uniform").Set([(1, 0, 0), (0, 1, 0), (0, 0, 1)])
    if scheme != "none":
        mesh.CreateHoleIndicesAttr([0])
    subset(mesh, "gone", [1], add_material(stage, "/World/Cut", opacity=0.0, opacityThreshold=0.1))
    subset(mesh, "red", [2], add_material(stage, "/World/Red"))
    translation = translate(stage)
    translation.scene.validate()
    found = meshes(translation)["/World/Mesh"]
    if scheme == "none":
        assert found["face_vertex_indices"].tolist() == [0, 2, 3, 1, 4, 6, 7, 5]
        assert found["display_color"]["values"].tolist() == [[1, 0, 0], [0, 0, 1]]
        assert [material_name(translation, "/World/Mesh", f) for f in (0, 1)] == [
            "displayColor",
            "/World/Red",
        ]
    else:
        assert found["hole_indices"].tolist() == [0, 1], "the surface beside the hole keeps its shape"
        assert len(found["face_vertex_counts"]) == 3


def test_cut_out_instances(stage: Usd.Stage) -> None:
    stage.CreateClassPrim("/Asset")
    add_square(stage, "/Asset/Mesh")
    cut = add_material(stage, "/World/Cut", opacity=0.0, opacityThreshold=0.1)
    for i in range(2):
        prim = stage.DefinePrim(f"/World/I{i}")
        prim.GetReferences().AddInternalReference("/Asset")
        prim.SetInstanceable(True)
        if i:
            bind(prim, cut)
    assert list(instances(translate(stage))) == ["/World/I0"]


# Without a supported material


def test_display_color(stage: Usd.Stage) -> None:
    add_square(stage, "/World/Red").CreateDisplayColorAttr([(1, 0, 0)])
    add_square(stage, "/World/AlsoRed").CreateDisplayColorAttr([(1, 0, 0)])
    add_square(stage, "/World/None")
    varying = add_square(stage, "/World/Varying").CreateDisplayColorPrimvar("vertex")
    varying.Set([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1)])
    translation = translate(stage)
    names = {path: material_name(translation, path) for path in instances(translation)}
    assert names == {
        "/World/Red": "displayColor(1, 0, 0)",
        "/World/AlsoRed": "displayColor(1, 0, 0)",
        "/World/None": "default",
        "/World/Varying": "displayColor",
    }
    assert translation.counts["materials"] == 3
    found = materials(translation)["displayColor"]
    assert [n["kind"] for n in found["nodes"]] == ["displayColor"]
    assert found["inputs"]["diffuse_color"]["node"] == 0
    shown = meshes(translation)
    assert shown["/World/Varying"]["display_color"]["values"].shape == (4, 3)
    assert shown["/World/Red"]["display_color"] is None, "the material has it"


def test_a_material_that_reads_display_color(stage: Usd.Stage) -> None:
    material = square_with(stage)
    reader = UsdShade.Shader.Define(stage, "/World/Material/Reader")
    reader.CreateIdAttr("UsdPrimvarReader_float3")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("displayColor")
    reader.CreateOutput("result", Sdf.ValueTypeNames.Float3)
    shader = surface(material)
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(
        reader.ConnectableAPI(), "result"
    )
    UsdGeom.Gprim(stage.GetPrimAtPath("/World/Mesh")).CreateDisplayColorAttr([(0, 1, 0)])
    translation = translate(stage)
    assert [n["kind"] for n in materials(translation)["/World/Material"]["nodes"]] == ["displayColor"]
    assert meshes(translation)["/World/Mesh"]["display_color"]["values"].tolist() == [[0, 1, 0]]
    reader.GetInput("varname").Set("something")
    assert kinds(translate(stage))["connected diffuseColor"] == 1


def test_materials_that_are_not_supported_fall_back_to_display_color() -> None:
    stage = new_stage()
    for i, identifier in enumerate(("ND_standard_surface_surfaceshader", "MdlThing", "")):
        material = UsdShade.Material.Define(stage, f"/World/M{i}")
        if identifier:
            shader = UsdShade.Shader.Define(stage, f"/World/M{i}/Surface")
            shader.CreateIdAttr(identifier)
            context = "mtlx" if identifier.startswith("ND_") else ""
            material.CreateSurfaceOutput(context).ConnectToSource(shader.ConnectableAPI(), "out")
        mesh = add_square(stage, f"/World/Mesh{i}")
        mesh.CreateDisplayColorAttr([(1, 0, 0)])
        bind(mesh, material)
    translation = translate(stage)
    assert {material_name(translation, p) for p in instances(translation)} == {"displayColor(1, 0, 0)"}
    assert kinds(translation)["no UsdPreviewSurface"] == 2
    assert kinds(translation)["shader MdlThing"] == 1


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
