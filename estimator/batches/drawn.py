"""Recordings of a best fit with other noise, drawn when they are asked for. Knows no case and no batch.

Monte-Carlo adds white noise of the estimated deviation to the simulated signals; the bootstrap adds blocks of the
residuals, drawn with replacement from a circle (Politis and Romano 1992), which keeps their colour within a block.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from estimator.recordings.reading import recording_from_arrays
from estimator.recordings.recording import Recording
from estimator.results.result import Comparison

FloatArray = NDArray[np.float64]
Kind = Literal["monte-carlo", "bootstrap"]


@dataclass(frozen=True)
class BestFit:
    """What is drawn beside: a best fit, the noise of its outputs, and the inputs that its case names.

    Attributes
    ----------
    noise : output name → deviation, SI
    seed : the case's
    """

    comparisons: tuple[Comparison, ...]
    noise: Mapping[str, float]
    inputs: tuple[str, ...]
    kind: Kind
    seed: int

    @cached_property
    def digest(self) -> str:
        """All that the recordings follow from, as one number."""
        found = hashlib.sha256(repr((dict(self.noise), self.inputs, self.kind, self.seed)).encode())
        for c in self.comparisons:
            for array in (c.time, *c.inputs.values(), *c.measured.values(), *c.simulated.values()):
                found.update(array.tobytes())
        return found.hexdigest()


@dataclass(frozen=True)
class Drawn:
    """The k-th recordings of a best fit with other noise; made when they are asked for, thousands would not fit in."""

    fit: BestFit
    k: int

    @property
    def digest(self) -> str:
        """What the recordings follow from, as one number."""
        return f"{self.fit.digest} {self.k}"

    def recordings(self) -> tuple[Recording, ...]:
        """Draw them; each time the same."""
        rng = np.random.default_rng([self.fit.seed, self.k])
        return tuple(_again(c, self.fit, rng=rng) for c in self.fit.comparisons)


def blocks(residuals: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return residuals, (n, q), drawn anew in blocks of √n samples, all columns together; none may be missing."""
    n = len(residuals)
    length = max(1, round(n**0.5))
    starts = rng.integers(0, n, size=-(-n // length))
    index = (starts[:, None] + np.arange(length)).ravel()[:n] % n
    return np.asarray(residuals[index])


def _again(comparison: Comparison, fit: BestFit, *, rng: np.random.Generator) -> Recording:
    names = list(comparison.measured)
    simulated = np.column_stack([comparison.simulated[name] for name in names])
    measured = np.column_stack([comparison.measured[name] for name in names])
    residuals = measured - simulated
    missing = np.isnan(measured)
    if fit.kind == "bootstrap":
        noise = blocks(np.where(missing, 0.0, residuals - np.nanmean(residuals, axis=0)), rng)
    else:
        deviations = [fit.noise.get(n, float(np.nanstd(r))) for n, r in zip(names, residuals.T, strict=True)]
        noise = rng.standard_normal(simulated.shape) * deviations
    drawn = np.where(missing, np.nan, simulated + noise)
    columns = {name: comparison.inputs[name] for name in fit.inputs}
    columns |= dict(zip(names, drawn.T, strict=True))
    headers = {f"{n} [{u}]" if (u := comparison.units.get(n)) else n: np.array(c) for n, c in columns.items()}
    return recording_from_arrays(comparison.name, np.array(comparison.time), headers)
