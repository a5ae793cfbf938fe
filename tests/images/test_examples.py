"""The scenes after the paper's figures: made the same every time, sound, and rendered without complaint."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import make_car
import make_magnifying_glass
import make_mirror_and_glass
import make_rolling_balls
import numpy as np
import pytest
from parts import Polygons, border, grid, polygon_distance, primitives, revolved, split
from pxr import Usd, UsdGeom
from rendering import render

GENERATORS = {
    "mirror_and_glass": make_mirror_and_glass,
    "car": make_car,
    "magnifying_glass": make_magnifying_glass,
    "rolling_balls": make_rolling_balls,
}
FILES = {"magnifying_glass": 3}  # with textures; others: 2


def made(generator: ModuleType, folder: Path, quick: bool) -> Path:
    folder.mkdir()
    path = folder / "scene.usda"
    generator.make(path, quick).GetRootLayer().Export(str(path))
    return path


@pytest.mark.parametrize("name", GENERATORS)
def test_a_generator_makes_the_same_files_every_time(name: str, tmp_path: Path) -> None:
    first, second = (made(GENERATORS[name], tmp_path / str(i), quick=True) for i in range(2))
    files = sorted(p.name for p in first.parent.iterdir())
    assert len(files) == FILES.get(name, 2)
    for file in files:
        assert (first.parent / file).read_bytes() == (second.parent / file).read_bytes()


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [
        ("mirror_and_glass", 9e4, 1.1e5),
        ("car", 1.95e5, 2.15e5),
        ("magnifying_glass", 6e4, 7e4),
        ("rolling_balls", 1e4, 1.2e4),
    ],
)
def test_full_scenes_have_the_size_they_are_said_to_have(
    name: str, least: float, most: float, tmp_path: Path
) -> None:
    stage = Usd.Stage.Open(str(made(GENERATORS[name], tmp_path / name, quick=False)))
    assert least <= primitives(stage) <= most
    recorded = stage.GetRootLayer().customLayerData["encore"]
    assert {"width", "height", "samples", "max_bounces"} <= set(recorded)
    for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()):
        if not prim.IsA(UsdGeom.Mesh):
            continue
        mesh = UsdGeom.Mesh(prim)
        points, normals = (np.array(a.Get()) for a in (mesh.GetPointsAttr(), mesh.GetNormalsAttr()))
        assert np.isfinite(points).all(), prim
        if normals.ndim == 2:
            np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-4, err_msg=str(prim))


@pytest.mark.parametrize("name", GENERATORS)
def test_quick_scenes_render(name: str, tmp_path: Path) -> None:
    stage = Usd.Stage.Open(str(made(GENERATORS[name], tmp_path / name, quick=True)))
    result = render(stage, 96, 60, samples=2, occlusion_samples=4, light_samples=2, max_bounces=3)
    assert not result["statistics"]["warnings"]
    assert result["statistics"]["non_finite_samples"] == 0
    assert result["statistics"]["primitives"] == primitives(stage)
    assert result["alpha"].mean() > 0.7
    for layer, image in result["layers"].items():
        assert image.mean() > 0.002, layer
    assert result["composite"].std() > 0.1


def closed_tube() -> Polygons:
    return revolved(np.array([(1.0, -1.0), (1.0, 1.0)]), 24)


def area(mesh: Polygons) -> float:
    """Of planar faces, by fans from their first corners."""
    total = 0.0
    for start, count in zip(mesh.starts, mesh.counts, strict=True):
        p = mesh.points[mesh.indices[start : start + count]]
        total += 0.5 * np.linalg.norm(np.cross(p[1:-1] - p[0], p[2:] - p[0]).sum(axis=0))
    return total


def test_cutting_keeps_area_and_leaves_no_cracks() -> None:
    tube = closed_tube()
    above, below = split(tube, lambda p, n: p[:, 1] + 0.31 * p[:, 0] - 0.05)
    assert abs(area(above) + area(below) - area(tube)) < 1e-9
    # A cut goes once around: as many open edges as it has points, besides the tube's own end.
    for part, end in ((above, 24), (below, 24)):
        edges = border(part)
        assert len(edges) - end == len(np.unique(edges)) - end
    # Both sides of the cut have the same points.
    cut = set(np.unique(border(above))) & set(np.unique(border(below)))
    assert len(cut) == len(border(above)) - 24


def test_turning_and_mirroring_keep_normals_and_winding_together() -> None:
    sheet = grid(np.array([[(x, 0.2 * x * z, z) for x in (0.0, 1.0, 2.0)] for z in (0.0, 1.0, 2.0)]))
    for mesh in (sheet, sheet.turned(), sheet.mirrored(), sheet.moved((1, 2, 3), (1, 2, 3), 30.0)):
        start = mesh.starts[0]
        a, b, c = mesh.points[mesh.indices[start : start + 3]]
        assert np.cross(b - a, c - a) @ mesh.normals[mesh.indices[start]] > 0


def test_distance_to_a_polygon() -> None:
    square = [(0, 0), (2, 0), (2, 2), (0, 2)]
    x, y = np.array([1.0, 3.0, 0.5, -1.0]), np.array([1.0, 1.0, 1.0, -1.0])
    np.testing.assert_allclose(polygon_distance(square, x, y), [1, -1, 0.5, -np.sqrt(2)])
