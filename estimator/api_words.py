"""Remedies that name options of the command line, in the words of a Python program. Knows sentences only."""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Iterator

from estimator.errors import InputError

_MAPPED = {"column": "columns", "unit": "units", "scale": "scale", "offset": "offset", "fix": "fix", "bounds": "bounds"}
_TEXTS = frozenset({"columns", "units", "motor", "test", "kind", "method"})  # arguments whose values are texts
_SINGLE = ("supply", "counts", "per_turn", "rate", "motor", "test", "kind", "method")
_NAMES = _MAPPED | {name.replace("_", "-"): name for name in _SINGLE}
_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?([eE][-+]?\d+)?")
_VALUE = r"""(?:'(?P<quoted>[^']*)'|(?P<bare>[^\s,;:'")]+(?::[^\s,;:'")]+)?))"""
_PAIR = re.compile(rf"--(?P<option>{'|'.join(_MAPPED)}) (?=\S*=){_VALUE}")
_BESIDE = re.compile(r"(\w+)=\{([^{}]*)\} \1=\{([^{}]*)\}")
_ONE = re.compile(r"--(?P<option>[a-z-]+) (?P<value>\d[\d./]*\d|\d|[A-Z]+\b)")
_CHOICE = re.compile(r"--(?P<option>motor|test|kind|method|supply(?= \S+/)) (?P<value>[^\s,;)]+)")
_BARE = re.compile(r"--(?P<option>[a-z]+(?:-[a-z]+)*)")


@contextlib.contextmanager
def words_of_python() -> Iterator[None]:
    """Let an InputError that comes from inside name arguments, not options."""
    try:
        yield
    except InputError as error:
        error.args = (in_python(str(error)), *error.args[1:])
        raise


def in_python(sentence: str) -> str:
    """Return a sentence with the arguments that its options are: ``--unit w=rpm`` → ``units={"w": "rpm"}``."""
    sentence = _PAIR.sub(_mapping, sentence)
    while (merged := _BESIDE.sub(r"\1={\2, \3}", sentence)) != sentence:
        sentence = merged
    sentence = _CHOICE.sub(_assigned, sentence)
    sentence = _ONE.sub(_assigned, sentence)
    return _BARE.sub(lambda found: _NAMES.get(found["option"], found[0]), sentence)


def _mapping(found: re.Match[str]) -> str:
    name = _MAPPED[found["option"]]
    key, _, value = (found["quoted"] or found["bare"] or "").partition("=")
    low, colon, high = value.partition(":")
    ends = f"({low}, {high})" if colon and name == "bounds" else _written(name, value)
    return f"{name}={{{_text(key)}: {ends}}}"


def _assigned(found: re.Match[str]) -> str:
    name = _NAMES.get(found["option"])
    return found[0] if name is None else f"{name}={_written(name, found['value'])}"


def _written(name: str, value: str) -> str:
    """Return a value as Python has it; a word in capitals stands for a number."""
    is_number = name not in _TEXTS and (_NUMBER.fullmatch(value) or value.isupper())
    return value if is_number else _text(value)


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False)
