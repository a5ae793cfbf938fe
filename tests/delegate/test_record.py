"""`encore record` end to end on tiny stages: what is written, and what bad input is answered with."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import encore
import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest
from encore import cli, exr_file
from encore.errors import ExitCode
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade

pytest.importorskip("encore._core")

QUICK = (
    "-w",
    "32",
    "--imageHeight",
    "16",
    "--samples",
    "2",
    "--occlusionSamples",
    "4",
    "--lightSamples",
    "1",
)


def new_stage(folder: Path) -> Usd.Stage:
    """A stage with a camera at the origin that looks along -Z, and a card that fills its view."""
    stage = Usd.Stage.CreateNew(str(folder / "a.usda"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    camera = UsdGeom.Camera.Define(stage, "/Camera")
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.01, 1000))
    add_card(stage)
    return stage


def add_card(stage: Usd.Stage, half: float = 100) -> UsdGeom.Mesh:
    card = UsdGeom.Mesh.Define(stage, "/Card")
    card.CreatePointsAttr([(-half, -half, -10), (half, -half, -10), (half, half, -10), (-half, half, -10)])
    card.CreateFaceVertexCountsAttr([4])
    card.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    card.CreateSubdivisionSchemeAttr("none")
    st = UsdGeom.PrimvarsAPI(card).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    st.Set([(0, 0), (1, 0), (1, 1), (0, 1)])
    return card


def bind(stage: Usd.Stage, **inputs: object) -> UsdShade.Shader:
    """Gives the card a UsdPreviewSurface with these constant inputs."""
    material = UsdShade.Material.Define(stage, "/Material")
    shader = UsdShade.Shader.Define(stage, "/Material/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    for name, value in inputs.items():
        colour = name.endswith("Color")
        kind = Sdf.ValueTypeNames.Color3f if colour else Sdf.ValueTypeNames.Float
        shader.CreateInput(name, kind).Set(Gf.Vec3f(value) if colour else value)  # type: ignore[call-overload]
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath("/Card")).Bind(material)
    return shader


def record(folder: Path, output: str, *flags: str) -> int:
    return cli.main(["record", str(folder / "a.usda"), str(folder / output), *QUICK, *flags])


def read_exr(path: Path) -> tuple[dict[str, object], dict[str, np.ndarray]]:
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return dict(file.header()), {name: channel.pixels for name, channel in file.channels().items()}


def read_png(path: Path) -> np.ndarray:
    file = oiio.ImageInput.open(str(path))
    pixels = file.read_image("uint8")
    file.close()
    return pixels


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if path.name != "a.usda")


def test_channels_and_header(tmp_path: Path) -> None:
    stage = new_stage(tmp_path)
    bind(stage, diffuseColor=(0.5, 0.25, 0.125), roughness=0.0, opacity=0.5, ior=1.5)
    UsdLux.DomeLight.Define(stage, "/Sky")
    stage.Save()
    assert record(tmp_path, "a.exr", "--seed", "7", "--camera", "/Camera") == ExitCode.OK
    header, channels = read_exr(tmp_path / "a.exr")
    layers = ("direct", "reflection", "refraction")
    assert set(channels) == {*"RGBAZ", "N.X", "N.Y", "N.Z", *(f"{n}.{c}" for n in layers for c in "RGB")}
    assert channels["R"].shape == (16, 32)
    for c in "RGB":
        total = channels[f"direct.{c}"]
        for name in layers[1:]:
            total = total + channels[f"{name}.{c}"]
        assert np.array_equal(channels[c], total)
        assert channels[f"reflection.{c}"].max() > 0
    assert channels["A"] == pytest.approx(1, abs=1e-6)
    assert channels["Z"] == pytest.approx(10, rel=1e-4)
    assert channels["N.Z"] == pytest.approx(1, abs=1e-5)
    assert header["encore:method"] == "reuse"
    assert header["encore:seed"] == "7"
    assert header["encore:camera"] == "/Camera"
    assert header["encore:stage"] == str(tmp_path / "a.usda")
    assert header["encore:version"] == encore.__version__
    assert header["encore:version:usd"]
    assert header["encore:device"]
    settings = json.loads(str(header["encore:settings"]))
    assert (settings["width"], settings["height"], settings["samples"]) == (32, 16, 2)


def test_png_of_known_radiance(tmp_path: Path) -> None:
    """A card that emits 0.18, in front of a background of 0.5."""
    stage = new_stage(tmp_path)
    add_card(stage, 1.5)
    bind(stage, diffuseColor=(0, 0, 0), emissiveColor=(0.18, 0.18, 0.18), ior=1.0, roughness=1.0)
    UsdLux.DomeLight.Define(stage, "/Sky").CreateIntensityAttr(0.5)
    stage.Save()
    flags = ("--enableDomeLightVisibility", "--filter", "box", "--filterRadius", "0.5")
    assert record(tmp_path, "a.png", *flags) == ExitCode.OK
    pixels = read_png(tmp_path / "a.png")
    # 1.055 x^(1/2.4) - 0.055, times 255, rounded.
    assert list(pixels[8, 16]) == [118, 118, 118, 255]
    assert list(pixels[0, 0]) == [188, 188, 188, 255]


def test_two_runs_give_equal_files(tmp_path: Path) -> None:
    stage = new_stage(tmp_path)
    bind(stage, diffuseColor=(0.5, 0.25, 0.125), roughness=0.1)
    UsdLux.RectLight.Define(stage, "/Lamp").AddTranslateOp().Set((0, 0, -1))
    stage.Save()
    for name in ("1.exr", "2.exr", "1.png", "2.png"):
        assert record(tmp_path, name) == ExitCode.OK
    assert (tmp_path / "1.exr").read_bytes() == (tmp_path / "2.exr").read_bytes()
    assert (tmp_path / "1.png").read_bytes() == (tmp_path / "2.png").read_bytes()


def test_frames_show_their_own_time_and_leave_no_other_files(tmp_path: Path) -> None:
    stage = new_stage(tmp_path)
    emission = bind(stage, diffuseColor=(0, 0, 0), ior=1.0).CreateInput(
        "emissiveColor", Sdf.ValueTypeNames.Color3f
    )
    for frame in (1, 2, 3):
        emission.Set(Gf.Vec3f(frame), frame)
    stage.Save()
    flags = ("--frames", "1:3x2", "--stats", str(tmp_path / "s.json"), "--progress", "alf")
    assert record(tmp_path, "a.##.exr", *flags) == ExitCode.OK
    assert names(tmp_path) == ["a.01.exr", "a.03.exr", "s.json"]
    for frame in (1, 3):
        header, channels = read_exr(tmp_path / f"a.{frame:02}.exr")
        assert channels["R"] == pytest.approx(frame, rel=1e-5)
        assert header["encore:frame"] == str(frame)
    document = json.loads((tmp_path / "s.json").read_text())
    assert len(document["frames"]) == 2
    assert document["antialiasing_samples"] == 2 * 32 * 16 * 4
    assert document["time_s"]["total"] > 0


def test_tiled_files_hold_the_same_pixels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stage = new_stage(tmp_path)
    bind(stage, diffuseColor=(0.5, 0.25, 0.125), roughness=0.1)
    UsdLux.RectLight.Define(stage, "/Lamp").AddTranslateOp().Set((0, 0, -1))
    stage.Save()
    flags = ("-w", "100", "--imageHeight", "70", "--reuseTile", "32", "--debugAovs")
    assert record(tmp_path, "scanlines.exr", *flags) == ExitCode.OK
    monkeypatch.setattr(exr_file, "BAND_BYTES", 0)
    assert record(tmp_path, "tiles.exr", *flags) == ExitCode.OK
    (scanlines, expected), (tiles, found) = (read_exr(tmp_path / f"{n}.exr") for n in ("scanlines", "tiles"))
    assert (scanlines["type"], tiles["type"]) == (OpenEXR.scanlineimage, OpenEXR.tiledimage)
    assert {"direct_debug.evaluations", "reflection_debug.distance", "direct_id.R"} <= set(expected)
    assert set(found) == set(expected)
    for name, pixels in expected.items():
        assert np.array_equal(found[name], pixels), name


def test_prims_are_shaded_at_their_rates(tmp_path: Path) -> None:
    stage = new_stage(tmp_path)
    rate = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/Card")).CreatePrimvar(
        "encore:shadingRate", Sdf.ValueTypeNames.Float
    )
    flags = ("-w", "64", "--imageHeight", "64", "--stats", str(tmp_path / "s.json"))
    for asked in (0.25, 1.0, 8.0):
        rate.Set(asked)
        stage.Save()
        assert record(tmp_path, "a.exr", *flags) == ExitCode.OK
        layer = json.loads((tmp_path / "s.json").read_text())["layers"]["direct"]
        seeds = layer["shading_evaluations"] - layer["reshading_evaluations"]
        assert seeds / 64**2 == pytest.approx(asked, rel=0.05)


def test_reference_and_disable_gpu(tmp_path: Path) -> None:
    stage = new_stage(tmp_path)
    bind(stage, diffuseColor=(0.5, 0.5, 0.5))
    stage.Save()
    flags = ("--method", "reference", "--disableGpu", "--stats", str(tmp_path / "s.json"))
    assert record(tmp_path, "a.exr", *flags) == ExitCode.OK
    assert read_exr(tmp_path / "a.exr")[0]["encore:method"] == "reference"
    document = json.loads((tmp_path / "s.json").read_text())
    assert document["device"]["cpu"]
    assert document["shading_evaluations"] == 32 * 16 * 4


def test_dump_shows_what_would_be_rendered(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    new_stage(tmp_path).Save()
    assert (
        cli.main(["dump", str(tmp_path / "a.usda"), "-w", "40", "--imageHeight", "20", "-f", "3"])
        == ExitCode.OK
    )
    text = capsys.readouterr().out
    assert "image 40 x 20" in text
    assert "/Card" in text
    assert cli.main(["dump", str(tmp_path / "a.usda"), "-f", "1:3"]) == ExitCode.USAGE


def test_devices_are_listed_with_what_the_flag_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["devices"]) == ExitCode.OK
    listed = capsys.readouterr().out.splitlines()
    cpu = next(line for line in listed if "(CPU, " in line)
    index, name = cpu.split(": ", 1)
    new_stage(tmp_path).Save()
    for select in (index, name.split()[0].upper()):
        assert record(tmp_path, "a.exr", "--device", select) == ExitCode.OK


def test_camera_by_name(tmp_path: Path) -> None:
    stage = new_stage(tmp_path)
    far = UsdGeom.Camera.Define(stage, "/World/Far")
    far.AddTranslateOp().Set((0, 0, 30))
    stage.Save()
    assert record(tmp_path, "a.exr", "-cam", "Far") == ExitCode.OK
    header, channels = read_exr(tmp_path / "a.exr")
    assert header["encore:camera"] == "/World/Far"
    assert channels["Z"] == pytest.approx(40, rel=1e-4)


# --- Bad input ---------------------------------------------------------------------------------------


def check_failure(
    folder: Path, capsys: pytest.CaptureFixture[str], code: int, *messages: str, flags: tuple[str, ...] = ()
) -> None:
    assert record(folder, "a.exr", *flags) == code
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith("Error: ")
    for message in messages:
        assert message in error
    assert names(folder) == []


def test_nothing_to_render(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stage = new_stage(tmp_path)
    stage.RemovePrim("/Card")
    stage.Save()
    check_failure(tmp_path, capsys, ExitCode.STAGE, "render")


def test_unknown_camera(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    new_stage(tmp_path).Save()
    check_failure(tmp_path, capsys, ExitCode.STAGE, "/Nope", "/Camera", flags=("--camera", "/Nope"))


def test_points_that_are_not_numbers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stage = new_stage(tmp_path)
    points = UsdGeom.Mesh.Get(stage, "/Card").GetPointsAttr()
    points.Set([(float("nan"), 0, 0), *list(points.Get())[1:]])
    stage.Save()
    check_failure(tmp_path, capsys, ExitCode.STAGE, "/Card", "points")


def test_face_indices_out_of_range(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stage = new_stage(tmp_path)
    UsdGeom.Mesh.Get(stage, "/Card").GetFaceVertexIndicesAttr().Set([0, 1, 2, 7])
    stage.Save()
    check_failure(tmp_path, capsys, ExitCode.STAGE, "/Card", "7")


def test_a_bad_mesh_among_good_ones_is_left_out_unless_strict(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stage = new_stage(tmp_path)
    bad = UsdGeom.Mesh.Define(stage, "/Bad")
    bad.CreatePointsAttr([(0, 0, 0)])
    bad.CreateFaceVertexCountsAttr([3])
    bad.CreateFaceVertexIndicesAttr([0, 1, 2])
    stage.Save()
    check_failure(tmp_path, capsys, ExitCode.STAGE, "/Bad", flags=("--strict",))
    assert record(tmp_path, "a.exr") == ExitCode.OK
    assert "Warning: /Bad" in capsys.readouterr().err


def test_a_missing_texture_gives_its_fallback_unless_strict(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stage = new_stage(tmp_path)
    shader = bind(stage, diffuseColor=(0, 0, 0), ior=1.0, roughness=1.0)
    texture = UsdShade.Shader.Define(stage, "/Material/Wood")
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set("wood.png")
    texture.CreateInput("fallback", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(0.25, 0.5, 1, 1))
    output = texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    shader.CreateInput("emissiveColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(output)
    stage.Save()
    check_failure(tmp_path, capsys, ExitCode.STAGE, "wood.png", flags=("--strict",))
    assert record(tmp_path, "a.exr") == ExitCode.OK
    assert "wood.png" in capsys.readouterr().err
    channels = read_exr(tmp_path / "a.exr")[1]
    assert [float(channels[c][8, 16]) for c in "RGB"] == pytest.approx([0.25, 0.5, 1], rel=1e-5)


def test_broken_references_are_said_once(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    stage = new_stage(tmp_path)
    for i in range(20):
        stage.DefinePrim(f"/Broken{i}").GetReferences().AddReference("./nothing.usda")
    stage.Save()
    capfd.readouterr()  # what USD said of authoring them
    assert record(tmp_path, "a.exr") == ExitCode.OK
    lines = [line for line in capfd.readouterr().err.splitlines() if "nothing.usda" in line]
    assert len(lines) == 1
    assert "20 prims" in lines[0]


def test_too_little_memory_says_how_much_is_enough(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    new_stage(tmp_path).Save()
    check_failure(tmp_path, capsys, ExitCode.MEMORY, "--memory", "MiB", flags=("--memory", "1K"))


def test_too_many_micropolygons(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stage = new_stage(tmp_path)
    UsdGeom.Mesh.Get(stage, "/Card").GetSubdivisionSchemeAttr().Set("catmullClark")
    stage.Save()
    flags = ("--targetEdgeLength", "0.01", "--maxMicropolygons", "1000")
    check_failure(tmp_path, capsys, ExitCode.MEMORY, "/Card", flags=flags)


def test_unknown_device(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    new_stage(tmp_path).Save()
    check_failure(tmp_path, capsys, ExitCode.DEVICE, "no such device", flags=("--device", "no such device"))


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_while_rendering_leaves_nothing(tmp_path: Path, number: int) -> None:
    new_stage(tmp_path).Save()
    arguments = ["record", str(tmp_path / "a.usda"), str(tmp_path / "a.exr")]
    # Many small tiles, so that there is something to interrupt, and soon.
    flags = [
        "-w",
        "1024",
        "--imageHeight",
        "1024",
        "--samples",
        "16",
        "--reuseTile",
        "16",
        "--progress",
        "json",
    ]
    process = subprocess.Popen(
        [sys.executable, "-m", "encore", *arguments, *flags],
        env={**os.environ, "PYTHONPATH": str(Path(encore.__file__).parents[1])},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    # Until the loop over blocks runs.
    while json.loads(process.stdout.readline())["stage"] != "render":
        pass
    process.send_signal(number)
    _, errors = process.communicate()
    assert process.returncode == 128 + number
    assert "Traceback" not in errors
    assert names(tmp_path) == []
