"""Ctrl-C, also where the tests themselves run in the background, which ignores it."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager


def takes_interrupts() -> None:
    """Restore the usual meaning of SIGINT; a `preexec_fn`."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@contextmanager
def taking_interrupts() -> Iterator[None]:
    """Give SIGINT its usual meaning in this process for a while: a KeyboardInterrupt."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
