"""What was compiled once is not compiled again: a cache of libraries that workers of pytest-xdist and sessions share.

A library depends on the compiler's version, the command, the C file, and the files that stand in the folders it
includes; what does not compile is compiled every time. Knows no model and no FMU.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import shutil
import subprocess
import time
import types
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fmu_build import compiler

FOLDER = "FMU_ESTIMATOR_TESTS_COMPILED"  # the environment variable that names where libraries are kept
QUICKLY = "FMU_ESTIMATOR_TESTS_QUICKLY"  # the environment variable by which compilers do not optimise: the same bits
DAYS = 7  # that a library is kept that nobody takes
run = subprocess.run  # as it is: some tests take it away


def keep() -> None:
    """Keep what this process compiles from here on, and take what others have, in the folder that FOLDER names."""
    if FOLDER in os.environ:
        own = functools.partial(_run, Path(os.environ[FOLDER]))
        compiler.subprocess = types.SimpleNamespace(run=own, DEVNULL=subprocess.DEVNULL)  # type: ignore[assignment]


def forget(folder: Path) -> None:
    """Remove what was taken by nobody for some days."""
    for path in folder.iterdir():
        with contextlib.suppress(OSError):
            if time.time() - path.stat().st_mtime > 86400 * DAYS:
                path.unlink()


def _run(folder: Path, arguments: Sequence[str], **how: Any) -> subprocess.CompletedProcess[str]:
    if QUICKLY in os.environ:
        arguments = ["-O0" if word == "-O3" else word for word in arguments]
    output = arguments.index("-o") + 1
    kept = folder / _key(arguments[: output - 2], Path(arguments[output - 2]), arguments[output + 1 :])
    if kept.exists():
        os.utime(kept)
        shutil.copy(kept, arguments[output])
        return subprocess.CompletedProcess(arguments, 0, "", "")
    done = run(arguments, **how)
    if done.returncode == 0 and not done.stderr and Path(arguments[output]).is_file():
        unfinished = kept.with_suffix(f".{os.getpid()}")
        shutil.copy(arguments[output], unfinished)
        unfinished.replace(kept)
    return done


def _key(before: Sequence[str], source: Path, after: Sequence[str]) -> str:
    """Return what tells compilations apart; folders count by the files in them, not by their names."""
    digest = hashlib.sha256(
        repr((_version(before[0]), [w for w in before if not w.startswith("-I")], list(after))).encode()
    )
    digest.update(source.read_bytes() if source.is_file() else os.urandom(16))
    for word in before:
        if word.startswith("-I"):
            for name, content in _contents(Path(word[2:])):
                digest.update(repr((name, content)).encode())
        elif os.path.isfile(word):
            digest.update(Path(word).read_bytes())
    digest.update(repr(_near(source)).encode())
    return digest.hexdigest()


def _contents(folder: Path) -> list[tuple[str, str]]:
    if folder == compiler.fmi_headers():
        return _of_fmi()
    return [(path.name, _digest(path)) for path in sorted(folder.glob("*")) if path.is_file()]


@functools.cache
def _version(compiler: str) -> str:
    return run([compiler, "--version"], capture_output=True, text=True).stdout


@functools.cache
def _of_fmi() -> list[tuple[str, str]]:
    return [(path.name, _digest(path)) for path in sorted(compiler.fmi_headers().glob("*")) if path.is_file()]


def _near(source: Path) -> list[tuple[str, str]]:
    """Return the C files beside the source, which it may include by name."""
    return [(p.name, _digest(p)) for p in sorted(source.parent.glob("*")) if p.suffix in (".c", ".h", ".inc")]


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
