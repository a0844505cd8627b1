"""Something of a recording that cannot be as it was read, or that a plain motor does not do. Knows no recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


class Evidence(NamedTuple):
    """What of a signal shows something: from one time to another, s."""

    signal: str
    start: float
    end: float


@dataclass(frozen=True)
class Finding:
    """One thing that was found.

    Attributes
    ----------
    kind : "exchanged", "sign i", "unit w", "coasts", …
    sentence : what it looks like, with its evidence, and what puts it right
    is_fatal : nothing could be estimated from it
    is_sure : it is told whoever says that the unit is right
    is_harmless : what it takes away is in the standard errors: it is told, and lowers no verdict
    evidence : where in the recording it shows
    """

    kind: str
    sentence: str
    is_fatal: bool = False
    is_sure: bool = False
    is_harmless: bool = False
    evidence: tuple[Evidence, ...] = ()
