"""Ctrl-C for child processes, also where the tests themselves run in the background, which ignores it."""

from __future__ import annotations

import signal


def takes_interrupts() -> None:
    """Restore the usual meaning of SIGINT; a `preexec_fn`."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
