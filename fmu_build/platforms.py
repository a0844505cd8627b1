"""The platforms that an FMU may hold binaries for: their names in FMI, their compiler's target. Knows no model."""

from __future__ import annotations

import platform
import struct
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec

from .errors import BuildError


@dataclass(frozen=True)
class Platform:
    """What FMUs are compiled for.

    Attributes
    ----------
    name : str
        What the user calls it, such as ``linux64``.
    target : str
        What zig calls it; for Linux with the oldest glibc that the binary runs on.
    tuple : str
        FMI 3.0's name, such as ``x86_64-linux``.
    folder : str
        FMI 2.0's name. It has one for macOS, and none for Linux on ARM, where FMI 3.0's is taken.
    """

    name: str
    target: str
    tuple: str
    folder: str

    @property
    def system(self) -> str:
        """Python's name of the operating system."""
        return {"windows": "win32"}.get(self.tuple.partition("-")[2], self.tuple.partition("-")[2])

    @property
    def suffix(self) -> str:
        """The suffix of a shared library."""
        return {"win32": ".dll", "darwin": ".dylib"}.get(self.system, ".so")


PLATFORMS = {
    known.name: known
    for known in (
        Platform("linux64", "x86_64-linux-gnu.2.17", "x86_64-linux", "linux64"),
        Platform("linux-aarch64", "aarch64-linux-gnu.2.17", "aarch64-linux", "aarch64-linux"),
        Platform("win64", "x86_64-windows-gnu", "x86_64-windows", "win64"),
        Platform("darwin-x86_64", "x86_64-macos.11.0", "x86_64-darwin", "darwin64"),
        Platform("darwin-aarch64", "aarch64-macos.11.0", "aarch64-darwin", "darwin64"),
    )
}


def find_platforms(names: Iterable[str]) -> list[Platform]:
    """Return the platforms of these names, each once.

    Raises
    ------
    BuildError
        There is none of a name, or none is named.
    """
    wanted = list(dict.fromkeys(names))
    for name in wanted:
        if name not in PLATFORMS:
            raise BuildError(f"no platform {name!r}; there are {', '.join(PLATFORMS)}")
    if not wanted:
        raise BuildError(f"no platform is named; there are {', '.join(PLATFORMS)}")
    return [PLATFORMS[name] for name in wanted]


def native_tuple() -> str:
    """Return FMI 3.0's name of this machine."""
    machine = platform.machine().lower()
    architecture = {"amd64": "x86_64", "arm64": "aarch64", "i686": "x86"}.get(machine, machine)
    system = {"win32": "windows", "darwin": "darwin"}.get(sys.platform, "linux")
    return f"{architecture}-{system}"


def zig_compiler(target: str | None = None) -> list[str] | None:
    """Return the command of the C compiler in the ziglang package; None where it is missing.

    Parameters
    ----------
    target : str, optional
        `Platform.target`; by default this machine's. Without one, zig would use what only this processor has.
    """
    if find_spec("ziglang") is None:
        return None
    own = [known.target for known in PLATFORMS.values() if known.tuple == native_tuple()]
    chosen = target or (own[0] if own else None)
    return [sys.executable, "-m", "ziglang", "cc", *(["-target", chosen] if chosen else [])]


def universal_binary(slices: Sequence[bytes]) -> bytes:
    """Return one macOS library of several, one for each processor (Apple, mach-o/fat.h)."""
    alignment = 14  # 2^14: a page on ARM
    position = 1 << alignment
    header = struct.pack(">II", 0xCAFEBABE, len(slices))
    body = b""
    for data in slices:
        magic, processor, variant = struct.unpack("<III", data[:12])
        if magic != 0xFEEDFACF:
            raise BuildError("the compiler's output is no macOS library of 64 bits")
        header += struct.pack(">IIIII", processor, variant, position + len(body), len(data), alignment)
        body += data + b"\0" * (-len(data) % (1 << alignment))
    return header.ljust(position, b"\0") + body


def platform_folder(fmi: int = 2) -> str:
    """Return FMI's name for this machine: ``linux64`` in FMI 2.0, ``x86_64-linux`` in FMI 3.0."""
    if fmi == 3:
        return native_tuple()
    system = {"win32": "win", "darwin": "darwin"}.get(sys.platform, "linux")
    return f"{system}{64 if sys.maxsize > 2**32 else 32}"
