"""A long search survives a kill: every batch of candidates is journalled, and a resumed search replays the journal.

The search is a function of its seed and of what candidates cost. So nothing of its state needs saving: started again,
it asks for the same candidates in the same order, gets the journalled costs without any simulation, and stands where it
was killed, bit for bit. Knows batches of candidates only; no search and no format of results.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import struct
import time
import zlib
from pathlib import Path
from types import TracebackType
from typing import IO

import numpy as np
from numpy.typing import NDArray

from estimator.errors import InputError
from estimator.fmus.job import Batch, Failure
from estimator.fmus.workers import Workers

FloatArray = NDArray[np.float64]

MAGIC = b"fmu-estimator journal 1\n"
FRAME = struct.Struct("<II")  # length, CRC-32
SHORT = 5.0  # s: a search that ends sooner writes nothing
FLUSH = 5.0  # s between two flushes to the disk itself; a kill loses nothing, a power cut what is younger


class Journal:
    """Costs of the candidates of one search, in the order in which they were asked for. Use as a context manager.

    Parameters
    ----------
    path : path
        Read if it is there, written from where it ends.
    digest : str
        Of all that the search depends on; a journal of another search is thrown away.
    after : float
        s before anything is written.

    Raises
    ------
    InputError
        The file cannot be read or written.
    """

    def __init__(self, path: Path, *, digest: str, after: float = SHORT) -> None:
        self.path = path
        self.replayed = 0  # candidates that came from the journal
        self._head = MAGIC + digest.encode() + b"\n"
        self._after = after
        self._began = self._flushed = time.monotonic()
        self._pending: list[bytes] = []
        self._file: IO[bytes] | None = None
        self._records, self._end = self._read()
        self._next = 0

    def recall(self, key: bytes) -> Batch | None:
        """Return what the next batch came to, if it is the one with this key; forget the rest if it is not."""
        if self._next == len(self._records):
            return None
        start, record = self._records[self._next]
        if record[:32] != key:
            del self._records[self._next :]
            self._end = start
            return None
        self._next += 1
        (n,) = struct.unpack_from("<q", record, 32)
        self.replayed += n
        costs = np.frombuffer(record, dtype="<f8", count=n, offset=40).copy()
        steps = np.frombuffer(record, dtype="<i8", count=n, offset=40 + 8 * n).astype(np.int64)
        failed = np.frombuffer(record, dtype=np.uint8, count=n, offset=40 + 16 * n).astype(bool)
        return Batch(costs=costs, steps=steps, failed=failed, shown=None)

    def recalled_failures(self) -> list[Failure]:
        """Return the failures that came up first in the batch recalled last."""
        _, record = self._records[self._next - 1]
        (n,) = struct.unpack_from("<q", record, 32)
        return [Failure(reason, tuple(values)) for reason, values in json.loads(record[40 + 17 * n :])]

    def append(self, key: bytes, batch: Batch, failures: list[Failure]) -> None:
        """Write what a batch came to."""
        failed = json.dumps([[failure.reason, failure.values] for failure in failures]).encode()
        record = key + struct.pack("<q", len(batch.costs)) + batch.costs.astype("<f8").tobytes()
        record += batch.steps.astype("<i8").tobytes() + batch.failed.astype(np.uint8).tobytes() + failed
        self._pending.append(FRAME.pack(len(record), zlib.crc32(record)) + record)
        now = time.monotonic()
        if self._file is None and now - self._began < self._after:
            return
        try:
            if self._file is None:
                self._file = self._opened()
            self._file.write(b"".join(self._pending))
            self._file.flush()
            if now - self._flushed > FLUSH:
                os.fsync(self._file.fileno())
                self._flushed = now
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written ({error.strerror or error}); make room") from error
        self._pending.clear()

    def remove(self) -> None:
        """Remove the file: the search is done."""
        self.close()
        self.path.unlink(missing_ok=True)

    def close(self) -> None:
        """Close the file; it stays, for another time."""
        if self._file is not None:
            with contextlib.suppress(OSError):
                self._file.close()
            self._file = None

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _read(self) -> tuple[list[tuple[int, bytes]], int]:
        """Return the records that are whole, with where they begin, and where the last one ends."""
        try:
            content = self.path.read_bytes()
        except FileNotFoundError:
            if not self.path.parent.is_dir():  # said now, not once the search has taken long
                raise InputError(f"{self.path}: there is no folder {self.path.parent}; make it first") from None
            return [], 0
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read ({error.strerror or error}); give another file") from error
        if content and not content.startswith(MAGIC[: len(content)]):
            raise InputError(f"{self.path} is no checkpoint of a search; give the name of a new file")
        if not content.startswith(self._head):
            return [], 0
        records, at = [], len(self._head)
        while at + FRAME.size <= len(content):
            length, crc = FRAME.unpack_from(content, at)
            record = content[at + FRAME.size : at + FRAME.size + length]
            if len(record) < length or zlib.crc32(record) != crc:
                break
            records.append((at, record))
            at += FRAME.size + length
        return records, at

    def _opened(self) -> IO[bytes]:
        if self._end == 0:
            file: IO[bytes] = open(self.path, "wb")  # noqa: SIM115 - held until closed
            file.write(self._head)
        else:
            file = open(self.path, "r+b")  # noqa: SIM115
            file.truncate(self._end)
            file.seek(self._end)
        return file


class JournalledWorkers(Workers):
    """Workers that ask the journal first, where there is one.

    Trajectories are not journalled: few are asked for, and they are long.
    """

    def __init__(self, count: int, *, journal: Journal | None = None, inside: bool = False) -> None:
        super().__init__(count, inside=inside)
        self.journal = journal

    def __enter__(self) -> JournalledWorkers:
        return self

    def run(
        self, values: FloatArray, *, bounds: FloatArray | None = None, refine: int = 1, record: bool = False
    ) -> Batch:
        """Simulate candidates, or recall what they came to; see `Workers.run`."""
        journal = self.journal
        if journal is None or record:
            return super().run(values, bounds=bounds, refine=refine, record=record)
        asked = hashlib.sha256(np.ascontiguousarray(values).tobytes())
        asked.update(repr((values.shape, refine, bounds is None)).encode())
        if bounds is not None:
            asked.update(np.ascontiguousarray(bounds, dtype=np.float64).tobytes())
        batch = journal.recall(asked.digest())
        if batch is not None:
            self.simulations += len(batch.costs)
            self.steps += int(batch.steps.sum())
            self.failed += int(batch.failed.sum())
            self.failures += journal.recalled_failures()
            return batch
        before = len(self.failures)
        batch = super().run(values, bounds=bounds, refine=refine)
        journal.append(asked.digest(), batch, self.failures[before:])
        return batch
