"""The methods to compare with (§4, Fig. 5 and 6), against the reference, by the variance over seeds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pxr import Usd
from rendering import ROOT, mixed_stage, render, save_evidence, total

SIZE = (72, 48)
SEEDS = range(4)
CELL = 6  # pixels; neighbourhoods that are compared
SETTINGS = {"samples": 5, "light_samples": 8, "occlusion_samples": 16, "max_bounces": 3}

# Settings, and the share of brightness that a neighbourhood's systematic error may reach.
METHODS: dict[str, tuple[dict[str, Any], float]] = {
    "reuse": ({"method": "reuse"}, 0.02),
    "reuse, metric": ({"method": "reuse", "footprint_reuse": "metric"}, 0.02),
    "reuse, octaves": ({"method": "reuse", "footprint_reuse": "octaves"}, 0.02),
    "reuse, distance limit": ({"method": "reuse", "max_reuse_distance": 1.0}, 0.02),
    "reuse, world-space parameters": ({"method": "reuse", "world_space_parameters": True}, 0.02),
    "reuse, cells": ({"method": "reuse", "search": "cells"}, 0.02),
    "decoupled": ({"method": "decoupled"}, 0.04),
    "decoupled-pixel": ({"method": "decoupled-pixel"}, 0.04),
    # Vertices share one path where antialiasing samples spread: edges of reflections move.
    "vertex": ({"method": "vertex", "shading_rate": 8.0}, 0.06),
}


def still_life() -> Usd.Stage:
    return Usd.Stage.Open(str(ROOT / "examples" / "still_life.usda"))


@pytest.fixture(scope="module", params=["mixed", "still life"])
def stage(request: pytest.FixtureRequest) -> Usd.Stage:
    return mixed_stage() if request.param == "mixed" else still_life()


def seeds(stage: Usd.Stage, **settings: Any) -> list[dict]:
    return [render(stage, *SIZE, seed=seed, **{**SETTINGS, **settings}) for seed in SEEDS]


@pytest.fixture(scope="module")
def reference(stage: Usd.Stage) -> list[dict]:
    return seeds(stage, method="reference")


def neighbourhoods(results: list[dict]) -> np.ndarray:
    images = np.stack([r["composite"] for r in results]).astype(float)
    return images.reshape(len(SEEDS), SIZE[1] // CELL, CELL, SIZE[0] // CELL, CELL, 3).mean(axis=(2, 4))


@pytest.mark.parametrize("name", METHODS)
def test_methods_agree_with_the_reference(stage: Usd.Stage, reference: list[dict], name: str) -> None:
    """Means over 6 × 6 pixels: |difference| in units of its standard error, after the method's allowance."""
    settings, allowance = METHODS[name]
    results = seeds(stage, **settings)
    ours, theirs = neighbourhoods(results), neighbourhoods(reference)
    np.testing.assert_allclose(ours.mean(), theirs.mean(), rtol=allowance)
    difference = np.abs(ours.mean(0) - theirs.mean(0))
    error = np.sqrt((ours.var(0, ddof=1) + theirs.var(0, ddof=1)) / len(SEEDS))
    z = np.maximum(0, difference - allowance * theirs.mean(0) - 1e-3) / (error + 1e-6)
    assert (z > 4).mean() < 0.04, (
        float((z > 4).mean()),
        save_evidence(f"method_{settings['method']}", ours=ours.mean(0), reference=theirs.mean(0), z=z),
    )


@pytest.mark.parametrize("method", ["reuse", "decoupled", "decoupled-pixel", "vertex"])
def test_methods_see_the_same_surfaces(stage: Usd.Stage, reference: list[dict], method: str) -> None:
    result = render(stage, *SIZE, seed=0, **SETTINGS, method=method)
    for key in ("alpha", "depth", "normal"):
        np.testing.assert_array_equal(result[key], reference[0][key])
    assert result["layers"].keys() == reference[0]["layers"].keys()
    composite = sum(image.astype(float) for image in result["layers"].values())
    np.testing.assert_allclose(composite, result["composite"], rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("method", ["reuse", "decoupled", "decoupled-pixel"])
def test_sharing_shades_less_than_the_reference(stage: Usd.Stage, reference: list[dict], method: str) -> None:
    result = render(stage, *SIZE, seed=0, **SETTINGS, method=method)
    assert total(result, "shading_evaluations") < 0.5 * total(reference[0], "shading_evaluations")


def test_vertices_are_shaded_as_often_as_asked() -> None:
    """Twice the rate: about twice the vertices, whatever the number of antialiasing samples."""
    stage = mixed_stage()
    counts = {
        (rate, samples): render(
            stage, 96, 96, method="vertex", shading_rate=rate, samples=samples, occlusion_samples=1
        )["statistics"]["layers"]["direct"]["shading_evaluations"]
        for rate, samples in ((1.0, 3), (4.0, 3), (4.0, 6))
    }
    assert 2.0 < counts[4.0, 3] / counts[1.0, 3] < 5.0
    assert abs(counts[4.0, 6] / counts[4.0, 3] - 1) < 0.15


def test_decoupled_sampling_shades_by_its_rate() -> None:
    stage = still_life()
    settings = {"samples": 8, "occlusion_samples": 1, "light_samples": 1, "max_bounces": 0}
    shades = [
        total(render(stage, *SIZE, method="decoupled", shading_rate=rate, **settings), "shading_evaluations")
        for rate in (1.0, 4.0)
    ]
    assert 2.0 < shades[1] / shades[0] < 5.0
