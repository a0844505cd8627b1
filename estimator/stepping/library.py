"""Where the compiled stepping loop lies, and whether it is there. Loads nothing."""

from __future__ import annotations

import sys
from pathlib import Path

from estimator.errors import InputError

SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")  # of a shared library
STEPPER = Path(__file__).with_name("stepper" + SUFFIX)  # the compiled stepping loop, which every worker loads


def check_installed() -> None:
    """Raise InputError unless the stepping loop is there."""
    if not STEPPER.is_file():
        raise InputError(f"{STEPPER} is missing: an installation compiles it; install fmu-estimator again by pip")
