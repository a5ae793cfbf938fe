"""Progress in every dialect: monotonic, from 0 to 100, over frames."""

import io
import json
import re

import pytest
from encore import progress
from encore.progress import Progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def run(
    mode: str, frames: int = 2, *, quiet: bool = False, err: io.StringIO | None = None
) -> tuple[str, str]:
    """Standard output and standard error of a run whose core reports values that even fall."""
    out, err = io.StringIO(), err or io.StringIO()
    shown = progress.create(mode, frames, quiet=quiet, out=out, err=err)
    for index in range(frames):
        shown.begin_frame(index, str(101 + index))
        for done, stage in ((0.0, "dice"), (0.3, "trace"), (0.25, "trace"), (0.999, "film"), (1.5, "film")):
            shown.update(done, stage)
        shown.written(f"a.{101 + index}.exr")
    shown.close()
    return out.getvalue(), err.getvalue()


def assert_rises_to_100(percents: list[int]) -> None:
    assert percents == sorted(percents)
    assert percents[0] == 0
    assert percents[-1] == 100
    assert all(0 <= p <= 100 for p in percents)
    assert percents.count(100) == 1


def test_alf() -> None:
    out, err = run("alf")
    lines = out.splitlines()
    assert all(re.fullmatch(r"ALF_PROGRESS \d+%", line) for line in lines)
    assert_rises_to_100([int(line.split()[1][:-1]) for line in lines])
    # What a farm's regular expression for failures would look for.
    assert "Error" not in err


def test_openjd() -> None:
    out, _ = run("openjd")
    assert all(re.match(r"openjd_(progress: \d+$|status: .)", line) for line in out.splitlines())
    assert_rises_to_100([int(p) for p in re.findall(r"^openjd_progress: (\d+)$", out, re.M)])
    assert "openjd_status: frame 102: trace" in out


def test_openjd_says_why_it_failed_in_one_line() -> None:
    out = io.StringIO()
    progress.create("openjd", 1, out=out, err=io.StringIO()).fail("a\nb")
    assert out.getvalue() == "openjd_fail: a b\n"


def test_json() -> None:
    out, _ = run("json")
    events = [json.loads(line) for line in out.splitlines()]
    progressed = [event for event in events if event["event"] == "progress"]
    percents = [event["percent"] for event in progressed]
    assert percents == sorted(percents)
    assert (percents[0], percents[-1]) == (0, 100)
    assert [e["output"] for e in events if e["event"] == "written"] == ["a.101.exr", "a.102.exr"]
    assert {event["frames"] for event in events} == {2}


def test_json_failure() -> None:
    out = io.StringIO()
    progress.create("json", 1, out=out, err=io.StringIO()).fail("no light")
    event = json.loads(out.getvalue())
    assert (event["event"], event["message"]) == ("failed", "no light")


def test_100_percent_means_written() -> None:
    out = io.StringIO()
    shown = progress.create("alf", 1, out=out, err=io.StringIO())
    shown.begin_frame(0, "1")
    shown.update(1.0, "film")
    assert "100%" not in out.getvalue()
    shown.written("a.exr")
    assert out.getvalue().endswith("ALF_PROGRESS 100%\n")


def test_auto_is_lines_elsewhere_than_on_a_terminal() -> None:
    out, err = run("auto")
    assert out == ""
    lines = [line for line in err.splitlines() if "%" in line]
    assert_rises_to_100([int(line.split()[0]) for line in lines])
    assert "Wrote a.101.exr" in err


def test_lines_come_every_5_percent_or_10_seconds() -> None:
    now = 0.0
    err = io.StringIO()
    shown = progress.PlainProgress(1, io.StringIO(), err)
    shown.clock = lambda: now
    shown.begin_frame(0, "1")
    for step in range(1, 100):
        now += 0.01
        shown.update(step / 100, "trace")
    fast = err.getvalue().splitlines()
    assert [int(line.split()[0]) for line in fast] == list(range(0, 100, 5))

    err.truncate(0)
    shown.update(0.96, "trace")
    assert err.getvalue() == ""
    shown = progress.PlainProgress(1, io.StringIO(), err)
    shown.clock = lambda: now
    shown.begin_frame(0, "1")
    for step in range(1, 5):
        now += 11
        shown.update(step / 100, "trace")
    slow = err.getvalue().replace("\0", "").splitlines()
    assert [int(line.split()[0]) for line in slow] == [0, 1, 2, 3, 4]


def test_auto_is_a_bar_on_a_terminal() -> None:
    terminal = Terminal()
    out, _ = run("auto", err=terminal)
    assert out == ""
    assert "100 % |" in terminal.getvalue()
    assert "Wrote a.102.exr\n" in terminal.getvalue()


@pytest.mark.parametrize("mode", ["auto", "none"])
def test_quiet_is_silent(mode: str) -> None:
    assert run(mode, quiet=True) == ("", "")
    assert run(mode, quiet=True, err=Terminal()) == ("", "")


def test_quiet_leaves_programs_their_progress() -> None:
    out, err = run("alf", quiet=True)
    assert out.endswith("ALF_PROGRESS 100%\n")
    assert err == ""


def test_every_mode_can_be_made() -> None:
    for mode in progress.MODES:
        assert isinstance(progress.create(mode, 1), Progress)
