"""Exit codes, and how errors of the core become errors of the command line."""

import re
import signal
from pathlib import Path

import pytest
from encore import errors
from encore.errors import Cancelled, EncoreError, ExitCode, from_core

DOCS = Path(__file__).parents[2] / "docs"


def all_kinds(kind: type[EncoreError]) -> set[type[EncoreError]]:
    return {kind}.union(*(all_kinds(child) for child in kind.__subclasses__()))


def test_documented_exit_codes_are_those_of_the_program() -> None:
    rows = re.findall(r"^\| (\d+) \| (.+?) \|$", (DOCS / "exit_codes.md").read_text(encoding="utf-8"), re.M)
    assert {int(code): meaning for code, meaning in rows} == {
        int(code): meaning for code, meaning in errors.MEANINGS.items()
    }


def test_every_exit_code_has_a_meaning() -> None:
    assert set(errors.MEANINGS) == set(ExitCode)


def test_every_kind_of_error_has_an_exit_code_of_the_table_and_none_means_success() -> None:
    for kind in all_kinds(EncoreError):
        assert ExitCode(kind.exit_code) is not ExitCode.OK


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, ExitCode.INTERRUPTED), (signal.SIGTERM, ExitCode.TERMINATED)]
)
def test_signals_give_128_plus_their_number(number: int, code: ExitCode) -> None:
    assert Cancelled(number).exit_code == code == 128 + number


@pytest.mark.parametrize(
    ("parts", "text"),
    [
        (("gone", "/a", "Look for it"), "/a: gone. Look for it"),
        (("gone",), "gone"),
        (("gone", "/a"), "/a: gone"),
        (("gone.", "", "Look for it"), "gone. Look for it"),
    ],
)
def test_text_of_an_error(parts: tuple[str, ...], text: str) -> None:
    assert str(EncoreError(*parts)) == text


class CoreError(Exception):
    """An error with the attributes of encore._core.Error."""

    def __init__(self, kind: str, what: str, where: str = "", remedy: str = "") -> None:
        super().__init__((f"{where}: " if where else "") + what + (f". {remedy}" if remedy else ""))
        self.kind, self.where, self.remedy = kind, where, remedy


@pytest.mark.parametrize(
    ("kind", "code"),
    [
        ("scene", ExitCode.STAGE),
        ("setting", ExitCode.SETTING),
        ("device", ExitCode.DEVICE),
        ("memory", ExitCode.MEMORY),
        ("cancelled", ExitCode.TERMINATED),
        ("internal", ExitCode.INTERNAL),
        ("a kind of the future", ExitCode.INTERNAL),
    ],
)
def test_kinds_of_core_errors(kind: str, code: ExitCode) -> None:
    assert from_core(CoreError(kind, "x"), signal.SIGTERM).exit_code == code


def test_parts_of_a_core_error_are_kept() -> None:
    error = from_core(CoreError("scene", "points: 3 are not finite", "/World/Mesh", "Repair them"))
    assert (error.where, error.what, error.remedy) == (
        "/World/Mesh",
        "points: 3 are not finite",
        "Repair them",
    )
    assert str(error) == "/World/Mesh: points: 3 are not finite. Repair them"
