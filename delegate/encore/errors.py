"""What can go wrong, and the exit code of each kind (docs/exit_codes.md has the same table)."""

from __future__ import annotations

import enum
import signal


class ExitCode(enum.IntEnum):
    """Exit codes of the command line; MEANINGS explains them."""

    OK = 0
    INTERNAL = 1
    USAGE = 2
    STAGE = 3
    SETTING = 4
    DEVICE = 5
    OUTPUT = 6
    TIME_LIMIT = 7
    MEMORY = 8
    INTERRUPTED = 130
    TERMINATED = 143


MEANINGS: dict[ExitCode, str] = {
    ExitCode.OK: "Every frame was rendered and written.",
    ExitCode.INTERNAL: "An error inside Encore: please report it with the output of --verbose.",
    ExitCode.USAGE: "The command line is wrong, or asks for something that is not supported yet.",
    ExitCode.STAGE: "The stage or an asset of it cannot be read, or there is nothing in it to render.",
    ExitCode.SETTING: "A render setting is out of its range.",
    ExitCode.DEVICE: "There is no usable Vulkan device, or the device failed.",
    ExitCode.OUTPUT: "The image or the statistics cannot be written.",
    ExitCode.TIME_LIMIT: "Reserved for a time limit; not returned yet.",
    ExitCode.MEMORY: "The frame does not fit into the memory budget, or exceeds the cap on micropolygons.",
    ExitCode.INTERRUPTED: "Interrupted by SIGINT (Ctrl-C). No partial file is left.",
    ExitCode.TERMINATED: "Terminated by SIGTERM. No partial file is left.",
}


class EncoreError(Exception):
    """An error that the user can understand: `where: what. remedy`.

    where is a prim path, a file or the name of a setting; it and remedy (what to do about it) may be empty.
    """

    exit_code = ExitCode.INTERNAL

    def __init__(self, what: str, where: str = "", remedy: str = "") -> None:
        self.what = what
        self.where = str(where)
        self.remedy = remedy
        super().__init__(compose(what, self.where, remedy))


class UsageError(EncoreError):
    """The command line is wrong, or asks for what is not supported."""

    exit_code = ExitCode.USAGE


class StageError(EncoreError):
    """The stage cannot be read, or holds nothing that can be rendered."""

    exit_code = ExitCode.STAGE


class AssetError(StageError):
    """A file that the stage names is missing or cannot be read."""


class SettingError(EncoreError):
    """A render setting is out of its range; where is its name."""

    exit_code = ExitCode.SETTING


class DeviceError(EncoreError):
    """There is no usable Vulkan device, or it failed."""

    exit_code = ExitCode.DEVICE


class OutputError(EncoreError):
    """An image or the statistics cannot be written; where is the file."""

    exit_code = ExitCode.OUTPUT


class MemoryLimitError(EncoreError):
    """The frame does not fit into its memory budget, or exceeds a cap."""

    exit_code = ExitCode.MEMORY


class InternalError(EncoreError):
    """A defect of Encore itself."""


class Cancelled(EncoreError):  # noqa: N818
    """The render was stopped by a signal; nothing is written."""

    def __init__(self, signal_number: int = signal.SIGINT) -> None:
        self.signal_number = signal_number
        self.exit_code = ExitCode.TERMINATED if signal_number == signal.SIGTERM else ExitCode.INTERRUPTED
        super().__init__(f"stopped by {signal.Signals(signal_number).name}")


_CORE_KINDS: dict[str, type[EncoreError]] = {
    "scene": StageError,
    "setting": SettingError,
    "device": DeviceError,
    "memory": MemoryLimitError,
    "internal": InternalError,
}


def from_core(error: Exception, signal_number: int = signal.SIGINT) -> EncoreError:
    """The EncoreError that says what an encore._core.Error says.

    signal_number: what to blame for an error of kind "cancelled".
    """
    kind = getattr(error, "kind", "internal")
    if kind == "cancelled":
        return Cancelled(signal_number)
    where, remedy = getattr(error, "where", ""), getattr(error, "remedy", "")
    what = str(error)
    # str(error) is composed as ours is; take it apart again.
    if where:
        what = what.removeprefix(f"{where}: ")
    if remedy:
        what = what.removesuffix(f". {remedy}")
    return _CORE_KINDS.get(kind, InternalError)(what, where, remedy)


def compose(what: str, where: str, remedy: str) -> str:
    """`where: what. remedy`, without the parts that are empty; what carries no full stop of its own."""
    what = what.rstrip().removesuffix(".")
    return (f"{where}: " if where else "") + what + (f". {remedy}" if remedy else "")
