"""Encore, a shading-reuse renderer for OpenUSD.

Importing it registers the schema of Encore's own attributes with USD, so import it before the first
stage is opened if EncorePrimvarsAPI is to be applied or validated. Rendering does not depend on that.

The names below are loaded when they are first used, so that importing costs little.
"""

import importlib
from typing import TYPE_CHECKING, Any

from encore import schema

if TYPE_CHECKING:
    from encore.errors import (
        AssetError,
        Cancelled,
        DeviceError,
        EncoreError,
        InternalError,
        MemoryLimitError,
        OutputError,
        SettingError,
        StageError,
        UsageError,
    )
    from encore.render_buffer import AovBinding, Format, RenderBuffer
    from encore.render_delegate import RenderDelegate
    from encore.render_result import RenderResult
    from encore.renderer import Renderer

__version__ = "0.1.0"

_MODULES = {
    "Renderer": "renderer",
    "RenderResult": "render_result",
    "RenderBuffer": "render_buffer",
    "AovBinding": "render_buffer",
    "Format": "render_buffer",
    "RenderDelegate": "render_delegate",
    "EncoreError": "errors",
    "UsageError": "errors",
    "StageError": "errors",
    "AssetError": "errors",
    "SettingError": "errors",
    "DeviceError": "errors",
    "OutputError": "errors",
    "MemoryLimitError": "errors",
    "InternalError": "errors",
    "Cancelled": "errors",
}

__all__ = [
    "AovBinding",
    "AssetError",
    "Cancelled",
    "DeviceError",
    "EncoreError",
    "Format",
    "InternalError",
    "MemoryLimitError",
    "OutputError",
    "RenderBuffer",
    "RenderDelegate",
    "RenderResult",
    "Renderer",
    "SettingError",
    "StageError",
    "UsageError",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'encore' has no attribute {name!r}")
    found = getattr(importlib.import_module(f"encore.{_MODULES[name]}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


schema.register()
