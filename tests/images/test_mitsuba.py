"""Against an independent renderer: the same scene by Mitsuba 3, with a transport that ends as ours does."""

from __future__ import annotations

import ctypes.util
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import mitsuba_scene
import numpy as np
import pytest
from rendering import render, save_evidence

SEEDS = 6
TRIAL = """
import mitsuba, drjit
mitsuba.set_variant("llvm_ad_rgb")
x = drjit.sqrt(drjit.maximum(mitsuba.Float([1, -2, 3]), 0))
assert float(drjit.sum(x)[0]) > 2
"""
LAYERS = ("direct", "reflection", "refraction")


@pytest.fixture(scope="module")
def mitsuba() -> Any:
    module = pytest.importorskip("mitsuba", reason="Mitsuba 3 is not installed (pip install -e .[dev])")
    if "DRJIT_LIBLLVM_PATH" not in os.environ and not ctypes.util.find_library("LLVM"):
        found = sorted(Path("/usr/lib").glob("*/libLLVM*.so*"))
        if not found:
            pytest.skip("Mitsuba's vectorised variants need libLLVM, and there is none")
        os.environ["DRJIT_LIBLLVM_PATH"] = str(found[-1])
    # Versions of LLVM that it does not know end the process: tried in another one.
    tried = subprocess.run([sys.executable, "-c", TRIAL], capture_output=True, text=True)
    if tried.returncode != 0:
        pytest.skip(f"Mitsuba's vectorised variant does not run here: {tried.stderr.strip()[-200:]}")
    module.set_variant("llvm_ad_rgb")
    return module


@pytest.fixture(scope="module")
def images(mitsuba: Any, tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, np.ndarray]]:
    """(seeds, height, width, 3) by renderer and layer."""
    theirs = [mitsuba_scene.render_mitsuba(mitsuba, 144, seed) for seed in range(SEEDS)]
    stage = mitsuba_scene.usd_stage(tmp_path_factory.mktemp("mitsuba"))
    settings = {
        "method": "reference",
        "samples": 12,
        "light_samples": 2,
        "occlusion_samples": 4,
        "max_bounces": mitsuba_scene.MAX_BOUNCES,
        "filter": "box",
        "filter_radius_pixels": 0.5,
        "lights_visible": True,
        "dome_light_visible": True,
        # What Mitsuba's plugins do: glass casts full shadows, microfacets scatter once.
        "glass_shadows": "opaque",
        "energy_compensation": False,
    }
    size = mitsuba_scene.WIDTH, mitsuba_scene.HEIGHT
    ours = [render(stage, *size, seed=seed, **settings)["layers"] for seed in range(SEEDS)]
    return {
        "encore": {name: np.stack([image[name] for image in ours]).astype(float) for name in LAYERS},
        "mitsuba": {name: np.stack([image[name] for image in theirs]).astype(float) for name in LAYERS},
    }


@pytest.mark.parametrize("layer", LAYERS)
def test_means_agree_within_noise(images: dict[str, dict[str, np.ndarray]], layer: str) -> None:
    """Of the whole layer: within four standard errors and 0.3 %, for what single precision and filters of
    textures do."""
    ours, theirs = (images[renderer][layer].mean(axis=(1, 2)) for renderer in ("encore", "mitsuba"))
    difference = np.abs(ours.mean(0) - theirs.mean(0))
    error = np.sqrt((ours.var(0, ddof=1) + theirs.var(0, ddof=1)) / SEEDS)
    assert (theirs.mean(0) > 0.01).all()
    assert (difference < 4 * error + 0.003 * theirs.mean(0)).all(), (ours.mean(0), theirs.mean(0), error)


@pytest.mark.parametrize("layer", LAYERS)
def test_pixels_differ_by_noise_only(images: dict[str, dict[str, np.ndarray]], layer: str) -> None:
    """The mean square of the difference of two means is the sum of their variances, if there is only noise;
    4 × 4 pixels together, so that a firefly does not decide."""
    blocks = {}
    for renderer in ("encore", "mitsuba"):
        image = images[renderer][layer]
        shape = (SEEDS, image.shape[1] // 4, 4, image.shape[2] // 4, 4, 3)
        blocks[renderer] = image.reshape(shape).mean(axis=(2, 4))
    ours, theirs = blocks["encore"], blocks["mitsuba"]
    difference = ours.mean(0) - theirs.mean(0)
    variance = (ours.var(0, ddof=1) + theirs.var(0, ddof=1)) / SEEDS
    floor = (0.005 * theirs.mean(0)) ** 2 + 1e-8
    z2 = difference**2 / (variance + floor)
    evidence = {"encore": ours.mean(0), "mitsuba": theirs.mean(0), "z2": z2}
    # A t distribution of ten degrees of freedom: the mean of its square is 1.25, of which 5 lie beyond 1 %.
    assert z2.mean() < 2.0, (z2.mean(), save_evidence(f"mitsuba_{layer}", **evidence))
    assert (z2 > 25).mean() < 0.01, save_evidence(f"mitsuba_{layer}", **evidence)
