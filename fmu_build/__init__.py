"""Motor models in C to FMUs: the only place that knows how an FMU is made. Knows nothing of estimation."""

from __future__ import annotations

from .bundle import bundled, bundled_names
from .errors import BuildError
from .export import build
from .template import new_model

__all__ = ["BuildError", "build", "bundled", "bundled_names", "new_model"]
