"""Values that a Python program gives, checked as the command line checks its own. Knows no case."""

from __future__ import annotations

import math
import numbers
import os
from collections.abc import Mapping
from typing import Any

from estimator.errors import InputError, is_sized


def number(name: str, value: Any, *, above: float = -math.inf, below: float = math.inf) -> float:
    """Return a finite number between two others.

    Raises
    ------
    InputError
        It is none; so of the other functions.
    """
    if isinstance(value, bool) or not isinstance(value, numbers.Real) or not _is_between(value, above, below):
        least = f" above {above:g}" if above > -math.inf else ""
        most = f" and below {below:g}" if below < math.inf else ""
        raise InputError(f"{name}={value!r} is no finite number{least}{most}")
    return float(value)


def _is_between(value: numbers.Real, least: float, most: float) -> bool:
    try:
        return least < float(value) < most and is_sized(float(value))
    except OverflowError:
        return False


def count(name: str, value: Any, *, least: int) -> int:
    """Return a whole number."""
    if isinstance(value, bool) or not isinstance(value, numbers.Integral) or value < least:
        raise InputError(f"{name}={value!r} is not a whole number of at least {least}")
    return int(value)


def named_numbers(name: str, values: Any) -> tuple[tuple[str, float], ...]:
    """Return a mapping of names to numbers as pairs."""
    if not isinstance(values or {}, Mapping):
        raise InputError(f"{name}={values!r} is no mapping of names to numbers")
    return tuple((key, number(f"{name}[{key!r}]", value)) for key, value in (values or {}).items())


def interval(name: str, ends: Any) -> tuple[float, float]:
    """Return a lower and an upper end."""
    try:
        low, high = ends
    except (TypeError, ValueError):
        raise InputError(f"{name}={ends!r} is no pair of numbers, such as (0.4, 2.0)") from None
    low, high = number(name, low), number(name, high)
    if not low < high:
        raise InputError(f"{name}={ends!r} ends before it begins; give the lower end first")
    return low, high


def named_intervals(name: str, values: Any) -> tuple[tuple[str, tuple[float, float]], ...]:
    """Return a mapping of names to lower and upper ends as pairs."""
    if not isinstance(values or {}, Mapping):
        raise InputError(f"{name}={values!r} is no mapping of names to pairs of numbers")
    return tuple((key, interval(f"{name}[{key!r}]", ends)) for key, ends in (values or {}).items())


def listed(given: Any) -> list[Any]:
    """Return a list of paths or mappings; one alone is a list of it."""
    return [given] if isinstance(given, (str, os.PathLike, Mapping)) else list(given)
