"""A dictionary of results that answers a name which it does not have. Knows names only."""

from __future__ import annotations

from typing import NoReturn, TypeVar

from estimator.errors import suggestion

V = TypeVar("V")


class Named(dict[str, V]):
    """Name → what was found.

    >>> Named(R=3.1, K=0.05)["Rs"]
    Traceback (most recent call last):
    KeyError: "there is no 'Rs'; did you mean 'R'? (R, K)"
    """

    def __missing__(self, name: str) -> NoReturn:
        """Say which names there are."""
        raise KeyError(f"there is no {name!r}{suggestion(str(name), self)}")
