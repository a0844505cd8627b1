"""Answers of worker processes, as they come. Knows lines of JSON; no order, no FMU.

Where pipes can be waited for they are, by who wants an answer: a thread that listens to each costs two changes of
thread an answer, a tenth of a short estimate.
"""

from __future__ import annotations

import json
import os
import queue
import select
import threading
import time
from typing import IO, Any, Generic, TypeVar

Sender = TypeVar("Sender")

CHUNK = 1 << 16  # bytes that are read at once


class Mailbox(Generic[Sender]):
    """Answers of several senders, each a line of JSON on a pipe of its own; None is the last word of one that ended.

    What is no JSON object has been written by something else that got hold of the pipe: nothing after it is believed.
    """

    def __init__(self) -> None:
        self._known: queue.SimpleQueue[tuple[Sender, dict[str, Any] | None]] = queue.SimpleQueue()
        self._pipes: dict[int, tuple[Sender, IO[bytes], bytearray]] = {}
        self._poll = select.poll() if hasattr(select, "poll") else None  # Windows waits for no pipe

    def join(self, sender: Sender, pipe: IO[bytes]) -> None:
        """Listen to one more sender; its pipe is closed here, when it ends or leaves."""
        if self._poll is None:
            threading.Thread(target=self._listen, args=(sender, pipe), daemon=True).start()
            return
        self._pipes[pipe.fileno()] = sender, pipe, bytearray()
        self._poll.register(pipe.fileno(), select.POLLIN)

    def leave(self, sender: Sender) -> None:
        """Listen no more to a sender that has ended; what it has not been asked for is lost."""
        for place in [place for place, (own, _, _) in self._pipes.items() if own is sender]:
            self._close(place)

    def put(self, sender: Sender, message: dict[str, Any] | None) -> None:
        """Put an answer back, behind those that are there."""
        self._known.put((sender, message))

    def get(self, *, timeout: float) -> tuple[Sender, dict[str, Any] | None]:
        """Return the next answer, and whose it is.

        Raises
        ------
        queue.Empty
            None has come within `timeout` seconds.
        """
        if self._poll is None:
            return self._known.get(timeout=timeout)
        until = time.monotonic() + timeout
        while self._known.empty():
            ready = self._poll.poll(1e3 * timeout)
            if not ready and time.monotonic() >= until:
                raise queue.Empty
            for place, _ in ready:
                self._read(place)
            timeout = max(0.0, until - time.monotonic())
        return self._known.get_nowait()

    def _read(self, place: int) -> None:
        """Take what has come from one pipe."""
        sender, _, begun = self._pipes[place]
        chunk = os.read(place, CHUNK)
        ended, newline, rest = chunk.rpartition(b"\n")
        sound = True
        if newline:
            sound = all(self._take(sender, line) for line in (begun + ended).split(b"\n"))
            begun.clear()
        begun += rest
        if not chunk or not sound:
            self._close(place)
            self._known.put((sender, None))

    def _take(self, sender: Sender, line: bytes | bytearray) -> bool:
        """Take a line; false if it is no answer."""
        try:
            message = json.loads(line)
        except ValueError:
            return False
        if isinstance(message, dict):
            self._known.put((sender, message))
        return isinstance(message, dict)

    def _close(self, place: int) -> None:
        assert self._poll is not None
        self._poll.unregister(place)
        self._pipes.pop(place)[1].close()

    def _listen(self, sender: Sender, pipe: IO[bytes]) -> None:
        """Take all that comes from one pipe, in a thread of its own."""
        with pipe:
            all(self._take(sender, line) for line in pipe)
        self._known.put((sender, None))
