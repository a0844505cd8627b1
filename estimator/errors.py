"""What can go wrong, by whose hand. Knows only sentences.

``InputError`` is the caller's: a file, a key, an option (exit status 2 on the command line). ``SimulationError``
is the FMU's. Every message is one sentence that names the place and what would be right there.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches

LEAST_SIZE, LARGEST_SIZE = 1e-150, 1e150  # of a number that is given
SIZES = f"0, or of a size from {LEAST_SIZE:g} to {LARGEST_SIZE:g}"


class EstimatorError(Exception):
    """Base of all errors that this package raises on purpose."""


class InputError(EstimatorError, ValueError):
    """Something that the caller gave is wrong."""


class RecordingError(InputError):
    """A recording cannot be read or used."""


class SeveralMotorsError(RecordingError):
    """A recording holds several motors, and nobody said which is meant."""

    def __init__(self, sentence: str, motors: tuple[str, ...]) -> None:
        super().__init__(sentence)
        self.motors = motors


class CaseError(InputError):
    """A case file is wrong."""


class FmuError(InputError):
    """An FMU cannot be read, loaded or used."""


class SimulationError(EstimatorError, RuntimeError):
    """The FMU failed while it was simulated."""


def is_build_error(error: Exception) -> bool:
    """Whether the building of an FMU failed, which is loaded where one is built."""
    from fmu_build.errors import BuildError

    return isinstance(error, BuildError)


def to_install(extra: str) -> str:
    """Say how what an extra of this package brings is installed."""
    return f"install it with: pip install 'fmu-estimator[{extra}]'"


def suggestion(name: str, known: Iterable[str], *, among: Sequence[str] | None = None) -> str:
    """Return ``"; did you mean 'R'? (R, K, L)"``: the nearest known name, of those that may be meant, then all."""
    names, name = list(known), str(name)  # Python's callers may give a number
    meant = names if among is None else among
    nearest = get_close_matches(name, meant, n=1, cutoff=0.5)
    if not nearest:
        nearest = [n for n in meant if n.lower() == name.lower()]
    listed = (", ".join(names[:20]) or "there is none") + (", …" if len(names) > 20 else "")
    return (f"; did you mean {nearest[0]!r}?" if nearest else "") + f" ({listed})"


def one_line(error: object) -> str:
    """Return the text of an error on one line, without the traceback's noise."""
    return " ".join(str(error).split())[:400] or type(error).__name__


def is_sized(value: float) -> bool:
    """Return whether a number is finite, and zero or of a size whose square is told from zero and from infinity."""
    return value == 0 or LEAST_SIZE <= abs(value) <= LARGEST_SIZE


def is_text(name: str) -> bool:
    """Return whether a file's name is UTF-8; no report, case file or answer can hold another."""
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True
