"""Where compiled code lies: the loops, whether they are there, and an FMU's binaries. Loads nothing."""

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


def binaries(number: str) -> str:
    """Return an FMU's folder of this machine's binaries: ``linux64``, of FMI 3.0 (its number "3") ``x86_64-linux``."""
    import platform

    wide = sys.maxsize > 2**32
    if number == "3":
        system = {"win32": "windows", "darwin": "darwin"}.get(sys.platform, "linux")
        arm = platform.machine().lower() in ("aarch64", "arm64")
        return f"{'aarch64' if arm else 'x86_64' if wide else 'x86'}-{system}"
    return {"win32": "win", "darwin": "darwin"}.get(sys.platform, "linux") + ("64" if wide else "32")
