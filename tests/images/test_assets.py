"""Real assets that nobody here made, where the machine has them (see tests/rendering.py: ASSETS)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd
from rendering import ASSETS, render

STAGES = [
    "full_assets/Teapot/Teapot.usd",
    "full_assets/McUsd/McUsd.usda",
    "full_assets/Vehicles/USD_Mini_Car_Kit/assets/vehicles/formula/asset/formulaFullAsset.usda",
    "full_assets/SubdivisionSurfaces/Creases_SpinningPyramids.usda",
    "full_assets/StandardShaderBall/standard_shader_ball_scene.usda",
    "intent-vfx/scenes/teapotScene.usd",
]


@pytest.mark.skipif(not ASSETS.is_dir(), reason="the folder of real assets is not on this machine")
@pytest.mark.parametrize("name", STAGES)
def test_asset_renders(name: str) -> None:
    path: Path = ASSETS / name
    result = render(Usd.Stage.Open(str(path)), 160, 90, samples=2, occlusion_samples=4, light_samples=2)
    image, alpha = result["composite"], result["alpha"]
    assert np.isfinite(image).all()
    assert result["statistics"]["non_finite_samples"] == 0
    # Something is seen, it is lit, and it is not one flat colour.
    assert alpha.mean() > 0.02
    assert image[alpha > 0.5].mean() > 0.005
    assert image[alpha > 0.5].std() > 0.002
