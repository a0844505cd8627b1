"""The names of the methods: the program's own, and those that other packages add by entry points. Loads no method.

A package adds a search as docs/add-a-method.md says: by an entry point of the group ``fmu_estimator.searches``, whose
name is the method's and whose object makes an `Optimiser` (estimating/optimiser.py).
"""

from __future__ import annotations

from typing import Any

from estimator.errors import InputError, suggestion

GROUP = "fmu_estimator.searches"
CUCKOO = "cuckoo"
WITHOUT_POLISH = ("paper", "original", "integral", "steiglitz-mcbride", "differential-evolution")  # no standard errors


class _Names(tuple[str, ...]):
    """The program's own names; one that a package adds is among them too, but looked for only where it is asked for."""

    __slots__ = ()

    def __contains__(self, name: object) -> bool:
        return super().__contains__(name) or name in added()


METHODS = _Names((CUCKOO, *WITHOUT_POLISH))


def added() -> tuple[str, ...]:
    """Return the names of the methods that installed packages add."""
    from importlib.metadata import entry_points

    return tuple(sorted({point.name for point in entry_points(group=GROUP)} - set(tuple(METHODS))))


def loaded(name: str) -> Any:
    """Return what a package registered under a name.

    Raises
    ------
    InputError
        There is no such method, or its package cannot be imported.
    """
    from importlib.metadata import entry_points

    for point in entry_points(group=GROUP, name=name):
        try:
            return point.load()
        except Exception as error:  # of somebody else's code: whatever it is, the user reads whose it is
            where = f"{point.value} ({type(error).__name__}: {error})"
            raise InputError(f"the method {name!r} cannot be loaded from {where}; install its package again") from error
    raise InputError(f"there is no method {name!r}{suggestion(name, (*METHODS, *added()))}")
