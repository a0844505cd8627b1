"""TOML read strictly: every check names file, line and key. Knows no case.

``Table`` is one table with its checks; ``to_toml`` writes a value so that it reads back the same.
"""

from __future__ import annotations

import glob
import json
import math
import os
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from estimator.errors import SIZES, CaseError, is_sized, is_text, suggestion

CASE_SUFFIX = ".case.toml"  # ends the name of every such file
Way = tuple[str | int, ...]  # the way to a value: ("parameters", "R", "min"), ("recording", 0, "file")


class Cell(str):
    """A cell of a table that was filled into the document: a text that may also be a number.

    Attributes
    ----------
    number : the text, with a decimal point where the table has decimal commas
    """

    number: str

    def __new__(cls, text: str, decimal: str = ".") -> Cell:
        """Make a cell of a table whose numbers have this decimal mark, or a point."""
        cell = super().__new__(cls, text)
        has_comma = decimal == "," and re.fullmatch(r"[-+]?\d+,\d+([eE][-+]?\d+)?(\s*%)?", text, re.ASCII)
        cell.number = text.replace(",", ".") if has_comma else text
        return cell


@dataclass(frozen=True)
class Table:
    """One table of the document, with its checks."""

    document: Document
    way: Way
    value: dict[str, Any]

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys, in the order of the file."""
        return tuple(self.value)

    @property
    def title(self) -> str:
        """What messages call the table: ``parameters.R``."""
        return ".".join(str(key) for key in self.way if isinstance(key, str)) or "the file"

    def fail(self, keys: Way, sentence: str) -> NoReturn:
        """Raise a CaseError that names file and line of a key below this table."""
        self.document.fail((*self.way, *keys), sentence)

    def only(self, *known: str) -> None:
        """Refuse any other key."""
        for key in self.value:
            if key not in known:
                inside = f" in {self.title}" if self.way else ""
                self.fail((key,), f"there is no key {key!r}{inside}{suggestion(key, known)}")

    def table(self, key: str) -> Table:
        """Return the table below a key, empty if there is none."""
        value = self.value.get(key, {})
        if not isinstance(value, dict):
            self.fail((key,), f"{self.full(key)} must be a table, not {_kind(value)}")
        return Table(self.document, (*self.way, key), value)

    def full(self, key: str) -> str:
        """Return what messages call a key: ``parameters.R.min``."""
        return f"{self.title}.{key}" if self.way else key

    def number(self, key: str, *, above: float | None = None, below: float | None = None) -> float | None:
        """Return a number of a usual size, or None if the key is not there; true and false are no numbers."""
        value = _number_of(self.value.get(key))
        if value is None:
            return None
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            self.fail((key,), f"{self.full(key)} must be a number, not {_kind(value)}")
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            self.fail((key,), f"{self.full(key)} must be a finite number, not {number}")
        if not is_sized(number):
            self.fail((key,), f"{self.full(key)} must be {SIZES}, not {number:g}")
        if above is not None and number <= above:
            self.fail((key,), f"{self.full(key)} must be above {above:g}, not {number:g}")
        if below is not None and number >= below:
            self.fail((key,), f"{self.full(key)} must be below {below:g}, not {number:g}")
        return number

    def required_number(self, key: str, *, above: float | None = None) -> float:
        """Return a finite number."""
        number = self.number(key, above=above)
        if number is None:
            self.fail((), f"{self.title} has no {key}; add {key} = …")
        return number

    def integer(self, key: str, *, minimum: int, maximum: int | None = None, default: int | None = None) -> int | None:
        """Return a whole number within limits, or None if there is neither it nor a default."""
        value = _number_of(self.value.get(key, default))
        if value is None:
            return None
        if isinstance(value, bool) or not isinstance(value, int):
            self.fail((key,), f"{self.full(key)} must be a whole number, not {_kind(value)}")
        if value < minimum or (maximum is not None and value > maximum):
            span = f"at least {minimum}" if maximum is None else f"{minimum} to {maximum}"
            self.fail((key,), f"{self.full(key)} must be {span}, not {value}")
        return value

    def flag(self, key: str) -> bool:
        """Return true or false."""
        value = self.value[key]
        if not isinstance(value, bool):
            self.fail((key,), f"{self.full(key)} must be true or false")
        return value

    def text(self, key: str, *, default: str | None = None, expected: str = "a text in quotes") -> str:
        """Return a text that is not blank."""
        value = self.value.get(key, default)
        if value is None:
            self.fail((), f'{self.title} has no {key}; add {key} = "…"')
        if not isinstance(value, str):
            self.fail((key,), f"{self.full(key)} must be {expected}, not {_kind(value)}")
        if not value.strip():
            self.fail((key,), f"{self.full(key)} is empty; it should be {expected}")
        return value

    def texts(self, key: str) -> tuple[str, ...]:
        """Return one or more names."""
        value = self.value[key]
        texts = value if isinstance(value, list) else [value]
        if not texts or not all(isinstance(text, str) and text.strip() for text in texts):
            self.fail((key,), f'{self.full(key)} must be a name such as "Ke", or names such as ["Ke", "Km"]')
        return tuple(texts)

    def choice(self, key: str, known: tuple[str, ...], *, default: str) -> str:
        """Return one of the known texts."""
        value = self.text(key, default=default)
        if value not in known:
            self.fail((key,), f"{self.full(key)} cannot be {value!r}{suggestion(value, known)}")
        return value

    def file(self, key: str, *, what: str, folder: Path | None = None) -> Path:
        """Return an existing file as an absolute path; relative ones start in the document's folder.

        With a `folder`, the file is looked for there, whatever folder the document names.
        """
        text = self.text(key)
        base, inside = self._place(text, folder)
        file = Path(os.path.abspath(base / inside)) if "\0" not in text else None
        if file is None or not file.exists():
            self.fail((key,), f"there is no {what} {text!r}{_where(folder)}")
        if not file.is_file():
            self.fail((key,), f"the {what} {text!r} is not a file; give a file's path")
        return file

    def files(self, key: str, *, what: str, folder: Path | None = None) -> tuple[Path, ...]:
        """Return the files that a pattern such as ``motor_*.csv`` means, sorted by name; at least one."""
        files = self._matching(self.text(key), folder)
        if not files:
            self.fail((key,), f"no {what} matches {self.text(key)!r}{_where(folder)}")
        return files

    def has_files(self, key: str, *, folder: Path | None = None) -> bool:
        """Whether the file that a text names is there, or one that matches it."""
        text = self.text(key)
        base, inside = self._place(text, folder)
        return "\0" not in text and ((base / inside).exists() or bool(self._matching(text, folder)))

    def is_pattern(self, key: str, *, folder: Path | None = None) -> bool:
        """Whether a text is a pattern of file names and not a file's own name."""
        text = self.text(key)
        base, inside = self._place(text, folder)
        return glob.has_magic(text) and not ("\0" not in text and (base / inside).exists())

    def _matching(self, text: str, folder: Path | None) -> tuple[Path, ...]:
        base, inside = self._place(text, folder)
        found = [base / name for name in glob.glob(inside, root_dir=base, recursive=True)] if "\0" not in text else []
        files = {Path(os.path.abspath(path)) for path in found if path.is_file()}
        for path in files:
            if not is_text(path.name):
                raise CaseError(f"{self.document.path.name}: {path.name!r} has a name that is no UTF-8 text; rename it")
        return tuple(sorted(files, key=lambda path: path.as_posix()))

    def _place(self, text: str, folder: Path | None) -> tuple[Path, str]:
        if folder is None:
            return self.document.path.parent, text
        return folder, os.path.basename(text) if os.path.isabs(text) or ".." in Path(text).parts else text


class Document:
    """The file's text and content; finds the line of a key."""

    row = ""  # the row of a table whose cells were filled in, for messages

    def __init__(self, path: Path) -> None:
        """Read the file."""
        self.path = path
        try:
            data = path.read_bytes()
        except FileNotFoundError:
            raise CaseError(f"there is no case file {path}; give the path of a {CASE_SUFFIX} file") from None
        except IsADirectoryError:
            raise CaseError(f"{path} is a folder; give a {CASE_SUFFIX} file") from None
        except OSError as error:
            raise CaseError(f"{path} cannot be read ({error.strerror or error}); make it readable") from None
        try:
            self.text = data.decode("utf-8-sig").replace("\r\n", "\n")
        except UnicodeDecodeError as error:
            line = data.count(b"\n", 0, error.start) + 1
            raise CaseError(f"{path.name} line {line} is not UTF-8 text; save the case file as UTF-8") from None
        try:
            self.content = tomllib.loads(self.text)
        except (ValueError, RecursionError) as error:
            raise CaseError(self._syntax(error)) from None

    def table(self) -> Table:
        """Return the top table."""
        return Table(self, (), self.content)

    def fail(self, keys: Way, sentence: str) -> NoReturn:
        """Raise a CaseError that names the file, and the line of a key."""
        line = self.line(keys) if keys else None
        row = f" ({self.row})" if self.row else ""
        raise CaseError(f"{self.path.name}{f' line {line}' if line else ''}{row}: {sentence}")

    def filled(self, cells: Mapping[str, str], *, row: str, decimal: str = ".") -> Document:
        """Return the document with every ``{column}`` in its texts replaced by that column's cell.

        A key whose whole text is one empty cell is left out. ``decimal`` is what numbers may have for a point.

        Raises
        ------
        CaseError
            A text names a column that the table does not have.
        """
        filled: Document = object.__new__(Document)
        filled.path, filled.text, filled.row = self.path, self.text, row
        filled.content = {key: value for key, value in self.content.items() if key == "motors"}
        for key, value in self.content.items():
            if key != "motors" and (new := self._filled(value, cells, (key,), decimal)) is not None:
                filled.content[key] = new
        return filled

    def _filled(self, value: Any, cells: Mapping[str, str], way: Way, decimal: str) -> Any:
        if isinstance(value, dict):
            items = {key: self._filled(item, cells, (*way, key), decimal) for key, item in value.items()}
            return {key: item for key, item in items.items() if item is not None}
        if isinstance(value, list):
            items_ = [self._filled(item, cells, (*way, k), decimal) for k, item in enumerate(value)]
            return [item for item in items_ if item is not None]
        if not isinstance(value, str):
            return value

        def cell(match: re.Match[str]) -> str:
            name = match[1].strip()
            if name not in cells:
                self.fail(way, f"the table of motors has no column {name!r}{suggestion(name, cells)}")
            return cells[name]

        text = re.sub(r"\{([^{}]*)\}", cell, value)
        if text != value and re.fullmatch(r"\{[^{}]*\}", value):
            return Cell(text, decimal) if text else None
        return text

    def _syntax(self, error: Exception) -> str:
        words = re.sub(r"\s*\(at [^)]*\)$", "", str(error)) or "nested too deeply"
        at = re.search(r"\(at line (\d+), column \d+\)", str(error))
        line = int(at[1]) if at else self.text.rstrip().count("\n") + 1
        words = re.sub(r"\('.*',?\)", lambda key: ".".join(re.findall(r"'([^']*)'", key[0])), words)  # ('a', 'b')
        if "overwrite" in words:
            words = f"{words}: is it given twice?"
        is_named = self.path.suffix.lower() == ".toml"
        remedy = "" if is_named else f"; a case file is meant, whose name ends in {CASE_SUFFIX}"
        return f"{self.path.name} line {line} is not valid TOML: {words[:1].lower()}{words[1:]}{remedy}"

    def line(self, keys: Way) -> int | None:
        """Return the line that says most of the way to a key: the key, else its inline table, else [its table]."""
        best, best_depth = None, 0
        head: Way = ()
        counts: dict[Way, int] = {}
        for number, line in enumerate(self.text.split("\n"), start=1):
            if table := re.match(r"\s*(\[\[?)([^\[\]=]+)\]", line):
                head = _dotted(table[2])
                if table[1] == "[[":
                    counts[head] = counts.get(head, -1) + 1
                    head = (*head, counts[head])
                said = head
            elif entry := re.match(r"\s*((?:\"[^\"]*\"|'[^']*'|[\w.\- ])+?)\s*=", line):
                said = (*head, *_dotted(entry[1]))
            else:
                continue
            depth = min(len(said), len(keys))
            if depth > best_depth and said[:depth] == keys[:depth]:
                best, best_depth = number, depth
        return best


def _dotted(text: str) -> Way:
    parts = re.findall(r"\"((?:[^\"\\]|\\.)*)\"|'([^']*)'|([\w\-]+)", text)
    return tuple(_unescaped(basic) or literal or bare for basic, literal, bare in parts)


def _unescaped(text: str) -> str:
    try:
        return str(tomllib.loads(f'text = "{text}"')["text"])
    except tomllib.TOMLDecodeError:
        return text


def _number_of(value: Any) -> Any:
    """Return a cell as the number that it is, anything else as it is."""
    if not isinstance(value, Cell):
        return value
    try:
        return int(value) if re.fullmatch(r"[-+]?\d+", value, re.ASCII) else float(value.number)
    except ValueError:
        return value


def number_in(value: Any) -> float | None:
    """Return the number, of a usual size, that a value of JSON or TOML is; None: it is none."""
    value = _number_of(value)
    is_one = isinstance(value, (int, float)) and not isinstance(value, bool) and is_sized(value)
    return float(value) if is_one else None


def _where(folder: Path | None) -> str:
    return "; paths are relative to the case file's folder" if folder is None else f" in {folder}"


def _kind(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f"the text {value!r}"
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list):
        return "an array"
    return str(value)


def to_key(name: str) -> str:
    """Return a key as TOML, in quotes where it needs them."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else to_toml(name)


def to_toml(value: Any) -> str:
    """Return a value as TOML; None within a table is left out."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        inside = ", ".join(f"{to_key(name)} = {to_toml(item)}" for name, item in value.items() if item is not None)
        return f"{{ {inside} }}" if inside else "{}"
    if isinstance(value, list):
        return f"[{', '.join(to_toml(item) for item in value)}]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(float(value)) if isinstance(value, float) else str(value)
