"""Reuse against the no-reuse reference, judged by the variance over seeds (§4: "visually identical")."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Usd
from rendering import ROOT, render, save_evidence, total

SIZE = (96, 54)
SEEDS = range(4)


@pytest.fixture(scope="module")
def stage() -> Usd.Stage:
    return Usd.Stage.Open(str(ROOT / "examples" / "still_life.usda"))


@pytest.fixture(scope="module")
def images(stage: Usd.Stage) -> dict[str, list[dict]]:
    shared = {"samples": 6, "light_samples": 16, "occlusion_samples": 32}
    return {
        method: [render(stage, *SIZE, method=method, seed=seed, **shared) for seed in SEEDS]
        for method in ("reuse", "reference")
    }


def stack(images: list[dict], layer: str) -> np.ndarray:
    return np.stack([image["layers"][layer] for image in images]).astype(float)


@pytest.mark.parametrize("layer", ["direct", "reflection", "refraction"])
def test_layer_means_agree(images: dict[str, list[dict]], layer: str) -> None:
    reuse, reference = stack(images["reuse"], layer), stack(images["reference"], layer)
    assert reference.mean() > 1e-3
    np.testing.assert_allclose(reuse.mean(axis=(0, 1, 2)), reference.mean(axis=(0, 1, 2)), rtol=0.01)


@pytest.mark.parametrize("layer", ["direct", "reflection", "refraction"])
def test_neighbourhoods_agree_within_noise(images: dict[str, list[dict]], layer: str) -> None:
    """Means over 6 × 6 pixels: |difference| in units of its standard error, after 2 % for reuse's bias at
    shadow edges and textures; more than one in 50 beyond 4 would be systematic."""
    reuse, reference = (
        stack(images[m], layer).reshape(len(SEEDS), SIZE[1] // 6, 6, SIZE[0] // 6, 6, 3).mean(axis=(2, 4))
        for m in ("reuse", "reference")
    )
    difference = np.abs(reuse.mean(0) - reference.mean(0))
    error = np.sqrt((reuse.var(0, ddof=1) + reference.var(0, ddof=1)) / len(SEEDS))
    z = np.maximum(0, difference - 0.02 * reference.mean(0) - 1e-4) / (error + 1e-6)
    share = float((z > 4).mean())
    assert share < 0.02, (
        share,
        save_evidence(f"reuse_{layer}", reuse=reuse.mean(0), reference=reference.mean(0), z=z),
    )


def test_alpha_depth_and_normal_do_not_depend_on_the_method(images: dict[str, list[dict]]) -> None:
    for a, b in zip(images["reuse"], images["reference"], strict=True):
        for key in ("alpha", "depth", "normal"):
            np.testing.assert_array_equal(a[key], b[key])


def test_reuse_shades_a_fraction(images: dict[str, list[dict]]) -> None:
    reuse, reference = (images[m][0] for m in ("reuse", "reference"))
    assert total(reuse, "shading_evaluations") * 8 < total(reference, "shading_evaluations")
    samples = reuse["statistics"]["antialiasing_samples"]
    assert samples == reference["statistics"]["antialiasing_samples"] == SIZE[0] * SIZE[1] * 36
