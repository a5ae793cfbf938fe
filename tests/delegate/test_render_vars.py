"""RenderVars: where their numbers come from, and what their channels are called."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from encore.channels import EMPTY_DEPTH
from encore.errors import SettingError
from encore.render_settings import Product, RenderVar
from encore.render_vars import Selection, select
from encore.report import Reports

H, W = 3, 4


def images(layers: tuple[str, ...] = ("direct", "reflection", "refraction")) -> dict[str, Any]:
    """Noise as encore._core.render() hands it out."""
    noise = np.random.default_rng(7)
    made = {name: noise.random((H, W, 3), np.float32) for name in layers}
    depth = noise.random((H, W), np.float32) + 1
    depth[0, 0] = np.inf
    ids = noise.integers(-1, 5, (H, W)).astype(np.int32)
    return {
        "layers": made,
        "composite": sum(made.values()),
        "alpha": noise.random((H, W), np.float32),
        "depth": depth,
        "normal": noise.random((H, W, 3), np.float32) - 0.5,
        "aovs": {
            "position": noise.random((H, W, 3), np.float32) * 1e6,
            "eyePosition": noise.random((H, W, 3), np.float32),
            "eyeNormal": noise.random((H, W, 3), np.float32),
            "primId": ids,
            "instanceId": ids + 10,
            "elementId": ids + 20,
            "primvar:st:2": noise.random((H, W, 2), np.float32),
            "primvar:st:3": noise.random((H, W, 3), np.float32),
            "primvar:wear:1": noise.random((H, W, 1), np.float32),
        },
    }


def var(
    name: str, source: str = "", data_type: str = "", source_type: str = "raw", channel: str = ""
) -> RenderVar:
    return RenderVar(f"/Render/{name}", data_type, source_type, source or name, channel)


def chosen(*variables: RenderVar, reports: Reports | None = None) -> Selection:
    found = select(Product("/Render/P", vars=variables), Reports() if reports is None else reports)
    assert found is not None
    return found


def channels(selection: Selection, given: dict[str, Any] | None = None) -> dict[str, np.ndarray]:
    """Name → pixels, of a render that has what the selection asks for."""
    found = {}
    for part in selection.parts(given or images(), lambda pixels: pixels):
        for i, name in enumerate(part.names):
            found[name] = part.pixels[..., i]
    return found


def test_without_variables_a_product_holds_everything() -> None:
    assert select(Product("/Render/P"), Reports()) is None


@pytest.mark.parametrize(
    ("variable", "names"),
    [
        (var("Beauty", "color", "color3f"), "R G B"),
        (var("Beauty", "Ci", "color4f"), "R G B A"),
        (var("Beauty", "rgba"), "R G B A"),
        (var("Beauty", "rgba", "color3f"), "R G B"),
        (var("Beauty", "color", "color4f", channel="C"), "R G B A"),
        (var("Beauty", "color", "color3f", channel="main"), "main.R main.G main.B"),
        (var("Total", "C.*", "color3f", "lpe"), "Total.R Total.G Total.B"),
        (var("Total", "C.*", "color4f", "lpe"), "Total.R Total.G Total.B Total.A"),
        (var("Total", "C.*", "color3f", "lpe", channel="beauty"), "R G B"),
        (var("a", data_type="float"), "A"),
        (var("Depth", "z", "float"), "Z"),
        (var("Depth", "cameraDepth", "float", channel="depth"), "depth"),
        (var("N", data_type="normal3f"), "N.X N.Y N.Z"),
        (var("Normals", "N", "color3f"), "Normals.R Normals.G Normals.B"),
        (var("Neye"), "Neye.X Neye.Y Neye.Z"),
        (var("P", data_type="point3f"), "P.X P.Y P.Z"),
        (var("id", "primId", "int"), "id"),
        (var("direct", data_type="color3h"), "direct.R direct.G direct.B"),
        (var("refl", "reflection.color"), "refl.R refl.G refl.B"),
        (var("refr", "color:refraction"), "refr.R refr.G refr.B"),
        (var("st", data_type="texCoord2f", source_type="primvar"), "st.U st.V"),
        (var("uv", "primvars:st", "float2"), "uv.X uv.Y"),
        (var("st", source_type="primvar"), "st.R st.G st.B"),
        (var("wear", data_type="float", source_type="primvar"), "wear"),
    ],
)
def test_names(variable: RenderVar, names: str) -> None:
    assert tuple(channels(chosen(variable))) == tuple(names.split())


def test_values() -> None:
    given = images()
    found = channels(
        chosen(
            var("rgba"),
            var("depth"),
            var("N"),
            var("P"),
            var("Peye"),
            var("Neye"),
            var("primId"),
            var("instanceId"),
            var("elementId"),
            var("st", data_type="texCoord2f", source_type="primvar"),
            var("wear", data_type="float", source_type="primvar"),
        ),
        given,
    )
    for i, name in enumerate("RGB"):
        assert np.array_equal(found[name], given["composite"][..., i])
    assert np.array_equal(found["A"], given["alpha"])
    assert found["Z"][0, 0] == EMPTY_DEPTH and np.array_equal(found["Z"][1:], given["depth"][1:])
    aovs = given["aovs"]
    for i, name in enumerate("XYZ"):
        assert np.array_equal(found[f"N.{name}"], given["normal"][..., i])
        assert np.array_equal(found[f"P.{name}"], aovs["position"][..., i])
        assert np.array_equal(found[f"Peye.{name}"], aovs["eyePosition"][..., i])
        assert np.array_equal(found[f"Neye.{name}"], aovs["eyeNormal"][..., i])
    for name in ("primId", "instanceId", "elementId"):
        assert np.array_equal(found[name], aovs[name].astype(np.float32))
    assert np.array_equal(found["st.V"], aovs["primvar:st:2"][..., 1])
    assert np.array_equal(found["wear"], aovs["primvar:wear:1"][..., 0])


def test_what_core_is_asked_for() -> None:
    selection = chosen(
        var("color"),
        var("P"),
        var("st", data_type="float2", source_type="primvar"),
        var("id", "elementId"),
    )
    assert [aov.arguments() for aov in selection.aovs] == [
        {"kind": "position", "name": "position"},
        {"kind": "primvar", "name": "primvar:st:2", "primvar": "st", "components": 2},
        {"kind": "elementId", "name": "elementId"},
    ]


def test_layers_add_up_to_colour_and_expressions_are_sums_of_layers() -> None:
    given = images()
    found = channels(
        chosen(
            var("color"),
            var("direct"),
            var("reflection"),
            var("refraction"),
            var("Traced", "C[SG].*", "color3f", "lpe"),
            var("All", "C.*[<L.>O]", "color3f", "lpe"),
        ),
        given,
    )
    for c in "RGB":
        assert np.array_equal(
            found[c], found[f"direct.{c}"] + found[f"reflection.{c}"] + found[f"refraction.{c}"]
        )
        assert np.array_equal(found[f"Traced.{c}"], found[f"reflection.{c}"] + found[f"refraction.{c}"])
        assert np.array_equal(found[f"All.{c}"], found[c])


def test_layers_that_nothing_feeds_are_black() -> None:
    found = channels(chosen(var("color"), var("reflection")), images(("direct",)))
    assert not found["reflection.R"].any() and found["R"].any()


def test_a_name_that_is_taken_gets_the_prims_own_in_front() -> None:
    found = chosen(var("rgba"), var("Again", "color", "color3f"), var("alpha"), var("z"), var("Far", "depth"))
    names = [name for channel in found.channels for name in channel.names]
    assert names == [*"RGBA", "Again.R", "Again.G", "Again.B", "alpha", "Z", "Far"]
    with pytest.raises(
        SettingError, match=r"/Render/P.orderedVars: /Render/b and /Render/a both write .* x\.R"
    ):
        chosen(var("a", "direct", channel="x"), var("b", "reflection", channel="x"))


def test_data_types_of_channels() -> None:
    given = images()
    selection = chosen(
        var("color", data_type="color3h"),
        var("P", data_type="half3"),
        var("id", "primId", "int"),
        var("z", data_type="half"),
    )
    parts = {part.names[0]: part for part in selection.parts(given, lambda pixels: pixels)}
    assert [p.pixel_type for p in parts.values()] == ["half", "half", "uint", "half"]
    # What half cannot hold is its largest number, and no infinity.
    assert parts["P.X"].pixels.max() == 65504
    assert parts["Z"].pixels[0, 0, 0] == 65504
    ids = np.rint(parts["id"].pixels[..., 0].astype(np.float64) * (2**32 - 1)).astype(np.uint32)
    assert np.array_equal(ids, given["aovs"]["primId"].astype(np.uint32))


@pytest.mark.parametrize(
    ("variable", "kind"),
    [
        (var("depth", data_type="color3f"), "components of a render var"),
        (var("N", data_type="float2"), "components of a render var"),
        (var("direct", data_type="color4f"), "components of a render var"),
        (var("color", data_type="color3d"), "double dataType"),
        (var("depth", data_type="int"), "type of a render var"),
        (var("primId", data_type="half"), "type of a render var"),
    ],
)
def test_what_a_source_cannot_be_is_noted(variable: RenderVar, kind: str) -> None:
    reports = Reports()
    parts = chosen(variable, reports=reports).parts(images(), lambda pixels: pixels)
    assert [r.kind for r in reports] == [kind]
    assert not reports.has_errors
    assert {p.pixel_type for p in parts} == {"float"}


@pytest.mark.parametrize(
    ("variable", "message"),
    [
        (var("Crypto", "cryptomatte"), "'cryptomatte' is nothing that Encore has (color, alpha, depth"),
        (var("Key", "C.*<L.'key'>", source_type="lpe"), "there is a label"),
        (var("Lit", "C<RD>L", source_type="lpe"), "direct: (C<RD>L)|(C[LO])"),
        (var("Odd", "color", source_type="shader"), "sourceType shader"),
        (var("None", "primvars:", source_type="primvar"), "'primvars:' names no primvar"),
        (var("Raw", "primvars:"), "'primvars:' names no primvar"),
    ],
)
def test_variables_that_do_not_exist_are_left_out_and_reported(variable: RenderVar, message: str) -> None:
    reports = Reports()
    selection = chosen(var("color"), variable, reports=reports)
    assert [channel.names for channel in selection.channels] == [("R", "G", "B")]
    (report,) = reports.errors
    assert report.path == variable.path
    assert message in report.message
    untyped = replace(variable, data_type="nonsense")  # which is reported first, and is not why
    with pytest.raises(
        SettingError, match=r"/Render/P\.orderedVars: none of its .* can be rendered\. "
    ) as caught:
        chosen(untyped)
    assert caught.value.remedy == f"{report.path}: {report.message}"


@pytest.mark.parametrize("data_type", ["token", "matrix4d", "float[]", "nonsense"])
def test_data_types_that_are_no_numbers(data_type: str) -> None:
    reports = Reports()
    assert len(channels(chosen(var("color", data_type=data_type), reports=reports))) == 3
    assert [r.kind for r in reports.errors] == ["bad dataType"]


def test_a_picture_is_the_first_radiance_with_alpha() -> None:
    given = images()
    found = chosen(var("depth"), var("reflection"), var("color")).picture()
    assert found is not None
    pixels = channels(found, given)
    assert tuple(pixels) == ("R", "G", "B", "A")
    assert np.array_equal(pixels["G"], given["layers"]["reflection"][..., 1])
    assert np.array_equal(pixels["A"], given["alpha"])
    assert chosen(var("depth")).picture() is None
