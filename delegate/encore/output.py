"""Images to files: EXR with every layer, PNG of the composite; whole or not at all."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt
import OpenEXR
import OpenImageIO as oiio

from encore.color import DisplayTransform
from encore.errors import InternalError, OutputError, UsageError

FORMATS = (".exr", ".png")

# Depth where nothing was hit: finite, so that the file holds no infinities, and beyond every far plane.
EMPTY_DEPTH = np.float32(1e30)

# Primaries and white point of Rec.709 as (x, y) of red, green, blue and white.
REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)

Plane = npt.NDArray[np.float32]
HeaderValue = str | int | float


@dataclass
class Image:
    """Arrays of one frame, top row first.

    layers: name → (H, W, 3) premultiplied scene-linear radiance. composite: (H, W, 3), their sum.
    alpha: (H, W) coverage. depth: (H, W) along the viewing axis in world units, infinite where nothing is.
    normal: (H, W, 3) world space.
    """

    layers: dict[str, Plane]
    composite: Plane
    alpha: Plane
    depth: Plane
    normal: Plane
    pixel_aspect_ratio: float = 1.0
    header: dict[str, HeaderValue] = field(default_factory=dict)

    def channels(self) -> dict[str, Plane]:
        """EXR channels: name → (H, W) float32. Throws InternalError if a number is not finite."""
        channels = _split("", "RGB", self.composite) | {"A": self.alpha}
        for name, layer in self.layers.items():
            channels |= _split(f"{name}.", "RGB", layer)
        channels["Z"] = np.where(np.isposinf(self.depth), EMPTY_DEPTH, self.depth)
        channels |= _split("N.", "XYZ", self.normal)
        for name, plane in channels.items():
            _require_finite(name, plane)
        return {name: np.ascontiguousarray(plane, dtype=np.float32) for name, plane in channels.items()}


def check_format(path: str) -> None:
    """Throws UsageError unless the extension is that of a format that can be written."""
    suffix = Path(path).suffix
    if suffix.lower() not in FORMATS:
        what = f"'{suffix}' is not an image format that can be written" if suffix else "has no file extension"
        raise UsageError(what, path, f"Use {' or '.join(FORMATS)}")


def check_writable(path: str) -> None:
    """Throws OutputError unless a file of this name can be made; leaves nothing behind."""
    target = Path(path)
    if target.is_dir():
        raise OutputError("is a folder, not a file name", path, "Give the name of a file")
    if not target.parent.is_dir():
        raise OutputError("its folder does not exist", path, f"Create {target.parent} first")
    try:
        with tempfile.NamedTemporaryFile(dir=target.parent, prefix=f".{target.name}."):
            pass
    except OSError as error:
        what = f"its folder cannot be written to ({error.strerror})"
        raise OutputError(what, path, "Choose another place") from error


@contextlib.contextmanager
def atomic_file(path: str) -> Iterator[str]:
    """Yields a temporary name in the same folder; on success it becomes `path`, on failure it vanishes."""
    target = Path(path)
    temporary: Path | None = None
    try:
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.", suffix=".tmp")
        temporary = Path(name)
        os.close(handle)
        yield name
        temporary.chmod(0o666 & ~_umask())
        _sync(temporary)
        temporary.replace(target)
        temporary = None
        _sync(target.parent)
    except OSError as error:
        what = f"cannot be written ({error.strerror or error})"
        raise OutputError(what, path, "Free some space or choose another place") from error
    finally:
        if temporary:
            temporary.unlink(missing_ok=True)


def write_text(path: str, text: str) -> None:
    """Writes a text file, whole or not at all."""
    with atomic_file(path) as temporary:
        Path(temporary).write_text(text, encoding="utf-8")


def write_image(path: str, image: Image, transform: DisplayTransform) -> None:
    """Writes the image in the format of the path's extension. transform: for PNG; EXR is scene-linear."""
    if Path(path).suffix.lower() == ".png":
        write_png(path, image, transform)
    else:
        write_exr(path, image)


def write_exr(path: str, image: Image) -> None:
    """Writes every channel as 32-bit float, so that the composite stays exactly the sum of the layers."""
    header: dict[str, object] = dict(image.header)
    header |= {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "chromaticities": REC709,
        "pixelAspectRatio": float(image.pixel_aspect_ratio),
    }
    channels = image.channels()
    with atomic_file(path) as temporary:
        try:
            with OpenEXR.File(header, channels) as file:
                file.write(temporary)
        except (RuntimeError, ValueError) as error:
            raise OutputError(f"cannot be written ({error})", path) from error


def write_png(path: str, image: Image, transform: DisplayTransform) -> None:
    """Writes the composite with 8 bits and unassociated alpha, as PNG asks for."""
    channels = image.channels()
    rgb = np.stack([channels[c] for c in "RGB"], axis=-1)
    alpha = np.clip(channels["A"], 0, 1)
    # Light without coverage (a visible lamp, for one) has nothing to be divided by, and stays as it is.
    rgb /= np.where(alpha > 0, alpha, 1)[..., None]
    values = np.concatenate([transform.apply(rgb), alpha[..., None]], axis=-1)
    pixels = (np.clip(values, 0, 1) * 255 + 0.5).astype(np.uint8)

    height, width, _ = pixels.shape
    spec = oiio.ImageSpec(width, height, 4, "uint8")
    spec.alpha_channel = 3
    spec.attribute("oiio:UnassociatedAlpha", 1)
    spec.attribute("PixelAspectRatio", float(image.pixel_aspect_ratio))
    spec.attribute("Software", f"Encore {image.header.get('encore:version', '')}".strip())
    spec.attribute("encore:display", transform.description)
    for name, value in image.header.items():
        spec.attribute(name, str(value))
    with atomic_file(path) as temporary:
        file = oiio.ImageOutput.create("png")
        if not (file and file.open(temporary, spec) and file.write_image(pixels) and file.close()):
            raise OutputError(f"cannot be written ({file.geterror() if file else oiio.geterror()})", path)
        # The PNG writer does not notice a disk that fills up.
        written = _read_png(temporary)
        if written is None or not np.array_equal(written, pixels):
            raise OutputError("cannot be written (the file is incomplete)", path, "Free some space")


def _read_png(path: str) -> npt.NDArray[np.uint8] | None:
    """The (H, W, 4) values of a PNG as they are in the file; None if it cannot be read."""
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    file = oiio.ImageInput.open(path, config)
    if not file:
        return None
    pixels: npt.NDArray[np.uint8] | None = file.read_image("uint8")
    file.close()
    return pixels


def _split(prefix: str, names: str, planes: Plane) -> dict[str, Plane]:
    return {f"{prefix}{name}": planes[..., i] for i, name in enumerate(names)}


def _require_finite(name: str, plane: Plane) -> None:
    bad = np.argwhere(~np.isfinite(plane))
    if len(bad):
        y, x = bad[0]
        raise InternalError(
            f"channel {name} has {len(bad)} numbers that are not finite, the first at pixel ({x}, {y}); "
            "the frame is not written",
            remedy="Look for extreme light intensities, and report the stage",
        )


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
