"""./dev bench: kernels and frames, as a table and JSON. Timings live here and never in a test.

Frames: still_life by reuse, by the reference with the same rays per shade, and by classic distribution ray
tracing (the reference with one occlusion ray and one light sample per antialiasing sample) at several sample
counts, against a converged reference. Equal-error times are read off the distribution curve, log-log.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import flip_evaluator
import numpy as np
from encore import _core
from pxr import Usd
from rendering import ROOT, render, total

# Fixed for every image, so that FLIP values of different methods can be compared.
EXPOSURES = {"startExposure": -2.0, "stopExposure": 2.0, "numExposures": 5}


def flip(reference: np.ndarray, image: np.ndarray) -> float:
    _, mean, _ = flip_evaluator.evaluate(reference, image, "HDR", True, False, True, EXPOSURES)
    return float(mean)


def rmse(reference: np.ndarray, image: np.ndarray) -> float:
    return float(np.sqrt(np.mean((image.astype(float) - reference.astype(float)) ** 2)))


def converged(stage: Usd.Stage, size: tuple[int, int], passes: int) -> np.ndarray:
    """Mean of independent seeds of distribution ray tracing: the same transport, no reuse."""
    mean = np.zeros((size[1], size[0], 3))
    for seed in range(passes):
        settings = {"samples": 16, "light_samples": 2, "occlusion_samples": 2, "seed": 1000 + seed}
        mean += render(stage, *size, method="reference", **settings)["composite"]
    return (mean / passes).astype(np.float32)


def measure(
    stage: Usd.Stage, size: tuple[int, int], truth: np.ndarray, runs: int, **settings: Any
) -> dict[str, Any]:
    """The medians of `runs` renders: end to end, by stage, and error against `truth`."""
    seconds, results = [], []
    for _ in range(runs):
        start = time.perf_counter()
        results.append(render(stage, *size, **settings))
        seconds.append(time.perf_counter() - start)
    result = results[0]
    stats = result["statistics"]
    stages = stats["time_s"].keys()
    return {
        "seconds": statistics.median(seconds),
        "time_s": {s: statistics.median(r["statistics"]["time_s"][s] for r in results) for s in stages},
        "shading_evaluations_per_pixel": total(result, "shading_evaluations") / (size[0] * size[1]),
        "reshaded_share": total(result, "reshading_evaluations")
        / max(1, total(result, "shading_evaluations")),
        "failed_share": total(result, "failed_samples") / max(1, total(result, "antialiasing_samples")),
        "rays_traced": stats["rays_traced"],
        "rmse": rmse(truth, result["composite"]),
        "flip": flip(truth, result["composite"]),
        "settings": settings,
    }


def time_at_error(curve: list[dict[str, Any]], metric: str, error: float) -> float:
    """Seconds at which a method reaches `error`, by a straight line through log error over log time."""
    x = np.log([point["seconds"] for point in curve])
    y = np.log([point[metric] for point in curve])
    slope, intercept = np.polyfit(x, y, 1)
    return float(np.exp((np.log(error) - intercept) / slope))


def frames(arguments: argparse.Namespace) -> dict[str, Any]:
    size = (arguments.width, round(arguments.width * 9 / 16))
    stage = Usd.Stage.Open(str(ROOT / "examples" / "still_life.usda"))
    truth = converged(stage, size, arguments.truth_passes)
    common = {"samples": 11, "shading_rate": 2.0, "seed": 1}
    full = {"occlusion_samples": 64, "light_samples": 16}
    one = {"occlusion_samples": 1, "light_samples": 1}
    rows: dict[str, Any] = {"size": size, "truth_samples_per_pixel": 256 * arguments.truth_passes}
    rows["reuse"] = measure(stage, size, truth, arguments.runs, method="reuse", **common, **full)
    rows["reference, same rays per shade"] = measure(
        stage, size, truth, 1 if arguments.quick else arguments.runs, method="reference", **common, **full
    )
    curve = []
    for n in (4, 7, 11, 16) if arguments.quick else (4, 6, 8, 11, 16, 23):
        settings = {**common, **one, "samples": n, "method": "reference"}
        curve.append(measure(stage, size, truth, arguments.runs, **settings))
        rows[f"distribution ray tracing, {n} x {n}"] = curve[-1]
    rows["equal_error"] = {
        metric: {
            "error": rows["reuse"][metric],
            "reuse_seconds": rows["reuse"]["seconds"],
            "distribution_seconds": time_at_error(curve, metric, rows["reuse"][metric]),
        }
        for metric in ("rmse", "flip")
    }
    return rows


def print_frames(rows: dict[str, Any]) -> None:
    stages = ("dice", "build", "trace", "shade", "reuse", "film")
    width, height = rows["size"]
    truth = rows["truth_samples_per_pixel"]
    print(f"still_life, {width} x {height}, truth {truth} samples per pixel")
    heads = f"{'':34}{'s':>8}{'RMSE':>9}{'FLIP':>8}{'shade/px':>10}{'resh. %':>9}"
    print(heads + "".join(f"{s:>8}" for s in stages))
    for name, row in rows.items():
        if not isinstance(row, dict) or "rmse" not in row or "settings" not in row:
            continue
        print(f"{name:34}{row['seconds']:8.2f}{row['rmse']:9.5f}{row['flip']:8.4f}", end="")
        print(f"{row['shading_evaluations_per_pixel']:10.2f}{100 * row['reshaded_share']:9.2f}", end="")
        print("".join(f"{row['time_s'].get(s, 0):8.2f}" for s in stages))
    for metric, row in rows["equal_error"].items():
        ratio = row["distribution_seconds"] / row["reuse_seconds"]
        winner = "reuse" if ratio > 1 else "distribution ray tracing"
        print(
            f"at reuse's {metric.upper()} of {row['error']:.5f}: reuse {row['reuse_seconds']:.2f} s, "
            f"distribution ray tracing {row['distribution_seconds']:.2f} s: "
            f"{winner} wins by {max(ratio, 1 / ratio):.2f} x"
        )


def kernels() -> list[dict[str, Any]]:
    """Runs build/tests/core/reuse_bench, which prints one JSON object a line."""
    program = ROOT / "build" / "tests" / "core" / "reuse_bench"
    output = subprocess.run([str(program)], check=True, capture_output=True, text=True).stdout
    return [json.loads(line) for line in output.splitlines() if line.startswith("{")]


def main() -> int:
    parser = argparse.ArgumentParser(prog="./dev bench", description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a small frame, one run each")
    parser.add_argument("--runs", type=int, default=5, help="runs per figure; medians are reported (5)")
    parser.add_argument("--width", type=int, default=480, help="width of the frame in pixels (480)")
    parser.add_argument(
        "--truth-passes", type=int, default=16, help="times 256 samples per pixel of truth (16)"
    )
    parser.add_argument("--only", choices=("kernels", "frames"), help="leave out the other")
    parser.add_argument("--json", type=Path, help="write all figures to this file")
    arguments = parser.parse_args()
    if arguments.quick:
        arguments.runs, arguments.width, arguments.truth_passes = 1, 240, 4
    device = _core.create_device("", False).info
    report: dict[str, Any] = {"device": device}
    print(f"device {device['name']}, driver {device['driver']}")
    if arguments.only != "frames":
        report["kernels"] = kernels()
        for row in report["kernels"]:
            print("  ".join(f"{key} {value}" for key, value in row.items()))
    if arguments.only != "kernels":
        report["frames"] = frames(arguments)
        print_frames(report["frames"])
    if arguments.json:
        arguments.json.write_text(json.dumps(report, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
