"""Images on disk: channels, header, colours, and whole files or none."""

import contextlib
import os
import struct
import threading
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from encore import color, output
from encore.channels import EMPTY_DEPTH
from encore.color import ColorOptions, display_transform
from encore.errors import InternalError, OutputError, UsageError
from encore.exr_file import REC709
from pictures import HEADER, LAYERS, Images, new_images, read_exr, write


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def read_attributes(path: Path) -> dict[str, tuple[str, bytes]]:
    """Header of a single-part EXR, read byte by byte: name → (type, value)."""
    data = path.read_bytes()
    magic, version = struct.unpack_from("<ii", data)
    assert magic == 20000630
    assert version & 0xFF == 2
    assert not version & 0x1A00, "tiled, deep or multi-part"
    attributes, at = {}, 8
    while data[at]:
        name, kind, _ = data[at : at + 600].split(b"\0", 2)
        at += len(name) + len(kind) + 2
        (size,) = struct.unpack_from("<i", data, at)
        attributes[name.decode()] = (kind.decode(), data[at + 4 : at + 4 + size])
        at += 4 + size
    return attributes


def srgb(linear: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.power(linear, 1 / 2.4) - 0.055)


def test_exr_holds_every_channel_bit_for_bit(tmp_path: Path) -> None:
    made = new_images()
    write(tmp_path / "a.exr", made)
    _, channels = read_exr(tmp_path / "a.exr")
    layers = [f"{layer}.{c}" for layer in LAYERS for c in "RGB"]
    assert set(channels) == {"R", "G", "B", "A", "Z", "N.X", "N.Y", "N.Z", *layers}
    assert all(channel.dtype == np.float32 for channel in channels.values())
    for i, c in enumerate("RGB"):
        assert np.array_equal(channels[c], made["composite"][..., i])
        total = (channels[f"direct.{c}"] + channels[f"reflection.{c}"]) + channels[f"refraction.{c}"]
        assert np.array_equal(channels[c], total)
    assert np.array_equal(channels["A"], made["alpha"])
    assert channels["Z"][0, 0] == EMPTY_DEPTH
    assert np.array_equal(channels["Z"].ravel()[1:], made["depth"].ravel()[1:])


def test_only_layers_that_exist_are_written(tmp_path: Path) -> None:
    made = new_images()
    del made["layers"]["reflection"], made["layers"]["refraction"]
    write(tmp_path / "a.exr", made)
    assert not any(name.startswith("refl") for name in read_exr(tmp_path / "a.exr")[1])


def test_exr_header(tmp_path: Path) -> None:
    made = new_images()
    write(tmp_path / "a.exr", made, pixel_aspect_ratio=2.0)
    attributes = read_attributes(tmp_path / "a.exr")
    # A part name makes viewers show layers called ".R"; single-part files must not have one.
    assert "name" not in attributes
    assert attributes["compression"] == ("compression", bytes([3]))
    assert attributes["pixelAspectRatio"] == ("float", struct.pack("<f", 2))
    assert attributes["chromaticities"] == ("chromaticities", struct.pack("<8f", *REC709))
    for name, value in HEADER.items():
        assert attributes[name] == ("string", value.encode())


def test_another_reader_sees_the_same_channels(tmp_path: Path) -> None:
    made = new_images()
    write(tmp_path / "a.exr", made)
    file = oiio.ImageInput.open(str(tmp_path / "a.exr"))
    spec = file.spec()
    assert not file.seek_subimage(1, 0)
    assert spec.channelnames[:4] == ("R", "G", "B", "A")
    assert {"Z", "direct.R", "N.X"} <= set(spec.channelnames)
    assert spec.getattribute("encore:method") == "reuse"
    file.close()


def test_equal_images_give_equal_files(tmp_path: Path) -> None:
    for suffix in (".exr", ".png"):
        paths = [tmp_path / f"{name}{suffix}" for name in "ab"]
        for path in paths:
            write(path, new_images())
        assert paths[0].read_bytes() == paths[1].read_bytes()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("suffix", [".exr", ".png"])
def test_numbers_that_are_not_finite_are_never_written(tmp_path: Path, bad: float, suffix: str) -> None:
    made = new_images()
    made["layers"]["direct"][2, 3, 1] = bad
    with pytest.raises(InternalError, match=r"direct\.G .*not finite.*\(3, 2\)"):
        write(tmp_path / f"a{suffix}", made)
    assert names(tmp_path) == []


def test_depth_that_is_nan_is_not_taken_for_empty(tmp_path: Path) -> None:
    made = new_images()
    made["depth"][1, 1] = np.nan
    with pytest.raises(InternalError, match="channel Z"):
        write(tmp_path / "a.exr", made)


def read_png(path: Path) -> np.ndarray:
    file = oiio.ImageInput.open(str(path))
    spec = file.spec()
    assert spec.format == oiio.UINT8
    assert spec.nchannels == 4
    file.close()
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)  # values as they are in the file
    file = oiio.ImageInput.open(str(path), config)
    pixels = file.read_image("uint8")
    file.close()
    return pixels


def flat(rgb: tuple[float, float, float], alpha: float) -> Images:
    """One premultiplied colour."""
    composite = np.full((2, 2, 3), rgb, dtype=np.float32)
    plane = np.zeros((2, 2), dtype=np.float32)
    return {
        "layers": {"direct": composite},
        "composite": composite,
        "alpha": plane + np.float32(alpha),
        "depth": plane,
        "normal": composite * 0,
    }


@pytest.mark.parametrize("linear", [0.0, 0.001, 0.0031308, 0.18, 0.5, 0.9, 1.0])
def test_png_is_srgb(tmp_path: Path, linear: float) -> None:
    path = tmp_path / "a.png"
    write(path, flat((linear, linear / 2, 0), 1))
    expected = srgb(np.array([linear, linear / 2, 0])) * 255
    assert read_png(path)[0, 0, :3] == pytest.approx(expected, abs=0.5001)
    assert read_png(path)[0, 0, 3] == 255


def test_png_clips_without_a_tone_map(tmp_path: Path) -> None:
    write(tmp_path / "a.png", flat((40, 0.18, -1), 1))
    assert list(read_png(tmp_path / "a.png")[0, 0]) == [255, 118, 0, 255]


def test_png_has_unassociated_alpha(tmp_path: Path) -> None:
    write(tmp_path / "a.png", flat((0.25, 0, 0), 0.5))
    pixel = read_png(tmp_path / "a.png")[0, 0]
    assert list(pixel[1:]) == [0, 0, 128]
    assert pixel[0] == pytest.approx(srgb(np.array(0.5)) * 255, abs=0.5001)


def test_png_keeps_light_without_coverage(tmp_path: Path) -> None:
    write(tmp_path / "a.png", flat((0.18, 0.18, 0.18), 0))
    assert list(read_png(tmp_path / "a.png")[0, 0]) == [118, 118, 118, 0]


def test_png_disabled_correction_is_linear(tmp_path: Path) -> None:
    write(tmp_path / "a.png", flat((0.5, 0.25, 1), 1), color=ColorOptions("disabled"))
    assert list(read_png(tmp_path / "a.png")[0, 0]) == [128, 64, 255, 255]


def test_png_says_how_it_was_made(tmp_path: Path) -> None:
    write(tmp_path / "a.png", new_images())
    file = oiio.ImageInput.open(str(tmp_path / "a.png"))
    assert file.spec().getattribute("encore:method") == "reuse"
    assert file.spec().getattribute("encore:display").endswith("sRGB - Display, Un-tone-mapped")
    file.close()


# --- OpenColorIO -------------------------------------------------------------------------------------


def test_the_aces_view_of_a_builtin_configuration_maps_tones() -> None:
    options = ColorOptions(config="cg-config-v2.1.0_aces-v1.3_ocio-v2.3", view="ACES 1.0 - SDR Video")
    assert options.resolved_mode == "openColorIO"
    grey = np.full((1, 1, 3), 2.0, dtype=np.float32)
    mapped = display_transform(options).apply(grey)
    assert np.all((mapped > 0.7) & (mapped < 1))
    assert np.all(grey == 2), "the input is left alone"


@pytest.mark.parametrize("name", color.builtin_configs())
def test_every_builtin_configuration_works_by_name(name: str) -> None:
    transform = display_transform(ColorOptions(config=name))
    white = transform.apply(np.ones((1, 1, 3), dtype=np.float32))
    assert np.all(np.isfinite(white))
    assert white.max() > 0.5


def test_ocio_variable_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OCIO", "ocio://studio-config-v2.1.0_aces-v1.3_ocio-v2.3")
    assert "studio" in display_transform(ColorOptions("openColorIO")).description
    monkeypatch.setenv("OCIO", "/no/such/config.ocio")
    with pytest.raises(UsageError, match=r"\$OCIO"):
        display_transform(ColorOptions("openColorIO"))
    display_transform(ColorOptions("sRGB"))  # does not ask


def test_a_configuration_file_with_another_name_for_linear_rec709(tmp_path: Path) -> None:
    path = tmp_path / "c.ocio"
    path.write_text(
        "ocio_profile_version: 2\n"
        "roles: {scene_linear: lin, default: lin}\n"
        "displays:\n  Screen:\n    - !<View> {name: Double, colorspace: twice}\n"
        "colorspaces:\n"
        "  - !<ColorSpace> {name: lin, aliases: [lin_rec709]}\n"
        "  - !<ColorSpace>\n    name: twice\n"
        "    from_scene_reference: !<MatrixTransform> {matrix: [2,0,0,0, 0,2,0,0, 0,0,2,0, 0,0,0,1]}\n"
    )
    transform = display_transform(ColorOptions(config=str(path)))
    assert transform.apply(np.full((1, 1, 3), 0.25, np.float32)) == pytest.approx(0.5)
    assert transform.description.endswith("Screen, Double")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (ColorOptions(display="Nope"), "--ocioDisplay.*'sRGB - Display'"),
        (ColorOptions(view="Nope"), "--ocioView.*'Un-tone-mapped'"),
        (ColorOptions(config="nope"), "--ocioConfig.*cg-config"),
        (ColorOptions(config="ocio://nope"), "--ocioConfig.*cg-config"),
        (ColorOptions("sRGB", view="Raw"), "--colorCorrectionMode"),
    ],
)
def test_bad_color_options_say_what_there_is(options: ColorOptions, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        display_transform(options)


# --- Whole or not at all -----------------------------------------------------------------------------


def test_a_failing_writer_leaves_the_old_file_and_no_other(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    path.write_text("old")
    with contextlib.suppress(ZeroDivisionError), output.atomic_file(str(path)) as temporary:
        Path(temporary).write_text("half")
        raise ZeroDivisionError
    assert path.read_text() == "old"
    assert names(tmp_path) == ["a.exr"]


def test_the_file_appears_at_the_end_and_with_usual_permissions(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    mask = os.umask(0o027)
    try:
        with output.atomic_file(str(path)) as temporary:
            Path(temporary).write_text("whole")
            assert Path(temporary).parent == tmp_path
            assert not path.exists()
    finally:
        os.umask(mask)
    assert path.read_text() == "whole"
    assert path.stat().st_mode & 0o777 == 0o640


def test_a_full_disk_is_an_output_error_and_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"No space left"), output.atomic_file(str(tmp_path / "a.exr")):
        raise OSError(28, "No space left on device")
    assert names(tmp_path) == []


def test_files_made_side_by_side_keep_the_permissions_of_others(tmp_path: Path) -> None:
    mask = os.umask(0o027)
    try:
        threads = [
            threading.Thread(target=output.write_text, args=(str(tmp_path / f"{i}.txt"), "text"))
            for i in range(16)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        assert os.umask(mask) == 0o027
    assert {path.stat().st_mode & 0o777 for path in tmp_path.iterdir()} == {0o640}


@pytest.mark.parametrize("name", ["a.jpg", "a.tif", "a", "exr", "a.exr.gz"])
def test_other_formats_are_refused_and_ours_named(name: str) -> None:
    with pytest.raises(UsageError, match=r"\.exr or \.png"):
        output.check_format(name)


@pytest.mark.parametrize("name", ["a.exr", "A.PNG", "b/a.####.EXR"])
def test_our_formats(name: str) -> None:
    output.check_format(name)


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "folder.exr").mkdir()
    for name, message in (
        ("missing/a.exr", "does not exist"),
        ("file/a.exr", "does not exist"),
        ("folder.exr", "is a folder"),
    ):
        with pytest.raises(OutputError, match=message):
            output.check_writable(str(tmp_path / name))
    with pytest.raises(OutputError, match="cannot be written to"):
        output.check_writable("/proc/a.exr")
    output.check_writable(str(tmp_path / "a.exr"))
    assert names(tmp_path) == ["file", "folder.exr"]
