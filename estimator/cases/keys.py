"""Keys of a case file, each described once, for reader, writer, schema and documentation. Knows no case.

A table of the file is a `Keys`: name → `Key`. A key knows how its value is read and checked (by `strict_toml.Table`,
whose errors name file and line), how it is written, and what a JSON Schema says of it. Defaults are those of the
dataclass that holds the values.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields, replace
from typing import Any, Literal

from estimator.cases.strict_toml import Cell, Table

FREE: Literal["free"] = "free"
Value = float | Literal["free"] | None
CELL = {"type": "string", "pattern": r"^\{[^{}]*\}$", "description": "a column of the table of motors"}
TEXT = {"type": "string", "pattern": r"\S"}


@dataclass(frozen=True)
class Key:
    """One key of a table.

    Attributes
    ----------
    read : (table, key) → value, checked
    schema : what a JSON Schema says of the value
    write : value → plain data that reads back the same
    field : attribute that holds the value; "": the key's own name
    required : there is no default
    """

    read: Callable[[Table, str], Any]
    schema: Mapping[str, Any]
    write: Callable[[Any], Any] = lambda value: value
    field: str = ""
    required: bool = False

    def in_field(self, name: str) -> Key:
        """Return the key for an attribute of another name."""
        return replace(self, field=name)


class Keys(dict[str, Key]):
    """The keys of one table, and the dataclass that holds their values, if one does."""

    def __init__(self, holder: type[Any] | None = None, /, **keys: Key) -> None:
        """Take the keys in the order in which messages list them and files are written."""
        super().__init__(keys)
        self.usual = {} if holder is None else _defaults(holder)

    def read(self, table: Table) -> dict[str, Any]:
        """Return field → value for the keys that a table has, and for those that it must have."""
        present = {name: key for name, key in self.items() if key.required or name in table.value}
        return {key.field or name: key.read(table, name) for name, key in present.items()}

    def checked(self, table: Table) -> dict[str, Any]:
        """Read a table that may have no other keys."""
        table.only(*self)
        return self.read(table)

    def write(self, holder: Any, *, always: tuple[str, ...] = ()) -> dict[str, Any]:
        """Return the values that are not as by default, as plain data; `always`: these even so."""
        values = {name: getattr(holder, key.field or name) for name, key in self.items()}
        return {
            name: self[name].write(value)
            for name, value in values.items()
            if name in always or value != self.usual.get(self[name].field or name)
        }

    def schema(self) -> dict[str, Any]:
        """Return the table as a JSON Schema."""
        properties = {name: dict(key.schema) for name, key in self.items()}
        for name, key in self.items():
            usual = self.usual.get(key.field or name)
            if isinstance(usual, (bool, int, float)) or (isinstance(usual, str) and usual):
                properties[name]["default"] = usual
        required = [name for name, key in self.items() if key.required]
        made = {"type": "object", "properties": properties, "additionalProperties": False}
        return {**made, "required": required} if required else made


def number(about: str, *, above: float | None = None, below: float | None = None) -> Key:
    """Return the key of a finite number between two limits."""
    limits = {"exclusiveMinimum": above, "exclusiveMaximum": below}
    kind = {"type": "number", **{k: v for k, v in limits.items() if v is not None}}
    return Key(
        lambda table, key: table.number(key, above=above, below=below), {"anyOf": [kind, CELL], "description": about}
    )


def whole(about: str, *, minimum: int, maximum: int | None = None) -> Key:
    """Return the key of a whole number within limits, both included."""
    limits = {"minimum": minimum, "maximum": maximum}
    kind = {"type": "integer", **{k: v for k, v in limits.items() if v is not None}}
    return Key(
        lambda table, key: table.integer(key, minimum=minimum, maximum=maximum),
        {"anyOf": [kind, CELL], "description": about},
    )


def text(about: str = "", *, required: bool = False) -> Key:
    """Return the key of a text that is not blank."""
    return Key(
        lambda table, key: table.text(key), {**TEXT, **({"description": about} if about else {})}, required=required
    )


def choice(known: tuple[str, ...], about: str = "") -> Key:
    """Return the key of one of the known texts."""
    described = {"description": about} if about else {}
    return Key(lambda table, key: table.choice(key, known, default=known[0]), {"enum": list(known), **described})


def flag(about: str) -> Key:
    """Return the key of true or false."""
    return Key(lambda table, key: table.flag(key), {"type": "boolean", "description": about})


def value(about: str, *, never: float | None = None) -> Key:
    """Return the key of a number (held) or "free" (estimated); not given: found in the data where it shows.

    `never` is the number that makes no sense.
    """
    limits = {} if never is None else {"not": {"const": never}}

    def read(table: Table, key: str) -> Value:
        given = table.value[key]
        if isinstance(given, str) and given != FREE and not isinstance(given, Cell):
            table.fail((key,), f'{table.full(key)} must be a number, or "free" to estimate it')
        if given == FREE:
            return FREE
        number = table.number(key)
        if number == never:
            table.fail((key,), f"{table.full(key)} is {number:g}, which leaves nothing; give another number")
        return number

    return Key(
        read,
        {
            "anyOf": [{"type": "number", **limits}, {"const": FREE}, CELL],
            "description": f'{about}: a number (held), "free" (estimated); default: by the data',
        },
    )


def named(entry: Key, about: str) -> Key:
    """Return the key of a table whose keys are names, each with the same kind of value."""

    def read(table: Table, key: str) -> dict[str, Any]:
        inner = table.table(key)
        return {name: entry.read(inner, name) for name in inner.keys}

    return Key(
        read,
        map_of(entry.schema, about),
        lambda values: {name: entry.write(item) for name, item in values.items()},
    )


def map_of(entry: Mapping[str, Any], about: str) -> dict[str, Any]:
    """Return the schema of a table whose keys are names."""
    return {"type": "object", "additionalProperties": dict(entry), "description": about}


def _defaults(holder: type[Any]) -> dict[str, Any]:
    found = {}
    for f in fields(holder):
        made = f.default_factory
        found[f.name] = f.default if made is MISSING else made()
    return {name: default for name, default in found.items() if default is not MISSING}
