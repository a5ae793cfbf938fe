"""Files that are written while the image is rendered: any tiling, little memory, and failures half-way."""

import contextlib
import resource
import shutil
import threading
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest
from encore import exr_file, image_writer
from encore.channels import EMPTY_DEPTH
from encore.color import ColorOptions, display_transform
from encore.errors import InternalError, OutputError
from encore.image_file import Cursor, ImageInfo
from encore.image_writer import ImageWriter
from pictures import DEBUG, HEADER, LAYERS, Images, cut, new_images, read_exr, rectangles, write

# width, height, tile, pad: blocks as small as they get, with every reach of the filter; odd sizes; one tile.
TILINGS = [
    (130, 70, 64, 1),
    (129, 65, 64, 0),
    (200, 150, 48, 3),
    (100, 90, 16, 8),
    (67, 131, 32, 2),
    (65, 200, 128, 8),
    (1, 1, 16, 1),
    (17, 1, 16, 8),
    (1, 300, 80, 5),
]


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def new_writer(path: Path, width: int, height: int, band_rows: int = 16) -> ImageWriter:
    info = ImageInfo(width, height, band_rows, HEADER)
    return ImageWriter(str(path), info, display_transform(ColorOptions()))


def flat_images(height: int, width: int) -> Images:
    """Not a number in it but one: fast to make and to compress."""
    plane = np.full((height, width), 0.5, np.float32)
    colour = np.full((height, width, 3), 0.5, np.float32)
    layers = dict.fromkeys(LAYERS, colour)
    return {"layers": layers, "composite": colour, "alpha": plane, "depth": plane, "normal": colour}


def expected_channels(images: Images) -> dict[str, np.ndarray]:
    """What a file must hold, spelled out."""
    found = {c: images["composite"][..., i] for i, c in enumerate("RGB")}
    found |= {
        f"{layer}.{c}": images["layers"][layer][..., i] for layer in LAYERS for i, c in enumerate("RGB")
    }
    found |= {f"N.{c}": images["normal"][..., i] for i, c in enumerate("XYZ")}
    found |= {"A": images["alpha"], "Z": np.where(np.isinf(images["depth"]), EMPTY_DEPTH, images["depth"])}
    for layer, debug in images.get("debug", {}).items():
        found |= {f"{layer}_debug.{name}": debug[name] for name in DEBUG}
        found |= {f"{layer}_id.{c}": debug["id"][..., i] for i, c in enumerate("RGB")}
    return found


def assert_holds(path: Path, images: Images) -> None:
    _, channels = read_exr(path)
    expected = expected_channels(images)
    assert set(channels) == set(expected)
    for name, pixels in expected.items():
        assert np.array_equal(channels[name], pixels), name


@pytest.fixture
def tiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """No row of rectangles is small enough for scanlines."""
    monkeypatch.setattr(exr_file, "BAND_BYTES", 0)


# --- What is in the file -----------------------------------------------------------------------------


@pytest.mark.parametrize(("width", "height", "tile", "pad"), TILINGS)
def test_scanlines_hold_every_pixel_and_the_tiling_leaves_no_trace(
    tmp_path: Path, width: int, height: int, tile: int, pad: int
) -> None:
    images = new_images(height, width)
    write(tmp_path / "whole.exr", images, tile=1024)
    write(tmp_path / "a.exr", images, tile=tile, pad=pad)
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "whole.exr").read_bytes()
    assert_holds(tmp_path / "a.exr", images)


@pytest.mark.usefixtures("tiled")
@pytest.mark.parametrize(("width", "height", "tile", "pad"), TILINGS)
def test_tiles_hold_every_pixel(tmp_path: Path, width: int, height: int, tile: int, pad: int) -> None:
    images = new_images(height, width)
    for name in ("a.exr", "b.exr"):
        write(tmp_path / name, images, tile=tile, pad=pad)
    assert_holds(tmp_path / "a.exr", images)
    header, _ = read_exr(tmp_path / "a.exr")
    assert header["type"] == OpenEXR.tiledimage
    assert header["lineOrder"] == OpenEXR.RANDOM_Y
    assert (header["tiles"].xSize, header["tiles"].ySize) == (64, 64)
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()


@pytest.mark.parametrize(("width", "height", "tile", "pad"), TILINGS)
def test_png_is_the_same_whatever_the_tiling(
    tmp_path: Path, width: int, height: int, tile: int, pad: int
) -> None:
    images = new_images(height, width)
    write(tmp_path / "whole.png", images, tile=1024)
    write(tmp_path / "a.png", images, tile=tile, pad=pad)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "whole.png").read_bytes()
    buffer = oiio.ImageBuf(str(tmp_path / "a.png"))
    assert (buffer.spec().width, buffer.spec().height) == (width, height)


def test_the_file_is_what_openexr_itself_would_write(tmp_path: Path) -> None:
    images = new_images(40, 50, debug=True)
    write(tmp_path / "a.exr", images, pixel_aspect_ratio=2.0)
    header: dict[str, Any] = dict(HEADER)
    header |= {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    header |= {"chromaticities": exr_file.REC709, "pixelAspectRatio": 2.0}
    channels = {n: np.ascontiguousarray(p, np.float32) for n, p in expected_channels(images).items()}
    with OpenEXR.File(header, channels) as file:
        file.write(str(tmp_path / "b.exr"))
    (ours, our_channels), (theirs, their_channels) = (read_exr(tmp_path / f"{n}.exr") for n in "ab")
    assert list(our_channels) == list(their_channels), "in the same order"
    for name, pixels in their_channels.items():
        assert np.array_equal(our_channels[name], pixels)
    assert list(ours) == list(theirs)
    for key, value in theirs.items():
        assert str(ours[key]) == str(value), key


def test_debug_channels(tmp_path: Path) -> None:
    images = new_images(30, 40, debug=True)
    write(tmp_path / "a.exr", images, tile=16)
    assert_holds(tmp_path / "a.exr", images)
    _, channels = read_exr(tmp_path / "a.exr")
    assert {"reflection_debug.evaluations", "refraction_debug.reshaded", "direct_id.G"} <= set(channels)
    # Every layer name is a word, as Nuke wants it, and old readers cut names at 31 characters.
    assert all(name.partition(".")[0].replace("_", "").isalpha() and len(name) <= 31 for name in channels)


def test_rows_beyond_the_limit_make_tiles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    images = new_images(32, 50)
    row_of_tiles = 16 * 50 * len(expected_channels(images)) * 4
    for limit, storage in ((row_of_tiles, OpenEXR.scanlineimage), (row_of_tiles - 1, OpenEXR.tiledimage)):
        monkeypatch.setattr(exr_file, "BAND_BYTES", limit)
        write(tmp_path / "a.exr", images, tile=16)
        assert read_exr(tmp_path / "a.exr")[0]["type"] == storage
    # A reuse tile that is higher than the image has no more rows than the image.
    monkeypatch.setattr(exr_file, "BAND_BYTES", 2 * row_of_tiles)
    write(tmp_path / "a.exr", images, tile=1024)
    assert read_exr(tmp_path / "a.exr")[0]["type"] == OpenEXR.scanlineimage


# --- While it is rendered ----------------------------------------------------------------------------


def test_rows_are_on_disk_before_the_last_are_rendered(tmp_path: Path) -> None:
    images = new_images(64, 512)
    with new_writer(tmp_path / "a.exr", 512, 64) as writer:
        for rectangle in rectangles(512, 64, 32, 1):
            if rectangle[1] > 0:
                break
            writer.add(*rectangle[:2], cut(images, rectangle))
        chunk_bytes = 16 * 512 * len(expected_channels(images)) * 4
        deadline = time.monotonic() + 60
        while sum(path.stat().st_size for path in tmp_path.iterdir()) < chunk_bytes / 2:
            assert time.monotonic() < deadline, "nothing is written"
            time.sleep(0.01)
        assert names(tmp_path) != ["a.exr"]
        for rectangle in rectangles(512, 64, 32, 1):
            if rectangle[1] > 0:
                writer.add(*rectangle[:2], cut(images, rectangle))
    assert names(tmp_path) == ["a.exr"]
    assert_holds(tmp_path / "a.exr", images)
    assert writer.busy_s > 0


@pytest.mark.usefixtures("tiled")
def test_memory_does_not_grow_with_the_height(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(image_writer, "_QUEUE_BYTES", 2**20)
    part = flat_images(130, 130)

    def peak(height: int) -> int:
        tracemalloc.start()
        with new_writer(tmp_path / "a.exr", 1024, height, 128) as writer:
            for x0, y0, x1, y1 in rectangles(1024, height, 128, 2):
                writer.add(x0, y0, cut(part, (0, 0, x1 - x0, y1 - y0)))
        found = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return found

    low, high = peak(256), peak(1024)
    assert high < 1.2 * low
    # Partial tiles along the width, the queue, and rectangles in work.
    assert high < 64 * 1024 * 17 * 4 + 2**20 + 6 * 130 * 130 * 17 * 4


class StuckFile:
    """Waits in its first add() until it may go on."""

    def __init__(self) -> None:
        self.go = threading.Event()
        self.added = 0

    def add(self, x0: int, y0: int, found: Any) -> None:
        self.added += 1
        assert self.go.wait(60)

    def close(self) -> None:
        pass


@pytest.fixture
def stuck(monkeypatch: pytest.MonkeyPatch) -> Iterator[StuckFile]:
    file = StuckFile()
    monkeypatch.setattr(ImageWriter, "_open", lambda *arguments: file)
    yield file
    file.go.set()


def test_rendering_waits_only_when_much_is_to_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stuck: StuckFile
) -> None:
    part = flat_images(16, 16)
    size = image_writer._bytes(part)
    monkeypatch.setattr(image_writer, "_QUEUE_BYTES", 3 * size)
    taken = []

    def render(writer: ImageWriter) -> None:
        for i in range(10):
            writer.add(16 * i, 0, part)
            taken.append(i)

    with new_writer(tmp_path / "a.exr", 160, 16) as writer:
        rendering = threading.Thread(target=render, args=(writer,))
        rendering.start()
        deadline = time.monotonic() + 60
        while len(taken) < 4:  # one in the file, three in the queue
            assert time.monotonic() < deadline
            time.sleep(0.01)
        rendering.join(0.2)
        assert len(taken) == 4
        stuck.go.set()
        rendering.join(60)
        assert len(taken) == 10
    assert stuck.added == 10


# --- Failures ----------------------------------------------------------------------------------------


class Stopped(Exception):  # noqa: N818
    pass


@pytest.mark.parametrize("name", ["a.exr", "a.png"])
def test_a_render_that_fails_leaves_the_old_file_and_no_other(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("old")
    images = new_images(64, 64)
    for count in range(4):
        with pytest.raises(Stopped), new_writer(tmp_path / name, 64, 64, 32) as writer:
            for rectangle in list(rectangles(64, 64, 32, 1))[:count]:
                writer.add(*rectangle[:2], cut(images, rectangle))
            raise Stopped
        assert not writer.failed
        assert names(tmp_path) == [name]
    assert (tmp_path / name).read_text() == "old"


def test_a_render_that_fails_does_not_wait_for_what_is_queued(tmp_path: Path, stuck: StuckFile) -> None:
    threading.Timer(0.2, stuck.go.set).start()
    with pytest.raises(Stopped), new_writer(tmp_path / "a.exr", 64, 16) as writer:
        for i in range(4):
            writer.add(16 * i, 0, flat_images(16, 16))
        while not stuck.added:
            time.sleep(0.01)
        raise Stopped
    assert stuck.added == 1
    assert names(tmp_path) == []


@pytest.mark.usefixtures("tiled")
@pytest.mark.parametrize("name", ["a.exr", "a.png"])
def test_a_number_that_is_not_finite_stops_the_render(tmp_path: Path, name: str) -> None:
    images = new_images(64, 64)
    images["normal"][40, 50, 1] = np.nan
    with pytest.raises(InternalError, match=r"N\.Y .*\(50, 40\)"):
        write(tmp_path / name, images, tile=32)
    assert names(tmp_path) == []


def test_a_writer_that_has_failed_says_so_to_the_next_rectangle(tmp_path: Path) -> None:
    bad = flat_images(16, 16)
    bad["composite"][:] = np.inf
    with pytest.raises(InternalError, match="not finite"), new_writer(tmp_path / "a.exr", 160, 16) as writer:
        writer.add(0, 0, bad)
        deadline = time.monotonic() + 60
        while not writer.failed and time.monotonic() < deadline:
            time.sleep(0.01)
        with pytest.raises(InternalError, match="not finite"):
            writer.add(16, 0, flat_images(16, 16))
        raise Stopped  # such as "cancelled", because `failed` told the render to stop
    assert names(tmp_path) == []


@pytest.mark.parametrize("name", ["a.exr", "a.png"])
def test_the_folder_is_removed_meanwhile(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    images = flat_images(16, 32)
    with (
        pytest.raises(OutputError, match=r"No such file|Could not open") as caught,
        new_writer(folder / name, 32, 16) as writer,
    ):
        writer.add(0, 0, flat_images(16, 16))
        while not names(folder):
            time.sleep(0.01)
        shutil.rmtree(folder)
        writer.add(16, 0, cut(images, (16, 0, 32, 16)))
    assert caught.value.where == str(folder / name)
    assert names(tmp_path) == []


@pytest.mark.parametrize(
    "wrong",
    [
        [],
        [(0, 0, 16, 16)],
        [(16, 0, 32, 16), (0, 0, 16, 16)],
        [(0, 0, 16, 16), (0, 0, 16, 16), (16, 0, 32, 16)],
        [(0, 0, 16, 16), (16, 0, 32, 8)],
        [(0, 0, 32, 8)],
        [(0, 0, 32, 16), (0, 16, 32, 32)],
    ],
    ids=str,
)
@pytest.mark.parametrize("name", ["a.exr", "a.png"])
def test_rectangles_out_of_order_are_a_defect_and_no_file(
    tmp_path: Path, name: str, wrong: list[tuple[int, int, int, int]]
) -> None:
    with pytest.raises(InternalError), new_writer(tmp_path / name, 32, 16) as writer:
        for x0, y0, x1, y1 in wrong:
            writer.add(x0, y0, flat_images(y1 - y0, x1 - x0))
    assert names(tmp_path) == []


def test_cursor() -> None:
    cursor = Cursor(30, 20)
    assert [cursor.advance(*r) for r in ((0, 0, 20, 15), (20, 0, 10, 15), (0, 15, 30, 5))] == [
        False,
        True,
        True,
    ]
    cursor.require_end()
    with pytest.raises(InternalError, match="out of order"):
        cursor.advance(0, 20, 30, 1)


@contextlib.contextmanager
def file_size_limit(limit: int) -> Iterator[None]:
    """What a full disk does, without one: no file may grow beyond the limit in bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize(("name", "band_bytes"), [("a.exr", 2**30), ("a.exr", 0), ("a.png", 0)])
@pytest.mark.parametrize("missing", [1, 4000, 10**9])
def test_a_disk_that_fills_up_is_reported_and_leaves_nothing(
    tmp_path: Path, name: str, band_bytes: int, missing: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(exr_file, "BAND_BYTES", band_bytes)
    path, images = tmp_path / name, new_images(100, 150)
    write(path, images)
    size = path.stat().st_size
    path.unlink()
    limit = max(size - missing, 100)
    with pytest.raises(OutputError, match="cannot be written") as caught, file_size_limit(limit):
        write(path, images)
    assert caught.value.where == str(path)
    assert names(tmp_path) == []
    with file_size_limit(size):
        write(path, images)
    assert names(tmp_path) == [name]
