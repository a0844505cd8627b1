"""Figures drawn in the process that wants them, where matplotlib is loaded once: for tests that ask what is drawn.

That the program draws them in a process of its own is asked in test_figure_process.py, and of programs started anew.
"""

from __future__ import annotations

from typing import Self

from estimator.results import figure_process
from estimator.results.figure_process import FigureProcess

__all__ = ["FigureProcess", "draw_here"]


class DrawnHere(FigureProcess):
    """What a figure process is where none can be started: figures are drawn by their owner."""

    def __enter__(self) -> Self:
        """Start no process."""
        self._process = None
        return self


def draw_here() -> None:
    """Let commands that are run in this process from here on, or forked from it, draw their figures themselves."""
    figure_process.FigureProcess = DrawnHere  # type: ignore[misc]
