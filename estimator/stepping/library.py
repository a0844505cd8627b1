"""Where the compiled loops lie, and whether they are there. Loads nothing."""

from __future__ import annotations

import sys
from pathlib import Path

from estimator.errors import InputError

SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")  # of a shared library
STEPPER = Path(__file__).with_name("stepper" + SUFFIX)  # the stepping loop, which every worker loads
KALMAN = Path(__file__).with_name("kalman" + SUFFIX)  # the whitening filter, which holds no FMU: the program loads it


def check_installed(library: Path | None = None) -> None:
    """Raise InputError unless a compiled loop is there, by default the stepping loop."""
    library = STEPPER if library is None else library
    if not library.is_file():
        raise InputError(f"{library} is missing: an installation compiles it; install fmu-estimator again by pip")
