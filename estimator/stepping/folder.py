"""A run's folder, removed so that a kill in the middle leaves it to the next start. Knows nothing of what it holds."""

from __future__ import annotations

import contextlib
import os
import shutil
from pathlib import Path

LOCK = "owner.lock"  # in the folder: without it nobody knows a leftover from a folder that is being made


def remove(folder: Path) -> None:
    """Remove a folder, its lock last, and not while anything else is left: another process may still write there."""
    with contextlib.suppress(OSError):
        for entry in list(os.scandir(folder)):
            if entry.is_dir(follow_symlinks=False):
                shutil.rmtree(entry.path, ignore_errors=True)
            elif entry.name != LOCK:
                os.unlink(entry.path)
        if set(os.listdir(folder)) <= {LOCK}:
            shutil.rmtree(folder, ignore_errors=True)
