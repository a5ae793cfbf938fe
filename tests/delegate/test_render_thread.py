"""Jobs in the background: pause, stop, failures, and the end of the program."""

import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import pytest
from encore.errors import Cancelled, StageError, UsageError
from encore.render_thread import RenderThread


def until(condition: Callable[[], bool]) -> None:
    """Waits for what must come; a test that hangs here has failed."""
    end = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.002)


class Job:
    """Counts its steps, and takes one when it is let to."""

    def __init__(self, steps: int = 3) -> None:
        self.steps = steps
        self.taken = 0
        self.allowed = threading.Semaphore(0)
        self.thread: threading.Thread | None = None

    def __call__(self, progress: Any) -> None:
        self.thread = threading.current_thread()
        for step in range(self.steps):
            self.allowed.acquire()
            if not progress(step / self.steps, "count"):
                raise Cancelled
            self.taken += 1

    def allow(self, steps: int = 1) -> None:
        self.allowed.release(steps)


def test_a_job_runs_in_a_thread_of_its_own() -> None:
    thread, job = RenderThread(), Job()
    assert not thread.wait(), "nothing was started"
    thread.start(job)
    assert thread.is_rendering
    job.allow(2)
    until(lambda: job.taken == 2)
    assert (thread.progress.done, thread.progress.stage) == (1 / 3, "count")
    assert not thread.is_converged
    with pytest.raises(TimeoutError):
        thread.wait(0.01)
    job.allow()
    assert thread.wait()
    assert thread.is_converged
    assert not thread.is_rendering
    assert job.thread is not threading.current_thread()


def test_run_uses_the_callers_thread() -> None:
    thread, job = RenderThread(), Job()
    job.allow(3)
    assert thread.run(job)
    assert job.thread is threading.current_thread()


def test_one_job_at_a_time() -> None:
    thread, job = RenderThread(), Job()
    thread.start(job)
    with pytest.raises(UsageError, match="being rendered"):
        thread.start(Job())
    with pytest.raises(UsageError, match="being rendered"):
        thread.run(Job())
    job.allow(3)
    assert thread.wait()
    assert job.taken == 3


def test_pause_holds_the_job_and_its_clock() -> None:
    thread, job = RenderThread(), Job()
    thread.pause()
    assert not thread.is_pause_requested, "there is nothing to pause"
    thread.start(job)
    job.allow()
    until(lambda: job.taken == 1)
    thread.pause()
    assert thread.is_pause_requested
    job.allow(2)
    until(lambda: thread.is_paused)
    before = thread.progress
    time.sleep(0.05)
    assert thread.progress == before
    assert thread.is_rendering
    assert job.taken == 1
    thread.resume()
    assert thread.wait()
    assert job.taken == 3
    assert not thread.is_paused
    assert thread.progress.active_s >= before.active_s


def test_stop_ends_a_job_that_waits() -> None:
    thread, job = RenderThread(), Job()
    thread.start(job)
    thread.pause()
    job.allow(3)
    until(lambda: thread.is_paused)
    thread.stop()
    assert not thread.is_rendering
    assert not thread.is_converged
    assert not thread.wait()
    assert job.taken == 0
    # The next one is neither paused nor stopped.
    job.allow(3)
    assert thread.run(job)


def test_a_job_may_stop_itself() -> None:
    thread = RenderThread()

    def job(progress: Any) -> None:
        thread.stop()
        if not progress(0.5, "count"):
            raise Cancelled

    assert not thread.run(job)
    thread.start(job)
    assert not thread.wait()


def test_what_a_job_raises_surfaces_in_wait() -> None:
    thread = RenderThread()

    def fail(progress: Any) -> None:
        raise StageError("broken", "/World")

    thread.start(fail)
    for _ in range(2):
        with pytest.raises(StageError, match="/World: broken"):
            thread.wait()
    assert isinstance(thread.error, StageError)
    with pytest.raises(StageError):
        thread.run(fail)
    job = Job()
    job.allow(3)
    assert thread.run(job), "a failure is forgotten when the next job starts"
    assert thread.error is None


def test_a_thread_that_cannot_be_had_is_no_job(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    thread, job = RenderThread(), Job()
    monkeypatch.setattr(threading.Thread, "start", refuse)
    with pytest.raises(RuntimeError, match="new thread"):
        thread.start(job)
    monkeypatch.undo()
    assert not thread.is_rendering
    with pytest.raises(RuntimeError, match="new thread"):
        thread.wait(10)
    job.allow(3)
    assert thread.run(job)


def test_what_is_to_be_done_before_a_job() -> None:
    thread, job, prepared = RenderThread(), Job(), [0]

    def prepare() -> None:
        prepared[0] += 1

    def fail() -> None:
        raise StageError("broken")

    thread.start(job, prepare)
    assert prepared == [1]
    for begin in (thread.start, thread.run):
        with pytest.raises(UsageError, match="being rendered"):
            begin(job, prepare)
    assert prepared == [1], "not while another job runs"
    job.allow(3)
    assert thread.wait()
    for begin in (thread.start, thread.run):
        with pytest.raises(StageError):
            begin(job, fail)
        assert not thread.is_rendering
    assert job.taken == 3
    job.allow(3)
    assert thread.run(job, prepare)
    assert prepared == [2]


def test_a_job_that_gives_up_by_itself_was_not_stopped() -> None:
    thread = RenderThread()

    def give_up(progress: Any) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        thread.run(give_up)


@pytest.mark.parametrize("paused", [False, True])
def test_the_program_can_end_while_something_runs(paused: bool) -> None:
    code = f"""
import time
from encore.render_thread import RenderThread
from encore.errors import Cancelled

def job(progress):
    while progress(0.5, "work"):
        time.sleep(0.001)
    print("stopped", flush=True)
    raise Cancelled

thread = RenderThread()
thread.start(job)
if {paused}:
    thread.pause()
    while not thread.is_paused:
        time.sleep(0.001)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, "stopped\n", "")
