"""The statistics of a run as JSON: what --stats writes (docs/usage.md explains every name)."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from encore.output import write_text

FORMAT = 1

# Counters that are added over frames; of the others the largest frame's is kept.
_SUMMED = ("shading_evaluations", "reshading_evaluations", "antialiasing_samples", "rays_traced", "pixels")
_LAYER_COUNTERS = ("shading_evaluations", "reshading_evaluations", "failed_samples", "antialiasing_samples")
_LAYER_TIMES = ("trace", "shade", "reuse", "film")
STAGES = ("sync", "dice", "build", "trace", "shade", "reuse", "film", "write")
_PEAKS = ("peak_memory_bytes", "device_peak_bytes", "geometry_bytes", "texture_bytes")


def frame_statistics(
    core: Mapping[str, Any],
    *,
    frame: str,
    output: str,
    camera: str,
    sync_s: float,
    write_s: float,
    total_s: float,
    warnings: Mapping[str, int],
) -> dict[str, Any]:
    """One frame's entry. core: the statistics of encore._core.render(). warnings: message → count."""
    pixels = int(core["pixels"])
    layers = {name: _layer(values, pixels) for name, values in core["layers"].items()}
    shading = sum(layer["shading_evaluations"] for layer in layers.values())
    times = {stage: float(core["time_s"].get(stage, 0.0)) for stage in STAGES}
    times |= {"sync": sync_s, "write": write_s, "total": total_s}
    return {
        "frame": frame,
        "output": output,
        "camera": camera,
        "pixels": pixels,
        "primitives": core["primitives"],
        "micropolygons": core["micropolygons"],
        "shading_evaluations": shading,
        "reshading_evaluations": sum(layer["reshading_evaluations"] for layer in layers.values()),
        "shading_evaluations_per_pixel": shading / pixels,
        "antialiasing_samples": core["antialiasing_samples"],
        "rays_traced": core["rays_traced"],
        "non_finite_samples": core["non_finite_samples"],
        "time_s": times,
        **{name: core[name] for name in _PEAKS},
        "layers": layers,
        "kernels": {name: dict(values) for name, values in core["kernels"].items()},
        "warnings": dict(core["warnings"]) | dict(warnings),
    }


def run_statistics(
    frames: Sequence[Mapping[str, Any]],
    *,
    version: str,
    stage: str,
    settings: Mapping[str, Any],
    device: Mapping[str, Any],
) -> dict[str, Any]:
    """The whole document: all frames together under the names of a frame, and each of them in `frames`."""
    total = {name: sum(frame[name] for frame in frames) for name in _SUMMED}
    pixels = max(1, total["pixels"])
    return {
        "format": FORMAT,
        "version": version,
        "stage": stage,
        "settings": dict(settings),
        "device": dict(device),
        "primitives": _largest(frame["primitives"] for frame in frames),
        "micropolygons": _largest(frame["micropolygons"] for frame in frames),
        **total,
        "shading_evaluations_per_pixel": total["shading_evaluations"] / pixels,
        "time_s": _sum_times(frame["time_s"] for frame in frames),
        "peak_memory_bytes": _largest(frame["peak_memory_bytes"] for frame in frames),
        "layers": _sum_layers(frames),
        "warnings": _sum_counts(frame["warnings"] for frame in frames),
        "frames": [dict(frame) for frame in frames],
    }


def write(path: str, statistics: Mapping[str, Any]) -> None:
    """Writes the document, whole or not at all."""
    write_text(path, json.dumps(statistics, indent=2) + "\n")


def _layer(core: Mapping[str, Any], pixels: int) -> dict[str, Any]:
    return {
        **{name: core[name] for name in _LAYER_COUNTERS},
        "shading_evaluations_per_pixel": core["shading_evaluations"] / pixels,
        "time_s": {stage: core[f"{stage}_s"] for stage in _LAYER_TIMES},
    }


def _sum_layers(frames: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    totals: dict[str, Any] = {}
    for name in dict.fromkeys(name for frame in frames for name in frame["layers"]):
        parts = [frame["layers"][name] for frame in frames if name in frame["layers"]]
        pixels = max(1, sum(frame["pixels"] for frame in frames if name in frame["layers"]))
        totals[name] = {counter: sum(part[counter] for part in parts) for counter in _LAYER_COUNTERS}
        totals[name]["shading_evaluations_per_pixel"] = totals[name]["shading_evaluations"] / pixels
        totals[name]["time_s"] = _sum_times(part["time_s"] for part in parts)
    return totals


def _sum_times(times: Iterable[Mapping[str, float]]) -> dict[str, float]:
    totals: dict[str, float] = {}
    for entry in times:
        for stage, seconds in entry.items():
            totals[stage] = totals.get(stage, 0.0) + seconds
    return totals


def _sum_counts(counts: Iterable[Mapping[str, int]]) -> dict[str, int]:
    totals: dict[str, int] = {}
    for entry in counts:
        for message, count in entry.items():
            totals[message] = totals.get(message, 0) + count
    return totals


def _largest(values: Iterable[int]) -> int:
    return max(values, default=0)
