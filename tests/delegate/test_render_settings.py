"""What RenderSettings and RenderProducts say, and in what image it results."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from encore.adapters.camera import CameraData, Film, FilmOptions, conform
from encore.errors import SettingError, StageError
from encore.render_settings import (
    POLICIES,
    RenderSpec,
    data_window,
    find_settings,
    read_settings,
)
from encore.report import Reports
from encore.settings import STAGE_SETTINGS
from pxr import Gf, Sdf, Usd, UsdGeom, UsdRender

TIME = Usd.TimeCode(1)


@pytest.fixture
def settings(stage: Usd.Stage) -> UsdRender.Settings:
    """RenderSettings with a camera."""
    UsdGeom.Camera.Define(stage, "/Camera")
    made = UsdRender.Settings.Define(stage, "/Render/Settings")
    made.CreateCameraRel().SetTargets(["/Camera"])
    return made


def add_product(settings: UsdRender.Settings, name: str = "Beauty", **attributes: Any) -> UsdRender.Product:
    stage = settings.GetPrim().GetStage()
    product = UsdRender.Product.Define(stage, f"/Render/{name}")
    product.CreateProductNameAttr(f"{name}.exr")
    for attribute, value in attributes.items():
        getattr(product, f"Create{attribute}Attr")(value)
    settings.CreateProductsRel().AddTarget(product.GetPath())
    return product


def author(prim: Usd.Prim, name: str, kind: Sdf.ValueTypeName, value: Any) -> None:
    """Gives an attribute of the schema a value of another type, as files can."""
    spec = prim.GetStage().GetRootLayer().GetPrimAtPath(prim.GetPath())
    Sdf.AttributeSpec(spec, name, kind).default = value


def read(settings: UsdRender.Settings, reports: Reports | None = None) -> RenderSpec:
    return read_settings(settings, TIME, Reports() if reports is None else reports)


# --- Which settings ----------------------------------------------------------------------------------


def test_the_stage_names_its_settings_and_a_path_wins(settings: UsdRender.Settings) -> None:
    stage, reports = settings.GetPrim().GetStage(), Reports()
    assert find_settings(stage, "", reports) is None
    UsdRender.Settings.Define(stage, "/Render/Other")
    stage.SetMetadata("renderSettingsPrimPath", "/Render/Other")
    for path, expected in (("", "/Render/Other"), ("/Render/Settings", "/Render/Settings")):
        found = find_settings(stage, path, reports)
        assert found is not None and found.GetPath() == expected
    assert find_settings(stage, "none", reports) is None
    assert not len(reports)


@pytest.mark.parametrize("path", ["/World", "/Nope", "Settings", "not a path", "/Render/Settings.products"])
def test_what_is_no_settings_prim(settings: UsdRender.Settings, path: str) -> None:
    stage, reports = settings.GetPrim().GetStage(), Reports()
    with pytest.raises(StageError, match=r"Choose one of: /Render/Settings"):
        find_settings(stage, path, reports)
    stage.SetMetadata("renderSettingsPrimPath", path)
    assert find_settings(stage, "", reports) is None
    assert reports.has_errors


# --- What they say -----------------------------------------------------------------------------------


def test_fallbacks_are_those_of_the_schema(settings: UsdRender.Settings) -> None:
    spec = read(settings)
    assert (spec.path, spec.purposes, spec.material_purposes) == (
        "/Render/Settings",
        ("default", "render"),
        ("full", ""),
    )
    (product,) = spec.products
    assert (product.path, product.camera, product.resolution) == ("", "/Camera", (2048, 1080))
    assert (product.pixel_aspect_ratio, product.conform_policy) == (1.0, "expandAperture")
    assert product.window_ndc == (0, 0, 1, 1)
    assert product.motion_blur and product.depth_of_field
    assert dict(product.encore) == {} and product.vars == ()


def test_products_have_what_settings_say_but_for_what_they_author(settings: UsdRender.Settings) -> None:
    stage = settings.GetPrim().GetStage()
    UsdGeom.Camera.Define(stage, "/Other")
    settings.CreateResolutionAttr(Gf.Vec2i(100, 50))
    settings.CreatePixelAspectRatioAttr(2.0)
    settings.CreateAspectRatioConformPolicyAttr("cropAperture")
    settings.CreateDataWindowNDCAttr(Gf.Vec4f(0, 0, 0.5, 0.5))
    settings.CreateDisableMotionBlurAttr(True)
    settings.CreateDisableDepthOfFieldAttr(True)
    add_product(settings, "Same")
    other = add_product(
        settings,
        "Other",
        Resolution=Gf.Vec2i(10, 20),
        PixelAspectRatio=1.0,
        AspectRatioConformPolicy="adjustApertureWidth",
        DataWindowNDC=Gf.Vec4f(-1, -1, 2, 2),
        DisableMotionBlur=False,
        DisableDepthOfField=False,
    )
    other.CreateCameraRel().SetTargets(["/Other"])
    same, changed = read(settings).products
    assert (same.path, same.name, same.camera) == ("/Render/Same", "Same.exr", "/Camera")
    assert (same.resolution, same.pixel_aspect_ratio) == ((100, 50), 2.0)
    assert (same.conform_policy, same.window_ndc) == ("cropAperture", (0, 0, 0.5, 0.5))
    assert not same.motion_blur and not same.depth_of_field
    assert (changed.camera, changed.resolution, changed.pixel_aspect_ratio) == ("/Other", (10, 20), 1.0)
    assert (changed.conform_policy, changed.window_ndc) == ("adjustApertureWidth", (-1, -1, 2, 2))
    assert changed.motion_blur and changed.depth_of_field


def test_instantaneous_shutter_is_no_motion_blur(settings: UsdRender.Settings) -> None:
    settings.CreateInstantaneousShutterAttr(True)
    assert not read(settings).products[0].motion_blur


def test_values_may_vary_with_time(settings: UsdRender.Settings) -> None:
    name = add_product(settings).GetProductNameAttr()
    for frame in (1, 2):
        name.Set(f"a.{frame}.exr", frame)
    for frame in (1, 2):
        spec = read_settings(settings, Usd.TimeCode(frame), Reports())
        assert spec.products[0].name == f"a.{frame}.exr"


def test_variables_in_their_order(settings: UsdRender.Settings) -> None:
    stage, product = settings.GetPrim().GetStage(), add_product(settings)
    depth = UsdRender.Var.Define(stage, "/Render/Depth")
    depth.CreateSourceNameAttr("depth")
    depth.CreateDataTypeAttr("float")
    beauty = UsdRender.Var.Define(stage, "/Render/Beauty/C")
    beauty.CreateSourceNameAttr("C.*")
    beauty.CreateSourceTypeAttr("lpe")
    beauty.GetPrim().CreateAttribute("driver:parameters:aov:name", Sdf.ValueTypeNames.String).Set("total")
    unnamed = UsdRender.Var.Define(stage, "/Render/Peye")
    paths = [depth.GetPath(), beauty.GetPath(), unnamed.GetPath()]
    product.CreateOrderedVarsRel().SetTargets(paths)
    first, second, third = read(settings).products[0].vars
    assert (first.name, first.data_type, first.source_type) == ("Depth", "float", "raw")
    assert (second.source_name, second.source_type, second.channel) == ("C.*", "lpe", "total")
    assert (third.source_name, third.data_type) == ("Peye", ""), "its own name, and no type of its own"


def test_encores_own_settings(settings: UsdRender.Settings) -> None:
    values = {"encore:samples": 3, "encore:shadingRate": 0.5, "encore:filter": "box", "encore:memory": 2**33}
    values |= {"encore:energyCompensation": False, "encore:seed": 2**32 - 1}
    for name, value in values.items():
        kind = Sdf.ValueTypeNames.Find(STAGE_SETTINGS[name].usd_type_name)
        settings.GetPrim().CreateAttribute(name, kind).Set(value)
    product = add_product(settings).GetPrim()
    product.CreateAttribute("encore:samples", Sdf.ValueTypeNames.Int).Set(5)
    add_product(settings, "Plain")
    own, plain = read(settings).products
    assert plain.encore == {
        "samples": 3,
        "shading_rate": 0.5,
        "filter": "box",
        "memory_budget_bytes": 2**33,
        "energy_compensation": False,
        "seed": 2**32 - 1,
    }
    assert own.encore == {**plain.encore, "samples": 5}


# --- What cannot be used -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("attribute", "value", "message"),
    [
        ("Resolution", Gf.Vec2i(0, 10), r"\.resolution: \(0, 10\) .* from 1 to 65536"),
        ("Resolution", Gf.Vec2i(10, 65537), r"\.resolution: \(10, 65537\)"),
        ("PixelAspectRatio", 0.0, r"\.pixelAspectRatio: 0\.0 is out of range"),
        ("PixelAspectRatio", math.nan, r"\.pixelAspectRatio: nan"),
        (
            "AspectRatioConformPolicy",
            "stretch",
            r"\.aspectRatioConformPolicy: 'stretch' .*adjustPixelAspectRatio",
        ),
        ("DataWindowNDC", Gf.Vec4f(0, 0, 0, 1), r"\.dataWindowNDC: .* xmin < xmax"),
        ("DataWindowNDC", Gf.Vec4f(0, 1, 1, 0), r"\.dataWindowNDC"),
        ("DataWindowNDC", Gf.Vec4f(0, 0, math.inf, 1), r"\.dataWindowNDC"),
    ],
)
def test_values_out_of_range(settings: UsdRender.Settings, attribute: str, value: Any, message: str) -> None:
    for schema in (settings, add_product(settings)):
        getattr(schema, f"Create{attribute}Attr")(value)
        with pytest.raises(SettingError, match=f"^{schema.GetPath()}{message}") as caught:
            read(settings)
        assert caught.value.exit_code == 4
        getattr(schema, f"Get{attribute}Attr")().Clear()


@pytest.mark.parametrize(
    ("name", "kind", "value", "message"),
    [
        ("samples", "Int", 65, "65 is out of range. It must be at least 1, at most 64"),
        ("samples", "Float", 2.5, "2.5 is out of range. It must be of type int: at least 1"),
        ("samples", "Bool", True, "True is out of range"),
        ("shadingRate", "Float", math.nan, "nan is out of range"),
        ("shadingRate", "String", "high", "high is out of range"),
        ("filter", "Token", "sinc", "box or gaussian or mitchell or blackman-harris"),
        ("reuseTile", "Int", 100, "a multiple of 16"),
        ("debugAovs", "Token", "on", "on is out of range"),
        ("memory", "Int64", -1, "-1 is out of range"),
    ],
)
def test_bad_settings_name_prim_attribute_and_range(
    settings: UsdRender.Settings, name: str, kind: str, value: Any, message: str
) -> None:
    prim = settings.GetPrim()
    prim.CreateAttribute(f"encore:{name}", getattr(Sdf.ValueTypeNames, kind)).Set(value)
    with pytest.raises(SettingError) as caught:
        read(settings)
    assert str(caught.value).startswith(f"/Render/Settings.encore:{name}: ")
    assert message in str(caught.value)


@pytest.mark.parametrize("size", [(math.inf, 48), (64.7, 48), (math.nan, 48), (64, 48, 1)])
def test_resolutions_are_two_whole_finite_numbers(
    settings: UsdRender.Settings, size: tuple[float, ...]
) -> None:
    kind = Sdf.ValueTypeNames.Float2 if len(size) == 2 else Sdf.ValueTypeNames.Float3
    author(settings.GetPrim(), "resolution", kind, kind.type.pythonClass(*size))
    with pytest.raises(SettingError, match=r"/Render/Settings\.resolution: .* It must be two whole numbers"):
        read(settings)


def test_whole_numbers_may_be_of_another_type(settings: UsdRender.Settings) -> None:
    author(settings.GetPrim(), "resolution", Sdf.ValueTypeNames.Float2, Gf.Vec2f(64, 48))
    assert read(settings).products[0].resolution == (64, 48)


@pytest.mark.parametrize("name", ["includedPurposes", "materialBindingPurposes"])
@pytest.mark.parametrize(
    ("kind", "value", "shown"), [("Int", 1, "1"), ("String", "render", "render"), ("IntArray", [1], r"\[1\]")]
)
def test_purposes_are_lists(
    settings: UsdRender.Settings, name: str, kind: str, value: Any, shown: str
) -> None:
    author(settings.GetPrim(), name, getattr(Sdf.ValueTypeNames, kind), value)
    with pytest.raises(SettingError, match=rf"\.{name}: {shown} .* It must be a list of tokens"):
        read(settings)


def test_time_samples_say_nothing_at_the_default_time(settings: UsdRender.Settings) -> None:
    settings.CreateResolutionAttr(Gf.Vec2i(100, 50))
    product = add_product(settings)
    product.CreateResolutionAttr().Set(Gf.Vec2i(10, 5), 1)
    product.CreateInstantaneousShutterAttr().Set(True, 1)
    product.GetPrim().CreateAttribute("encore:samples", Sdf.ValueTypeNames.Int).Set(3, 1)
    settings.CreatePixelAspectRatioAttr().Block()
    (still,) = read_settings(settings, Usd.TimeCode.Default(), Reports()).products
    assert (still.resolution, still.motion_blur, dict(still.encore)) == ((100, 50), True, {})
    assert still.pixel_aspect_ratio == 1, "a blocked value is none either"
    (moving,) = read(settings).products
    assert (moving.resolution, moving.motion_blur, moving.encore) == ((10, 5), False, {"samples": 3})


def test_unknown_settings_are_reported_with_what_was_meant(settings: UsdRender.Settings) -> None:
    settings.GetPrim().CreateAttribute("encore:sample", Sdf.ValueTypeNames.Int).Set(3)
    settings.GetPrim().CreateAttribute("other:sample", Sdf.ValueTypeNames.Int).Set(3)
    reports = Reports()
    read(settings, reports)
    (report,) = reports.errors
    assert "did you mean encore:samples?" in report.line()


def test_targets_that_are_something_else(settings: UsdRender.Settings) -> None:
    product = add_product(settings)
    settings.GetProductsRel().AddTarget("/World")
    settings.GetProductsRel().AddTarget("/Nope")
    var = UsdRender.Var.Define(settings.GetPrim().GetStage(), "/Render/Var")
    product.CreateOrderedVarsRel().SetTargets(["/Gone", var.GetPath()])
    reports = Reports()
    spec = read(settings, reports)
    assert [p.path for p in spec.products] == ["/Render/Beauty"]
    assert [v.path for v in spec.products[0].vars] == ["/Render/Var"]
    assert {r.kind for r in reports.errors} == {"bad product", "bad render var"}
    product.GetOrderedVarsRel().SetTargets(["/Gone"])
    with pytest.raises(
        SettingError,
        match=r"/Render/Beauty\.orderedVars: none of its variables exists\. /Gone: is no RenderVar",
    ):
        read(settings)


def test_what_is_deactivated_is_not_there(settings: UsdRender.Settings) -> None:
    stage, product = settings.GetPrim().GetStage(), add_product(settings)
    off = add_product(settings, "Off").GetPrim()
    variables = [UsdRender.Var.Define(stage, f"/Render/{name}").GetPrim() for name in ("Var", "OffVar")]
    product.CreateOrderedVarsRel().SetTargets([var.GetPath() for var in variables])
    off.SetActive(False)
    variables[1].SetActive(False)
    reports = Reports()
    spec = read(settings, reports)
    assert [p.path for p in spec.products] == ["/Render/Beauty"]
    assert [v.path for v in spec.products[0].vars] == ["/Render/Var"]
    assert [line.partition(",")[0] for line in reports.lines()] == [
        "Error: /Render/Off: is deactivated",
        "Error: /Render/OffVar: is deactivated",
    ]
    variables[0].SetActive(False)
    with pytest.raises(SettingError, match=r"none of its variables exists\. /Render/OffVar: is deactivated"):
        read(settings)
    product.GetPrim().SetActive(False)
    with pytest.raises(SettingError, match=r"none of its products .*\. /Render/Off: is deactivated"):
        read(settings)
    settings.GetPrim().SetActive(False)
    with pytest.raises(StageError, match=r"^/Render/Settings: is deactivated"):
        find_settings(stage, "/Render/Settings", reports)
    stage.SetMetadata("renderSettingsPrimPath", "/Render/Settings")
    assert find_settings(stage, "", reports) is None
    assert reports.lines()[-1].startswith("Error: /Render/Settings: is deactivated")


def test_products_of_other_types_are_left_out_by_name(settings: UsdRender.Settings) -> None:
    deep = add_product(settings, "Deep", ProductType="deepRaster")
    with pytest.raises(SettingError, match=r"/Render/Settings\.products: none of its products .* deepRaster"):
        read(settings)
    add_product(settings)
    reports = Reports()
    assert [p.path for p in read(settings, reports).products] == ["/Render/Beauty"]
    assert f"{deep.GetPath()}: productType deepRaster is not supported yet" in reports.lines()[0]


def test_purposes(settings: UsdRender.Settings) -> None:
    settings.CreateIncludedPurposesAttr(["default", "guide", "mine", "guide"])
    settings.CreateMaterialBindingPurposesAttr(["preview", "allPurpose", "render"])
    reports = Reports()
    spec = read(settings, reports)
    assert spec.purposes == ("default", "guide")
    assert spec.material_purposes == ("preview", "")
    assert {r.kind for r in reports.errors} == {"bad includedPurposes", "bad materialBindingPurposes"}


# --- The data window ---------------------------------------------------------------------------------


def listed_window(ndc: tuple[float, ...], width: int, height: int) -> tuple[int, int, int, int]:
    """By asking every pixel of a large neighbourhood, in exact arithmetic, whether its centre is in."""
    x_min, y_min, x_max, y_max = map(Fraction, ndc)
    half = Fraction(1, 2)
    columns = [x for x in range(-3 * width, 4 * width) if x_min <= (x + half) / width < x_max]
    rows = [y for y in range(-3 * height, 4 * height) if y_min <= 1 - (y + half) / height < y_max]
    return columns[0], rows[0], columns[-1] + 1, rows[-1] + 1


@pytest.mark.parametrize(
    "ndc",
    [
        (0, 0, 1, 1),
        (0.25, 0.25, 0.75, 0.75),
        (0.1, 0.2, 0.3, 0.4),
        (-0.1, -0.2, 1.3, 1.4),
        (1 / 3, 1 / 7, 2 / 3, 6 / 7),
        (0.5, 0.0, 1.0, 0.5),
        (-1.5, 0.3, -0.5, 2.5),
        (0.05, 0.15, 0.95, 0.85),  # centres of pixels of 10 x 10, but for single precision
        (0.0625, 0.1875, 0.9375, 0.8125),  # exactly centres of pixels of 8 x 8
    ],
)
@pytest.mark.parametrize("size", [(8, 8), (10, 10), (7, 5), (64, 48), (33, 17)])
def test_pixels_are_in_if_their_centres_are(ndc: tuple[float, ...], size: tuple[int, int]) -> None:
    single = tuple(float(x) for x in np.asarray(ndc, np.float32))
    assert data_window(single, *size) == listed_window(single, *size)  # type: ignore[arg-type]


def test_centres_on_lower_and_left_edges_are_in() -> None:
    # Of 4 pixels, centres are at 1/8, 3/8, 5/8 and 7/8.
    assert data_window((1 / 8, 1 / 8, 5 / 8, 5 / 8), 4, 4) == (0, 2, 2, 4)


def test_windows_side_by_side_share_no_pixel_and_miss_none() -> None:
    edges = [float(x) for x in np.linspace(0, 1, 14, dtype=np.float32)]
    for width in (5, 13, 64, 101):
        columns = [data_window((a, 0, b, 1), width, 3) for a, b in itertools.pairwise(edges)]
        assert [w[0] for w in columns[1:]] == [w[2] for w in columns[:-1]]
        assert (columns[0][0], columns[-1][2]) == (0, width)
        rows = [data_window((0, a, 1, b), 3, width) for a, b in itertools.pairwise(edges)]
        assert [w[3] for w in rows[1:]] == [w[1] for w in rows[:-1]], "y is up there and down here"
        assert (rows[0][3], rows[-1][1]) == (width, 0)


# --- Aspect ratios -----------------------------------------------------------------------------------


def camera(width: float, height: float) -> CameraData:
    """Its aperture, at distance 1."""
    return CameraData("/Camera", np.eye(4), width / 2, (0.0, 0.0), width / height, (1.0, 10.0))


def film(
    aperture: tuple[float, float], policy: str, pixel: float = 1.0, size: tuple[int, int] = (40, 20)
) -> Film:
    return conform(camera(*aperture), FilmOptions(*size, pixel, policy))


@pytest.mark.parametrize(
    ("policy", "aperture", "expected"),
    [
        # An image of 2:1 of an aperture that is narrower than that, and of one that is wider.
        ("expandAperture", (3.0, 2.0), (4.0, 2.0)),
        ("expandAperture", (6.0, 2.0), (6.0, 3.0)),
        ("cropAperture", (3.0, 2.0), (3.0, 1.5)),
        ("cropAperture", (6.0, 2.0), (4.0, 2.0)),
        ("adjustApertureWidth", (3.0, 2.0), (4.0, 2.0)),
        ("adjustApertureWidth", (6.0, 2.0), (4.0, 2.0)),
        ("adjustApertureHeight", (3.0, 2.0), (3.0, 1.5)),
        ("adjustApertureHeight", (6.0, 2.0), (6.0, 3.0)),
        ("adjustPixelAspectRatio", (3.0, 2.0), (3.0, 2.0)),
        ("adjustPixelAspectRatio", (6.0, 2.0), (6.0, 2.0)),
    ],
)
def test_policies(policy: str, aperture: tuple[float, float], expected: tuple[float, float]) -> None:
    found = film(aperture, policy)
    assert [2 * h for h in found.half_tangents] == pytest.approx(expected)
    if policy == "adjustPixelAspectRatio":
        assert found.pixel_aspect_ratio == pytest.approx(aperture[0] / aperture[1] / 2)
    else:
        assert found.pixel_aspect_ratio == 1


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("pixel", [0.5, 1.0, 1.7])
@pytest.mark.parametrize("aperture", [(36.0, 24.0), (20.0, 20.0), (10.0, 40.0)])
@pytest.mark.parametrize("size", [(64, 48), (48, 64), (7, 3)])
def test_pixels_have_their_aspect_ratio(
    policy: str, pixel: float, aperture: tuple[float, float], size: tuple[int, int]
) -> None:
    """In the film window as in the image: that is what conforming is for."""
    found = film(aperture, policy, pixel, size)
    width, height = found.half_tangents
    assert (width / size[0]) / (height / size[1]) == pytest.approx(found.pixel_aspect_ratio)
    if policy != "adjustPixelAspectRatio":
        assert found.pixel_aspect_ratio == pixel
    given = aperture[0] / 2, aperture[1] / 2
    if policy == "expandAperture":
        assert all(found.half_tangents[i] >= given[i] * (1 - 1e-12) for i in (0, 1))
    if policy == "cropAperture":
        assert all(found.half_tangents[i] <= given[i] * (1 + 1e-12) for i in (0, 1))
    if policy in ("expandAperture", "cropAperture"):
        assert any(found.half_tangents[i] == pytest.approx(given[i]) for i in (0, 1)), "no more than needed"


def test_without_a_height_the_image_has_the_apertures_shape() -> None:
    for pixel in (1.0, 2.0):
        found = conform(camera(6.0, 2.0), FilmOptions(60, None, pixel))
        assert (found.width, found.height) == (60, int(20 * pixel))
        assert found.half_tangents == pytest.approx((3.0, 1.0))
