"""Reuse quality controls do what they are for (§2.4 and docs/settings.md)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import make_mirror_and_glass
import numpy as np
import pytest
from parts import write_png
from pxr import Sdf, Usd, UsdGeom, UsdShade
from rendering import (
    add_camera,
    add_material,
    add_mesh,
    mixed_stage,
    new_stage,
    render,
    rmse,
    save_evidence,
    total,
)


def glow(stage: Usd.Stage, material: str, image: UsdShade.Shader) -> None:
    """Makes a material emit its texture and reflect nothing, so that shading has no noise."""
    surface = UsdShade.Shader.Get(stage, f"/World/Looks/{material}/Surface")
    colour = surface.GetInput("diffuseColor") or surface.CreateInput(
        "diffuseColor", Sdf.ValueTypeNames.Color3f
    )
    colour.ClearSources()
    colour.Set((0, 0, 0))
    emission = surface.CreateInput("emissiveColor", Sdf.ValueTypeNames.Color3f)
    emission.ConnectToSource(image.ConnectableAPI(), "rgb")


DOTS_SIZE = (240, 160)
DOTS_SETTINGS: dict[str, Any] = {"samples": 3, "max_bounces": 6, "camera_light": False}


class Dots:
    """The scene after Fig. 4, its ground glowing; pixels of its reflection that the ball plays no part in."""

    def __init__(self, folder: Path) -> None:
        path = folder / "mirror.usda"
        make_mirror_and_glass.make(path, True).GetRootLayer().Export(str(path))
        self.stage = Usd.Stage.Open(str(path))
        self.stage.RemovePrim("/World/Lights")
        glow(self.stage, "Paving", UsdShade.Shader.Get(self.stage, "/World/Looks/Paving/Image"))
        self.truth = self.mirror(method="reference")
        self.stage.GetPrimAtPath("/World/Ball").SetActive(False)
        without = self.mirror(method="reference")
        self.stage.GetPrimAtPath("/World/Ball").SetActive(True)
        # Samples are the same with and without the ball, bit for bit, where it plays no part.
        self.ground = (self.truth == without).all(-1) & (self.truth > 0).all(-1)

    def mirror(self, **settings: Any) -> np.ndarray:
        return render(self.stage, *DOTS_SIZE, **DOTS_SETTINGS, **settings)["layers"]["reflection"]

    def error(self, **settings: Any) -> float:
        return rmse(self.mirror(**settings)[self.ground], self.truth[self.ground])


@pytest.fixture(scope="module")
def dots(tmp_path_factory: pytest.TempPathFactory) -> Dots:
    with pytest.MonkeyPatch.context() as patch:
        # Coarse enough for a small frame: what reuse errs anyway must not hide the dots.
        patch.setattr(make_mirror_and_glass, "TEXTURE_REPEATS", 2.0)
        return Dots(tmp_path_factory.mktemp("dots"))


@pytest.fixture(scope="module")
def plain_error(dots: Dots) -> float:
    return dots.error()


def test_the_ball_makes_dots_in_the_mirror(dots: Dots, plain_error: float) -> None:
    """Fig. 4 b: what is reused from paths through the ball is in excess of what reuse errs without it."""
    assert dots.ground.sum() > 6000
    dots.stage.GetPrimAtPath("/World/Ball").SetActive(False)
    without = dots.error()
    dots.stage.GetPrimAtPath("/World/Ball").SetActive(True)
    assert plain_error > 1.1 * without


@pytest.mark.parametrize(
    "control",
    [{"footprint_reuse": "metric", "footprint_weight": 1.0}, {"footprint_reuse": "octaves"}],
    ids=["metric", "octaves"],
)
def test_footprints_remove_the_dots(dots: Dots, plain_error: float, control: dict[str, Any]) -> None:
    """Fig. 4 c."""
    image = dots.mirror(**control)
    error = rmse(image[dots.ground], dots.truth[dots.ground])
    assert error < 0.95 * plain_error, save_evidence("dots", image=image, truth=dots.truth)


def plank_stage(folder: Path) -> Usd.Stage:
    """A plank of 100 : 1 that fills the film's width, with glowing stripes across."""
    stage = new_stage()
    stripes = np.repeat((np.arange(256) // 4 % 2)[None, :, None], 3, axis=2).repeat(4, axis=0) * 0.8 + 0.1
    write_png(folder / "stripes.png", stripes)
    material = add_material(stage, "Stripes")
    reader = UsdShade.Shader.Define(stage, "/World/Looks/Stripes/St")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    image = UsdShade.Shader.Define(stage, "/World/Looks/Stripes/Image")
    image.CreateIdAttr("UsdUVTexture")
    image.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(str(folder / "stripes.png"))
    image.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("raw")
    image.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(
        reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    )
    image.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    glow(stage, "Stripes", image)
    plank = add_mesh(
        stage, "/World/Plank", [(-50, 0.5, 0), (-50, -0.5, 0), (50, -0.5, 0), (50, 0.5, 0)], [[0, 1, 2, 3]]
    )
    UsdShade.MaterialBindingAPI.Apply(plank.GetPrim()).Bind(material)
    st = UsdGeom.PrimvarsAPI(plank).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    st.Set([(0, 1), (0, 0), (1, 0), (1, 1)])
    camera = add_camera(stage, (0, 0, 100), (0, 0, 0), 0.5)
    camera.GetVerticalApertureAttr().Set(10.0 / 64)
    return stage


def test_a_plank_does_not_reuse_along_its_length(tmp_path: Path) -> None:
    stage = plank_stage(tmp_path)
    settings = {"samples": 4, "camera_light": False, "max_bounces": 0}
    size = (1024, 16)
    truth = render(stage, *size, method="reference", **settings)
    assert truth["composite"].std() > 0.2
    errors, failed = {}, {}
    for scaled in (False, True):
        result = render(stage, *size, world_space_parameters=scaled, **settings)
        errors[scaled] = rmse(result["composite"], truth["composite"])
        failed[scaled] = total(result, "failed_samples")
    assert errors[True] < 0.6 * errors[False], errors
    # The samples are the same ones; only what is nearest has changed.
    assert failed[True] == failed[False] == 0


def test_samples_beyond_the_distance_limit_fail() -> None:
    stage = mixed_stage()
    settings = {"samples": 4, "occlusion_samples": 8, "light_samples": 4, "max_bounces": 3}
    results = {
        limit: render(stage, 64, 64, max_reuse_distance=limit, **settings)
        for limit in (0.0, 8.0, 2.0, 0.5, 1e-4)
    }
    failed = {limit: total(result, "failed_samples") for limit, result in results.items()}
    samples = total(results[0.0], "antialiasing_samples")
    # Seeds are the same ones; a smaller limit fails whatever a larger one does, and more.
    assert failed[0.0] <= failed[8.0] < failed[2.0] < failed[0.5] < failed[1e-4]
    assert failed[1e-4] > 0.98 * samples
    assert failed[8.0] < failed[0.0] + 0.05 * samples
    assert failed[0.5] > failed[0.0] + 0.1 * samples
    # Failures are shaded once per pixel and primitive, hence many fewer than they are.
    assert total(results[1e-4], "reshading_evaluations") < 0.4 * samples
    means = [result["composite"].mean() for result in results.values()]
    np.testing.assert_allclose(means, means[0], rtol=0.02)


def test_a_distance_limit_helps_where_nothing_near_was_shaded(dots: Dots, plain_error: float) -> None:
    assert dots.error(max_reuse_distance=0.7) < plain_error


def test_octaves_keep_reuse_from_unlike_footprints() -> None:
    """What fails with them had neighbours of other octaves only; most samples have one of their own."""
    stage = mixed_stage()
    settings = {"samples": 4, "occlusion_samples": 4, "light_samples": 2, "max_bounces": 3}
    plain = render(stage, 64, 64, **settings)
    octaves = render(stage, 64, 64, footprint_reuse="octaves", **settings)
    assert total(octaves, "failed_samples") > total(plain, "failed_samples")
    assert total(octaves, "failed_samples") < 0.15 * total(octaves, "antialiasing_samples")
    np.testing.assert_allclose(octaves["composite"].mean(), plain["composite"].mean(), rtol=0.02)
