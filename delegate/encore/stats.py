"""The statistics of a run as JSON: what --stats writes (docs/usage.md explains every name)."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from encore.output import write_text

FORMAT = 1

STAGES = ("sync", "dice", "build", "trace", "shade", "reuse", "film", "write")
# Of these the largest frame's is kept; all other counters are added over frames.
_LARGEST = (
    "primitives",
    "micropolygons",
    "peak_memory_bytes",
    "device_peak_bytes",
    "geometry_bytes",
    "texture_bytes",
)
# What core says of a frame that is no counter.
_NO_COUNTERS = ("device", "driver", "threads", "time_s", "layers", "kernels", "warnings")


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
        **{name: value for name, value in core.items() if name not in _NO_COUNTERS},
        "shading_evaluations": shading,
        "reshading_evaluations": sum(layer["reshading_evaluations"] for layer in layers.values()),
        "shading_evaluations_per_pixel": shading / pixels,
        "time_s": times,
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
    names = [name for name, value in frames[0].items() if isinstance(value, int)]
    total = {n: (max if n in _LARGEST else sum)(frame[n] for frame in frames) for n in names}
    return {
        "format": FORMAT,
        "version": version,
        "stage": stage,
        "settings": dict(settings),
        "device": dict(device),
        **total,
        "shading_evaluations_per_pixel": total["shading_evaluations"] / total["pixels"],
        "time_s": _sum_times(frame["time_s"] for frame in frames),
        "layers": _sum_layers(frames),
        "warnings": _sum_counts(frame["warnings"] for frame in frames),
        "frames": [dict(frame) for frame in frames],
    }


def write(path: str, statistics: Mapping[str, Any]) -> None:
    """Writes the document, whole or not at all."""
    write_text(path, json.dumps(statistics, indent=2) + "\n")


def _layer(core: Mapping[str, Any], pixels: int) -> dict[str, Any]:
    """A layer's entry: everything that core says of it, times apart."""
    return {
        **{name: value for name, value in core.items() if not name.endswith("_s")},
        "shading_evaluations_per_pixel": core["shading_evaluations"] / pixels,
        "time_s": {n.removesuffix("_s"): value for n, value in core.items() if n.endswith("_s")},
    }


def _sum_layers(frames: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    totals: dict[str, Any] = {}
    for name in dict.fromkeys(name for frame in frames for name in frame["layers"]):
        parts = [frame["layers"][name] for frame in frames if name in frame["layers"]]
        pixels = sum(frame["pixels"] for frame in frames if name in frame["layers"])
        total = {key: _together([p[key] for p in parts]) for key in parts[0] if key != "time_s"}
        total["shading_evaluations_per_pixel"] = total["shading_evaluations"] / pixels
        totals[name] = total | {"time_s": _sum_times(part["time_s"] for part in parts)}
    return totals


def _together(values: Sequence[Any]) -> Any:
    """The sum of numbers; of words, each that occurs."""
    return ", ".join(dict.fromkeys(values)) if isinstance(values[0], str) else sum(values)


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
