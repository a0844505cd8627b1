"""Values of a request as they must be: objects, texts, names, numbers; else InputError. Knows no request."""

from __future__ import annotations

import json
from typing import Any

from estimator.errors import InputError


def object_of(body: Any) -> dict[str, Any]:
    """Return what must be an object."""
    if not isinstance(body, dict):
        raise InputError("the request must be an object")
    return body


def text_of(body: Any, key: str) -> str:
    """Return what an object must have as a text."""
    text = object_of(body).get(key)
    if not isinstance(text, str) or not text:
        raise InputError(f"the request must have a text {key!r}")
    return text


def names_of(text: str) -> list[str]:
    """Return names that JSON lists."""
    names = json.loads(text)
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InputError("names must be a list of texts")
    return names


def number_of(value: Any) -> float:
    """Return what must be a finite number."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise InputError(f"{value!r} is no number; give one, such as 0.5") from None
    if number - number != 0:
        raise InputError(f"{value!r} is no finite number; give one, such as 0.5")
    return number
