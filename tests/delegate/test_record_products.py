"""Render products end to end: small renders, their files, and what is in them."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest
from encore import cli
from encore.errors import ExitCode
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdRender, UsdShade, Vt

pytest.importorskip("encore._core")

WIDTH, HEIGHT = 64, 48


@pytest.fixture
def stage(tmp_path: Path) -> Usd.Stage:
    """A glossy card with st from 0 to 1 in the left half of the view, under a lamp, and render settings."""
    made = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageUpAxis(made, UsdGeom.Tokens.y)
    camera = UsdGeom.Camera.Define(made, "/Camera")
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.01, 1000))
    camera.CreateHorizontalApertureAttr(40.0)
    camera.CreateVerticalApertureAttr(30.0)
    camera.CreateFocalLengthAttr(20.0)  # the view is 20 wide and 15 high at distance 10
    add_card(made, "/Card", -10, -1, 10)
    UsdLux.RectLight.Define(made, "/Lamp").AddTranslateOp().Set((0, 0, 5))
    UsdLux.DomeLight.Define(made, "/Sky").CreateIntensityAttr(0.5)
    settings = UsdRender.Settings.Define(made, "/Render/Settings")
    settings.CreateCameraRel().SetTargets(["/Camera"])
    settings.CreateResolutionAttr(Gf.Vec2i(WIDTH, HEIGHT))
    for name, value in (("samples", 2), ("occlusionSamples", 4), ("lightSamples", 1)):
        settings.GetPrim().CreateAttribute(f"encore:{name}", Sdf.ValueTypeNames.Int).Set(value)
    made.SetMetadata("renderSettingsPrimPath", "/Render/Settings")
    return made


def add_card(stage: Usd.Stage, path: str, left: float, right: float, distance: float) -> UsdGeom.Mesh:
    card = UsdGeom.Mesh.Define(stage, path)
    corners = [(left, -20), (right, -20), (right, 20), (left, 20)]
    card.CreatePointsAttr([(x, y, -distance) for x, y in corners])
    card.CreateFaceVertexCountsAttr([4])
    card.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    card.CreateSubdivisionSchemeAttr("none")
    st = UsdGeom.PrimvarsAPI(card).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    st.Set([(0, 0), (1, 0), (1, 1), (0, 1)])
    material = UsdShade.Material.Define(stage, f"{path}/Material")
    shader = UsdShade.Shader.Define(stage, f"{path}/Material/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(0.5, 0.25, 0.125))
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.1)
    shader.CreateInput("opacity", Sdf.ValueTypeNames.Float).Set(0.75)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(card.GetPrim()).Bind(material)
    return card


def add_product(
    stage: Usd.Stage, name: str, *variables: tuple[str, str, str, str], **attributes: Any
) -> UsdRender.Product:
    """variables: name, source, its type, dataType."""
    product = UsdRender.Product.Define(stage, f"/Render/{re.sub('[^a-z]', '_', name)}")
    product.CreateProductNameAttr(name)
    UsdRender.Settings.Get(stage, "/Render/Settings").CreateProductsRel().AddTarget(product.GetPath())
    for var_name, source, kind, data_type in variables:
        var = UsdRender.Var.Define(stage, f"/Render/Vars/{var_name}")
        var.CreateSourceNameAttr(source)
        var.CreateSourceTypeAttr(kind)
        var.CreateDataTypeAttr(data_type)
        product.CreateOrderedVarsRel().AddTarget(var.GetPath())
    for attribute, value in attributes.items():
        getattr(product, f"Create{attribute}Attr")(value)
    return product


def record(stage: Usd.Stage, *flags: str, output: str = "", code: int = ExitCode.OK) -> Path:
    """Renders to the folder of the stage; that folder."""
    stage.Save()
    path = Path(stage.GetRootLayer().realPath)
    found = cli.main(
        ["record", str(path), str(path.parent / output) if output else f"{path.parent}/", *flags]
    )
    assert found == code
    return path.parent


def read(path: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return dict(file.header()), {name: channel.pixels for name, channel in file.channels().items()}


def window(header: dict[str, Any], name: str = "dataWindow") -> tuple[int, int, int, int]:
    """x0, y0, x1, y1, the last two excluded."""
    (x0, y0), (x1, y1) = header[name]
    return int(x0), int(y0), int(x1) + 1, int(y1) + 1


def images(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if path.suffix in (".exr", ".png"))


RAW = "raw"


def test_two_products_and_six_variables(stage: Usd.Stage) -> None:
    add_product(
        stage,
        "beauty.exr",
        ("rgba", "color", RAW, "color4f"),
        ("direct", "direct", RAW, "color3f"),
        ("Mirror", "C<R[GS]>.*", "lpe", "color3h"),
        ("Glass", "C<T[GS]>.*", "lpe", "color3f"),
    )
    add_product(stage, "data.exr", ("depth", "depth", RAW, "float"), ("N", "N", RAW, "normal3f"))
    add_product(stage, "view.png")
    folder = record(stage, "--stats", str(Path(stage.GetRootLayer().realPath).parent / "s.json"))
    assert images(folder) == ["beauty.exr", "data.exr", "view.png"]
    header, beauty = read(folder / "beauty.exr")
    layers = ("direct", "Mirror", "Glass")
    assert set(beauty) == {*"RGBA", *(f"{name}.{c}" for name in layers for c in "RGB")}
    assert beauty["R"].shape == (HEIGHT, WIDTH)
    assert beauty["Mirror.R"].dtype == np.float16 and beauty["Glass.R"].dtype == np.float32
    for c in "RGB":
        assert all(beauty[f"{name}.{c}"].max() > 0 for name in layers)
        total = sum(beauty[f"{name}.{c}"].astype(np.float64) for name in layers)
        assert total == pytest.approx(beauty[c], rel=1e-3, abs=1e-3)
    assert header["encore:renderSettings"] == "/Render/Settings"
    assert header["encore:renderProduct"] == "/Render/beauty_exr"
    assert json.loads(header["encore:renderVars"])["/Render/Vars/Mirror"] == "Mirror.R Mirror.G Mirror.B"
    assert json.loads(header["encore:flags"]) == []
    settings = json.loads(header["encore:settings"])
    assert (settings["samples"], settings["width"], settings["height"]) == (2, WIDTH, HEIGHT)
    data = read(folder / "data.exr")[1]
    assert set(data) == {"Z", "N.X", "N.Y", "N.Z"}
    assert data["Z"][24, 8] == pytest.approx(10, rel=1e-4) and data["Z"][24, 60] == np.float32(1e30)
    assert data["N.Z"][24, 8] == pytest.approx(1, abs=1e-4)
    document = json.loads((folder / "s.json").read_text())
    (frame,) = document["frames"]
    assert [o["product"] for o in frame["outputs"]] == [
        f"/Render/{n}" for n in ("beauty_exr", "data_exr", "view_png")
    ]
    assert frame["render_settings"]["renderSettings"] == "/Render/Settings"
    assert frame["resolution"] == [WIDTH, HEIGHT] and frame["data_window"] == [0, 0, WIDTH, HEIGHT]
    assert document["antialiasing_samples"] == WIDTH * HEIGHT * 4, "rendered once for all of them"


def test_the_example(tmp_path: Path) -> None:
    example = Path(__file__).parents[2] / "examples" / "still_life_products.usda"
    flags = ("-w", "32", "--samples", "1", "--occlusionSamples", "1", "--lightSamples", "1", "--strict")
    assert cli.main(["record", str(example), f"{tmp_path}/", *flags]) == ExitCode.OK
    assert images(tmp_path) == ["crop.exr", "data.exr", "layers.exr", "picture.png"]
    channels = {name: read(tmp_path / f"{name}.exr")[1] for name in ("crop", "data", "layers")}
    assert set(channels["layers"]) == {
        *"RGBA",
        *(f"{n}.{c}" for n in ("direct", "mirrored", "refracted") for c in "RGB"),
    }
    assert set(channels["data"]) == {"Z", "st.U", "st.V", "id", *(f"{n}.{c}" for n in "PN" for c in "XYZ")}
    assert np.array_equal(channels["crop"]["R"], channels["layers"]["R"][9:, 8:24])
    assert len(np.unique(channels["data"]["id"])) > 5


def test_flags_win_and_headers_say_so(stage: Usd.Stage) -> None:
    folder = record(stage, "-w", "32", "--samples", "1", output="a.exr")
    header, channels = read(folder / "a.exr")
    assert channels["R"].shape == (24, 32)
    assert json.loads(header["encore:settings"])["samples"] == 1
    assert json.loads(header["encore:flags"]) == ["--imageWidth", "--samples"]


def test_without_settings_the_file_is_as_ever(stage: Usd.Stage) -> None:
    add_product(stage, "a.exr", ("depth", "depth", RAW, "float"))
    folder = record(stage, "-rs", "none", "-w", "16", "--samples", "1", output="b.exr")
    header, channels = read(folder / "b.exr")
    assert {"R", "A", "Z", "direct.R", "N.X"} <= set(channels)
    assert "encore:renderSettings" not in header
    assert channels["R"].shape == (12, 16)


def test_aspect_ratios_of_pixels_and_apertures(stage: Usd.Stage) -> None:
    """The card ends at x = -1: at 45 % of the aperture's width of 20."""
    for name, policy, size, pixel in (
        ("expand.exr", "expandAperture", (80, 30), 1.0),
        ("crop.exr", "cropAperture", (80, 30), 1.0),
        ("pixel.exr", "adjustPixelAspectRatio", (80, 30), 1.0),
        ("wide.exr", "expandAperture", (40, 60), 2.0),
    ):
        add_product(
            stage,
            name,
            ("a", "alpha", RAW, "float"),
            Resolution=Gf.Vec2i(*size),
            AspectRatioConformPolicy=policy,
            PixelAspectRatio=pixel,
        )
    folder = record(stage, "--filter", "box", "--filterRadius", "0.5", "--samples", "4")
    # Width of the view at distance 10, and of a pixel: 15 high, or 20 wide.
    expected = {"expand": (40, 1.0), "crop": (20, 1.0), "pixel": (20, 4 / 3 / (80 / 30)), "wide": (20, 2.0)}
    for name, (view, pixel) in expected.items():
        header, channels = read(folder / f"{name}.exr")
        assert header["pixelAspectRatio"] == pytest.approx(pixel)
        covered = float(channels["A"][15].sum())
        width = channels["A"].shape[1]
        left = max(0.0, view / 2 - 10) / view * width  # the card begins at -10
        assert covered == pytest.approx((0.5 - 1 / view) * width - left, abs=0.3), name


def test_the_linear_space_of_images(stage: Usd.Stage) -> None:
    settings = UsdRender.Settings.Get(stage, "/Render/Settings")
    folder = record(stage, output="a.exr")
    settings.CreateRenderingColorSpaceAttr("lin_ap1_scene")
    record(stage, output="b.exr")
    record(stage, output="b.png")
    (_, plain), (header, converted) = read(folder / "a.exr"), read(folder / "b.exr")
    matrix = np.array(
        [[0.613097, 0.339523, 0.047379], [0.070194, 0.916354, 0.013452], [0.020616, 0.10957, 0.869815]]
    )
    for prefix in ("", "direct.", "reflection."):
        rgb = np.dstack([plain[f"{prefix}{c}"] for c in "RGB"])
        found = np.dstack([converted[f"{prefix}{c}"] for c in "RGB"])
        assert found == pytest.approx(rgb @ matrix.T, rel=1e-3, abs=1e-4)
    assert np.array_equal(plain["A"], converted["A"])
    assert list(header["chromaticities"])[:2] == pytest.approx([0.713, 0.293])


def test_a_pass_hides_and_prunes(stage: Usd.Stage) -> None:
    add_card(stage, "/Other", 1, 10, 10)
    render_pass = UsdRender.Pass.Define(stage, "/Render/Pass")
    render_pass.CreateRenderSourceRel().SetTargets(["/Render/Settings"])
    Usd.CollectionAPI(render_pass.GetPrim(), "prune").CreateIncludesRel().SetTargets(["/Card"])
    folder = record(stage, "-rp", "/Render/Pass", output="a.exr")
    header, channels = read(folder / "a.exr")
    assert header["encore:renderPass"] == "/Render/Pass"
    assert not channels["A"][:, :24].any() and channels["A"][:, 48:].all()
    assert "active" not in Path(stage.GetRootLayer().realPath).read_text(), "the stage itself is as it was"


def test_frames_of_products(stage: Usd.Stage) -> None:
    add_product(stage, "a.<F4>.exr", ("a", "alpha", RAW, "float"))
    named = add_product(stage, "b", ("z", "depth", RAW, "float")).GetProductNameAttr()
    named.Set("one.exr", 1)
    named.Set("two.exr", 2)
    folder = record(stage, "--frames", "1:2", "-w", "16")
    assert images(folder) == ["a.0001.exr", "a.0002.exr", "one.exr", "two.exr"]


def test_a_product_that_cannot_be_rendered_leaves_the_others(
    stage: Usd.Stage, capsys: pytest.CaptureFixture[str]
) -> None:
    add_product(stage, "good.exr", ("a", "alpha", RAW, "float"))
    away = UsdGeom.Camera.Define(stage, "/Broken")
    away.CreateFocalLengthAttr(0.0)
    bad = add_product(stage, "bad.exr", ("b", "alpha", RAW, "float"))
    bad.CreateCameraRel().SetTargets(["/Broken"])
    folder = record(stage, code=ExitCode.STAGE)
    assert images(folder) == ["good.exr"]
    assert "/Broken" in capsys.readouterr().err.splitlines()[-1]


def test_what_is_wrong_is_said_before_anything_is_rendered(
    stage: Usd.Stage, capsys: pytest.CaptureFixture[str]
) -> None:
    add_product(stage, "good.exr")
    bad = add_product(
        stage, "bad.exr", ("Key", "C.*<L.'key'>", "lpe", "color3f"), ("z", "depth", RAW, "float")
    )
    record(stage, "--strict", code=ExitCode.STAGE)
    assert "/Render/Vars/Key" in capsys.readouterr().err
    bad.GetOrderedVarsRel().RemoveTarget("/Render/Vars/z")
    record(stage, code=ExitCode.SETTING)
    error = capsys.readouterr().err.splitlines()[-1]
    assert "bad_exr.orderedVars: none of its variables can be rendered. /Render/Vars/Key: 'C.*<L." in error
    bad.GetOrderedVarsRel().AddTarget("/Render/Vars/z")
    bad.GetPrim().CreateAttribute("encore:samples", Sdf.ValueTypeNames.Int).Set(0)
    folder = record(stage, code=ExitCode.SETTING)
    assert "Error: /Render/bad_exr.encore:samples: 0 is out of range" in capsys.readouterr().err
    bad.GetPrim().RemoveProperty("encore:samples")
    bad.GetProductNameAttr().Set("missing/bad.exr")
    record(stage, code=ExitCode.OUTPUT)
    assert images(folder) == []


def test_dump_shows_what_the_settings_ask_for(stage: Usd.Stage, capsys: pytest.CaptureFixture[str]) -> None:
    add_product(stage, "a.exr", ("st", "st", "primvar", "float2"), ("odd", "odd", RAW, "float"))
    stage.Save()
    assert cli.main(["dump", stage.GetRootLayer().realPath]) == ExitCode.OK
    text = capsys.readouterr().out
    assert f"image {WIDTH} x {HEIGHT}" in text
    assert re.search(r"mesh /Card\n(  .*\n)*  .*\bst\b", text), "which no material reads"
    assert "report Error: /Render/Vars/odd: 'odd' is nothing that Encore has" in text


# --- What needs windows and variables of the film ----------------------------------------------------


def test_a_crop_is_that_part_of_the_whole(stage: Usd.Stage) -> None:
    # Tiles that windows cut.
    tile = stage.GetPrimAtPath("/Render/Settings").CreateAttribute("encore:reuseTile", Sdf.ValueTypeNames.Int)
    tile.Set(16)
    add_product(stage, "full.exr")
    add_product(stage, "crop.exr", DataWindowNDC=Gf.Vec4f(0.25, 0.1, 0.8, 0.6))
    add_product(stage, "crop.png", DataWindowNDC=Gf.Vec4f(0.25, 0.1, 0.8, 0.6))
    add_product(stage, "over.exr", DataWindowNDC=Gf.Vec4f(-0.125, -0.25, 1.125, 1.125))
    folder = record(stage)
    (_, full), (crop_header, crop), (over_header, over) = (
        read(folder / f"{n}.exr") for n in ("full", "crop", "over")
    )
    x0, y0, x1, y1 = window(crop_header)
    # Centres (x + 0.5) / 64 in [0.25, 0.8), and 1 - (y + 0.5) / 48 in [0.1, 0.6).
    assert (x0, x1) == (16, 51)
    assert (y0, y1) == (math.floor(48 * 0.4 - 0.5) + 1, math.floor(48 * 0.9 - 0.5) + 1)
    assert window(crop_header, "displayWindow") == (0, 0, WIDTH, HEIGHT)
    assert set(crop) == set(full) == set(over)
    for name, pixels in full.items():
        assert np.array_equal(crop[name], pixels[y0:y1, x0:x1]), name
    ox, oy, ox1, oy1 = window(over_header)
    assert (ox, oy, ox1, oy1) == (-8, -6, 72, 60)
    for name, pixels in full.items():
        assert np.array_equal(over[name][-oy : HEIGHT - oy, -ox : WIDTH - ox], pixels), name
    assert over["A"][0, 10:30].all(), "there is more of the card beyond the upper border"
    png = oiio.ImageInput.open(str(folder / "crop.png"))
    assert (png.spec().width, png.spec().height) == (x1 - x0, y1 - y0)
    png.close()


def test_variables_of_first_hits(stage: Usd.Stage) -> None:
    add_card(stage, "/Other", 2, 10, 5)
    add_product(
        stage,
        "a.exr",
        ("P", "P", RAW, "point3f"),
        ("Peye", "Peye", RAW, "point3f"),
        ("Neye", "Neye", RAW, "normal3f"),
        ("prim", "primId", RAW, "int"),
        ("primF", "primId", RAW, "float"),
        ("instance", "instanceId", RAW, "int"),
        ("face", "elementId", RAW, "int"),
        ("st", "st", "primvar", "texCoord2f"),
        ("a", "alpha", RAW, "float"),
        ("z", "depth", RAW, "float"),
    )
    camera = UsdGeom.Camera.Get(stage, "/Camera")
    camera.AddTranslateOp().Set((0, 0, 0.25))
    folder = record(stage, "--filter", "box", "--filterRadius", "0.5")
    found = read(folder / "a.exr")[1]
    assert set(found) == {
        *(f"{n}.{c}" for n in ("P", "Peye", "Neye") for c in "XYZ"),
        *("prim", "primF", "instance", "face", "st.U", "st.V", "A", "Z"),
    }
    assert found["prim"].dtype == np.uint32 and found["primF"].dtype == np.float32
    y, left, gap, right = 24, 8, 32, 60
    assert found["P.Z"][y, left] == pytest.approx(-10) and found["P.Z"][y, right] == pytest.approx(-5)
    assert found["Peye.Z"][y, left] == pytest.approx(-10.25)
    assert found["Z"][y, left] == pytest.approx(10.25, rel=1e-5)
    # The view is 20.5 wide there, and one of 64 pixels a 64th of it.
    middle = ((left + 0.5) / 64 - 0.5) * 20.5
    assert found["P.X"][y, left] == pytest.approx(middle, abs=20.5 / 64 / 2)
    assert found["Neye.Z"][y, left] == pytest.approx(1, abs=1e-4)
    ids = {int(found["prim"][y, x]) for x in (left, gap, right)}
    assert found["prim"][y, gap] == 2**32 - 1 and found["primF"][y, gap] == -1 and len(ids) == 3
    assert found["face"][y, left] == 0
    # st.U is 0 at x = -10 and 1 at -1.
    assert found["st.U"][y, left] == pytest.approx((middle + 10) / 9, abs=0.02)
    assert found["A"][y, left] == pytest.approx(1)


def test_files_of_one_type_of_numbers(stage: Usd.Stage) -> None:
    add_card(stage, "/Other", 2, 10, 5)
    add_product(stage, "ids.exr", ("prim", "primId", RAW, "int"), ("face", "elementId", RAW, "int"))
    add_product(stage, "half.exr", ("c", "color", RAW, "color3h"), ("a", "alpha", RAW, "half"))
    add_product(stage, "float.exr", ("f", "color", RAW, "color3f"), ("id", "primId", RAW, "float"))
    folder = record(stage, "--filter", "box", "--filterRadius", "0.5")
    ids, half, single = (read(folder / f"{name}.exr")[1] for name in ("ids", "half", "float"))
    assert {p.dtype for p in ids.values()} == {np.dtype(np.uint32)}
    assert {p.dtype for p in half.values()} == {np.dtype(np.float16)}
    assert {p.dtype for p in single.values()} == {np.dtype(np.float32)}
    expected = single["id"].astype(np.int64).astype(np.uint32)  # -1: the largest
    assert np.array_equal(ids["prim"], expected) and len(np.unique(expected)) == 3
    assert all(np.array_equal(half[c], single[c].astype(np.float16)) for c in "RGB") and half["R"].any()


def test_primvars_that_no_material_reads(stage: Usd.Stage) -> None:
    card = stage.GetPrimAtPath("/Card")
    wear = UsdGeom.PrimvarsAPI(card).CreatePrimvar("wear", Sdf.ValueTypeNames.Float, "constant")
    wear.Set(0.625)
    UsdGeom.Mesh(card).CreateDisplayColorAttr(Vt.Vec3fArray([(0.25, 0.5, 0.75)]))
    add_product(
        stage,
        "a.exr",
        ("wear", "wear", "primvar", "float"),
        ("color", "displayColor", "primvar", "color3f"),
        ("nothing", "nothing", "primvar", "float"),
    )
    found = read(record(stage) / "a.exr")[1]
    assert found["wear"][24, 8] == pytest.approx(0.625)
    assert [found[f"color.{c}"][24, 8] for c in "RGB"] == pytest.approx([0.25, 0.5, 0.75])
    assert not found["nothing"].any() and not found["wear"][:, 48:].any()
