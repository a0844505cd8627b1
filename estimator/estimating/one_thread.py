"""One thread of linear algebra while an estimation runs. Knows no estimation.

The matrices here are small, and the cores simulate: more threads only wait for each other, on a busy machine most of
the time. The command line asks for one before numpy is loaded; in a program that has loaded it already it is asked for
here.
"""

from __future__ import annotations

import contextlib
import functools
import os
from collections.abc import Iterator
from typing import Any


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Let BLAS use one thread, and then as many as before; a context, or a decorator."""
    if os.environ.get("OPENBLAS_NUM_THREADS") == "1":
        yield
        return
    with _libraries().limit(limits=1, user_api="blas"):
        yield


@functools.cache
def _libraries() -> Any:
    """Find the libraries that are loaded: those of numpy and scipy are, once there is something to estimate."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
