"""A run of `encore record` around the renderer, which is replaced: frames, failures, signals, statistics."""

import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from encore import cli, record
from encore.adapters.camera import ShutterOptions
from encore.errors import Cancelled, ExitCode, SettingError, StageError
from encore.frame_recorder import RenderedFrame
from encore.image_file import ImageInfo
from encore.image_writer import ImageWriter
from encore.render_products import Render
from encore.report import Reports
from pxr import Usd, UsdGeom

STATISTICS = {
    "device": "none",
    "driver": "none",
    "pixels": 6,
    "primitives": 1,
    "micropolygons": 1,
    "antialiasing_samples": 24,
    "rays_traced": 24,
    "non_finite_samples": 0,
    "peak_memory_bytes": 1,
    "device_peak_bytes": 1,
    "geometry_bytes": 1,
    "texture_bytes": 0,
    "time_s": {"trace": 0.5, "total": 1.0},
    "layers": {},
    "kernels": {},
    "warnings": {"a texture was clamped": 3},
}


class Device:
    info: ClassVar[dict[str, Any]] = {"name": "none", "cpu": True}


class StandInRecorder:
    """Writes grey images instead of rendering. `before` is called with the label; it may raise."""

    before: Any = None
    time_codes: ClassVar[list[Usd.TimeCode]] = []
    renders: ClassVar[list[Render]] = []

    def __init__(self, stage: Usd.Stage, delegate: Any, source: str, transform: Any) -> None:
        self.transform = transform
        self.time_codes.clear()
        self.renders.clear()

    def render(self, time_code: Usd.TimeCode, label: str, render: Render, progress: Any) -> RenderedFrame:
        self.time_codes.append(time_code)
        self.renders.append(render)
        if StandInRecorder.before:
            StandInRecorder.before(label)
        colour = np.full((2, 3, 3), 0.25, dtype=np.float32)
        plane = np.ones((2, 3), dtype=np.float32)
        images = {"layers": {"direct": colour}, "composite": colour, "alpha": plane, "depth": plane}
        busy_s = 0.0
        for file in render.files:
            info = ImageInfo(3, 2, 16, {"encore:frame": label})
            with ImageWriter(file.path, info, self.transform) as writer:
                writer.add(0, 0, {**images, "normal": colour})
                for done in (0.0, 0.5, 1.0):
                    if not progress(done, "render"):
                        raise Cancelled
            busy_s += writer.busy_s
        reports = Reports()
        reports.error("missing texture", "wood.png does not exist", "/World/Table")
        files = tuple(file.path for file in render.files)
        return RenderedFrame(STATISTICS, reports, "/Cam", 0.125, busy_s, (3, 2), files)


@pytest.fixture
def stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A stage file next to a folder `out`; the renderer is replaced."""
    monkeypatch.setattr(record, "FrameRecorder", StandInRecorder)
    monkeypatch.setattr(record, "create_device", lambda select, disable_gpu: Device())
    (tmp_path / "out").mkdir()
    made = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.Cube.Define(made, "/Cube")
    made.SetStartTimeCode(5)
    made.Save()
    yield str(tmp_path / "a.usda")
    StandInRecorder.before = None


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def run(stage: str, output: str, *flags: str) -> int:
    return cli.main(["record", stage, str(Path(stage).parent / "out" / output), *flags])


def test_a_range_writes_every_frame(stage: str, tmp_path: Path) -> None:
    assert run(stage, "a.###.exr", "--frames", "1:5x2") == ExitCode.OK
    assert names(tmp_path / "out") == ["a.001.exr", "a.003.exr", "a.005.exr"]
    assert [t.GetValue() for t in StandInRecorder.time_codes] == [1, 3, 5]


def test_start_time_and_default_time(stage: str) -> None:
    assert run(stage, "a.png") == ExitCode.OK
    assert StandInRecorder.time_codes[0].GetValue() == 5
    assert run(stage, "a.png", "--defaultTime") == ExitCode.OK
    assert StandInRecorder.time_codes[0].IsDefault()


def test_the_first_failing_frame_ends_the_run_with_its_code(
    stage: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(label: str) -> None:
        if label == "2":
            raise StageError("points are not finite", "/World/Mesh", "Repair them")

    StandInRecorder.before = fail
    flags = ("--frames", "1:3", "--stats", str(tmp_path / "s.json"), "--progress", "openjd")
    assert run(stage, "a.#.exr", *flags) == ExitCode.STAGE
    assert names(tmp_path / "out") == ["a.1.exr"]
    captured = capsys.readouterr()
    assert captured.err.splitlines()[-1] == "Error: /World/Mesh: points are not finite. Repair them"
    assert captured.out.splitlines()[-1] == "openjd_fail: /World/Mesh: points are not finite. Repair them"
    assert "openjd_progress: 100" not in captured.out
    # Statistics of what is on disk.
    assert [f["frame"] for f in json.loads((tmp_path / "s.json").read_text())["frames"]] == ["1"]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_stops_the_frame_and_leaves_nothing(stage: str, tmp_path: Path, number: int) -> None:
    StandInRecorder.before = lambda label: os.kill(os.getpid(), number)
    before = signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)
    assert run(stage, "a.exr") == 128 + number
    assert names(tmp_path / "out") == []
    assert (signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)) == before


def test_a_signal_during_the_last_frame_keeps_the_frames_before(stage: str, tmp_path: Path) -> None:
    def stop(label: str) -> None:
        if label == "2":
            os.kill(os.getpid(), signal.SIGTERM)

    StandInRecorder.before = stop
    assert run(stage, "a.#.exr", "--frames", "1:3") == ExitCode.TERMINATED
    assert names(tmp_path / "out") == ["a.1.exr"]


def test_an_unexpected_error_is_internal_and_leaves_nothing(
    stage: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(label: str) -> None:
        raise ZeroDivisionError("oops")

    StandInRecorder.before = fail
    assert run(stage, "a.exr") == ExitCode.INTERNAL
    assert "internal error: ZeroDivisionError: oops" in capsys.readouterr().err
    assert names(tmp_path / "out") == []


def test_a_write_that_fails_is_an_output_error(
    stage: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class FullDisk:
        def add(self, *arguments: Any) -> None:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(ImageWriter, "_open", lambda *arguments: FullDisk())
    assert run(stage, "a.exr") == ExitCode.OUTPUT
    assert "No space left on device" in capsys.readouterr().err
    assert names(tmp_path / "out") == []


def test_statistics(stage: str, tmp_path: Path) -> None:
    assert (
        run(stage, "a.#.png", "--frames", "1:2", "--stats", str(tmp_path / "s.json"), "--samples", "3") == 0
    )
    document = json.loads((tmp_path / "s.json").read_text())
    assert document["settings"]["samples"] == 3
    assert document["device"] == Device.info
    assert document["stage"] == stage
    assert document["warnings"] == {"a texture was clamped": 6, "missing texture": 2}
    first, second = document["frames"]
    assert first["output"].endswith("a.1.png")
    assert first["camera"] == "/Cam"
    # Opening the stage is charged to the first frame.
    assert first["time_s"]["sync"] > second["time_s"]["sync"] == 0.125
    assert all(
        f["time_s"]["write"] > 0 and f["time_s"]["total"] >= f["time_s"]["write"] for f in (first, second)
    )


def test_reports_are_warnings_and_quiet_hides_them(stage: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(stage, "a.png") == ExitCode.OK
    text = capsys.readouterr().err
    assert "Warning: /World/Table: wood.png does not exist." in text
    assert "a texture was clamped (3 times)" in text
    # What farms take for a failure.
    assert "Error" not in text
    assert run(stage, "a.png", "--quiet") == ExitCode.OK
    assert capsys.readouterr().err == ""
    assert run(stage, "a.png", "--verbose") == ExitCode.OK
    assert "Camera: /Cam" in capsys.readouterr().err


def test_machine_dialects_have_standard_output_for_themselves(
    stage: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(stage, "a.#.png", "--frames", "1:2", "--progress", "json", "--verbose") == ExitCode.OK
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [event["event"] for event in events].count("written") == 2
    assert [e["percent"] for e in events if e["event"] == "progress"][-1] == 100


def test_colour_correction_of_exr_is_refused_in_words(stage: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(stage, "a.exr", "-color", "sRGB") == ExitCode.OK
    assert "EXR stays scene-linear" in capsys.readouterr().err
    assert run(stage, "a.exr") == ExitCode.OK
    assert "EXR stays scene-linear" not in capsys.readouterr().err


def test_debug_aovs_of_png_are_refused_in_words(stage: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(stage, "a.png", "--debugAovs") == ExitCode.OK
    assert "--debugAovs: PNG holds only the composite" in capsys.readouterr().err
    assert run(stage, "a.exr", "--debugAovs") == ExitCode.OK
    assert "--debugAovs" not in capsys.readouterr().err


def test_render_settings_that_do_not_exist_are_said_to_be_unused(
    stage: str, capsys: pytest.CaptureFixture[str]
) -> None:
    made = Usd.Stage.Open(stage)
    made.SetMetadata("renderSettingsPrimPath", "/Render/Final")
    made.Save()
    assert run(stage, "a.png") == ExitCode.OK
    assert "/Render/Final" in capsys.readouterr().err


def test_flags_reach_the_translation(stage: str) -> None:
    flags = ("--purposes", "render", "--camera", "/C", "-w", "64", "--imageHeight", "32", "--strict")
    more = ("--disableCameraLight", "--disableDepthOfField", "--shutterOpen=-1")
    more = (*more, "--targetEdgeLength", "0.5", "--complexity", "high")
    # The stand-in finds a texture missing while it renders, which --strict does not let pass.
    assert run(stage, "a.png", *flags, *more) == ExitCode.STAGE
    assert run(stage, "a.png", *(flag for flag in flags if flag != "--strict"), *more) == ExitCode.OK
    assert not StandInRecorder.renders[0].sync["strict"]
    assert run(stage, "a.png", *flags, *more) == ExitCode.STAGE
    render = StandInRecorder.renders[0]
    assert render.sync == {
        "camera": "/C",
        "purposes": ("default", "render"),
        "camera_light": False,
        "strict": True,
        "shutter": ShutterOptions(motion_blur=True, opens=-1.0, closes=None),
        "depth_of_field": False,
    }
    assert (render.film.width, render.film.height) == (64, 32)
    assert render.settings["target_edge_length_world"] == 0.5
    assert render.settings["edge_length_scale"] == 0.25


def test_setting_errors_of_the_core_name_the_flag(stage: str) -> None:
    from encore.render_pass import core_error

    class CoreError(Exception):
        kind, where, remedy = "setting", "shading_rate", "Choose less"

    converted = core_error(CoreError("shading_rate: value 1e9 is out of range. Choose less"))
    assert isinstance(converted, SettingError)
    assert str(converted) == "--shadingRate: value 1e9 is out of range. Choose less"


def test_traces_of_usd(stage: str, tmp_path: Path) -> None:
    json_file, text_file = tmp_path / "t.json", tmp_path / "t.txt"
    assert run(stage, "a.png", "--traceToFile", str(json_file)) == ExitCode.OK
    assert json.loads(json_file.read_text())["traceEvents"]
    flags = ("--traceToFile", str(text_file), "--traceFormat", "trace")
    assert run(stage, "a.#.png", *flags) == ExitCode.USAGE
    assert "Tree view" in text_file.read_text(), "of runs that fail, too"
    assert run(stage, "a.png", "--traceToFile", str(tmp_path / "gone" / "t")) == ExitCode.OUTPUT


def test_session_layer_and_mask(tmp_path: Path) -> None:
    made = Usd.Stage.CreateNew(str(tmp_path / "m.usda"))
    for name in "ABC":
        UsdGeom.Cube.Define(made, f"/World/{name}")
    made.Save()
    session = Usd.Stage.CreateNew(str(tmp_path / "session.usda"))
    session.OverridePrim("/World/A").SetActive(False)
    session.Save()
    opened = record.open_stage(
        record.RecordOptions(
            stage=str(tmp_path / "m.usda"),
            output="",
            mask=("/World/A", "/World/B"),
            session_layer=str(tmp_path / "session.usda"),
        )
    )
    assert [str(prim.GetPath()) for prim in opened.Traverse()] == ["/World", "/World/B"]


def test_a_mask_leaves_render_settings(tmp_path: Path) -> None:
    made = Usd.Stage.CreateNew(str(tmp_path / "m.usda"))
    for path in ("/World/A", "/World/B", "/Render/Settings", "/Render/Products/A", "/Mine"):
        made.DefinePrim(path)
    for named, expected in (
        ("", []),
        ("/Render/Settings", ["/Render", "/Render/Settings", "/Render/Products", "/Render/Products/A"]),
        ("/Mine", ["/Mine"]),
    ):
        made.SetMetadata("renderSettingsPrimPath", named)
        made.Save()
        options = record.RecordOptions(stage=str(tmp_path / "m.usda"), output="", mask=("/World/A",))
        opened = record.open_stage(options)
        paths = [str(prim.GetPath()) for prim in opened.Traverse()]
        assert paths == ["/World", "/World/A", *expected]
