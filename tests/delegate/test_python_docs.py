"""The code of docs/python.md and examples/python runs, and leaves nothing but what it says."""

import re
import runpy
from pathlib import Path

import encore
import numpy as np
import pytest
from encore import aov
from pictures import read_exr
from pxr import Sdf
from test_renderer import new_scene

pytest.importorskip("encore._core")

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "python.md").read_text()
BLOCKS = re.findall(r"^```python\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
FILES = {0: ["still_life.exr"], 4: ["still_life.0001.exr", "still_life.0003.exr"]}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder of its own, beside which nothing is written."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("number", range(len(BLOCKS)))
def test_the_documented_code_runs(number: int, folder: Path) -> None:
    (folder / "examples").symlink_to(ROOT / "examples")
    exec(compile(BLOCKS[number], f"docs/python.md, block {number + 1}", "exec"), {"__name__": "__main__"})
    (folder / "examples").unlink()
    assert sorted(path.name for path in folder.iterdir()) == FILES.get(number, [])


def test_what_the_comments_say(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Output that the documentation quotes."""
    (folder / "examples").symlink_to(ROOT / "examples")
    exec(BLOCKS[1], {})
    printed = capsys.readouterr().out.strip()
    assert f"# {printed}\n" in BLOCKS[1]


def test_every_aov_and_error_is_documented() -> None:
    for name in aov.NAMES:
        assert re.search(rf"^\|.*`{name}`", TEXT, re.MULTILINE), name
    for name in encore.__all__:
        assert f"`{name}`" in TEXT or f"encore.{name}" in TEXT, name


def run_example(name: str, *arguments: str) -> None:
    main = runpy.run_path(str(ROOT / "examples" / "python" / name))["main"]
    main(*arguments)


def test_edit_and_rerender(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    new_scene().Export("a.usda")
    before = Sdf.Layer.FindOrOpen("a.usda").ExportToString()
    run_example("edit_and_rerender.py", "a.usda", "turn.%d.exr")
    assert sorted(path.name for path in folder.iterdir()) == ["a.usda", *(f"turn.{i}.exr" for i in range(4))]
    assert Sdf.Layer.FindOrOpen("a.usda").ExportToString() == before
    alpha = [read_exr(folder / f"turn.{i}.exr")[1]["A"] for i in range(4)]
    assert alpha[0].any()
    assert not alpha[2].any(), "half a turn away"
    assert not np.array_equal(alpha[0], alpha[1])
    assert capsys.readouterr().out.count(" s, reading the stage ") == 4


def test_aovs_to_numpy(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    new_scene().Export("a.usda")
    run_example("aovs_to_numpy.py", "a.usda")
    text = capsys.readouterr().out
    assert "240 x 180 pixels, 25% of them covered" in text
    assert "depth: 10 to 10" in text
    assert "direct: 100.0% of the light" in text
    assert "1 instances are seen" in text
    assert [path.name for path in folder.iterdir()] == ["a.usda"]
