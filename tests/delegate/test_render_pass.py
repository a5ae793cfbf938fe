"""One frame around the renderer, which is replaced: the file, its header, and what stops it."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from encore import render_pass
from encore.color import ColorOptions, display_transform
from encore.errors import Cancelled, DeviceError, InternalError, MemoryLimitError
from encore.image_writer import ImageWriter
from encore.render_pass import RenderedFrame, RenderPass
from encore.report import Reports
from encore.settings import resolve
from pictures import Images, cut, new_images, read_exr, rectangles
from pxr import Usd

WIDTH, HEIGHT, TILE = 50, 40, 16


class CoreError(Exception):
    def __init__(self, kind: str, what: str = "failed") -> None:
        super().__init__(what)
        self.kind, self.where, self.remedy = kind, "", ""


class Core:
    """Hands out noise as encore._core.render() does; `before` is called with the number of each rectangle."""

    Error = CoreError

    def __init__(self) -> None:
        self.images: Images = new_images(HEIGHT, WIDTH)
        self.before: Callable[[int], None] = lambda number: None
        self.settings: dict[str, Any] = {}

    @staticmethod
    def versions() -> dict[str, str]:
        return {"embree": "3.13.5"}

    def render(self, scene: Any, settings: dict[str, Any], device: Any, progress: Any, tile: Any) -> Any:
        self.settings = settings
        for number, rectangle in enumerate(rectangles(WIDTH, HEIGHT, settings["reuse_tile_pixels"], 1)):
            self.before(number)
            if not progress(0.5, "render"):
                raise CoreError("cancelled")
            tile(*rectangle[:2], cut(self.images, rectangle))
        return {"statistics": {"pixels": WIDTH * HEIGHT}}


@pytest.fixture
def core(monkeypatch: pytest.MonkeyPatch) -> Core:
    made = Core()
    found = SimpleNamespace(
        scene=None,
        width=WIDTH,
        height=HEIGHT,
        camera_path="/World/Camera",
        reports=Reports(),
        shutter=(-0.25, 0.5),
        lens=True,
    )
    monkeypatch.setattr(render_pass, "load_core", lambda: made)
    monkeypatch.setattr(render_pass, "translate", lambda *arguments: found)
    return made


def render(path: Path, progress: Any = None) -> RenderedFrame:
    device = SimpleNamespace(info={"name": "llvmpipe", "driver": "Mesa 25"})
    frame = RenderPass(
        Usd.Stage.CreateInMemory(), resolve({"reuse_tile_pixels": TILE, "seed": 9}), device, {}, "a.usda"
    )
    transform = display_transform(ColorOptions())
    return frame.render(Usd.TimeCode(7), "7", str(path), transform, progress)


def test_the_file_and_what_is_said_of_the_frame(core: Core, tmp_path: Path) -> None:
    frame = render(tmp_path / "a.exr")
    header, channels = read_exr(tmp_path / "a.exr")
    assert np.array_equal(channels["G"], core.images["composite"][..., 1])
    assert np.array_equal(channels["reflection.B"], core.images["layers"]["reflection"][..., 2])
    for name, value in {
        "encore:device": "llvmpipe",
        "encore:driver": "Mesa 25",
        "encore:camera": "/World/Camera",
        "encore:frame": "7",
        "encore:seed": "9",
        "encore:stage": "a.usda",
        "encore:shutter": "-0.25 0.5",
        "encore:motionBlur": "on",
        "encore:depthOfField": "on",
        "encore:version:embree": "3.13.5",
    }.items():
        assert header[name] == value
    settings = json.loads(header["encore:settings"])
    assert settings == {k: v for k, v in core.settings.items() if k != "shader_cache"}
    assert (settings["width"], settings["height"]) == (WIDTH, HEIGHT)
    assert frame.statistics == {"pixels": WIDTH * HEIGHT}
    assert frame.camera == "/World/Camera"
    assert frame.write_s > 0


def test_the_shader_cache_reaches_core_and_no_file(
    core: Core, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = []
    for home in ("here", "there"):
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / home))
        render(tmp_path / "a.exr")
        assert core.settings["shader_cache"] == str(tmp_path / home / "encore")
        files.append((tmp_path / "a.exr").read_bytes())
    assert files[0] == files[1]


def test_png(core: Core, tmp_path: Path) -> None:
    render(tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("stage", ["render", "write"])
def test_progress_cancels_and_nothing_is_left(core: Core, tmp_path: Path, stage: str) -> None:
    seen = []

    def progress(done: float, at: str) -> bool:
        seen.append(at)
        return at != stage or seen.count(at) < 3 - 2 * (stage == "write")

    with pytest.raises(Cancelled):
        render(tmp_path / "a.exr", progress)
    assert seen[-1] == stage
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("raised", "expected"),
    [
        (CoreError("device"), DeviceError),
        (CoreError("memory"), MemoryLimitError),
        (MemoryError(), MemoryLimitError),
        (KeyError("x"), KeyError),
    ],
)
def test_a_render_that_fails_leaves_nothing(
    core: Core, tmp_path: Path, raised: Exception, expected: type[Exception]
) -> None:
    def fail(number: int) -> None:
        if number == 7:
            raise raised

    core.before = fail
    with pytest.raises(expected):
        render(tmp_path / "a.exr")
    assert list(tmp_path.iterdir()) == []


def test_a_writer_that_fails_stops_the_render_and_is_what_is_reported(
    core: Core, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writers: list[ImageWriter] = []
    numbers: list[int] = []

    class Known(ImageWriter):
        def __init__(self, *arguments: Any) -> None:
            super().__init__(*arguments)
            writers.append(self)

    def before(number: int) -> None:
        numbers.append(number)
        while number == 1 and not writers[0].failed:
            time.sleep(0.01)

    monkeypatch.setattr(render_pass, "ImageWriter", Known)
    core.images["alpha"][0, 0] = np.nan
    core.before = before
    with pytest.raises(InternalError, match=r"channel A .*\(0, 0\)"):
        render(tmp_path / "a.exr")
    assert numbers == [0, 1], "that it is to stop, progress tells the renderer"
    assert list(tmp_path.iterdir()) == []


def test_a_frame_that_misses_pixels_is_no_file(
    core: Core, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(core, "render", lambda *arguments: {"statistics": {}})
    with pytest.raises(InternalError, match="without pixels"):
        render(tmp_path / "a.exr")
    assert list(tmp_path.iterdir()) == []
