"""Why a library cannot be loaded, in a sentence: what the dynamic loader says, without paths. Loads nothing."""

from __future__ import annotations

import re
import struct
from pathlib import Path

from estimator.stepping.library import binaries

_MACHINES = {0x03: "x86", 0x28: "ARM", 0x3E: "x86-64", 0xB7: "AArch64"}  # of ELF headers


def why_not_loaded(words: str, folder: str) -> str:
    """Return why an FMU's library cannot be loaded.

    Parameters
    ----------
    words : as fmpy and the dynamic loader say it
    folder : of the extracted FMU
    """
    words = " ".join(words.split())
    if found := re.match(r"Cannot find shared library (\S+?)\.?$", words):
        return _not_there(Path(folder) / "binaries" / _platform(folder) / found[1])
    missing = re.search(r"(\S+): cannot open shared object file", words)
    if missing and not missing[1].startswith(folder):
        return f"its library needs {Path(missing[1]).name}, which this machine does not have; install it"
    if missing and not Path(missing[1]).is_file():
        return _not_there(Path(missing[1]))
    own_path = next((Path(w.rstrip(".:")) for w in words.split() if w.startswith(folder)), None)
    if re.search(r"wrong ELF class|invalid ELF header|Exec format|cannot open shared object file", words):
        return f"its library is for {_architecture(own_path)}, not for this machine"
    symbol = re.search(r"undefined symbol: (\S+)", words)
    if symbol:
        name = symbol[1].rstrip(",")
        return f"its library lacks the symbol {name}: a library that it needs is missing, or there in another version"
    version = re.search(r"version `(\S+)' not found", words)
    if version:
        return f"its library needs {version[1]}, which this machine's libraries are too old for"
    return re.sub(r"/\S*/", "", words)


def _platform(folder: str) -> str:
    """Return which of the folders of binaries is this machine's, as FMI 1.0 and 2.0 or as FMI 3.0 name them."""
    names = [n for n in (binaries("3"), binaries("2")) if (Path(folder) / "binaries" / n).is_dir()]
    return (names or [binaries("2")])[0]


def _not_there(library: Path) -> str:
    beside = ", ".join(sorted(p.name for p in library.parent.glob("*")))
    return f"it has no library {library.name} in binaries/{library.parent.name}" + (
        f", only {beside}" if beside else ""
    )


def _architecture(path: Path | None) -> str:
    """Return what machine a library is for, as its ELF header says."""
    try:
        head = path.read_bytes()[:20] if path is not None else b""
    except OSError:
        head = b""
    if head[:4] != b"\x7fELF" or len(head) < 20:
        return "another operating system"
    machine = struct.unpack("<H", head[18:20])[0]
    return f"{_MACHINES.get(machine, 'another processor')} of {32 if head[4] == 1 else 64} bit"
