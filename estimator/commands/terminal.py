"""What the program says, and to whom: stdout, stderr, exit statuses. Knows no command."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import sys
import textwrap

from estimator.estimating.progress import is_terminal

PROGRAM = "fmu-estimator"
ASCII = ("+/-", "-", "...", ".", "x", "->", "<-", "<=", ">=", "Ohm", "u")
SPELLED = dict(zip("±−…·×→←≤≥Ωµ", ASCII, strict=True))
OK, FAILED, BAD_INPUT, INTERRUPTED, CLOSED = 0, 1, 2, 130, 141  # exit statuses


class StdoutClosed(Exception):
    """Whoever read the output has gone, as ``head`` does."""


class StdoutFull(Exception):
    """What is behind stdout takes no more, such as a file on a full disk."""


def say(text: str) -> None:
    """Write text to stdout at once."""
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except BrokenPipeError as error:
        raise StdoutClosed from error
    except OSError as error:
        raise StdoutFull(f"stdout cannot be written ({error.strerror or error}); send it elsewhere") from error


def columns() -> int | None:
    """Return how many characters a line of the terminal has; None where stdout is none."""
    return shutil.get_terminal_size().columns if is_terminal(sys.stdout) else None


def say_lines(text: str) -> None:
    """Write text to stdout; on a terminal, lines that are too long for it are broken, and what follows is indented."""
    width = columns()
    say("\n".join(part for line in text.split("\n") for part in broken(line, width)))


def broken(line: str, width: int | None) -> list[str]:
    """Return a line broken to a terminal's width; what follows is indented under what it belongs to."""
    if width is None or len(line) <= width:
        return [line]
    start = len(line) - len(line.lstrip())
    fact = re.match(r"(?: *- | *[^ ]+(?: [^ ]+)*  +(?=[^ ]))", line)  # an item of a list, or what follows a fact's name
    indent = min(fact.end() if fact else start + 2, width // 2)
    found = textwrap.wrap(
        line[start:], max(width, 20), initial_indent=" " * start, subsequent_indent=" " * indent,
        break_long_words=False, break_on_hyphens=False, drop_whitespace=True, replace_whitespace=False,
    )  # fmt: skip
    return found


def complain(sentence: str) -> None:
    """Write one sentence to stderr."""
    with contextlib.suppress(OSError, ValueError):
        print(f"{PROGRAM}: {' '.join(sentence.split())}", file=sys.stderr)


def give_up_stdout() -> int:
    """Give Python's own flush at exit an open file; return the status."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return CLOSED


def make_printable() -> None:
    """Let a stdout that cannot say ± say +/- instead of failing."""
    encoding = (getattr(sys.stdout, "encoding", None) or "utf-8").lower().replace("-", "")
    if encoding.startswith("utf") or not hasattr(sys.stdout, "reconfigure"):
        return
    import codecs

    def spell(error: UnicodeError) -> tuple[str, int]:
        if not isinstance(error, UnicodeEncodeError):
            raise error
        return "".join(SPELLED.get(c, "?") for c in error.object[error.start : error.end]), error.end

    codecs.register_error("fmu-estimator-spelled", spell)
    sys.stdout.reconfigure(errors="fmu-estimator-spelled")
