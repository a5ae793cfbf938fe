"""Renders in the background: start, stop, pause and resume, in the shape of HdRenderThread."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from encore.errors import Cancelled, UsageError
from encore.render_pass import ProgressCallback

# What is run: it calls back with its progress, and gives up with Cancelled when told to by False.
Job = Callable[[ProgressCallback], None]

# How often a paused job looks whether the program is ending, in seconds.
_LOOK_S = 0.2


@dataclass(frozen=True)
class RenderProgress:
    """How far a frame is. done: share of it, from 0 to 1. stage: what is at work, such as "shade".

    active_s: seconds that it took so far, pauses left out.
    """

    done: float = 0.0
    stage: str = ""
    active_s: float = 0.0


class RenderThread:
    """Runs one job at a time, in a thread or in the caller's. Any thread may call any of its methods.

    A paused job uses no processor and goes on where it was, so that pauses change no pixel. When the
    program's main thread ends, what is still running is stopped.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._running = False
        self._thread = 0  # the job's
        self._paused = False  # the job itself waits
        self._pause = False
        self._stop = False
        self._error: BaseException | None = None
        self._converged = False
        self._done, self._stage = 0.0, ""
        self._active_s = 0.0  # up to _since
        self._since: float | None = None  # None: the clock stands

    def start(self, job: Job, prepare: Callable[[], None] | None = None) -> None:
        """Runs a job in the background. Throws UsageError while one runs.

        prepare: is called here, before the job and while no other runs; where it throws, there is no job.
        """
        self._begin(prepare)
        # No daemon: the program must not end while core works. It is told to stop then: see _ends().
        thread = threading.Thread(target=self._run, args=(job,), name="render")
        try:
            thread.start()
        except Exception as error:  # there can be no more threads
            self._end(error)
            raise

    def run(self, job: Job, prepare: Callable[[], None] | None = None) -> bool:
        """start() here: True when the job is complete, False when stop() ended it. Throws what it throws."""
        self._begin(prepare)
        self._run(job)
        return self.wait()

    def stop(self) -> None:
        """Ends the job as soon as it looks at its progress, paused or not, and waits for that.

        Called by the job itself, it does not wait.
        """
        with self._changed:
            self._stop = True
            self._changed.notify_all()
            if self._thread != threading.get_ident():
                self._changed.wait_for(lambda: not self._running)

    def pause(self) -> None:
        """Makes the job wait as soon as it looks at its progress; returns at once. No job: does nothing."""
        with self._changed:
            self._pause = self._running
            self._changed.notify_all()

    def resume(self) -> None:
        """Ends the pause."""
        with self._changed:
            self._pause = False
            self._changed.notify_all()

    def wait(self, timeout: float | None = None) -> bool:
        """Waits for the job's end; True when it is complete, False when stop() ended it or there was none.

        Throws what the job has thrown, and TimeoutError after `timeout` seconds. A paused job does not end.
        """
        with self._changed:
            if not self._changed.wait_for(lambda: not self._running, timeout):
                raise TimeoutError(f"still rendering after {timeout:g} s")
            if self._error is not None:
                raise self._error
            return self._converged

    @property
    def is_rendering(self) -> bool:
        """Whether there is a job, paused ones included."""
        return self._running

    @property
    def is_pause_requested(self) -> bool:
        return self._pause

    @property
    def is_paused(self) -> bool:
        """Whether the job waits to be resumed: a pause begins a moment after pause()."""
        return self._paused

    @property
    def is_converged(self) -> bool:
        """Whether the last job ended because it was complete."""
        return self._converged

    @property
    def error(self) -> BaseException | None:
        """What ended the last job, where it failed."""
        return self._error

    @property
    def progress(self) -> RenderProgress:
        """Of the job, or of the last one."""
        with self._changed:
            running = 0.0 if self._since is None else time.perf_counter() - self._since
            return RenderProgress(self._done, self._stage, self._active_s + running)

    def _begin(self, prepare: Callable[[], None] | None) -> None:
        with self._changed:
            if self._running:
                raise UsageError("a frame is being rendered", "start", "Call stop() or wait() first")
            if prepare is not None:
                prepare()
            self._running = True
            self._stop = self._pause = self._converged = False
            self._error = None
            self._done, self._stage = 0.0, ""
            self._active_s, self._since = 0.0, time.perf_counter()

    def _run(self, job: Job) -> None:
        error: BaseException | None = None
        self._thread = threading.get_ident()
        try:
            job(self._advance)
        except BaseException as raised:
            error = raised
        self._end(error)

    def _end(self, error: BaseException | None) -> None:
        with self._changed:
            # What is raised because it was told to stop is no failure.
            stopped = self._stop and isinstance(error, Cancelled)
            self._error = None if stopped else error
            self._converged = error is None
            self._stand()
            self._running = False
            self._thread = 0
            self._changed.notify_all()

    def _advance(self, done: float, stage: str) -> bool:
        """The job's progress callback: waits while there is a pause; False where it is to end."""
        with self._changed:
            self._done, self._stage = done, stage
            while self._pause and not self._ends():
                if not self._paused:
                    self._paused = True
                    self._stand()
                    self._changed.notify_all()
                self._changed.wait(_LOOK_S)
            if self._paused:
                self._paused, self._since = False, time.perf_counter()
            return not self._ends()

    def _ends(self) -> bool:
        if not threading.main_thread().is_alive():
            self._stop = True
        return self._stop

    def _stand(self) -> None:
        """Stops the clock."""
        if self._since is not None:
            self._active_s += time.perf_counter() - self._since
        self._since = None
