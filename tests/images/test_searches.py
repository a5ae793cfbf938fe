"""However nearest neighbours are found, they are the same: images are equal bit for bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pxr import Usd
from rendering import (
    add_camera,
    add_dome,
    add_material,
    add_mesh,
    add_plane,
    assert_identical,
    mixed_stage,
    new_stage,
    render,
    total,
)

SHARED = {"samples": 4, "occlusion_samples": 4, "light_samples": 2, "max_bounces": 3, "reuse_tile_pixels": 32}
OTHERS = ("groups", "cells", "auto")


def assert_searches_agree(stage: Usd.Stage, size: tuple[int, int], **settings: Any) -> dict[str, Any]:
    given = {**SHARED, "debug_aovs": True, **settings}
    tree = render(stage, *size, search="tree", **given)
    for search in OTHERS:
        other = render(stage, *size, search=search, **given)
        assert_identical(tree, other, f"{search} against tree")
        for name, layer in tree["statistics"]["layers"].items():
            for count in ("shading_evaluations", "reshading_evaluations", "failed_samples"):
                assert other["statistics"]["layers"][name][count] == layer[count], (search, name, count)
    return tree


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"shading_rate": 0.3},
        {"shading_rate": 20.0, "samples": 2},
        {"footprint_reuse": "octaves"},
        {"max_reuse_distance": 1.0},
        {"world_space_parameters": True},
        {"reuse_tile_pixels": 512},
    ],
    ids=str,
)
def test_direct_reflection_and_refraction(settings: dict[str, Any]) -> None:
    result = assert_searches_agree(mixed_stage(), (64, 64), **settings)
    assert set(result["layers"]) == {"direct", "reflection", "refraction"}
    for name, image in result["layers"].items():
        assert image.mean() > 1e-3, name


def test_the_search_that_was_asked_for_is_used() -> None:
    for search in ("tree", "groups", "cells"):
        layers = render(mixed_stage(), 32, 32, search=search, **SHARED)["statistics"]["layers"]
        assert {layer["search"] for layer in layers.values()} == {search}


def sheet(n: int, size: float, bend: float = 1.0) -> tuple[np.ndarray, list[list[int]]]:
    """n × n quads around the origin in xz; bend: exponent by which they are unequal in size."""
    t = np.linspace(-1, 1, n + 1)
    t = np.sign(t) * np.abs(t) ** bend * size / 2
    x, z = np.meshgrid(t, t)
    points = np.stack([x, 0 * x, z], axis=-1).reshape(-1, 3)
    row = n + 1
    quads = [
        [i * row + j, (i + 1) * row + j, (i + 1) * row + j + 1, i * row + j + 1]
        for i in range(n)
        for j in range(n)
    ]
    return points, quads


def extreme(name: str) -> tuple[Usd.Stage, dict[str, Any]]:
    """A stage, and settings that bring out what is extreme about it."""
    stage = new_stage()
    add_dome(stage)
    grey = add_material(stage, "Grey", diffuseColor=(0.5, 0.5, 0.5))
    settings: dict[str, Any] = {}
    if name == "one primitive with many samples":
        add_plane(stage, "/World/Plane", 20, grey)
        settings = {"shading_rate": 60.0, "samples": 2, "occlusion_samples": 1}
    elif name == "a plane to the horizon":
        add_plane(stage, "/World/Plane", 1e7, grey)
        settings = {"shading_rate": 8.0}
    elif name == "hundreds of primitives in a pixel":
        add_mesh(stage, "/World/Dust", *sheet(260, 4), grey)
        settings = {"samples": 12, "shading_rate": 4.0, "occlusion_samples": 1}
    elif name == "primitives of one sample":
        add_mesh(stage, "/World/Sheet", *sheet(40, 4), grey)
        settings = {"shading_rate": 0.7}
    elif name == "faces of every size":
        add_mesh(stage, "/World/Sheet", *sheet(60, 6, bend=4.0), grey)
    elif name == "long thin faces":
        points = [(-50, 0, 0.05 * i - 1) for i in range(41)] + [(50, 0, 0.05 * i - 1) for i in range(41)]
        add_mesh(stage, "/World/Planks", points, [[i, i + 1, i + 42, i + 41] for i in range(40)], grey)
    elif name == "a fan of needles":
        rim = [(2 * np.cos(a), 0, 2 * np.sin(a)) for a in np.linspace(0, 2 * np.pi, 400, endpoint=False)]
        fan = [[0, 1 + (i + 1) % 400, 1 + i] for i in range(400)]
        add_mesh(stage, "/World/Fan", [(0, 0, 0), *rim], fan, grey)
    elif name == "collapsed quads":
        points = [(0, 0, 0), (0, 0, 0), (2, 0, -1), (1, 0, -2), (-1, 0, -2), (-2, 0, -1), (-2, 0, 1)]
        faces = [[0, 1, 2, 3], [0, 1, 3, 4], [0, 0, 5, 6], [1, 4, 5, 5]]
        add_mesh(stage, "/World/Collapsed", points, faces, grey)
    eye = (0, 1, 0) if name == "a plane to the horizon" else (0, 3, 2.5)
    target = (0, 0.9, -1) if name == "a plane to the horizon" else (0, 0, 0)
    add_camera(stage, eye, target, 0.5)
    return stage, settings


@pytest.mark.parametrize(
    "name",
    [
        "one primitive with many samples",
        "a plane to the horizon",
        "hundreds of primitives in a pixel",
        "primitives of one sample",
        "faces of every size",
        "long thin faces",
        "a fan of needles",
        "collapsed quads",
    ],
)
def test_extremes(name: str) -> None:
    stage, settings = extreme(name)
    result = assert_searches_agree(stage, (48, 48), **settings)
    assert result["statistics"]["non_finite_samples"] == 0
    assert total(result, "antialiasing_samples") > 48 * 48
    assert result["composite"].max() > 0.1
