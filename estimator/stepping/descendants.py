"""Processes that an FMU has started: found by a mark in their environment, or by their parents, and ended. Linux only.

A process group ends with its worker, but a child may leave the group (setsid). It keeps the environment that it was
born with, and while the worker lives, the worker is its ancestor: it adopts what other processes have left behind.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
from collections.abc import Iterable
from pathlib import Path

MARK = "FMU_ESTIMATOR_WORKER"  # environment variable: of which worker a process is
PROC = Path("/proc")
ADOPTS = 36  # PR_SET_CHILD_SUBREAPER


def adopt() -> None:
    """Make this process the parent of what its descendants leave behind."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(ADOPTS, 1, 0, 0, 0)


def descendants(pid: int) -> set[int]:
    """Return the processes that descend from one that lives."""
    found: set[int] = set()
    waiting = [pid]
    while waiting:
        for children in PROC.glob(f"{waiting.pop()}/task/*/children"):
            with contextlib.suppress(OSError, ValueError):
                new = {int(child) for child in children.read_text().split()} - found
                found |= new
                waiting += new
    return found


def marked(mark: str) -> set[int]:
    """Return the processes of this user, without this one, that carry a mark."""
    line = f"{MARK}={mark}".encode()
    found = set()
    for pid in os.listdir(PROC) if PROC.is_dir() else ():
        with contextlib.suppress(OSError, ValueError):  # it has ended, it is another user's, or it is none
            if int(pid) != os.getpid():
                with open(f"{PROC}/{pid}/environ", "rb", buffering=0) as environment:
                    if line in environment.read().split(b"\0"):
                        found.add(int(pid))
    return found


def end_all(mark: str, known: Iterable[int] = ()) -> None:
    """End the processes that carry a mark, and those that are known."""
    for pid in {*known, *marked(mark)}:
        with contextlib.suppress(OSError):
            os.kill(pid, signal.SIGKILL)
