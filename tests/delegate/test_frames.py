"""Frame specifications and placeholders, as usdrecord has them."""

import pytest
from encore.errors import UsageError
from encore.frames import fill_placeholder, parse_frame_specs, plan
from pxr import Usd


@pytest.mark.parametrize(
    ("text", "times", "decimals"),
    [
        ("123", [123], 0),
        ("101:105", [101, 102, 103, 104, 105], 0),
        ("105:101", [105, 104, 103, 102, 101], 0),
        ("101:109x2", [101, 103, 105, 107, 109], 0),
        ("101:110x2", [101, 103, 105, 107, 109], 0),
        ("1:2x0.25", [1, 1.25, 1.5, 1.75, 2], 2),
        ("5:1x-2", [5, 3, 1], 0),
        ("-2:1", [-2, -1, 0, 1], 0),
        ("1,3:4, 9", [1, 3, 4, 9], 0),
        ("1:3,2:4", [1, 2, 3, 4], 0),
        ("1.5", [1.5], 1),
    ],
)
def test_frame_specs(text: str, times: list[float], decimals: int) -> None:
    assert parse_frame_specs(text) == (times, decimals)


@pytest.mark.parametrize(
    "text", ["", "a", "1:", ":1", "1:2x", "1:2x0", "5:1x1", "1:5x-1", "1,,2", "1e3", "nan", "1:2:3", "1:1e9"]
)
def test_what_is_no_frame_spec(text: str) -> None:
    with pytest.raises(UsageError, match="--frames"):
        parse_frame_specs(text)


def test_a_range_that_would_never_end_is_refused() -> None:
    with pytest.raises(UsageError, match="more than"):
        parse_frame_specs("1:100000000x0.001")


@pytest.mark.parametrize(
    ("output", "time", "name"),
    [
        ("a.####.exr", 7, "a.0007.exr"),
        ("a.##.##.exr", 7.25, "a.07.25.exr"),
        ("a.#.exr", 1234, "a.1234.exr"),
        ("####/a.exr", 3, "0003/a.exr"),
        ("a.####.exr", -7, "a.-007.exr"),
    ],
)
def test_placeholders(output: str, time: float, name: str) -> None:
    assert fill_placeholder(output, time) == name


def stage() -> Usd.Stage:
    made = Usd.Stage.CreateInMemory()
    made.SetStartTimeCode(5)
    return made


def test_a_range_gives_one_output_each() -> None:
    frames = plan(stage(), "a.###.png", "1:3x2", False)
    assert [(f.time.GetValue(), f.output, f.label) for f in frames] == [
        (1, "a.001.png", "1"),
        (3, "a.003.png", "3"),
    ]


def test_without_frames_the_start_time_is_rendered() -> None:
    (frame,) = plan(stage(), "a.png", None, False)
    assert (frame.time.GetValue(), frame.output, frame.label) == (5, "a.png", "5")


def test_default_time() -> None:
    (frame,) = plan(stage(), "a.png", None, True)
    assert frame.time.IsDefault()
    assert frame.label == "default"


@pytest.mark.parametrize(
    ("output", "frames", "message"),
    [
        ("a.png", "1:3", "placeholder"),
        ("a.##.b.##.png", "1:3", "placeholder"),
        ("a.###.png", None, "no --frames"),
        ("a.###.png", "1:2x0.5", "###.#"),
    ],
)
def test_outputs_that_do_not_fit_the_frames(output: str, frames: str | None, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        plan(stage(), output, frames, False)
