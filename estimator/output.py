"""A folder for results, and files that are complete or not there at all. Knows nothing of their content."""

from __future__ import annotations

import contextlib
import os
import secrets
import signal
import tempfile
import threading
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from estimator.errors import InputError


class OutputFolder:
    """A folder for results, made on entering a ``with`` statement and removed again if nothing came of it.

    Parameters
    ----------
    path : path
        It may exist; files of the same names are replaced, others are left alone.
    own : names
        If given, the folder must not hold any other file: it is not a folder of ours.
    """

    def __init__(self, path: str | os.PathLike[str], *, own: Iterable[str] | None = None) -> None:
        self.path = Path(path)
        self._own = None if own is None else set(own)
        self._made: list[Path] = []
        self._lock: int | None = None

    def __enter__(self) -> OutputFolder:
        """Make the folder and see that it can be written, before any time is spent on results.

        Raises
        ------
        InputError
            It cannot be made or written, holds other files, or another run is at work in it.
        """
        if self.path.exists() and not self.path.is_dir():
            raise InputError(f"{self.path} is a file, not a folder; give -o another name")
        try:
            self._make()
            try:
                self._lock = _locked(self.path)  # first: what another run tries there is no file of the folder
            except InputError:
                self._made.clear()  # it is the other run's now, empty as it may be
                raise
            with tempfile.TemporaryFile(dir=self.path):
                pass
            found = {entry.name for entry in self.path.iterdir()}
            if self._own is not None and found - self._own:
                other = sorted(found - self._own)[0]
                raise InputError(f"{self.path} already holds other files ({other}); give -o an empty or a new folder")
        except OSError as error:
            self.__exit__()
            raise InputError(
                f"{self.path}: cannot write there ({error.strerror or error}); give -o a folder of yours"
            ) from error
        except BaseException:  # also Ctrl-C: nobody leaves what was not entered
            self.__exit__()
            raise
        return self

    def __exit__(self, *exception: object) -> None:
        """Remove the folder if it was made here and is still empty."""
        with _at_once(), contextlib.suppress(OSError):
            for folder in self._made:
                folder.rmdir()
        self._unlock()

    def write(self, files: Mapping[str, bytes], *, stale: Iterable[str] = ()) -> None:
        """Write files, all or none, and remove those names of `stale` that are not among them.

        Raises
        ------
        InputError
            The disk is full, or the folder went away.
        """
        write_files({self.path / name: content for name, content in files.items()})
        for name in set(stale) - set(files):
            (self.path / name).unlink(missing_ok=True)

    def _make(self) -> None:
        missing = [folder for folder in (self.path, *self.path.parents) if not folder.exists()]
        with _at_once():
            for folder in reversed(missing):
                if _made(folder):
                    self._made.insert(0, folder)

    def _unlock(self) -> None:
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


@contextlib.contextmanager
def _at_once() -> Iterator[None]:
    """Let Ctrl-C wait for what stands in the ``with`` statement, so that nothing of it is half done."""
    handler = signal.getsignal(signal.SIGINT)
    if not callable(handler) or threading.current_thread() is not threading.main_thread():
        yield  # it is ignored, ends the process at once, or is told to another thread
        return
    came: list[int] = []
    signal.signal(signal.SIGINT, lambda number, frame: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
        if came:
            handler(came[0], None)


def _made(folder: Path) -> bool:
    """Make a folder; return whether it was made here and not, since it was looked for, by another run."""
    try:
        folder.mkdir()
    except FileExistsError:
        if folder.is_dir():
            return False
        raise
    return True


def _locked(folder: Path) -> int | None:
    """Lock a folder for one run; return what to close, or None where folders cannot be locked.

    Raises
    ------
    InputError
        Another run has it.
    """
    try:
        import fcntl
    except ImportError:  # Windows
        return None
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise InputError(f"another run is at work in {folder}; wait for its end, or give -o another folder") from None
    except OSError:  # some folders of a network
        os.close(descriptor)
        return None
    return descriptor


def check_not_read(path: Path, read: Iterable[str | os.PathLike[str]], *, option: str) -> None:
    """Refuse to write a file over one that is read.

    Raises
    ------
    InputError
        They are the same.
    """
    if path.exists() and any(Path(other).exists() and path.samefile(other) for other in read):
        raise InputError(f"{path} is what is read; give {option} another name")


def write_files(files: Mapping[Path, bytes]) -> None:
    """Write files under temporary names beside their places; only when all are complete they get their names.

    Raises
    ------
    InputError
        Some file cannot be written; then none is changed.
    """
    token = secrets.token_hex(4)
    temporary: dict[Path, Path] = {}  # the place → the temporary name
    path = Path()
    try:
        for path, content in files.items():
            place = path.resolve()  # a link stays a link
            if place.is_dir():
                raise InputError(f"{path} is a folder; give the name of a file")
            if place.exists() and not place.is_file():  # a device or a pipe
                place.write_bytes(content)
                continue
            temporary[place] = place.with_name(f".{place.name}.{token}.tmp")
            with open(temporary[place], "xb") as stream:
                stream.write(content)
        with _at_once():
            for path, name in temporary.items():
                os.replace(name, path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error}); give another place") from error
    finally:
        for name in temporary.values():
            with contextlib.suppress(OSError):
                name.unlink(missing_ok=True)
