"""Very many instances: what they share must be there once. Each test has a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import pytest
from instanced_stages import SCRIPT

GIB = 1 << 30


def run(*arguments: str) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, str(SCRIPT), *arguments], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


def test_296_million_instanced_primitives() -> None:
    """3,400 instances of 88,200 faces each (the paper's Fig. 7 has 3,400 × 88,000) within 4 GiB."""
    found = run("crowd")
    assert found["counts"]["instances"] == 3400
    assert found["counts"]["prototypes"] == 1 and found["counts"]["meshes"] == 8
    assert found["primitives"] == 3400 * 8 * 105 * 105 > 296e6
    assert found["peak_bytes"] < 4 * GIB
    assert found["deviation"] > 0.02 and found["colors"] > 40, "districts of many colours are seen"


@pytest.mark.parametrize("values", [False, True])
def test_instances_are_small(values: bool) -> None:
    """An instance costs below 1.6 kB in all, half of it Embree's; with a colour of its own 100 more."""
    count = 100_000
    found, few = (run("scatter", "--count", str(n), *(["--values"] * values)) for n in (count, 1000))
    assert found["counts"]["instances"] == count and found["counts"]["prototypes"] == 1
    assert found["deviation"] > 0.02
    assert (found["colors"] > 100) == values
    assert (found["peak_bytes"] - few["peak_bytes"]) / count < 1600 + 100 * values
