"""What differs between the stage and what is rendered: nothing is dropped silently."""

from __future__ import annotations

import enum
from collections.abc import Iterator
from dataclasses import dataclass, field

from pxr import Sdf


class Severity(enum.Enum):
    """NOTE: a choice that was made. WARNING: unsupported. ERROR: broken in the stage; --strict fails."""

    NOTE = "Note"
    WARNING = "Warning"
    ERROR = "Error"


@dataclass
class Report:
    """One kind of difference: message and prim path of its first case, and all prims that it was found on."""

    kind: str
    severity: Severity
    message: str
    path: str
    paths: set[str] = field(default_factory=set)

    @property
    def count(self) -> int:
        return len(self.paths)

    def line(self) -> str:
        """`Warning: /path: message (3 prims).`"""
        also = f" ({self.count} prims)" if self.count > 1 else ""
        return f"{self.severity.value}: {self.path}: {self.message}{also}."


# Arguments of Reports.add(), one tuple a call.
Log = tuple[tuple[str, str, Sdf.Path | str, Severity], ...]


class Reports:
    """Collects reports, one per kind, in the order in which the kinds first came up."""

    def __init__(self) -> None:
        self._reports: dict[str, Report] = {}
        self._calls: list[tuple[str, str, Sdf.Path | str, Severity]] = []

    def add(
        self, kind: str, message: str, path: Sdf.Path | str, severity: Severity = Severity.WARNING
    ) -> None:
        """Notes a case. kind: what cases have in common, such as "unsupported BasisCurves".

        message: a sentence about the first case, without a full stop. path: the prim.
        """
        self._calls.append((kind, message, path, severity))
        report = self._reports.get(kind)
        if report is None:
            report = self._reports[kind] = Report(kind, severity, message.rstrip(" ."), str(path))
        report.paths.add(str(path))

    def note(self, kind: str, message: str, path: Sdf.Path | str) -> None:
        self.add(kind, message, path, Severity.NOTE)

    def error(self, kind: str, message: str, path: Sdf.Path | str) -> None:
        self.add(kind, message, path, Severity.ERROR)

    @property
    def mark(self) -> int:
        """A place in what has been reported, for since()."""
        return len(self._calls)

    def since(self, mark: int) -> Log:
        """What has been reported since a mark, for replay()."""
        return tuple(self._calls[mark:]) if len(self._calls) > mark else ()

    def replay(self, log: Log) -> None:
        """Reports the same again."""
        for kind, message, path, severity in log:
            self.add(kind, message, path, severity)

    def __iter__(self) -> Iterator[Report]:
        return iter(self._reports.values())

    def __len__(self) -> int:
        return len(self._reports)

    def count(self, kind: str) -> int:
        """Prims on which this kind was found."""
        report = self._reports.get(kind)
        return report.count if report else 0

    @property
    def errors(self) -> list[Report]:
        return [r for r in self if r.severity is Severity.ERROR]

    @property
    def has_errors(self) -> bool:
        return bool(self.errors)

    def lines(self) -> list[str]:
        """One line per kind: severity, first prim path, message and count."""
        return [report.line() for report in self]
