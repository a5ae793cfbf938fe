"""Neither the memory budget nor the number of threads changes a bit, with every control in turn."""

from __future__ import annotations

from typing import Any

import pytest
from encore import _core
from pxr import Usd
from rendering import assert_identical, mixed_stage, render, set_shading_rate, total

SIZE = (80, 48)  # whole and cut reuse tiles, several blocks each
SHARED = {"samples": 3, "occlusion_samples": 2, "light_samples": 2, "max_bounces": 3, "reuse_tile_pixels": 64}
LARGE = 4 << 30

CONTROLS: dict[str, dict[str, Any]] = {
    "none": {},
    "tree": {"search": "tree"},
    "groups": {"search": "groups"},
    "cells": {"search": "cells"},
    "metric": {"footprint_reuse": "metric", "footprint_weight": 0.5},
    "octaves": {"footprint_reuse": "octaves"},
    "distance limit": {"max_reuse_distance": 0.8},
    "world-space parameters": {"world_space_parameters": True},
    "all at once": {
        "footprint_reuse": "octaves",
        "max_reuse_distance": 1.5,
        "world_space_parameters": True,
    },
    "rates of layers": {"shading_rate": 0.7, "shading_rate_reflection": 5.0, "shading_rate_refraction": 1.3},
    "reference": {"method": "reference"},
    "decoupled": {"method": "decoupled"},
    "decoupled-pixel": {"method": "decoupled-pixel"},
    "vertex": {"method": "vertex"},
}


def least_budget(stage: Usd.Stage, **settings: Any) -> tuple[int, dict[str, Any]]:
    """The smallest power of two that is not refused, and what it renders."""
    for power in range(16, 32):
        try:
            return 1 << power, render(stage, *SIZE, memory_budget_bytes=1 << power, **settings)
        except _core.Error as error:
            assert error.kind == "memory", error
    raise AssertionError("no budget below 4 GiB is enough")


@pytest.mark.parametrize("name", CONTROLS)
@pytest.mark.parametrize("debug", [False, True], ids=["plain", "debug"])
def test_budget_and_threads_change_nothing(name: str, debug: bool) -> None:
    stage = mixed_stage()
    if name == "none":
        set_shading_rate(stage.GetPrimAtPath("/World/Floor"), 0.4)
        set_shading_rate(stage.GetPrimAtPath("/World/Box1"), 6.0)
        set_shading_rate(stage.GetPrimAtPath("/World/Box1"), 1.0, "reflection")
    settings = {**SHARED, **CONTROLS[name], "debug_aovs": debug}
    large = render(stage, *SIZE, memory_budget_bytes=LARGE, threads=2, **settings)
    least, small = least_budget(stage, threads=1, **settings)
    assert least > 1 << 16  # something was refused, so that this one is short
    assert_identical(large, small, f"{name}: one thread and {least} bytes")
    alone = render(stage, *SIZE, memory_budget_bytes=LARGE, threads=1, **settings)
    assert_identical(large, alone, f"{name}: one thread")
    for count in ("failed_samples", "antialiasing_samples"):
        assert total(large, count) == total(small, count) == total(alone, count)
    assert ("debug" in large) == debug


def test_threads_change_nothing_at_the_least_budget() -> None:
    stage = mixed_stage()
    least, one = least_budget(stage, threads=1, **SHARED)
    two = render(stage, *SIZE, memory_budget_bytes=least, threads=2, **SHARED)
    assert_identical(one, two)


def test_debug_images_do_not_change_the_picture() -> None:
    stage = mixed_stage()
    plain = render(stage, *SIZE, **SHARED)
    debug = render(stage, *SIZE, **SHARED, debug_aovs=True)
    images = debug.pop("debug")
    assert_identical(plain, debug)
    assert set(images) == set(plain["layers"])
    for layer, counts in plain["statistics"]["layers"].items():
        # Shading samples that lie outside of the image count in the statistics alone.
        seen = images[layer]["evaluations"].sum()
        assert 0.7 * counts["shading_evaluations"] <= seen <= counts["shading_evaluations"]
        assert images[layer]["reshaded"].max() <= 1
        assert (images[layer]["distance"] >= 0).all()
        assert images[layer]["id"].min() >= 0
        assert images[layer]["id"].max() <= 1
