"""A reason to doubt or refuse that knows where in the data it lies. Knows no recording."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Place:
    """Where in the data something is.

    Attributes
    ----------
    recording : name of the recording
    signal : output or input; "" for all
    start, end : s
    """

    recording: str
    signal: str
    start: float
    end: float


class Reason(str):
    """A sentence, as any other, with the places in the recordings that show it."""

    places: tuple[Place, ...]

    def __new__(cls, sentence: str, *places: Place) -> Reason:
        """Return a sentence with its places."""
        made = super().__new__(cls, sentence)
        made.places = places
        return made

    def __getnewargs__(self) -> tuple[object, ...]:  # type: ignore[override]
        """Pickle with the places."""
        return (str(self), *self.places)


def places_of(reasons: tuple[str, ...]) -> tuple[Place, ...]:
    """Return the places that reasons know."""
    return tuple(place for reason in reasons if isinstance(reason, Reason) for place in reason.places)
