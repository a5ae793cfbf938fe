"""Progress in the dialects of terminals, farms and programs, and the one way to print messages.

Dialects for programs (alf, openjd, json) own standard output. Everything for people goes to standard error.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable
from typing import Any, TextIO

MODES = ("auto", "alf", "openjd", "json", "none")


class Progress:
    """Share of a run that is done, in whole percent: from 0 to 100 over all frames, never falling.

    100 is reported only after the last frame has been written. This base class shows only what was written.
    quiet: nothing for people, errors apart.
    """

    def __init__(self, frames: int, out: TextIO, err: TextIO, *, quiet: bool = False) -> None:
        self.frames = max(1, frames)
        self.quiet = quiet
        self.out = out
        self.err = err
        self.percent = -1
        self.index = 0
        self.label = ""
        self.stage = ""

    def begin_frame(self, index: int, label: str) -> None:
        """Frame number `index` (from 0) starts; label is its time code."""
        self.index, self.label = index, label
        self.update(0.0, "sync")

    def update(self, done: float, stage: str) -> None:
        """`done` of the current frame, in [0, 1], is done; `stage` is at work."""
        share = (self.index + min(max(done, 0.0), 1.0)) / self.frames
        self._advance(min(99, int(share * 100)), stage)

    def written(self, output: str) -> None:
        """The current frame is complete and on disk as `output`."""
        last = self.index + 1 >= self.frames
        self._advance(100 if last else min(99, int((self.index + 1) / self.frames * 100)), "written")
        self.show_written(output)

    def message(self, text: str) -> None:
        """Prints a line for people."""
        print(text, file=self.err, flush=True)

    def fail(self, text: str) -> None:
        """The run fails; text is the error without its "Error: ". The caller prints it for people."""

    def close(self) -> None:
        """Ends the display."""

    def show(self) -> None:
        """Shows percent, stage and frame; called when one of them has changed."""

    def show_written(self, output: str) -> None:
        """Says that a file has been written."""
        if not self.quiet:
            self.message(f"Wrote {output}")

    def _advance(self, percent: int, stage: str) -> None:
        percent = max(percent, self.percent, 0)
        if (percent, stage) != (self.percent, self.stage):
            self.percent, self.stage = percent, stage
            self.show()

    @property
    def activity(self) -> str:
        """What is being done, for people."""
        return f"frame {self.label}: {self.stage}"


class PlainProgress(Progress):
    """Lines for a log: one whenever 5 % more are done, or 10 s have passed with progress."""

    step_percent = 5
    step_s = 10.0

    clock: Callable[[], float] = staticmethod(time.monotonic)
    shown_percent = -5
    shown_at = -math.inf

    def show(self) -> None:
        if self.quiet:
            return
        late = self.clock() - self.shown_at >= self.step_s and self.percent > self.shown_percent
        if late or self.percent - self.shown_percent >= (self.step_percent if self.percent < 100 else 1):
            self.shown_percent, self.shown_at = self.percent, self.clock()
            self.message(f"{self.percent:3d} % {self.activity}")


class BarProgress(Progress):
    """A bar for a terminal."""

    bar: Any = None

    def show(self) -> None:
        if self.bar is None:
            from tqdm import tqdm

            layout = "{percentage:3.0f} % |{bar}| {elapsed}, {remaining} left, {desc}"
            self.bar = tqdm(total=100, file=self.err, leave=False, bar_format=layout)
        self.bar.set_description_str(self.activity, refresh=False)
        self.bar.n = self.percent
        self.bar.refresh()

    def message(self, text: str) -> None:
        if self.bar is not None:
            self.bar.clear()
        super().message(text)
        if self.bar is not None:
            self.bar.refresh()

    def close(self) -> None:
        if self.bar is not None:
            self.bar.close()


class AlfProgress(Progress):
    """`ALF_PROGRESS n%`, which Tractor, OpenCue and Deadline read."""

    reported = -1

    def show(self) -> None:
        if self.percent > self.reported:
            self.reported = self.percent
            print(f"ALF_PROGRESS {self.percent}%", file=self.out, flush=True)


class OpenJdProgress(Progress):
    """The messages of Open Job Description sessions."""

    reported = -1

    def show(self) -> None:
        if self.percent > self.reported:
            self.reported = self.percent
            print(f"openjd_progress: {self.percent}", file=self.out, flush=True)
        print(f"openjd_status: {self.activity}", file=self.out, flush=True)

    def fail(self, text: str) -> None:
        print(f"openjd_fail: {' '.join(text.split())}", file=self.out, flush=True)


class JsonProgress(Progress):
    """One JSON object per line: events "progress", "written" and "failed"."""

    def show(self) -> None:
        self._event("progress", percent=self.percent, stage=self.stage)

    def show_written(self, output: str) -> None:
        self._event("written", output=output)

    def fail(self, text: str) -> None:
        self._event("failed", message=text)

    def _event(self, event: str, **fields: Any) -> None:
        line = {"event": event, "frame": self.label, "index": self.index, "frames": self.frames, **fields}
        print(json.dumps(line), file=self.out, flush=True)


def create(
    mode: str, frames: int, *, quiet: bool = False, out: TextIO | None = None, err: TextIO | None = None
) -> Progress:
    """The Progress of a mode of MODES. quiet: no progress for people; the other dialects stay."""
    out, err = out or sys.stdout, err or sys.stderr
    kinds: dict[str, type[Progress]] = {
        "auto": BarProgress if err.isatty() and not quiet else PlainProgress,
        "alf": AlfProgress,
        "openjd": OpenJdProgress,
        "json": JsonProgress,
        "none": Progress,
    }
    return kinds[mode](frames, out, err, quiet=quiet)
