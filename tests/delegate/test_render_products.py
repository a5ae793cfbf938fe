"""What a run renders and where it writes it: flags, settings, products and their names."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from encore.errors import ExitCode, SettingError, UsageError
from encore.frames import expand_product_name
from encore.record_options import RecordOptions
from encore.render_products import FrameJob, plan_first, plan_run
from encore.report import Reports
from encore.working_space import working_space
from pxr import Gf, Sdf, Usd, UsdGeom, UsdRender


@pytest.fixture
def settings(stage: Usd.Stage) -> UsdRender.Settings:
    """RenderSettings of 100 x 50 pixels with a camera, which the stage names."""
    UsdGeom.Camera.Define(stage, "/Camera")
    made = UsdRender.Settings.Define(stage, "/Render/Settings")
    made.CreateCameraRel().SetTargets(["/Camera"])
    made.CreateResolutionAttr(Gf.Vec2i(100, 50))
    stage.SetMetadata("renderSettingsPrimPath", "/Render/Settings")
    return made


def add_product(settings: UsdRender.Settings, name: str, file: str = "") -> UsdRender.Product:
    product = UsdRender.Product.Define(settings.GetPrim().GetStage(), f"/Render/{name}")
    product.CreateProductNameAttr(file or f"{name}.exr")
    settings.CreateProductsRel().AddTarget(product.GetPath())
    return product


def add_var(
    product: UsdRender.Product, name: str, source: str, kind: str = "raw", data: str = "color3f"
) -> None:
    var = UsdRender.Var.Define(product.GetPrim().GetStage(), f"/Render/Vars/{name}")
    var.CreateSourceNameAttr(source)
    var.CreateSourceTypeAttr(kind)
    var.CreateDataTypeAttr(data)
    product.CreateOrderedVarsRel().AddTarget(var.GetPath())


def plan(
    of: UsdRender.Settings, output: str, reports: Reports | None = None, **options: Any
) -> list[FrameJob]:
    """Of the settings' stage. options: fields of RecordOptions."""
    flags = RecordOptions(stage="a.usda", output=output, **options)
    return plan_run(flags, of.GetPrim().GetStage(), Reports() if reports is None else reports)


def files(jobs: list[FrameJob]) -> list[list[list[str]]]:
    """By frame and render."""
    return [[[file.path for file in render.files] for render in job.renders] for job in jobs]


# --- Flags, settings and defaults --------------------------------------------------------------------


def test_without_settings_flags_decide(settings: UsdRender.Settings) -> None:
    add_product(settings, "A")
    (job,) = plan(settings, "a.exr", render_settings="none", settings={"width": 64})
    (render,) = job.renders
    assert (render.film.width, render.film.height, render.window) == (64, None, None)
    assert render.film.conform_policy == "adjustApertureHeight"
    assert render.sync["camera"] == "" and render.sync["purposes"] == ("default", "proxy")
    assert dict(render.source) == {}
    assert render.files[0].selection is None


def test_settings_without_products_are_an_image_of_their_own(settings: UsdRender.Settings) -> None:
    (job,) = plan(settings, "a.exr")
    (render,) = job.renders
    assert (render.film.width, render.film.height) == (100, 50)
    assert render.film.conform_policy == "expandAperture"
    assert render.sync["camera"] == "/Camera"
    assert render.sync["purposes"] == ("default", "render")
    assert render.sync["material_purposes"] == ("full", "")
    assert render.source == {"encore:renderSettings": "/Render/Settings", "encore:flags": "[]"}
    assert files([job]) == [[["a.exr"]]]
    with pytest.raises(UsageError, match="/Render/Settings has no products"):
        plan(settings, "-")


def test_flags_win_over_products_those_over_settings_and_those_over_defaults(
    settings: UsdRender.Settings,
) -> None:
    prim = settings.GetPrim()
    for name, value in (("samples", 2), ("lightSamples", 3), ("maxBounces", 1)):
        prim.CreateAttribute(f"encore:{name}", Sdf.ValueTypeNames.Int).Set(value)
    product = add_product(settings, "A").GetPrim()
    product.CreateAttribute("encore:samples", Sdf.ValueTypeNames.Int).Set(5)
    product.CreateAttribute("encore:maxBounces", Sdf.ValueTypeNames.Int).Set(7)
    (job,) = plan(settings, "a.exr", settings={"max_bounces": 9})
    found = job.renders[0].settings
    assert (found["max_bounces"], found["samples"], found["light_samples"]) == (9, 5, 3)
    assert found["occlusion_samples"] == 64
    assert json.loads(job.renders[0].source["encore:flags"]) == ["--maxBounces"]


def test_a_flag_that_is_given_wins_even_with_the_default(settings: UsdRender.Settings) -> None:
    settings.GetPrim().CreateAttribute("encore:samples", Sdf.ValueTypeNames.Int).Set(2)
    (job,) = plan(settings, "a.exr", settings={"samples": 8})
    assert job.renders[0].settings["samples"] == 8
    (job,) = plan(settings, "a.exr", purposes=("proxy",), camera="/Other", motion_blur=False)
    sync = job.renders[0].sync
    assert sync["purposes"] == ("default", "proxy")
    assert sync["camera"] == "/Other"
    assert not sync["shutter"].motion_blur and sync["depth_of_field"]
    flags = json.loads(job.renders[0].source["encore:flags"])
    assert flags == ["--camera", "--disableMotionBlur", "--purposes"]


@pytest.mark.parametrize(
    ("flags", "size"),
    [
        ({}, (100, 50)),
        ({"width": 40}, (40, 20)),
        ({"height": 10}, (20, 10)),
        ({"width": 40, "height": 40}, (40, 40)),
        ({"width": 1}, (1, 1)),
    ],
)
def test_image_size_of_flags(
    settings: UsdRender.Settings, flags: dict[str, int], size: tuple[int, int]
) -> None:
    (job,) = plan(settings, "a.exr", settings=flags)
    render = job.renders[0]
    assert (render.film.width, render.film.height) == size
    assert (render.settings["width"], render.settings["height"]) == size


def test_what_is_disabled_stays_disabled(settings: UsdRender.Settings) -> None:
    settings.CreateDisableMotionBlurAttr(True)
    settings.CreateDisableDepthOfFieldAttr(True)
    (job,) = plan(settings, "a.exr")
    assert not job.renders[0].sync["shutter"].motion_blur
    assert not job.renders[0].sync["depth_of_field"]


def test_edges_are_halved_by_complexity_whoever_says_how_long_they_are(settings: UsdRender.Settings) -> None:
    settings.GetPrim().CreateAttribute("encore:edgeLengthScale", Sdf.ValueTypeNames.Float).Set(2.0)
    (job,) = plan(settings, "a.exr", complexity="high")
    assert job.renders[0].settings["edge_length_scale"] == 0.5


def test_settings_that_contradict_each_other_name_the_prim(settings: UsdRender.Settings) -> None:
    settings.GetPrim().CreateAttribute("encore:search", Sdf.ValueTypeNames.Token).Set("cells")
    with pytest.raises(SettingError, match=r"^/Render/Settings: with --search, 'cells' does not know"):
        plan(settings, "a.exr", settings={"reuse_time_weight": 1.0})
    with pytest.raises(SettingError, match=r"^--samples: 0 is out of range"):
        plan(settings, "a.exr", settings={"samples": 0})


# --- Windows -----------------------------------------------------------------------------------------


def test_data_windows(settings: UsdRender.Settings) -> None:
    attribute = settings.CreateDataWindowNDCAttr(Gf.Vec4f(0, 0, 1, 1))
    assert plan(settings, "a.exr")[0].renders[0].window is None, "all of it is no window"
    attribute.Set(Gf.Vec4f(0.5, 0.0, 1.0, 0.5))
    assert plan(settings, "a.exr")[0].renders[0].window == (50, 25, 100, 50)
    attribute.Set(Gf.Vec4f(-0.1, -0.1, 1.1, 1.1))
    assert plan(settings, "a.exr")[0].renders[0].window == (-10, -5, 110, 55)
    attribute.Set(Gf.Vec4f(0.5, 0.5, 0.501, 1.0))
    with pytest.raises(SettingError, match=r"/Render/Settings\.dataWindowNDC: .* no pixel's centre"):
        plan(settings, "a.exr")
    attribute.Set(Gf.Vec4f(-1000, 0, 1, 1))
    with pytest.raises(SettingError, match=r"/Render/Settings\.dataWindowNDC: .* out of range"):
        plan(settings, "a.exr")


# --- Products ----------------------------------------------------------------------------------------


def test_products_that_differ_in_what_they_hold_only_are_one_render(settings: UsdRender.Settings) -> None:
    for name in "ABC":
        add_product(settings, name)
    stage = settings.GetPrim().GetStage()
    products = {name: UsdRender.Product.Get(stage, f"/Render/{name}") for name in "ABC"}
    add_var(products["A"], "Point", "P")
    add_var(products["A"], "st", "st", "primvar", "float2")
    add_var(products["C"], "Id", "primId", data="int")
    products["C"].CreateOrderedVarsRel().AddTarget("/Render/Vars/Point")
    assert files(plan(settings, "-")) == [[["A.exr", "B.exr", "C.exr"]]]
    (render,) = plan(settings, "-")[0].renders
    assert [aov.kind for aov in render.aovs] == ["position", "primvar", "primId"]
    assert render.sync["aov_primvars"] == (("st", 2),)
    products["B"].CreateDataWindowNDCAttr(Gf.Vec4f(0, 0, 0.5, 0.5))
    jobs = plan(settings, "-")
    assert files(jobs) == [[["A.exr", "C.exr"], ["B.exr"]]]
    first, second = jobs[0].renders
    assert first.sync == second.sync, "so that one translation serves both"
    assert second.aovs == ()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("Resolution", Gf.Vec2i(50, 25)),
        ("PixelAspectRatio", 2.0),
        ("AspectRatioConformPolicy", "cropAperture"),
        ("DisableMotionBlur", True),
        ("DisableDepthOfField", True),
    ],
)
def test_products_that_differ_in_more_are_renders_of_their_own(
    settings: UsdRender.Settings, name: str, value: Any
) -> None:
    add_product(settings, "A")
    getattr(add_product(settings, "B"), f"Create{name}Attr")(value)
    assert files(plan(settings, "-")) == [[["A.exr"], ["B.exr"]]]


def test_cameras_of_products(settings: UsdRender.Settings) -> None:
    UsdGeom.Camera.Define(settings.GetPrim().GetStage(), "/Right")
    add_product(settings, "A")
    add_product(settings, "B").CreateCameraRel().SetTargets(["/Right"])
    left, right = plan(settings, "-")[0].renders
    assert (left.sync["camera"], right.sync["camera"]) == ("/Camera", "/Right")
    assert len(plan(settings, "-", camera="/Camera")[0].renders) == 1


@pytest.mark.parametrize("target", ["/World", "/Nope", "/Off"])
def test_a_camera_that_is_none_matters_where_it_is_used(settings: UsdRender.Settings, target: str) -> None:
    stage = settings.GetPrim().GetStage()
    UsdGeom.Camera.Define(stage, "/Off").GetPrim().SetActive(False)
    settings.GetCameraRel().SetTargets([target])
    products = [add_product(settings, name) for name in "AB"]
    products[0].CreateCameraRel().SetTargets(["/Camera"])
    with pytest.raises(
        SettingError, match=rf"^/Render/Settings\.camera: {target} is .*\. Name a Camera prim$"
    ):
        plan(settings, "-")
    (render,) = plan(settings, "-", camera="/Camera")[0].renders
    assert render.sync["camera"] == "/Camera"
    flags = RecordOptions(stage="a.usda", output="", camera="/Camera")
    assert plan_first(flags, stage, Usd.TimeCode(1), Reports()).sync["camera"] == "/Camera"
    products[1].CreateCameraRel().SetTargets(["/Camera"])
    assert [r.sync["camera"] for r in plan(settings, "-")[0].renders] == ["/Camera"]
    products[1].GetCameraRel().SetTargets([target])
    with pytest.raises(SettingError, match=rf"^/Render/B\.camera: {target} is"):
        plan(settings, "-")


def test_a_camera_that_the_mask_leaves_out(settings: UsdRender.Settings) -> None:
    root = settings.GetPrim().GetStage().GetRootLayer()
    masked = Usd.Stage.OpenMasked(root, Usd.StagePopulationMask(["/Render", "/World"]))
    left = UsdRender.Settings.Get(masked, settings.GetPath())
    with pytest.raises(SettingError, match=r"^/Render/Settings\.camera: /Camera is .*\. Add it to --mask$"):
        plan(left, "a.exr")
    assert plan(left, "a.exr", camera="/World/Camera")[0].renders[0].sync["camera"] == "/World/Camera"


# --- Names -------------------------------------------------------------------------------------------


def test_one_product_is_written_to_output(settings: UsdRender.Settings) -> None:
    add_product(settings, "A", "elsewhere/a.exr")
    assert files(plan(settings, "b.exr")) == [[["b.exr"]]]
    assert files(plan(settings, "b.##.exr", frames="1:2")) == [[["b.01.exr"]], [["b.02.exr"]]]


def test_names_are_relative_to_a_folder(settings: UsdRender.Settings, tmp_path: Path) -> None:
    add_product(settings, "A", "sub/a.exr")
    add_product(settings, "B", "/abs/b.png")
    for output, folder in (("-", ""), ("out/", "out/"), (str(tmp_path), f"{tmp_path}/")):
        assert files(plan(settings, output)) == [[[f"{folder}sub/a.exr", "/abs/b.png"]]]


def test_as_many_names_as_products(settings: UsdRender.Settings) -> None:
    add_product(settings, "A")
    add_product(settings, "B")
    assert files(plan(settings, "x.exr, y.png")) == [[["x.exr", "y.png"]]]
    with pytest.raises(
        UsageError, match=r"'x.exr' does not name the 2 products of /Render/Settings.*a folder or -"
    ):
        plan(settings, "x.exr")


def test_names_by_frame(settings: UsdRender.Settings) -> None:
    add_product(settings, "A", "a.<F4>.exr")
    named = add_product(settings, "B").GetProductNameAttr()
    for frame in (1, 2):
        named.Set(f"b_{'ab'[frame - 1]}.exr", frame)
    found = files(plan(settings, "-", frames="1:2"))
    assert found == [[["a.0001.exr", "b_a.exr"]], [["a.0002.exr", "b_b.exr"]]]


@pytest.mark.parametrize(
    ("name", "time", "expected"),
    [
        ("a.exr", 7, "a.exr"),
        ("a.####.exr", 7, "a.0007.exr"),
        ("a.#.exr", 1234, "a.1234.exr"),
        ("a.##.##.exr", 7.25, "a.07.25.exr"),
        ("####/a.####.exr", 7, "0007/a.0007.exr"),
        ("a.$F.exr", 7, "a.7.exr"),
        ("a.$F4.exr", 7, "a.0007.exr"),
        ("a.${F4}.exr", 7, "a.0007.exr"),
        ("a.<F>.exr", 7, "a.7.exr"),
        ("a.<F4>.exr", -7, "a.-007.exr"),
        ("a.%04d.exr", 7, "a.0007.exr"),
        ("a.%d.exr", 7, "a.7.exr"),
        ("a$FOO.exr", 7, "a$FOO.exr"),
    ],
)
def test_placeholders(name: str, time: float, expected: str) -> None:
    assert expand_product_name(name, Usd.TimeCode(time), "/P.productName") == expected


def test_placeholders_that_do_not_fit_the_time() -> None:
    with pytest.raises(
        SettingError, match=r"/P\.productName: '<F4>' .* no place for the decimals of frame 1\.5"
    ):
        expand_product_name("a.<F4>.exr", Usd.TimeCode(1.5), "/P.productName")
    with pytest.raises(SettingError, match="default time has no number"):
        expand_product_name("a.####.exr", Usd.TimeCode.Default(), "/P.productName")


@pytest.mark.parametrize("digits", ["65", "2000000000", "9" * 5000])
@pytest.mark.parametrize("form", ["<F{}>", "${{F{}}}", "%0{}d", "%{}d"])
def test_placeholders_have_a_largest_width(form: str, digits: str) -> None:
    with pytest.raises(SettingError, match=r"^/P\.productName: its frame placeholder is wider than 64"):
        expand_product_name(f"o.{form.format(digits)}.exr", Usd.TimeCode(7), "/P.productName")
    widest = expand_product_name(f"{form.format('00064')}.exr", Usd.TimeCode(7), "/P.productName")
    assert widest == f"{'7':0>64}.exr"


def test_hashes_have_a_largest_width() -> None:
    with pytest.raises(SettingError, match="wider than 64"):
        expand_product_name("#" * 65, Usd.TimeCode(7), "/P.productName")
    assert len(expand_product_name("#" * 64, Usd.TimeCode(7), "/P.productName")) == 64


def test_files_that_would_overwrite_each_other(settings: UsdRender.Settings) -> None:
    product = add_product(settings, "A")
    with pytest.raises(
        SettingError, match=r"/Render/A\.productName: frames 1 and 2 would both be written to A\.exr"
    ):
        plan(settings, "-", frames="1:2")
    add_product(settings, "B", "./A.exr")
    with pytest.raises(SettingError, match=r"/Render/B\.productName: /Render/A and it would both"):
        plan(settings, "-")
    product.GetProductNameAttr().Set("")
    with pytest.raises(SettingError, match=r"/Render/A\.productName: it is empty"):
        plan(settings, "-")
    product.GetProductNameAttr().Set("a.tif")
    with pytest.raises(SettingError, match=r"'a\.tif' is no image that can be written\. Use \.exr or \.png"):
        plan(settings, "-")


@pytest.mark.parametrize("second", ["sub/../p.exr", "{}/p.exr", "link/p.exr"])
def test_one_file_by_two_names(
    settings: UsdRender.Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, second: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sub").mkdir()
    (tmp_path / "link").symlink_to(tmp_path)
    add_product(settings, "A", "p.exr")
    add_product(settings, "B", second.format(tmp_path))
    with pytest.raises(
        SettingError, match=r"/Render/B\.productName: /Render/A and it would both be written to"
    ):
        plan(settings, "-")


def test_links_of_folders_are_followed(settings: UsdRender.Settings, tmp_path: Path) -> None:
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "a" / "b")
    add_product(settings, "A", "p.exr")
    add_product(settings, "B", "link/../p.exr")  # a/p.exr
    assert len(plan(settings, f"{tmp_path}/")[0].renders[0].files) == 2


def test_png_holds_the_first_picture(settings: UsdRender.Settings) -> None:
    product = add_product(settings, "A", "a.png")
    add_var(product, "Depth", "depth", data="float")
    with pytest.raises(SettingError, match=r"/Render/A\.orderedVars: none of its variables is a picture"):
        plan(settings, "-")
    add_var(product, "Beauty", "color")
    reports = Reports()
    (file,) = plan(settings, "-", reports)[0].renders[0].files
    assert file.selection is not None
    assert [channel.names for channel in file.selection.channels] == [("R", "G", "B"), ("A",)]
    assert "/Render/Vars/Beauty only" in reports.lines()[0]


# --- Passes and working spaces -----------------------------------------------------------------------


def test_a_pass_names_its_settings(settings: UsdRender.Settings) -> None:
    stage = settings.GetPrim().GetStage()
    UsdGeom.Cube.Define(stage, "/World/Cube")
    render_pass = UsdRender.Pass.Define(stage, "/Render/Pass")
    render_pass.CreateRenderSourceRel().SetTargets(["/Render/Settings"])
    Usd.CollectionAPI(render_pass.GetPrim(), "prune").CreateIncludesRel().SetTargets(["/World/Cube"])
    stage.ClearMetadata("renderSettingsPrimPath")
    (job,) = plan(settings, "a.exr", render_pass="/Render/Pass")
    assert job.renders[0].source["encore:renderPass"] == "/Render/Pass"
    assert job.renders[0].source["encore:renderSettings"] == "/Render/Settings"
    assert not stage.GetPrimAtPath("/World/Cube").IsActive()
    with pytest.raises(UsageError) as caught:
        plan(settings, "a.exr", render_pass="/Render/Pass", render_settings="/Render/Settings")
    assert caught.value.exit_code == ExitCode.USAGE


def test_the_first_render_alone(settings: UsdRender.Settings) -> None:
    product = add_product(settings, "A")
    add_var(product, "st", "st", "primvar")
    options = RecordOptions(stage="a.usda", output="")
    render = plan_first(options, settings.GetPrim().GetStage(), Usd.TimeCode(1), Reports())
    assert render.sync_options()["aov_primvars"] == (("st", 3),)
    assert (render.sync_options()["width"], render.sync_options()["conform_policy"]) == (
        100,
        "expandAperture",
    )


@pytest.mark.parametrize(
    "name", ["", "lin_rec709_scene", "raw", "identity", "Linear Rec.709 (sRGB)", "lin_srgb"]
)
def test_linear_rec709_needs_no_conversion(name: str) -> None:
    reports = Reports()
    space = working_space(name, "/R", reports)
    assert space.apply is None and not len(reports)
    assert space.chromaticities[:2] == (0.64, 0.33)


# Row by row: the matrices of the ACES Input Device Transforms (S-2014-004) and of ITU-R BT.2087.
MATRICES = {
    "lin_ap1_scene": [
        [0.613097, 0.339523, 0.047379],
        [0.070194, 0.916354, 0.013452],
        [0.020616, 0.109570, 0.869815],
    ],
    "lin_rec2020_scene": [
        [0.627404, 0.329283, 0.043313],
        [0.069097, 0.919540, 0.011362],
        [0.016391, 0.088013, 0.895595],
    ],
}


@pytest.mark.parametrize("name", MATRICES)
def test_images_are_converted_to_other_linear_spaces(name: str) -> None:
    reports = Reports()
    space = working_space(name, "/R", reports)
    assert (
        pytest.approx(np.array(MATRICES[name]), abs=2e-5) == space.map(np.eye(3, dtype=np.float32)[None])[0].T
    )
    assert space.map(np.full((1, 1, 3), 2, np.float32)) == pytest.approx(2, abs=1e-4), "white stays white"
    assert "converted to" in reports.lines()[0] and not reports.has_errors


def test_other_spaces_are_reported() -> None:
    for name in ("srgb_rec709_scene", "g22_ap1_scene", "nonsense"):
        reports = Reports()
        assert working_space(name, "/R", reports).apply is None
        assert reports.has_errors and name in reports.lines()[0]
