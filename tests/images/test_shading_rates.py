"""Shading rates of single prims: shades per covered pixel are what was asked."""

from __future__ import annotations

import numpy as np
import pytest
from rendering import (
    RATES,
    cell_of_rate,
    four_rates_stage,
    mixed_stage,
    render,
    rmse,
    save_evidence,
    set_shading_rate,
    total,
)

SIZE = (768, 384)


@pytest.fixture(scope="module")
def four() -> dict:
    # One sample per pixel: alpha counts the pixels that are covered, and a failure is one evaluation.
    return render(
        four_rates_stage(),
        *SIZE,
        samples=1,
        occlusion_samples=1,
        filter="box",
        filter_radius_pixels=0.5,
        debug_aovs=True,
    )


@pytest.mark.parametrize("row", [0, 1], ids=["on prims", "on turned instances"])
@pytest.mark.parametrize("column", range(len(RATES)), ids=str)
def test_shades_per_covered_pixel(four: dict, column: int, row: int) -> None:
    debug = four["debug"]["direct"]
    covered = cell_of_rate(four["alpha"], column, row).sum()
    late = cell_of_rate(debug["reshaded"], column, row).sum()
    asked = cell_of_rate(debug["evaluations"], column, row).sum() - late
    assert covered > 8000
    assert late < 0.01 * covered
    assert abs(asked / covered / RATES[column] - 1) < 0.05, (
        asked / covered,
        save_evidence("rates", evaluations=debug["evaluations"], alpha=four["alpha"]),
    )


def test_rates_of_layers_are_inherited() -> None:
    """Shading at the end of a reflection is at the rate of what is seen in it."""
    settings = {"samples": 2, "occlusion_samples": 1, "light_samples": 1, "max_bounces": 3}
    stage = mixed_stage()
    base = render(stage, 128, 128, **settings)["statistics"]["layers"]
    set_shading_rate(stage.GetPrimAtPath("/World"), 6.0)
    set_shading_rate(stage.GetPrimAtPath("/World"), 1.0, "reflection")
    rated = render(stage, 128, 128, **settings)["statistics"]["layers"]
    for layer, factor in (("direct", 3.0), ("reflection", 0.5), ("refraction", 3.0)):
        seeds = [s[layer]["shading_evaluations"] - s[layer]["reshading_evaluations"] for s in (rated, base)]
        assert abs(seeds[0] / seeds[1] / factor - 1) < 0.05, (layer, seeds)


def test_an_instance_overrides_its_prototype() -> None:
    settings = {"samples": 1, "occlusion_samples": 1, "max_bounces": 0, "debug_aovs": True}
    stage = four_rates_stage()
    set_shading_rate(stage.GetPrimAtPath("/Box/Mesh"), 0.5)
    result = render(stage, 384, 192, **settings)
    seen = [cell_of_rate(result["debug"]["direct"]["evaluations"], i, 1).sum() for i in range(len(RATES))]
    covered = [cell_of_rate(result["alpha"], i, 1).sum() for i in range(len(RATES))]
    densities = np.array(seen) / np.array(covered)
    assert (np.diff(densities) > 0).all()
    assert densities[3] > 6
    # Without a rate of its own, an instance has its prototype's.
    stage.GetPrimAtPath("/World/Instance3").RemoveProperty("primvars:encore:shadingRate")
    result = render(stage, 384, 192, **settings)
    evaluations = cell_of_rate(result["debug"]["direct"]["evaluations"], 3, 1).sum()
    assert abs(evaluations / covered[3] - 0.5) < 0.1


def test_rates_change_neither_visibility_nor_the_mean() -> None:
    settings = {"samples": 4, "occlusion_samples": 16}
    stage = four_rates_stage()
    rated = render(stage, 256, 128, **settings)
    for prim in stage.TraverseAll():
        prim.RemoveProperty("primvars:encore:shadingRate")
    uniform = render(stage, 256, 128, **settings)
    np.testing.assert_array_equal(rated["alpha"], uniform["alpha"])
    np.testing.assert_array_equal(rated["depth"], uniform["depth"])
    np.testing.assert_allclose(rated["composite"].mean(), uniform["composite"].mean(), rtol=0.01)
    assert total(rated, "shading_evaluations") != total(uniform, "shading_evaluations")


def test_a_higher_rate_is_closer_to_truth_where_it_was_asked_for() -> None:
    settings = {"samples": 4, "occlusion_samples": 4, "max_bounces": 0}
    stage = four_rates_stage()
    truth = render(stage, 256, 128, **{**settings, "occlusion_samples": 64}, method="reference")["composite"]
    image = render(stage, 256, 128, **settings)["composite"]
    errors = [
        rmse(cell_of_rate(image, i, row), cell_of_rate(truth, i, row)) for row in (0, 1) for i in (0, 3)
    ]
    assert errors[1] < 0.6 * errors[0]
    assert errors[3] < 0.6 * errors[2]
