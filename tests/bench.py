"""./dev bench: kernels and frames, as a table and JSON. Timings live here and never in a test.

Parts, each of which can be run alone (--only):
  kernels   build, nearest neighbours, failures and film, beside raw Embree
  phases    a direct-only 1080p frame without shading, as a multiple of raw Embree for the same rays
  frames    every example scene by every method, against a converged reference
  vertex    the car by reuse and by vertex shading of equal error
  controls  the reuse quality controls on the mirror and the glass ball: cost and error
  bias      the mean of 16 seeds against truth, with its interval
  instances stages of very many instances: seconds and memory
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any

import bench_parts
from bench_measure import SCENES, Scene, load
from encore import _core

PARTS = ("kernels", "phases", "frames", "vertex", "controls", "bias", "instances")
DEFAULT_SCENES = {
    "phases": ("still_life", "mirror_and_glass", "car"),
    "frames": ("still_life", "mirror_and_glass", "car"),
    "vertex": ("car",),
    "controls": ("mirror_and_glass",),
    "bias": ("still_life", "mirror_and_glass", "car"),
}
STAGES = ("dice", "build", "trace", "shade", "reuse", "film")


def print_kernels(report: dict[str, Any]) -> None:
    print(f"raw Embree, camera rays in packets of 16: {report['embree_m_rays_per_s']:.1f} M rays/s")
    last = ""
    for row in report["rows"]:
        if row["program"] != last:
            last = row["program"]
            print(f"{last}:")
        cells = {key: value for key, value in row.items() if key not in ("program", "device", "bench")}
        for key in [k for k, value in cells.items() if isinstance(value, dict)]:
            cells |= {f"{key} {inner}": value for inner, value in cells.pop(key).items()}
        print("  " + "  ".join(f"{key} {value}" for key, value in cells.items()))
    for program, lines in report["text"].items():
        print(f"{program}:", *lines, sep="\n  ")


def print_heads(report: dict[str, Any], title: str) -> None:
    width, height = report["size"]
    print(f"{title}, {width} x {height}, {report['samples']} x {report['samples']} samples per pixel")
    print(f"{'':34}{'runs':>5}{'s':>9}{'RMSE':>9}{'FLIP':>8}{'shade/px':>10}{'resh. %':>8}", end="")
    print(f"{'reuse %':>8}{'reuse/trace':>12}" + "".join(f"{s:>8}" for s in STAGES))


def print_row(name: str, row: dict[str, Any]) -> None:
    print(f"{name:34}{row['runs']:5}{row['seconds']:9.2f}{row['rmse']:9.5f}{row['flip']:8.4f}", end="")
    print(f"{row['shading_evaluations_per_pixel']:10.2f}{100 * row['reshaded_share']:8.2f}", end="")
    print(f"{100 * row['reuse_share_of_frame']:8.1f}{row['reuse_over_trace']:12.2f}", end="")
    print("".join(f"{row['time_s'].get(stage, 0):8.2f}" for stage in STAGES))


def print_frames(report: dict[str, Any], scene: str) -> None:
    print_heads(report, f"{scene} (truth {report['truth_samples_per_pixel']} samples per pixel)")
    for name, row in report["rows"].items():
        print_row(name, row)
    shares = ", ".join(f"{100 * v:.1f} % ({k})" for k, v in report["paper_reuse_share_of_frame"].items())
    print(f"  reuse's share of the frame in the paper: {shares}")
    if "reuse_over_equal_rays" in report:
        ratios = report["reuse_over_equal_rays"]
        print(
            f"  error over that of the reference with equal rays per pixel: RMSE {ratios['rmse']:.2f}, "
            f"FLIP {ratios['flip']:.2f} (wanted: at most 1.2)"
        )
        print(
            f"  {report['fewer_shades_than_reference']:.1f} x fewer shades than the reference "
            f"(wanted where less than 15 % is reshaded: {report['fewer_shades_wanted']:.1f})"
        )
    for metric, row in report.get("equal_error", {}).items():
        ratio = row["distribution_seconds"] / row["reuse_seconds"]
        winner = "reuse" if ratio > 1 else "distribution ray tracing"
        extended = "" if row["within_the_curve"] else " (extrapolated)"
        print(
            f"  at reuse's {metric.upper()} of {row['error']:.5f}: reuse {row['reuse_seconds']:.2f} s, "
            f"distribution ray tracing {row['distribution_seconds']:.2f} s{extended}: "
            f"{winner} wins by {max(ratio, 1 / ratio):.2f} x"
        )


def print_phases(report: dict[str, Any], scene: str) -> None:
    width, height = report["size"]
    parts = ", ".join(f"{stage} {ratio:.2f}" for stage, ratio in report["stages"].items())
    print(
        f"{scene}, direct only, {width} x {height}, 11 x 11: {report['ratio']:.2f} x raw Embree "
        f"({report['raw_seconds']:.2f} s): {parts} (wanted: at most 4; aim 2.5)"
    )


def print_vertex(report: dict[str, Any], scene: str) -> None:
    rate = f"{report['rate']:g} per pixel" if report["rate"] else "no rate tried reaches reuse's error"
    print_heads(report, f"{scene}: vertex shading, {rate}")
    print_row("reuse", report["reuse"])
    for row in report["tried"]:
        print_row(f"vertex, {row['rate']:g} per pixel", row)
    print(
        f"  reuse: {report['fewer_evaluations']:.1f} x fewer evaluations (wanted 17), "
        f"{report['faster']:.2f} x faster (wanted 3.5)"
    )


def print_controls(report: dict[str, Any], scene: str) -> None:
    print_heads(report, f"{scene}: reuse quality controls")
    for name, row in report["rows"].items():
        print_row(name, row)
    for name, row in report["rows"].items():
        layers = ", ".join(f"{layer} {value:.5f}" for layer, value in row["layer_rmse"].items())
        print(
            f"  {name:32} {row['times_the_cost']:5.2f} x the cost, {row['times_the_rmse']:5.2f} x the RMSE; "
            f"RMSE of layers: {layers}"
        )


def print_bias(report: dict[str, Any], scene: str) -> None:
    low, high = (100 * v for v in report["relative_interval"])
    print(
        f"{scene}, {report['size'][0]} x {report['size'][1]}: mean signed error of {report['seeds']} seeds "
        f"between {low:+.3f} % and {high:+.3f} % ({100 * report['confidence']:.0f} % interval); "
        f"{100 * report['share_of_blocks_off']:.1f} % of {report['blocks']} blocks off by more than their "
        f"interval; RMS bias of a block {100 * report['relative_block_bias']:.3f} % of the mean"
    )


def print_instances(report: dict[str, Any]) -> None:
    print(
        f"{'':24}{'instances':>10}{'M primitives':>14}{'sync s':>8}{'render s':>10}{'build s':>9}{'MiB':>8}"
    )
    for name, row in report.items():
        mebibytes = (row["peak_bytes"] - row["stage_bytes"]) / (1 << 20)
        print(
            f"{name:24}{row['counts']['instances']:10}{row['primitives'] / 1e6:14.1f}{row['sync_s']:8.2f}"
            f"{row['render_s']:10.2f}{row['time_s']['build']:9.2f}{mebibytes:8.0f}"
        )


# Parts without scenes.
ALONE = {"kernels": print_kernels, "instances": print_instances}
PRINTERS = {
    "phases": print_phases,
    "frames": print_frames,
    "vertex": print_vertex,
    "controls": print_controls,
    "bias": print_bias,
}


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="./dev bench", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="small frames and meshes, one run each")
    parser.add_argument("--runs", type=int, default=5, help="runs per figure; medians are reported (5)")
    parser.add_argument(
        "--patience", type=float, default=60, help="seconds beyond which a render is not repeated (60)"
    )
    parser.add_argument("--only", choices=PARTS, action="append", help="just this part; repeatable")
    parser.add_argument("--scene", choices=SCENES, action="append", help="just this scene; repeatable")
    parser.add_argument("--method", action="append", help="in frames, just this method; repeatable")
    parser.add_argument("--width", type=int, help="width of the frames in pixels; default: the scenes' own")
    parser.add_argument("--samples", type=int, help="N x N samples per pixel; default: the scenes' own")
    parser.add_argument("--threads", type=int, default=0, help="CPU threads; 0: all")
    parser.add_argument(
        "--truth-passes", type=int, help="times 256 samples per pixel of truth (16; 4 with --quick)"
    )
    parser.add_argument("--json", type=Path, help="write all figures to this file")
    result = parser.parse_args(arguments)
    if result.quick:
        result.runs, result.width = 1, result.width or 240
    result.truth_passes = result.truth_passes or (4 if result.quick else 16)
    if result.truth_passes < 2:
        parser.error("--truth-passes must be at least 2")
    return result


def main() -> int:
    arguments = parse()
    device = _core.create_device("", False).info
    threads = arguments.threads or len(os.sched_getaffinity(0))
    print(f"device {device['name']}, driver {device['driver']}; {threads} threads")
    report: dict[str, Any] = {"device": device, "threads": threads}

    def save() -> None:
        if arguments.json:
            arguments.json.write_text(json.dumps(report, indent=2) + "\n")

    scenes: dict[str, Scene] = {}
    for part in arguments.only or PARTS:
        print(f"\n{part}")
        if part in ALONE:
            report[part] = getattr(bench_parts, part)(arguments)
            ALONE[part](report[part])
            save()
            continue
        report[part] = {}
        for name in arguments.scene or DEFAULT_SCENES[part]:
            scenes.setdefault(name, load(name, arguments))
            report[part][name] = getattr(bench_parts, part)(scenes[name], arguments)
            PRINTERS[part](report[part][name], name)
            save()
    return 0


if __name__ == "__main__":
    sys.exit(main())
