"""The folder of a batch on disk: one folder a case, there whole or not at all. Knows no search and no FMU.

    index.html results.csv timings.csv …       written at the end, from what lies in cases/
    cases/NAME/outcome.json                     the case's row, its timing, and a digest of what went in
    cases/NAME/result.json …                    the case's result files
    journals/NAME.journal                       a long search under way (checkpoint.py)

A case's folder is filled under another name, flushed to the disk, and then renamed: after a kill, a power cut or on a
full disk it is complete or absent.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import secrets
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import IO
from urllib.parse import quote

from estimator.batches.case_worker import FAILED, Outcome
from estimator.errors import EstimatorError, InputError
from estimator.fmus.run_folder import try_lock

OUTCOME = "outcome.json"
LOCK = ".batch.lock"
UNFINISHED = ".unfinished-"
LONGEST = 120  # characters of a case's folder name


class DiskError(EstimatorError):
    """The batch's folder cannot be written any more: the disk is full, or the folder is gone."""


class BatchFolder:
    """The folder of one batch, locked while it is used. Use as a context manager.

    Parameters
    ----------
    path : path
        Made if it is not there.
    resume : bool
        Go on with the batch that is there already; otherwise it is an error that one is.

    Raises
    ------
    InputError
        It cannot be written, holds another batch, or another process works in it.
    """

    def __init__(self, path: Path, *, resume: bool) -> None:
        self.path = path
        self.cases, self.journals = path / "cases", path / "journals"
        if path.exists() and not path.is_dir():
            raise InputError(f"{path} is a file, not a folder; give -o another name")
        if not resume and self.cases.is_dir() and any(self.cases.iterdir()):
            raise InputError(f"{path} already holds a batch; go on with --resume, or give -o another folder")
        try:
            self.cases.mkdir(parents=True, exist_ok=True)
            self.journals.mkdir(exist_ok=True)
            self._lock: IO[str] = open(path / LOCK, "w")  # noqa: SIM115 - held for life
        except OSError as error:
            raise InputError(
                f"{path}: cannot write there ({error.strerror or error}); give -o a folder of yours"
            ) from error
        if not try_lock(self._lock):
            self._lock.close()
            raise InputError(f"another batch is at work in {path}; wait for it, or give -o another folder")
        for rest in self.cases.glob(UNFINISHED + "*"):
            shutil.rmtree(rest, ignore_errors=True)

    def kept(self, name: str, *, digest: str) -> Outcome | None:
        """Return the outcome of a case that is on disk, from the same case, recordings and FMU."""
        try:
            found = json.loads((self.cases / folder_name(name) / OUTCOME).read_bytes())
            if found["digest"] == digest and found["row"]["case"] == name:
                return Outcome(found["row"], timing=found["timing"])
        except (OSError, ValueError, KeyError, TypeError):
            pass
        return None

    def has_report(self, name: str, outcome: Outcome) -> bool:
        """Return whether a case that is on disk has a report, or can have none."""
        return outcome.row["verdict"] == FAILED or (self.case(name) / "report.html").exists()

    def all_kept(self) -> dict[str, tuple[Outcome, str]]:
        """Return all outcomes that are on disk, case → outcome and digest; what is damaged is left out."""
        found = {}
        for file in sorted(self.cases.glob(f"*/{OUTCOME}")):
            with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
                about = json.loads(file.read_bytes())
                outcome = Outcome(about["row"], timing=about["timing"])
                found[str(outcome.row["case"])] = (outcome, str(about["digest"]))
        return found

    def keep(self, name: str, outcome: Outcome, *, digest: str) -> None:
        """Put a case's outcome on disk, whole or not at all.

        Raises
        ------
        DiskError
            The disk is full, or cannot be written for another reason.
        """
        place = self.cases / folder_name(name)
        unfinished = self.cases / f"{UNFINISHED}{secrets.token_hex(6)}"
        about = {"digest": digest, "row": outcome.row, "timing": outcome.timing}
        files = {**outcome.files, OUTCOME: (json.dumps(about, allow_nan=False) + "\n").encode()}
        try:
            unfinished.mkdir()
            for file, content in files.items():
                _write(unfinished / file, content)
            _flush_folder(unfinished)
            if place.exists():
                shutil.rmtree(place)
            os.rename(unfinished, place)
            _flush_folder(self.cases)
        except OSError as error:
            raise _disk_error(self.path, error) from error
        finally:
            if unfinished.exists():
                shutil.rmtree(unfinished, ignore_errors=True)

    def links(self, names: Iterable[str]) -> dict[str, str]:
        """Return, for each case that has one, its report or else its result, relative to the batch's folder."""
        found = {}
        for name in names:
            folder = folder_name(name)
            for file in ("report.html", "result.json"):
                if (self.cases / folder / file).exists():
                    found[name] = f"cases/{quote(folder)}/{file}"
                    break
        return found

    def case(self, name: str) -> Path:
        """Return the folder of a case."""
        return self.cases / folder_name(name)

    def journal(self, name: str) -> Path:
        """Return where the search of a case is journalled while it is under way."""
        return self.journals / f"{folder_name(name)}.journal"

    def write(self, files: Mapping[str, bytes]) -> None:
        """Write files beside the cases, each whole or not at all.

        Raises
        ------
        DiskError
            As `keep`.
        """
        for name, content in files.items():
            temporary = self.path / f".{name}.{secrets.token_hex(4)}.tmp"
            try:
                _write(temporary, content)
                os.replace(temporary, self.path / name)
            except OSError as error:
                raise _disk_error(self.path, error) from error
            finally:
                with contextlib.suppress(OSError):
                    temporary.unlink(missing_ok=True)

    def close(self) -> None:
        """Let others work in the folder; remove it if nothing came of it."""
        with contextlib.suppress(OSError):
            self.journals.rmdir()  # if no search was cut off
        with contextlib.suppress(OSError):
            self.cases.rmdir()
            (self.path / LOCK).unlink()  # otherwise it stays: two could hold it if it came and went
        self._lock.close()
        with contextlib.suppress(OSError):
            self.path.rmdir()

    def __enter__(self) -> BatchFolder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def folder_name(name: str) -> str:
    """Return a case's folder: its name as far as every file system takes it, and different for different cases."""
    safe = re.sub(r"[^\w.,+=@\[\]-]", "_", name, flags=re.ASCII).strip(".")[:LONGEST]
    if safe == name:
        return safe
    return f"{safe}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"


def _write(path: Path, content: bytes) -> None:
    with open(path, "xb") as stream:
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())


def _flush_folder(path: Path) -> None:
    """Put a folder's names on the disk; not every system knows how."""
    with contextlib.suppress(OSError):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _disk_error(path: Path, error: OSError) -> DiskError:
    return DiskError(f"{path}: cannot be written ({error.strerror or error}); make room, then go on with --resume")
