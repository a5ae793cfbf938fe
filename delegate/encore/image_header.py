"""What an image file says of its making."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from pxr import Usd

from encore import __version__
from encore.render_pass import load_core


def header(
    settings: Mapping[str, Any], translation: Any, device: Any, source: str, label: str
) -> dict[str, str]:
    """What the image says of its making. Nothing in it differs between two equal runs.

    settings: all, with the size of the image. device: encore._core.Device. source: the stage as the user
    gave it. label: the frame's name.
    """
    # Where shaders are kept is a matter of the machine, and not of the image.
    recorded = {name: value for name, value in settings.items() if name != "shader_cache"}
    opens, closes = translation.shutter
    header = {
        "comments": f"Encore {__version__}, {settings['method']}",
        "encore:version": __version__,
        "encore:method": settings["method"],
        "encore:seed": str(settings["seed"]),
        "encore:settings": json.dumps(recorded, sort_keys=True),
        "encore:stage": source,
        "encore:frame": label,
        "encore:camera": translation.camera_path or "automatic",
        "encore:shutter": f"{opens:.9g} {closes:.9g}",
        "encore:motionBlur": "on" if closes > opens else "off",
        "encore:depthOfField": "on" if translation.lens else "off",
        "encore:device": device.info["name"],
        "encore:driver": device.info["driver"],
        "encore:version:usd": usd_version(),
    }
    versions: Mapping[str, str] = getattr(load_core(), "versions", dict)()
    return header | {f"encore:version:{name}": str(version) for name, version in versions.items()}


def usd_version() -> str:
    """USD's version as its releases are called, such as 26.11."""
    major, minor, patch = Usd.GetVersion()
    return f"{minor}.{patch:02d}" if major == 0 else f"{major}.{minor}.{patch}"
