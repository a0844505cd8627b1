"""The version of this package. Knows nothing else."""

from __future__ import annotations

import contextlib
from functools import cache
from pathlib import Path

DISTRIBUTION = "fmu-estimator"


@cache
def version() -> str:
    """Return the version of this package, also when it is run from its source tree without being installed."""
    from importlib.metadata import PackageNotFoundError
    from importlib.metadata import version as installed

    with contextlib.suppress(PackageNotFoundError):
        return installed(DISTRIBUTION)
    import tomllib

    with contextlib.suppress(OSError, KeyError, ValueError):
        text = (Path(__file__).parent.parent / "pyproject.toml").read_text(encoding="utf-8")
        return str(tomllib.loads(text)["project"]["version"])
    return "unknown"
