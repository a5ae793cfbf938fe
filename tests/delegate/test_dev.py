"""./dev, where it can be tried without installing anything: the rest is tried by every run of it."""

from __future__ import annotations

import os
import stat
import subprocess
from pathlib import Path

import pytest

DEV = Path(__file__).resolve().parents[2] / "dev"


@pytest.fixture
def bare_user(tmp_path: Path) -> dict[str, str]:
    """An environment of a user who is not root, may not use sudo, and has none of the packages."""
    for name, body in {
        "id": "echo 1000",
        "sudo": "exit 1",
        "dpkg-query": "exit 1",
        "apt-get": "echo 'apt-get was called' >&2; exit 99",
    }.items():
        script = tmp_path / name
        script.write_text(f"#!/bin/sh\n{body}\n")
        script.chmod(script.stat().st_mode | stat.S_IXUSR)
    return {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}


def run(*arguments: str, env: dict[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(DEV), *arguments], env=env, capture_output=True, text=True, timeout=60)


@pytest.mark.skipif(not Path("/etc/debian_version").exists(), reason="packages are Debian's")
def test_without_rights_it_says_what_is_missing_and_how_to_install_it(bare_user: dict[str, str]) -> None:
    result = run("render", "a.usda", "a.exr", env=bare_user)
    assert result.returncode == 1
    assert "libembree-dev" in result.stderr
    assert "mesa-vulkan-drivers >= 25" in result.stderr
    assert "apt-get install" in result.stderr
    assert "-backports mesa-vulkan-drivers" in result.stderr
    assert "apt-get was called" not in result.stderr


def test_unknown_commands_are_errors() -> None:
    result = run("frobnicate")
    assert result.returncode == 1
    assert "no command 'frobnicate'" in result.stderr


def test_help_names_every_command() -> None:
    result = run("help")
    assert result.returncode == 0
    for command in ("render", "test", "bench", "format", "lint", "clean"):
        assert command in result.stdout
