"""The statistics document: names, sums over layers and frames, and the file."""

import json
from pathlib import Path
from typing import Any

import pytest
from encore import stats

DOCS = Path(__file__).parents[2] / "docs"


def core(shading: int, reflection: int | None = None, search: str = "groups") -> dict[str, Any]:
    """What encore._core.render() returns as statistics."""

    def layer(count: int) -> dict[str, Any]:
        return {
            "shading_evaluations": count,
            "reshading_evaluations": count // 10,
            "failed_samples": count // 5,
            "antialiasing_samples": count * 8,
            "trace_s": 0.25,
            "shade_s": 0.5,
            "reuse_s": 0.125,
            "film_s": 0.0625,
            "search": search,
        }

    layers = {"direct": layer(shading)}
    if reflection is not None:
        layers["reflection"] = layer(reflection)
    return {
        "device": "llvmpipe",
        "driver": "Mesa",
        "threads": 2,
        "primitives": 10 + shading,
        "micropolygons": 20,
        "pixels": 100,
        "antialiasing_samples": 6400,
        "rays_traced": 9000,
        "non_finite_samples": 0,
        "peak_memory_bytes": 1000 * shading,
        "device_peak_bytes": 100,
        "geometry_bytes": 10,
        "texture_bytes": 0,
        "time_s": {
            "dice": 1.0,
            "build": 2.0,
            "trace": 3.0,
            "shade": 4.0,
            "reuse": 5.0,
            "film": 6.0,
            "total": 21.0,
        },
        "layers": layers,
        "kernels": {"nearest_neighbour": {"dispatches": 3, "seconds": 0.5}},
        "warnings": {"clamped": 2},
    }


def entry(**statistics: Any) -> dict[str, Any]:
    return stats.frame_statistics(
        core(**statistics),
        frame="7",
        output="a.exr",
        camera="/Cam",
        sync_s=0.5,
        write_s=0.25,
        total_s=22.0,
        warnings={"odd": 1},
    )


def document(*frames: dict[str, Any]) -> dict[str, Any]:
    return stats.run_statistics(
        frames, version="1", stage="a.usda", settings={"samples": 8}, device={"name": "llvmpipe"}
    )


def test_names_of_the_design_in_all_and_per_layer() -> None:
    for part in (entry(shading=200, reflection=40), document(entry(shading=200, reflection=40))):
        assert {
            "primitives",
            "micropolygons",
            "shading_evaluations",
            "reshading_evaluations",
            "shading_evaluations_per_pixel",
            "antialiasing_samples",
            "rays_traced",
            "time_s",
            "peak_memory_bytes",
            "layers",
        } <= set(part)
        assert set(part["time_s"]) == {*stats.STAGES, "total"}
        assert set(part["layers"]) == {"direct", "reflection"}


def test_one_frame() -> None:
    frame = entry(shading=200, reflection=40)
    assert frame["shading_evaluations"] == 240
    assert frame["reshading_evaluations"] == 24
    assert frame["shading_evaluations_per_pixel"] == 2.4
    assert frame["layers"]["reflection"]["shading_evaluations_per_pixel"] == 0.4
    assert frame["layers"]["direct"]["time_s"] == {
        "trace": 0.25,
        "shade": 0.5,
        "reuse": 0.125,
        "film": 0.0625,
    }
    assert frame["time_s"]["sync"] == 0.5
    assert frame["time_s"]["write"] == 0.25
    assert frame["time_s"]["total"] == 22
    assert frame["warnings"] == {"clamped": 2, "odd": 1}


def test_several_frames_add_up_and_peaks_are_the_largest() -> None:
    total = document(entry(shading=100, reflection=50), entry(shading=300))
    assert total["shading_evaluations"] == 450
    assert total["shading_evaluations_per_pixel"] == 450 / 200
    assert total["pixels"] == 200
    assert total["primitives"] == 310
    assert total["peak_memory_bytes"] == 300_000
    assert total["time_s"]["film"] == 12
    assert total["time_s"]["total"] == 44
    # A layer that only one of the frames has counts only that frame's pixels.
    assert total["layers"]["reflection"]["shading_evaluations_per_pixel"] == 0.5
    assert total["layers"]["direct"]["time_s"]["shade"] == 1
    assert total["warnings"] == {"clamped": 4, "odd": 2}
    assert total["device_peak_bytes"] == 100
    assert total["non_finite_samples"] == 0
    assert [frame["frame"] for frame in total["frames"]] == ["7", "7"]


def test_how_layers_were_searched() -> None:
    assert entry(shading=10)["layers"]["direct"]["search"] == "groups"
    several = document(*(entry(shading=10, search=name) for name in ("tree", "cells", "tree")))
    assert several["layers"]["direct"]["search"] == "tree, cells"


def test_counters_that_core_may_add_are_passed_on() -> None:
    def with_more(rays: int, share: int) -> dict[str, Any]:
        made = core(shading=10)
        made["seed_rays"] = rays
        made["layers"]["direct"]["seeds"] = share
        return stats.frame_statistics(
            made, frame="1", output="a", camera="", sync_s=0, write_s=0, total_s=0, warnings={}
        )

    total = document(with_more(7, 3), with_more(5, 2))
    assert (total["seed_rays"], total["layers"]["direct"]["seeds"]) == (12, 5)


def test_the_file_is_json_and_whole(tmp_path: Path) -> None:
    made = document(entry(shading=1))
    stats.write(str(tmp_path / "s.json"), made)
    assert json.loads((tmp_path / "s.json").read_text()) == made
    assert [path.name for path in tmp_path.iterdir()] == ["s.json"]


@pytest.mark.parametrize("name", sorted({*document(entry(shading=1)), *entry(shading=1)}))
def test_every_name_is_documented(name: str) -> None:
    assert f"`{name}`" in (DOCS / "usage.md").read_text(encoding="utf-8")
