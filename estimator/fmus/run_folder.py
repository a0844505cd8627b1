"""A temporary folder that goes with its owner, however the owner ends. Knows nothing of what lies in it.

The owner holds a lock on a file inside for its whole life; the operating system releases it even after a kill. So
the next start can tell the folders that were left behind from those in use, and removes the former.
"""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import IO

from estimator.stepping.folder import LOCK, remove

PREFIX = "fmu-estimator-"
OLD = 60.0  # s: an empty folder without a lock is not being made any more


class RunFolder:
    """A locked temporary folder; use it as a context manager."""

    def __init__(self) -> None:
        remove_leftovers()
        while True:
            self.path = Path(tempfile.mkdtemp(prefix=PREFIX)).resolve()
            self._lock = open(self.path / LOCK, "w")  # noqa: SIM115 - held for life
            if try_lock(self._lock) and (self.path / LOCK).is_file():
                break
            self.close()  # another start took it for a leftover before it was locked

    def close(self) -> None:
        """Remove the folder."""
        self._lock.close()
        remove(self.path)

    def __enter__(self) -> RunFolder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def remove_leftovers() -> None:
    """Remove the run folders of this user whose owner is gone."""
    place, names = tempfile.gettempdir(), list[str]()
    with contextlib.suppress(OSError):  # a folder that may be written, not listed
        names = os.listdir(place)
    for name in names:
        if not name.startswith(PREFIX):
            continue
        folder = Path(place, name)
        lock = folder / LOCK
        with contextlib.suppress(OSError):
            if not lock.is_file():  # its owner is just making it, or was killed there, or it is none of ours
                if time.time() - folder.stat().st_mtime > OLD:
                    folder.rmdir()  # if it is empty
                continue
            with open(lock, "r+") as file:
                owned = not try_lock(file)
                if not owned:  # removed while locked: so an owner that is just coming sees that it is gone
                    remove(folder)
            if not owned:  # on Windows an open file stays, and its folder
                remove(folder)


def try_lock(file: IO[str]) -> bool:
    """Take the lock of an open file, until it is closed; return False if somebody else has it."""
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
