"""The parts of the bench; each returns what it measured, ready for JSON."""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
from typing import Any

import numpy as np
from bench_measure import (
    PAPER_SHARES,
    RAYS,
    Scene,
    block_means,
    converged,
    load,
    mean_difference,
    measure,
    t_quantile,
    timed,
)
from encore import _core
from instanced_stages import SCRIPT
from rendering import ROOT, translate

VERTEX_RATES = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
ONE_RAY = {"light_samples": 1, "occlusion_samples": 1}

Rows = dict[str, Any]


# --- Kernels --------------------------------------------------------------------------------------


def kernels(arguments: argparse.Namespace) -> Rows:
    """Runs the programs build/tests/core/*_bench; and raw Embree, in this process.

    What they print as JSON lines becomes rows; anything else is kept as text.
    """
    rows, text = list[Rows](), dict[str, list[str]]()
    for program in sorted((ROOT / "build" / "tests" / "core").glob("*_bench")):
        flags = {"cell_lists_bench": ["--json"], "reuse_bench": ["--quick"] if arguments.quick else []}
        command = [str(program), *flags.get(program.name, [])]
        output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        for line in output.splitlines():
            if line.startswith("{"):
                rows.append({"program": program.name, **json.loads(line)})
            else:
                text.setdefault(program.name, []).append(line)
    scene = load("still_life", arguments)
    raw = [raw_rays_per_second(scene) for _ in range(max(arguments.runs, 5))]
    return {"rows": rows, "text": text, "embree_m_rays_per_s": statistics.median(raw) * 1e-6}


def instances(arguments: argparse.Namespace) -> Rows:
    """Stages of very many instances, each in a process of its own: what instanced_stages.py measures."""
    count = "100000" if arguments.quick else "1000000"
    rows = {"crowd": ["crowd"], "scatter": ["scatter"], "scatter with colours": ["scatter", "--values"]}
    found = {}
    for name, options in rows.items():
        more = ["--count", count] if name != "crowd" else []
        command = [sys.executable, str(SCRIPT), *options, *more]
        output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        found[name] = json.loads(output.splitlines()[-1])
    return found


def raw_rays_per_second(scene: Scene, **settings: Any) -> float:
    """Camera rays of the frame through rtcIntersect16, coherent, and nothing else."""
    core_scene = translate(scene.stage, *scene.size)
    width, height = scene.size
    given = {**scene.settings, **settings, "width": width, "height": height}
    raw = _core.trace_raw(core_scene, given)
    return float(raw["rays"] / raw["seconds"])


# --- Frames ---------------------------------------------------------------------------------------


def frames(scene: Scene, arguments: argparse.Namespace) -> Rows:
    """One scene by all methods, against a converged truth."""
    truth = converged(scene, arguments.truth_passes)
    report: Rows = {
        "size": scene.size,
        "samples": scene.settings["samples"],
        "truth_samples_per_pixel": truth.samples_per_pixel,
        "paper_reuse_share_of_frame": PAPER_SHARES,
    }
    rows = report["rows"] = {}

    def row(name: str, **settings: Any) -> Rows | None:
        if arguments.method and settings["method"] not in arguments.method:
            return None
        rows[name] = measure(scene, truth, arguments, **settings)
        return rows[name]

    reuse = row("reuse", method="reuse", **RAYS)
    same = row("reference, same rays per shade", method="reference", **RAYS)
    if reuse and same:
        equal = row("reference, equal rays per pixel", method="reference", **equal_rays(reuse, same))
        assert equal
        report["reuse_over_equal_rays"] = {m: reuse[m] / equal[m] for m in ("rmse", "flip")}
        report["fewer_shades_than_reference"] = same["shading_evaluations"] / reuse["shading_evaluations"]
        # What criterion 3 of the plan asks for: 0.4 × antialiasing samples over the rate.
        report["fewer_shades_wanted"] = 0.4 * scene.settings["samples"] ** 2 / 2
    curve = []
    for n in (4, 7, 11, 16) if arguments.quick else (4, 6, 8, 11, 16, 23):
        point = row(f"distribution ray tracing, {n} x {n}", method="reference", **{**ONE_RAY, "samples": n})
        if point:
            curve.append(point)
    row("decoupled", method="decoupled", **RAYS)
    row("decoupled-pixel", method="decoupled-pixel", **RAYS)
    for rate in (1.0, 4.0) if arguments.quick else (0.5, 1.0, 2.0, 4.0, 10.0):
        row(f"vertex, {rate:g} per pixel", method="vertex", shading_rate=rate, **RAYS)
    if reuse and curve:
        report["equal_error"] = {m: equal_error(reuse, curve, m) for m in ("rmse", "flip")}
    return report


def equal_rays(reuse: Rows, reference: Rows) -> dict[str, int]:
    """Light and occlusion samples that give the reference reuse's shadow rays per pixel; at least 1 each."""
    share = reuse["shading_evaluations"] / reference["shading_evaluations"]
    return {key: max(1, round(count * share)) for key, count in RAYS.items()}


def equal_error(reuse: Rows, curve: list[Rows], metric: str) -> Rows:
    """Seconds at which distribution ray tracing reaches reuse's error: a straight line through log error over
    log time."""
    x = np.log([point["seconds"] for point in curve])
    y = np.log([point[metric] for point in curve])
    slope, intercept = np.polyfit(x, y, 1)
    seconds = float(np.exp((np.log(reuse[metric]) - intercept) / slope))
    reached = min(point[metric] for point in curve) <= reuse[metric] <= max(point[metric] for point in curve)
    return {
        "error": reuse[metric],
        "reuse_seconds": reuse["seconds"],
        "distribution_seconds": seconds,
        "within_the_curve": reached,  # otherwise the line is extended
    }


# --- Phases ---------------------------------------------------------------------------------------


def phases(scene: Scene, arguments: argparse.Namespace) -> Rows:
    """All but shading of a direct-only pinhole frame, as a multiple of raw Embree for the same rays."""
    size = (480, 270) if arguments.quick else (1920, 1080)
    if arguments.width:
        size = (arguments.width, round(arguments.width * 9 / 16))
    frame = Scene(scene.name, scene.stage, size, {**scene.settings, "samples": 11, "max_bounces": 0})
    samples = frame.pixels * 121
    runs = []
    for _ in range(arguments.runs):
        raw_seconds = samples / raw_rays_per_second(frame)
        _, (result,) = timed(frame, 1, 0, method="reuse", **ONE_RAY)
        stages = result["statistics"]["time_s"]
        spent = {stage: stages[stage] / raw_seconds for stage in ("trace", "reuse", "film")}
        runs.append({"raw_seconds": raw_seconds, "ratio": sum(spent.values()), "stages": spent})
    return {
        "size": size,
        "samples": 11,
        "runs": len(runs),
        "raw_seconds": statistics.median(r["raw_seconds"] for r in runs),
        # Generation is timed with tracing. Seeds, trees and failures are in it as well.
        "ratio": statistics.median(r["ratio"] for r in runs),
        "stages": {s: statistics.median(r["stages"][s] for r in runs) for s in runs[0]["stages"]},
        "kernels_s": {name: k["seconds"] for name, k in result["statistics"]["kernels"].items()},
    }


# --- Vertex shading -------------------------------------------------------------------------------


def vertex(scene: Scene, arguments: argparse.Namespace) -> Rows:
    """Reuse against vertex shading at the coarsest rate whose RMSE is within 10 % of reuse's."""
    truth = converged(scene, arguments.truth_passes)
    reuse = measure(scene, truth, arguments, method="reuse", **RAYS)
    once = argparse.Namespace(**{**vars(arguments), "runs": 1})
    tried = {}
    for rate in VERTEX_RATES:
        tried[rate] = measure(scene, truth, once, method="vertex", shading_rate=rate, **RAYS)
        if tried[rate]["rmse"] <= 1.1 * reuse["rmse"]:
            break
    report: Rows = {
        "size": scene.size,
        "samples": scene.settings["samples"],
        "reuse": reuse,
        "tried": [{"rate": r, **row} for r, row in tried.items()],
    }
    reached = tried[rate]["rmse"] <= 1.1 * reuse["rmse"]
    report["rate"] = rate if reached else None
    chosen = tried[rate]
    if reached:
        chosen = measure(scene, truth, arguments, method="vertex", shading_rate=rate, **RAYS)
    report["vertex"] = chosen
    report["fewer_evaluations"] = chosen["shading_evaluations"] / reuse["shading_evaluations"]
    report["faster"] = chosen["seconds"] / reuse["seconds"]
    return report


# --- Bias -----------------------------------------------------------------------------------------


def bias(scene: Scene, arguments: argparse.Namespace, confidence: float = 0.99) -> Rows:
    """Mean of 16 seeds against truth.

    Seeds of reuse, and passes of the truth, are independent. Their means over the frame give the mean signed
    error and, by Welch's t, its interval; the same for every block of 16 × 16 pixels gives the share of
    blocks whose interval leaves 0 out (1 in 100 would without bias), and the bias left when its noise is
    taken off.
    """
    truth = converged(scene, arguments.truth_passes)
    seeds = np.array(
        [block_means(scene.render(method="reuse", **RAYS, seed=seed)["composite"]) for seed in range(16)]
    )
    mean, error, freedom = mean_difference(seeds.mean(axis=1), truth.passes.mean(axis=1))
    half = t_quantile(0.5 + confidence / 2, float(freedom)) * float(error)
    block, block_error, block_freedom = mean_difference(seeds, truth.passes)
    limit = [t_quantile(0.5 + confidence / 2, max(5.0, f)) for f in block_freedom]
    brightness = float(truth.passes.mean())
    excess = float(np.mean(block**2 - block_error**2))
    return {
        "size": scene.size,
        "seeds": len(seeds),
        "confidence": confidence,
        "mean_signed_error": float(mean),
        "interval": [float(mean) - half, float(mean) + half],
        "relative_interval": [(float(mean) - half) / brightness, (float(mean) + half) / brightness],
        "blocks": len(block),
        "share_of_blocks_off": float((np.abs(block) > np.array(limit) * block_error).mean()),
        "relative_block_bias": float(np.sqrt(max(0.0, excess))) / brightness,
    }


# --- Reuse quality controls -----------------------------------------------------------------------

CONTROLS: dict[str, dict[str, Any]] = {
    "none": {},
    "footprint metric, c = 1": {"footprint_reuse": "metric", "footprint_weight": 1.0},
    "footprint metric, c = 0.1": {"footprint_reuse": "metric", "footprint_weight": 0.1},
    "footprint octaves": {"footprint_reuse": "octaves"},
    "distance limit 4": {"max_reuse_distance": 4.0},
    "distance limit 2": {"max_reuse_distance": 2.0},
    "distance limit 1": {"max_reuse_distance": 1.0},
    "world-space parameters": {"world_space_parameters": True},
    "octaves, distance limit 2": {"footprint_reuse": "octaves", "max_reuse_distance": 2.0},
}


def controls(scene: Scene, arguments: argparse.Namespace) -> Rows:
    """Cost and error of each control, on and off."""
    truth = converged(scene, arguments.truth_passes)
    rows: Rows = {}
    for name, settings in CONTROLS.items():
        rows[name] = measure(scene, truth, arguments, method="reuse", **RAYS, **settings)
        rows[name]["times_the_cost"] = rows[name]["seconds"] / rows["none"]["seconds"]
        rows[name]["times_the_rmse"] = rows[name]["rmse"] / rows["none"]["rmse"]
    return {"size": scene.size, "samples": scene.settings["samples"], "rows": rows}
