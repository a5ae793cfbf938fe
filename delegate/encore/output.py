"""Files that appear whole or not at all."""

from __future__ import annotations

import contextlib
import os
import secrets
import tempfile
from collections.abc import Iterator
from pathlib import Path

from encore.errors import OutputError, UsageError

FORMATS = (".exr", ".png")


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
        name = target.with_name(f".{target.name}.{secrets.token_hex(4)}.tmp")
        name.touch(mode=0o666, exist_ok=False)
        temporary = name
        yield str(name)
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


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
