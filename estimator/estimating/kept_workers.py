"""Worker processes that stay from one estimation of a program to its next. Knows who may take them, nothing of cases.

A notebook or a script estimates again and again: to start a process takes longer than a short estimation. Those of the
last one wait, with no FMU loaded, until the program ends; after an error, Ctrl-C included, they are ended.
"""

from __future__ import annotations

import atexit
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from estimator.fmus.workers import Workers


@dataclass(frozen=True)
class _Place:
    """What a process takes over from its owner when it starts, and must not differ when it is taken again."""

    count: int
    owner: int
    folder: str
    environment: tuple[tuple[str, str], ...]


_kept: list[tuple[_Place, Workers]] = []  # at most one
_lock = threading.Lock()


@contextmanager
def kept_workers(count: int) -> Iterator[Workers]:
    """Lend the workers that wait, or new ones; they wait again after.

    Parameters
    ----------
    count : int
        Processes at most.
    """
    place = _Place(count, os.getpid(), os.path.abspath(os.curdir), tuple(sorted(os.environ.items())))
    crew = _taken(place) or Workers(count)
    try:
        yield crew
        crew.rest()
    except BaseException:
        crew.close()
        raise
    with _lock:
        ended = [old for _, old in _kept]
        _kept[:] = [(place, crew)]
    for old in ended:  # of another thread, which was quicker
        old.close()


def end_kept_workers() -> None:
    """End the workers that wait."""
    with _lock:
        ended = [old for place, old in _kept if place.owner == os.getpid()]  # those of a parent are not this one's
        _kept.clear()
    for old in ended:
        old.close()


def _taken(place: _Place) -> Workers | None:
    """Return the workers that wait, if they are as new ones would be."""
    with _lock:
        found = [crew for of, crew in _kept if of == place and crew.are_sound()]
        if found:
            _kept.clear()
    if not found:
        end_kept_workers()
    return found[0] if found else None


atexit.register(end_kept_workers)
