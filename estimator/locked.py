"""Data that stays as it was made, and travels to other processes all the same. Knows no field by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from types import MappingProxyType
from typing import Any


class Locked:
    """A frozen dataclass whose mappings are copied when it is made, and read-only after."""

    def __post_init__(self) -> None:
        """Lock the mappings."""
        for name, value in _values(self).items():
            if isinstance(value, Mapping):
                object.__setattr__(self, name, MappingProxyType(dict(value)))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle with plain dictionaries: a read-only view cannot be pickled."""
        values = _values(self).values()
        return type(self), tuple(dict(v) if isinstance(v, MappingProxyType) else v for v in values)


def _values(data: Any) -> dict[str, Any]:
    return {f.name: getattr(data, f.name) for f in fields(data)}
