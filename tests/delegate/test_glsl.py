"""Surfaces and displacements in GLSL: source, parameters, settings, and shaders that cannot be used."""

import math
from pathlib import Path
from typing import Any

import pytest
from encore.adapters.glsl import is_glsl
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, UsdUtils
from stages import (
    add_material,
    add_square,
    bind,
    connect_texture,
    kinds,
    material_name,
    materials,
    meshes,
    surface,
    translate,
    write_image,
)

T = Sdf.ValueTypeNames
CODE = "void surface() {}\n"


def glsl_on_square(stage: Usd.Stage, code: str = CODE, terminal: str = "surface") -> UsdShade.Shader:
    """A material whose terminal is a shader with GLSL code, on the square /World/Mesh; the shader."""
    material = UsdShade.Material.Define(stage, "/World/Material")
    shader = UsdShade.Shader.Define(stage, f"/World/Material/{terminal}")
    if code:
        shader.SetSourceCode(code, "glsl")
    output = material.CreateOutput(terminal, T.Token)
    output.ConnectToSource(shader.ConnectableAPI(), "out")
    bind(add_square(stage, "/World/Mesh"), material)
    return shader


def read(stage: Usd.Stage) -> dict[str, Any]:
    translation = translate(stage)
    translation.scene.validate()
    return materials(translation)["/World/Material"]


def test_source_code(stage: Usd.Stage) -> None:
    glsl_on_square(stage)
    found = read(stage)["surface_shader"]
    assert found["path"] == "/World/Material/surface"
    assert found["file"] == "/World/Material/surface.info:glsl:sourceCode"
    assert found["source"] == CODE and found["parameters"] == []
    assert not kinds(translate(stage)).keys() - {"camera"}


def test_universal_source_code(stage: Usd.Stage) -> None:
    glsl_on_square(stage, "").SetSourceCode(CODE)
    found = read(stage)["surface_shader"]
    assert found["file"] == "/World/Material/surface.info:sourceCode" and found["source"] == CODE


@pytest.mark.parametrize("source_type", ["glsl", ""])
def test_source_asset(stage: Usd.Stage, tmp_path: Path, source_type: str) -> None:
    path = tmp_path / "stripes.glsl"
    path.write_text(CODE)
    glsl_on_square(stage, "").SetSourceAsset(Sdf.AssetPath(str(path)), source_type)
    found = read(stage)["surface_shader"]
    assert found["file"] == str(path) and found["source"] == CODE


def test_source_asset_in_a_usdz(tmp_path: Path) -> None:
    (tmp_path / "stripes.glsl").write_text(CODE)
    stage = Usd.Stage.CreateNew(str(tmp_path / "scene.usda"))
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    glsl_on_square(stage, "").SetSourceAsset(Sdf.AssetPath("./stripes.glsl"), "glsl")
    stage.Save()
    package = str(tmp_path / "scene.usdz")
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "scene.usda"), package)
    (tmp_path / "stripes.glsl").unlink()
    opened = Usd.Stage.Open(package)
    if (
        not opened.GetPrimAtPath("/World/Material/surface")
        .GetAttribute("info:glsl:sourceAsset")
        .Get()
        .resolvedPath
    ):
        pytest.skip("this USD packs no files of other kinds")
    assert read(opened)["surface_shader"]["source"] == CODE


def test_parameters(stage: Usd.Stage) -> None:
    shader = glsl_on_square(stage)
    values = {
        "gain": (T.Float, 0.5),
        "tint": (T.Color3f, (1, 2, 3)),
        "shift": (T.Float2, (0.25, 0.75)),
        "up": (T.Normal3f, (0, 1, 0)),
        "four": (T.Float4, (1, 2, 3, 4)),
        "count": (T.Int, 7),
        "on": (T.Bool, True),
        "half": (T.Half, 0.5),
        "noise:scale": (T.Double, 2.0),
    }
    for name, (kind, value) in values.items():
        shader.CreateInput(name, kind).Set(
            value if not isinstance(value, tuple) else kind.type.pythonClass(*value)
        )
    found = {p["name"]: p for p in read(stage)["surface_shader"]["parameters"]}
    types = {name: p["type"] for name, p in found.items()}
    assert types == {
        "gain": "float",
        "tint": "vec3",
        "shift": "vec2",
        "up": "vec3",
        "four": "vec4",
        "count": "int",
        "on": "int",
        "half": "float",
        "noise_scale": "float",
    }
    values = {name: p["input"]["value"] for name, p in found.items()}
    assert values["gain"] == (0.5, 0, 0, 0) and values["tint"] == (1, 2, 3, 0)
    assert values["four"] == (1, 2, 3, 4) and values["count"] == (7, 0, 0, 0) and values["on"][0] == 1
    assert values["shift"] == (0.25, 0.75, 0, 0) and values["noise_scale"][0] == 2
    assert not kinds(translate(stage)).keys() - {"camera"}


def test_parameters_may_be_connected(stage: Usd.Stage, tmp_path: Path) -> None:
    shader = glsl_on_square(stage)
    texture = connect_texture(stage, shader, write_image(tmp_path / "a.png"), "uv", "tint")
    texture.CreateOutput("g", T.Float)
    shader.CreateInput("gain", T.Float).ConnectToSource(texture.ConnectableAPI(), "g")
    shader.CreateInput("wrong", T.Float4).ConnectToSource(texture.ConnectableAPI(), "g")
    reader = UsdShade.Shader.Define(stage, "/World/Material/Reader")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", T.String).Set("where")
    reader.CreateOutput("result", T.Float2)
    shader.CreateInput("at", T.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
    mesh = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World/Mesh"))
    mesh.CreatePrimvar("uv", T.TexCoord2fArray, "constant").Set([(0, 0)])
    mesh.CreatePrimvar("where", T.Float2Array, "constant").Set([(3, 4)])
    translation = translate(stage)
    translation.scene.validate()
    found = materials(translation)["/World/Material"]
    inputs = {p["name"]: p["input"] for p in found["surface_shader"]["parameters"]}
    kind = {name: found["nodes"][s["node"]]["kind"] for name, s in inputs.items() if s["node"] >= 0}
    assert kind == {"tint": "texture", "gain": "texture", "at": "primvar"}
    assert inputs["gain"]["channel"] == 1
    assert kinds(translation)["connected wrong"] == 1
    shown = meshes(translation)["/World/Mesh"]
    assert [t["name"] for t in shown["texcoords"]] == ["uv"]
    assert shown["primvars"][0]["values"].tolist() == [[3, 4, 0, 0]]


def test_what_shaders_are_given_without_asking(stage: Usd.Stage) -> None:
    """st and displayColor, where meshes have them."""
    glsl_on_square(stage)
    mesh = stage.GetPrimAtPath("/World/Mesh")
    assert not kinds(translate(stage)).keys() - {"camera"}, "a mesh may lack them"
    UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", T.TexCoord2fArray, "constant").Set([(0, 1)])
    UsdGeom.Gprim(mesh).CreateDisplayColorAttr([(1, 0, 0)])
    found = meshes(translate(stage))["/World/Mesh"]
    assert found["texcoords"][0]["values"].tolist() == [[0, 1]]
    assert found["display_color"]["values"].tolist() == [[1, 0, 0]]


def test_settings_of_the_surface_are_no_parameters(stage: Usd.Stage) -> None:
    shader = glsl_on_square(stage)
    shader.CreateInput("opacityMode", T.Token).Set("presence")
    shader.CreateInput("opacityThreshold", T.Float).Set(0.5)
    shader.CreateInput("useSpecularWorkflow", T.Int).Set(1)
    found = read(stage)
    assert found["surface_shader"]["parameters"] == []
    assert (found["opacity_mode"], found["opacity_threshold"]) == ("presence", 0.5)
    assert found["use_specular_workflow"] is True
    assert not kinds(translate(stage)).keys() - {"camera"}


@pytest.mark.parametrize(
    ("name", "kind", "value"),
    [
        ("file", T.Asset, Sdf.AssetPath("a.png")),
        ("words", T.String, "x"),
        ("matrix", T.Matrix4d, Gf.Matrix4d(1)),
        ("many", T.FloatArray, [1.0, 2.0]),
        ("gl_Position", T.Float, 1.0),
        ("a__b", T.Float, 1.0),
    ],
)
def test_inputs_that_glsl_cannot_have(stage: Usd.Stage, name: str, kind: Any, value: object) -> None:
    shader = glsl_on_square(stage)
    shader.CreateInput(name, kind).Set(value)
    assert read(stage)["surface_shader"]["parameters"] == []
    assert kinds(translate(stage))["GLSL parameter"] == 1


def test_names_that_become_the_same(stage: Usd.Stage) -> None:
    shader = glsl_on_square(stage)
    for name in ("a:b", "a_b"):
        shader.CreateInput(name, T.Float).Set(1.0)
    assert [p["name"] for p in read(stage)["surface_shader"]["parameters"]] == ["a_b"]
    assert kinds(translate(stage))["GLSL parameter"] == 1


def test_a_parameter_that_is_not_a_number(stage: Usd.Stage) -> None:
    shader = glsl_on_square(stage)
    shader.CreateInput("gain", T.Float).Set(math.nan)
    (found,) = read(stage)["surface_shader"]["parameters"]
    assert found["input"]["value"] == (0, 0, 0, 0)
    assert kinds(translate(stage))["bad gain"] == 1


def test_displacement_in_glsl(stage: Usd.Stage) -> None:
    """Beside a surface that is none, and for a mesh that keeps its material for it."""
    material = add_material(stage, "/World/Material", roughness=0.25)
    shader = UsdShade.Shader.Define(stage, "/World/Material/Waves")
    shader.SetSourceCode(CODE, "glsl")
    shader.CreateInput("height", T.Float).Set(0.5)
    material.CreateDisplacementOutput().ConnectToSource(shader.ConnectableAPI(), "out")
    bind(UsdGeom.Sphere.Define(stage, "/World/Ball"), material)
    found = read(stage)
    assert found["surface_shader"] is None
    assert found["displacement_shader"]["path"] == "/World/Material/Waves"
    assert [p["name"] for p in found["displacement_shader"]["parameters"]] == ["height"]
    assert found["inputs"]["roughness"]["value"] == 0.25
    assert surface(material)
    translation = translate(stage)
    mesh = meshes(translation)["/World/Ball"]
    assert translation.scene.material(mesh["material"])["path"] == "/World/Material"


@pytest.mark.parametrize(
    ("content", "kind"),
    [(None, "missing GLSL"), (b"\xff\xfe\x00", "unreadable GLSL"), (b" \n", "empty GLSL")],
)
def test_sources_that_cannot_be_used(
    stage: Usd.Stage, tmp_path: Path, content: bytes | None, kind: str
) -> None:
    """The mesh is shown in its own colour, and the stage is broken."""
    if content is not None:
        (tmp_path / "a.glsl").write_bytes(content)
    glsl_on_square(stage, "").SetSourceAsset(Sdf.AssetPath(str(tmp_path / "a.glsl")), "glsl")
    UsdGeom.Gprim(stage.GetPrimAtPath("/World/Mesh")).CreateDisplayColorAttr([(1, 0, 0)])
    translation = translate(stage)
    assert material_name(translation, "/World/Mesh") == "displayColor(1, 0, 0)"
    assert kinds(translation)[kind] == 1 and translation.reports.has_errors


@pytest.mark.parametrize("source_type", ["osl", "mdl"])
def test_other_languages(stage: Usd.Stage, source_type: str) -> None:
    glsl_on_square(stage, "").SetSourceCode("shader x() {}", source_type)
    translation = translate(stage)
    assert material_name(translation, "/World/Mesh") == "default"
    assert kinds(translation)["shader without id"] == 1


def test_code_of_another_language_is_not_taken_for_glsl() -> None:
    stage = Usd.Stage.CreateInMemory()
    shader = UsdShade.Shader.Define(stage, "/S")
    shader.GetPrim().CreateAttribute("info:implementationSource", Sdf.ValueTypeNames.Token).Set("sourceAsset")
    source = shader.GetPrim().CreateAttribute("info:sourceAsset", Sdf.ValueTypeNames.Asset)
    source.Set("x.osl")
    assert not is_glsl(shader)
    source.Set("x.glsl")
    assert is_glsl(shader)
    source.Set("x.osl")
    shader.GetPrim().CreateAttribute("info:glsl:sourceAsset", Sdf.ValueTypeNames.Asset).Set("any.name")
    assert is_glsl(shader)
