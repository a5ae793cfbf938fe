"""Frames of a run and the names of their images, with usdrecord's syntax."""

from __future__ import annotations

import re
from dataclasses import dataclass

from pxr import Usd, UsdUtils

from encore.errors import SettingError, UsageError

_NUMBER = r"(-?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+))"
_FRAME_SPEC = re.compile(f"{_NUMBER}(?::{_NUMBER}(?:x{_NUMBER})?)?")
_MOST_FRAMES = 1_000_000
_WIDEST = 64  # characters of a frame number
# usdrecord's, C's and Houdini's.
_PRODUCT_PLACEHOLDER = re.compile(
    r"(?P<hashes>#+(?:\.#+)?)|%0?(?P<c>[0-9]*)d|\$F(?![A-Za-z])(?P<f>[0-9]?)|<F(?P<angle>[0-9]*)>"
    r"|\$\{F(?P<brace>[0-9]*)\}"
)
PLACEHOLDER_HELP = "Write one placeholder such as ### or ###.### (any number of #) into the output name"


@dataclass(frozen=True)
class Frame:
    """One image to make. label: what logs, headers and statistics call it."""

    time: Usd.TimeCode
    output: str
    label: str


def parse_frame_specs(text: str) -> tuple[list[float], int]:
    """Time codes of comma-separated FrameSpecs, in order, each once, and the decimals that tell them apart.

    A FrameSpec is A, A:B or A:BxS, as UsdUtils.TimeCodeRange reads it. Throws UsageError.
    """
    times: dict[float, None] = {}
    decimals = 0
    for part in (p.strip() for p in text.split(",")):
        # Checked before USD sees it: some malformed specifications end the process there.
        match = _FRAME_SPEC.fullmatch(part)
        if not match:
            raise UsageError(f"'{part}' is not a frame specification", "--frames", "Write 7, 1:10 or 1:10x2")
        start, end = float(match[1]), float(match[2] or match[1])
        stride = float(match[3] or (1 if end >= start else -1))
        if stride == 0 or (end - start) * stride < 0:
            raise UsageError(f"'{part}' never reaches its end", "--frames", "Give the stride the other sign")
        if (end - start) / stride > _MOST_FRAMES:
            raise UsageError(f"'{part}' has more than {_MOST_FRAMES} frames", "--frames")
        times |= dict.fromkeys(t.GetValue() for t in UsdUtils.TimeCodeRange.CreateFromFrameSpec(part))
        decimals = max(decimals, *(_decimals(number) for number in match.groups() if number))
    return list(times), decimals


def split_placeholder(output: str) -> tuple[str, str, str] | None:
    """The parts of an output name before, in and after its placeholder; None without exactly one."""
    match = re.fullmatch(r"([^#]*)(#+(?:\.#+)?)([^#]*)", output)
    return (match[1], match[2], match[3]) if match else None


def fill_placeholder(output: str, time: float) -> str:
    """The output name for a time code: as wide as the placeholder at least, padded with zeros."""
    parts = split_placeholder(output)
    if parts is None:
        raise UsageError(f"'{output}' has no single frame placeholder", "OUTPUT", PLACEHOLDER_HELP)
    before, placeholder, after = parts
    return f"{before}{time:0{len(placeholder)}.{_decimals(placeholder)}f}{after}"


def plan(stage: Usd.Stage, output: str, frames: str | None, default_time: bool) -> list[Frame]:
    """The frames that the flags ask for: a range, the default time, or the stage's start time."""
    if frames is None:
        if split_placeholder(output):
            raise UsageError(f"'{output}' has a frame placeholder, but there are no --frames", "OUTPUT")
        if default_time:
            return [Frame(Usd.TimeCode.Default(), output, "default")]
        start = stage.GetStartTimeCode()
        return [Frame(Usd.TimeCode(start), output, f"{start:g}")]
    times, decimals = parse_frame_specs(frames)
    parts = split_placeholder(output)
    if parts is None:
        raise UsageError(f"'{output}' has no single frame placeholder", "OUTPUT", PLACEHOLDER_HELP)
    if _decimals(parts[1]) < decimals:
        raise UsageError(
            f"the frames need {decimals} decimals, but the placeholder {parts[1]} has {_decimals(parts[1])}",
            "OUTPUT",
            f"Write {'#' * max(1, len(parts[1].split('.')[0]))}.{'#' * decimals}",
        )
    return [Frame(Usd.TimeCode(t), fill_placeholder(output, t), f"{t:g}") for t in times]


def times(stage: Usd.Stage, frames: str | None, default_time: bool) -> list[Frame]:
    """The frames that the flags ask for, without names of images."""
    if frames is not None:
        return [Frame(Usd.TimeCode(t), "", f"{t:g}") for t in parse_frame_specs(frames)[0]]
    return plan(stage, "", None, default_time)


def expand_product_name(name: str, time: Usd.TimeCode, where: str) -> str:
    """A productName with its frame number for ####, ###.###, <F4>, $F4, ${F4} and %04d, all of them.

    where: the attribute, for messages. Throws SettingError where the time is no number that fits, and for
    widths beyond 64.
    """

    def number(match: re.Match[str]) -> str:
        hashes = match["hashes"] or ""
        digits = next((match[g] for g in ("c", "f", "angle", "brace") if match[g]), "").lstrip("0")
        # Python refuses to read very many digits.
        width = len(hashes) or int(digits[:3] or 1)
        if width > _WIDEST:
            raise SettingError(
                f"its frame placeholder is wider than {_WIDEST} characters", where, "Write <F4> or ####"
            )
        if time.IsDefault():
            raise SettingError(
                f"'{name}' has a frame placeholder, and the default time has no number",
                where,
                "Give --frames",
            )
        value = time.GetValue()
        decimals = _decimals(hashes)
        if not float(round(value, decimals)) == value:
            raise SettingError(
                f"'{match[0]}' in '{name}' has no place for the decimals of frame {value:g}",
                where,
                "Write a placeholder such as ####.##",
            )
        return f"{value:0{width}.{decimals}f}"

    return _PRODUCT_PLACEHOLDER.sub(number, name)


def _decimals(number: str) -> int:
    return len(number.partition(".")[2])
