"""One frame around the renderer, which is replaced: the file, its header, and what stops it."""

import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from encore import exr_file, frame_recorder, image_header, render_pass
from encore.adapters.camera import FilmOptions
from encore.color import ColorOptions, display_transform
from encore.errors import Cancelled, DeviceError, InternalError, MemoryLimitError, OutputError
from encore.frame_recorder import FrameRecorder, RenderedFrame
from encore.image_writer import ImageWriter
from encore.render_delegate import RenderDelegate
from encore.render_products import OutputFile, Render
from encore.render_vars import Aov, Channel, Selection, Source
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
        self.films: list[FilmOptions] = []
        self.synced: list[Any] = []

    @staticmethod
    def versions() -> dict[str, str]:
        return {"embree": "3.13.5"}

    def render(
        self, scene: Any, settings: dict[str, Any], device: Any, progress: Any, tile: Any, cache: Any = None
    ) -> Any:
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
        pixel_aspect_ratio=1.0,
        on_film=lambda film: made.films.append(film) or found,
    )
    monkeypatch.setattr(render_pass, "load_core", lambda: made)
    monkeypatch.setattr(image_header, "load_core", lambda: made)
    monkeypatch.setattr(frame_recorder, "RenderIndex", lambda stage, options: SimpleNamespace())
    monkeypatch.setattr(
        frame_recorder, "sync", lambda index, time, source: made.synced.append(index) or found
    )
    return made


def new_recorder() -> FrameRecorder:
    device = SimpleNamespace(info={"name": "llvmpipe", "driver": "Mesa 25"})
    delegate = RenderDelegate({"reuse_tile_pixels": TILE, "seed": 9}, device)
    return FrameRecorder(Usd.Stage.CreateInMemory(), delegate, "a.usda", display_transform(ColorOptions()))


def new_render(*paths: Path, **more: Any) -> Render:
    settings = resolve({"reuse_tile_pixels": TILE, "seed": 9})
    return Render(
        {}, FilmOptions(WIDTH, HEIGHT), settings, files=tuple(OutputFile(str(p)) for p in paths), **more
    )


def render(path: Path, progress: Any = None) -> RenderedFrame:
    return new_recorder().render(Usd.TimeCode(7), "7", new_render(path), progress)


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

    monkeypatch.setattr(frame_recorder, "ImageWriter", Known)
    core.images["alpha"][0, 0] = np.nan
    core.before = before
    with pytest.raises(InternalError, match=r"channel A .*\(0, 0\)"):
        render(tmp_path / "a.exr")
    assert numbers == [0, 1], "that it is to stop, progress tells the renderer"
    assert list(tmp_path.iterdir()) == []


def test_a_frame_that_misses_pixels_is_no_file(
    core: Core, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(core, "render", lambda *arguments, **more: {"statistics": {}})
    with pytest.raises(InternalError, match="without pixels"):
        render(tmp_path / "a.exr")
    assert list(tmp_path.iterdir()) == []


def test_several_files_of_one_render(core: Core, tmp_path: Path) -> None:
    paths = [tmp_path / name for name in ("a.exr", "b.png", "c.exr")]
    frame = new_recorder().render(Usd.TimeCode(7), "7", new_render(*paths))
    assert frame.written == tuple(map(str, paths)) and frame.failure is None
    assert paths[0].read_bytes() == paths[2].read_bytes()


def test_a_file_that_fails_leaves_the_others_alone(
    core: Core, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    good, bad = tmp_path / "good.exr", tmp_path / "gone" / "bad.exr"
    frame = new_recorder().render(Usd.TimeCode(7), "7", new_render(bad, good))
    assert frame.written == (str(good),)
    assert isinstance(frame.failure, OutputError) and str(bad) in str(frame.failure)
    assert read_exr(good)[1]["G"].shape == (HEIGHT, WIDTH)
    with pytest.raises(OutputError):
        new_recorder().render(Usd.TimeCode(7), "7", new_render(bad))
    assert [path.name for path in tmp_path.iterdir()] == ["good.exr"]


def test_what_differs_by_film_is_translated_once(core: Core, tmp_path: Path) -> None:
    recorder = new_recorder()
    first = new_render(tmp_path / "a.exr")
    other = replace(first, film=FilmOptions(WIDTH, HEIGHT, 2.0, "cropAperture"))
    for frame in (1, 2):
        for wanted in (first, other):
            recorder.render(Usd.TimeCode(frame), "7", wanted)
    assert core.films == [other.film, other.film]
    assert len(core.synced) == 2 and core.synced[0] is core.synced[1], "one index for both frames"


def test_only_what_is_asked_for_reaches_core(core: Core, tmp_path: Path) -> None:
    render(tmp_path / "a.exr")
    assert "window" not in core.settings and "aovs" not in core.settings
    selection = Selection((Channel("/V", ("id",), Source("aov", 1, aov=Aov("primId")), "float"),))
    asked = replace(
        new_render(), window=(-2, 3, 48, 43), files=(OutputFile(str(tmp_path / "b.exr"), "/P", selection),)
    )
    core.images["aovs"] = {"primId": np.arange(WIDTH * HEIGHT, dtype=np.int32).reshape(HEIGHT, WIDTH)}
    new_recorder().render(Usd.TimeCode(7), "7", asked)
    assert core.settings["window"] == (-2, 3, 48, 43)
    assert core.settings["aovs"] == [{"kind": "primId", "name": "primId"}]
    header, channels = read_exr(tmp_path / "b.exr")
    assert np.array_equal(channels["id"], core.images["aovs"]["primId"])
    (x0, y0), (x1, y1) = header["dataWindow"]
    assert (x0, y0, x1, y1) == (-2, 3, 47, 42)
    assert [list(corner) for corner in header["displayWindow"]] == [[0, 0], [WIDTH - 1, HEIGHT - 1]]
    assert header["encore:dataWindow"] == "-2 3 48 43"
    assert header["encore:renderProduct"] == "/P"
    assert json.loads(header["encore:renderVars"]) == {"/V": "id"}


def test_tiles_of_files_start_at_the_data_window(
    core: Core, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(exr_file, "BAND_BYTES", 0)
    new_recorder().render(Usd.TimeCode(7), "7", new_render(tmp_path / "a.exr", window=(7, -9, 57, 31)))
    header, channels = read_exr(tmp_path / "a.exr")
    assert [list(corner) for corner in header["dataWindow"]] == [[7, -9], [56, 30]]
    assert np.array_equal(channels["G"], core.images["composite"][..., 1])
