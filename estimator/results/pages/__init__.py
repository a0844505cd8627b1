"""Pages as Jinja templates with their style and script, all in one file that needs nothing else. Knows no estimate."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment

FOLDER = Path(__file__).parent


def page(name: str, **values: Any) -> str:
    """Return a template filled with values; texts are escaped, what is `drawn` is not."""
    return _environment().get_template(name).render(**values)


def asset(name: str) -> str:
    """Return a style or a script as it is, to stand inside a page."""
    return drawn((FOLDER / name).read_text(encoding="utf-8"))


def drawn(markup: str) -> str:
    """Return markup that is safe as it is: drawings of svg.py, styles, scripts."""
    from markupsafe import Markup

    return Markup(markup)


@functools.cache
def _environment() -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    return Environment(
        loader=FileSystemLoader(FOLDER),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
