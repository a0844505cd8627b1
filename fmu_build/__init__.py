"""Motor models in C to FMUs: the only place that knows how an FMU is made. Knows nothing of estimation."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .bundle import bundled, bundled_names
from .errors import BuildError
from .template import new_model

if TYPE_CHECKING:
    from .export import build

__all__ = ["BuildError", "build", "bundled", "bundled_names", "new_model"]


def __getattr__(name: str) -> Any:
    """Load what builds an FMU when it is asked for: whoever uses a bundled one builds none."""
    if name not in ("build", "export"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    export = import_module(f"{__name__}.export")
    return export if name == "export" else export.build
