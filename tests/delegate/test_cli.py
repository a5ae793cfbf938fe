"""The command line without rendering: flags, help, and what bad input is answered with."""

import argparse
import re
import subprocess
import sys
from pathlib import Path

import encore
import pytest
from encore import cli
from encore.errors import ExitCode
from encore.record_options import RecordOptions, refined, sync_options
from encore.settings import SETTINGS, resolve
from pxr import Usd, UsdGeom

ROOT = Path(__file__).parents[2]

# Flags of usdrecord 24.08 with a value where they take one, and where it goes.
USDRECORD = {
    "--mask": "/World/A,/World/B",
    "--purposes": "render",
    "--sessionLayer": "s.usda",
    "--disableGpu": None,
    "--disableCameraLight": None,
    "--camera": "/Cam",
    "-cam": "/Cam",
    "--defaultTime": None,
    "-d": None,
    "--frames": "1:3",
    "-f": "1:3",
    "--complexity": "veryhigh",
    "-c": "veryhigh",
    "--colorCorrectionMode": "sRGB",
    "-color": "sRGB",
    "--renderer": "Encore",
    "-r": "Encore",
    "--imageWidth": "100",
    "-w": "100",
    "--enableDomeLightVisibility": None,
    "--disableDrawMode": None,
    "--resolver": "inherit",
    "--traceToFile": "t.json",
    "--traceFormat": "trace",
    "--renderPassPrimPath": "/Render/Pass",
    "-rp": "/Render/Pass",
    "--renderSettingsPrimPath": "/Render/Settings",
    "-rs": "/Render/Settings",
}
OURS = [
    *("--disableMotionBlur", "--disableDepthOfField", "--shutterOpen", "--shutterClose"),
    *(setting.flag for setting in SETTINGS.values()),
    *("--stats", "--progress", "--device", "--strict", "--verbose", "--quiet", "-q"),
    *("--ocioConfig", "--ocioDisplay", "--ocioView"),
]


def stage_file(folder: Path) -> str:
    """A stage with one cube."""
    stage = Usd.Stage.CreateNew(str(folder / "cube.usda"))
    UsdGeom.Cube.Define(stage, "/Cube")
    stage.Save()
    return str(folder / "cube.usda")


def parse(*flags: str) -> RecordOptions:
    options = cli.build_parser().parse_args(["record", "a.usda", "a.exr", *flags])
    return cli._record_options(options, options.output)


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    """Exit code and standard error; checks that nothing but errors is said, in one line."""
    code = cli.main(list(arguments))
    captured = capsys.readouterr()
    assert captured.out == ""
    if code:
        assert re.fullmatch(r"Error: [^\n]+\n", captured.err), captured.err
    return code, captured.err


def record_parser() -> argparse.ArgumentParser:
    (commands,) = (a for a in cli.build_parser()._actions if isinstance(a, argparse._SubParsersAction))
    return commands.choices["record"]


@pytest.mark.parametrize("flag", USDRECORD)
def test_flags_of_usdrecord_are_known(flag: str) -> None:
    value = USDRECORD[flag]
    parse(flag, *([value] if value else []))


@pytest.mark.parametrize("flag", [*USDRECORD, *OURS])
def test_every_flag_is_in_help_and_in_the_documentation(flag: str) -> None:
    pattern = rf"(?<![\w-]){re.escape(flag)}(?![\w])"
    assert re.search(pattern, record_parser().format_help())
    docs = "".join((ROOT / "docs" / name).read_text(encoding="utf-8") for name in ("usage.md", "settings.md"))
    assert re.search(pattern, docs)


def test_documentation_names_no_flag_that_does_not_exist() -> None:
    known = {flag for action in record_parser()._actions for flag in action.option_strings} | {"--version"}
    for name in ("usage.md", "settings.md"):
        text = (ROOT / "docs" / name).read_text(encoding="utf-8")
        assert set(re.findall(r"(?<![\w-])--[a-zA-Z]+", text)) <= known


def test_every_flag_says_what_it_does_and_every_group_has_a_title() -> None:
    parser = record_parser()
    assert all(action.help for action in parser._actions)
    titles = [group.title for group in parser._action_groups if group._group_actions]
    assert all(titles)
    assert len(titles) == len(set(titles))


def test_defaults_of_usdrecord() -> None:
    options = parse()
    assert options.purposes is None
    assert sync_options(options, resolve({}))["purposes"] == ("default", "proxy")
    assert (options.render_settings, options.render_pass, options.resolver) == ("", "", "root")
    assert options.camera_light
    assert options.motion_blur and options.depth_of_field
    assert options.shutter_open is None and options.shutter_close is None
    assert options.complexity == "low"
    assert options.color.resolved_mode == "sRGB"
    assert resolve(options.settings)["width"] == 960
    assert not resolve(options.settings)["dome_light_visible"]


def test_values_arrive() -> None:
    options = parse(
        "--mask", "/A, /B", "--purposes", "render,guide", "--sessionLayer", "s.usda", "-cam", "main",
        "-f", "1:2", "--disableCameraLight", "--disableGpu", "--strict", "--samples", "3", "--memory", "64M",
        "--shadingRate", "0.5", "--enableDomeLightVisibility", "--stats", "s.json", "--device", "llvm",
        "--ocioView", "Raw", "--disableMotionBlur", "--disableDepthOfField", "--shutterOpen=-0.25",
        "--shutterClose", "0.5", "--disableEnergyCompensation", "--shaderCache", "none",
    )  # fmt: skip
    assert options.mask == ("/A", "/B")
    assert options.purposes == ("render", "guide")
    assert (options.session_layer, options.camera, options.frames) == ("s.usda", "main", "1:2")
    assert not options.camera_light
    assert not options.motion_blur and not options.depth_of_field
    assert (options.shutter_open, options.shutter_close) == (-0.25, 0.5)
    assert options.disable_gpu
    assert options.strict
    assert (options.stats, options.device) == ("s.json", "llvm")
    assert options.color.resolved_mode == "openColorIO"
    assert options.settings == {
        "samples": 3,
        "memory_budget_bytes": 64 * 2**20,
        "shading_rate": 0.5,
        "dome_light_visible": True,
        "energy_compensation": False,
        "shader_cache": "none",
    }


@pytest.mark.parametrize("setting", SETTINGS.values(), ids=lambda s: s.flag)
def test_every_setting_has_a_flag_that_works(setting: object) -> None:
    key, kind, default = setting.key, setting.kind, setting.default  # type: ignore[attr-defined]
    values = {"int": "32", "float": "0.75", "size": "32", "choice": default, "bool": None, "text": "none"}
    for flag in setting.flags:  # type: ignore[attr-defined]
        given = parse(flag, *([values[kind]] if values[kind] else [])).settings
        assert set(given) == {key}
        resolve(given)


@pytest.mark.parametrize(("name", "factor"), [("low", 1), ("medium", 2), ("high", 4), ("veryhigh", 8)])
def test_complexity_divides_the_edge_length(name: str, factor: int) -> None:
    assert refined(name, resolve({}))["edge_length_scale"] == 1 / factor
    assert refined(name, resolve({"edge_length_scale": 0.5}))["edge_length_scale"] == 0.5 / factor


@pytest.mark.parametrize(
    ("flags", "code", "message"),
    [
        (["--samples", "0"], ExitCode.SETTING, "--samples: 0 is out of range"),
        (["--samples", "x"], ExitCode.USAGE, "--samples: 'x' is not a whole number"),
        (["--samples", "1.5"], ExitCode.USAGE, "--samples"),
        (["-w", "0"], ExitCode.SETTING, "--imageWidth: 0"),
        (["-w", "-5"], ExitCode.SETTING, "--imageWidth: -5"),
        (["--imageHeight", "-1"], ExitCode.SETTING, "--imageHeight: -1"),
        (["--shadingRate", "nan"], ExitCode.SETTING, "--shadingRate: nan"),
        (["--shadingRate", "-1"], ExitCode.SETTING, "--shadingRate: -1"),
        (["--targetEdgeLength", "-1"], ExitCode.SETTING, "--targetEdgeLength: -1"),
        (["--memory", "lots"], ExitCode.USAGE, "--memory: 'lots'"),
        (["--filter", "sinc"], ExitCode.USAGE, "blackman-harris"),
        (["--method", "radiosity"], ExitCode.USAGE, "reuse, reference, decoupled, decoupled-pixel, vertex"),
        (["--search", "cells", "--footprintReuse", "metric"], ExitCode.SETTING, "--search: 'cells'"),
        (["--footprintWeight", "0"], ExitCode.SETTING, "--footprintWeight: 0"),
        (["--search", "cells", "--reuseTimeWeight", "1"], ExitCode.SETTING, "With --reuseTimeWeight"),
        (["--glassShadows", "green"], ExitCode.USAGE, "transmit, opaque"),
        (["--shutterOpen", "soon"], ExitCode.USAGE, "--shutterOpen: 'soon' is not a number of frames"),
        (["--shutterClose", "inf"], ExitCode.USAGE, "--shutterClose: 'inf'"),
        (
            ["--shutterOpen", "1", "--shutterClose", "0"],
            ExitCode.SETTING,
            "--shutterClose: the shutter closes",
        ),
        (["--shaderCache", "/dev/null/x"], ExitCode.OUTPUT, "/dev/null/x: cannot be used as a shader cache"),
        (["--renderer", "Storm"], ExitCode.USAGE, "there is no renderer 'Storm'"),
        (["-rs", "/Render/Settings"], ExitCode.STAGE, "/Render/Settings: is no RenderSettings prim"),
        (["-rs", "Settings"], ExitCode.STAGE, "Settings: is no RenderSettings prim"),
        (["-rp", "/Cube"], ExitCode.STAGE, "/Cube: is no RenderPass prim. The stage has none"),
        (["-rp", "/A", "-rs", "/B"], ExitCode.USAGE, "contradicts --renderSettingsPrimPath"),
        (["--resolver", "other"], ExitCode.USAGE, "invalid choice"),
        (["--complexity", "huge"], ExitCode.USAGE, "invalid choice"),
        (["--purposes", "red"], ExitCode.USAGE, "'red' is no purpose"),
        (["--mask", "World"], ExitCode.USAGE, "not an absolute prim path"),
        (["--mask", "/World.size"], ExitCode.USAGE, "not an absolute prim path"),
        (["--frames", "1:"], ExitCode.USAGE, "not a frame specification"),
        (["--frames", "1:3"], ExitCode.USAGE, "placeholder"),
        (["--frames", "1", "--defaultTime"], ExitCode.USAGE, "not allowed with"),
        (["--ocioView", "Nope"], ExitCode.USAGE, "Un-tone-mapped"),
        (["--sessionLayer", "nope.usda"], ExitCode.STAGE, "nope.usda: there is no such"),
        (["--stats", "/no/such/folder/s.json"], ExitCode.OUTPUT, "does not exist"),
        (["--bogus"], ExitCode.USAGE, "unrecognized arguments: --bogus"),
        (["--quiet", "--quiet", "extra"], ExitCode.USAGE, "unrecognized arguments: extra"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_bad_flags(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], flags: list[str], code: int, message: str
) -> None:
    found, text = run(capsys, "record", stage_file(tmp_path), str(tmp_path / "a.exr"), *flags)
    assert message in text
    assert found == code
    assert [path.name for path in tmp_path.iterdir()] == ["cube.usda"]


def test_bad_stages(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "garbage.usda").write_text("#usda 1.0\ndef {{{")
    (tmp_path / "picture.jpg").write_text("no stage")
    (tmp_path / "empty.usdc").write_text("")
    (tmp_path / "folder.usda").mkdir()
    for name, message in (
        ("missing.usda", "there is no such stage"),
        ("garbage.usda", "cannot be read"),
        ("picture.jpg", "read"),
        ("empty.usdc", "read"),
        ("folder.usda", "read"),
    ):
        code, text = run(capsys, "record", str(tmp_path / name), str(tmp_path / "a.exr"))
        assert (code, name in text, message in text) == (ExitCode.STAGE, True, True), text


@pytest.mark.parametrize(
    ("output", "code"),
    [
        ("a.jpg", ExitCode.USAGE),
        ("a", ExitCode.USAGE),
        ("no/folder/a.exr", ExitCode.OUTPUT),
        ("cube.usda/a.exr", ExitCode.OUTPUT),
        ("a.###.exr", ExitCode.USAGE),
    ],
)
def test_bad_outputs(tmp_path: Path, capsys: pytest.CaptureFixture[str], output: str, code: int) -> None:
    found, text = run(capsys, "record", stage_file(tmp_path), str(tmp_path / output))
    assert found == code
    assert output in text


def test_every_output_of_a_range_is_checked_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "1").mkdir()
    output = str(tmp_path / "#" / "a.exr")
    code, text = run(capsys, "record", stage_file(tmp_path), output, "--frames", "1:2")
    assert code == ExitCode.OUTPUT
    assert str(tmp_path / "2") in text


def test_errors_reach_the_farm_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code = cli.main(["record", "missing.usda", str(tmp_path / "a.exr"), "--progress", "openjd"])
    captured = capsys.readouterr()
    assert code == ExitCode.STAGE
    assert captured.out.startswith("openjd_fail: missing.usda: there is no such stage")
    assert captured.err.startswith("Error: missing.usda:")


def test_tracebacks_only_with_verbose(capsys: pytest.CaptureFixture[str]) -> None:
    cli.main(["record", "missing.usda", "a.exr"])
    assert "Traceback" not in capsys.readouterr().err
    cli.main(["record", "missing.usda", "a.exr", "--verbose"])
    assert "Traceback" in capsys.readouterr().err


def test_no_command_is_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys)[0] == ExitCode.USAGE


def test_module_program_and_help() -> None:
    environment = {"PYTHONPATH": str(Path(encore.__file__).parents[1])}
    for arguments, expected in (
        (["--version"], f"encore {encore.__version__}"),
        (["record", "--help"], "exit codes:"),
        (["dump", "--help"], "usage: encore dump"),
        (["devices", "--help"], "usage: encore devices"),
    ):
        command = [sys.executable, "-m", "encore", *arguments]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        assert expected in done.stdout


def test_version_is_that_of_the_build() -> None:
    cmake = (ROOT / "CMakeLists.txt").read_text(encoding="utf-8")
    assert f"VERSION {encore.__version__} " in cmake
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert f'version = "{encore.__version__}"' in project
