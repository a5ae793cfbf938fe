"""USD's own tracing of a run, as usdrecord's --traceToFile has it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from pxr import Trace

from encore.output import atomic_file, check_writable

FORMATS = ("chrome", "trace")


@contextlib.contextmanager
def traced(path: str, file_format: str) -> Iterator[None]:
    """While active, USD notes where its time goes; at the end that becomes a file, after failures too.

    path: empty: nothing is noted. file_format: of FORMATS: JSON for Chrome, or a report to read. Throws
    OutputError.
    """
    if not path:
        yield
        return
    check_writable(path)
    collector = Trace.Collector()
    collector.enabled = True
    try:
        yield
    finally:
        collector.enabled = False
        with atomic_file(path) as temporary:
            reporter = Trace.Reporter.globalReporter
            if file_format == "trace":
                reporter.Report(temporary)
            else:
                reporter.ReportChromeTracingToFile(temporary)
            collector.Clear()
            reporter.ClearTree()
