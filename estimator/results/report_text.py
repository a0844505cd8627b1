"""An estimate as text for a person, on a screen of so many lines. Knows only the result; computes nothing new."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace

from estimator.results.budget_table import budget_line
from estimator.results.numbers import counted
from estimator.results.report_sentences import TITLES, about_line, cost_lines, meaning, read_lines, validation_lines
from estimator.results.report_tables import chain_table, derived_table, parameter_table, signal_table
from estimator.results.result import Estimate
from estimator.results.text_table import TextTable

READ = "Read:"
REST = "in the report that -o DIR writes, and with --json"  # where what a screen leaves out stands
FEWEST = 3  # reasons, and recordings read, that a screen shows, however many there are


def text_report(estimate: Estimate, *, width: int | None = None, lines: int | None = None, rest: str = REST) -> str:
    """Return the result as aligned lines: what was read, verdict and reasons, then values, fit and cost.

    Parameters
    ----------
    width : int, optional
        Sentences are broken to so many characters; a table that is wider goes on below itself.
    lines : int, optional
        Lines of the screen: notes, then what is derived, then what was read of further recordings, then reasons are
        left out until it fits.
    rest : str
        Where what is left out can be read.
    """
    blocks = _blocks(estimate, width)
    if lines is None:
        return _joined(blocks, width) + "\n"
    for kind, least in (("notes", 0), ("failures", 0), ("derived", 0), ("read", FEWEST), ("reasons", FEWEST)):
        excess = _height(blocks, width) - lines
        if excess <= 0:
            break
        blocks = [b.shortened(excess, width=width, least=least, rest=rest) if b.kind == kind else b for b in blocks]
    return _joined(blocks, width) + "\n"


@dataclass(frozen=True)
class _Block:
    """A part of the text: a title, then a table's lines or a list of sentences."""

    kind: str
    title: str
    items: tuple[str, ...]
    rows: int = 0  # of a table
    is_list: bool = True
    left_out: str = ""

    def lines(self, width: int | None) -> list[str]:
        found = _wrapped(self.title, width) if self.title else []
        for item in self.items:
            found += _wrapped(item, width, first="  - ", other="    ") if self.is_list else [item]
        return found + (_wrapped(self.left_out, width, first="  ") if self.left_out else [])

    def shortened(self, excess: int, *, width: int | None, least: int, rest: str) -> _Block:
        """Return the block so many lines shorter, or as short as it may be, and where the rest stands."""
        if not self.is_list:
            return replace(self, items=(), title="", left_out=f"{self.rows} derived quantities: {rest}")
        goal = len(self.lines(width)) - excess
        short = self
        for kept in range(len(self.items) - 1, least - 1, -1):
            told = f"… {len(self.items) - kept} more: {rest}"
            if kept == 0:
                short = replace(
                    self, title="", items=(), left_out=f"{self.title} {counted(len(self.items), 'note')}, {rest}"
                )
            else:
                short = replace(self, items=self.items[:kept], left_out=told)
            if len(short.lines(width)) <= goal:
                break
        return short


def _blocks(estimate: Estimate, width: int | None) -> list[_Block]:
    """Return the parts of the text, in their order."""

    def table(kind: str, found: TextTable) -> _Block:
        return _Block(kind, "", tuple(found.lines(width)), len(found.rows), is_list=False)

    verdict = f"{TITLES[estimate.verdict].upper()}: {meaning(estimate)}"
    blocks = [_Block("reasons", verdict, estimate.reasons)]
    if read := [*read_lines(estimate), *([about_line(estimate)] if estimate.about else [])]:
        blocks.insert(0, _Block("read", read[0], ()) if len(read) == 1 else _Block("read", READ, tuple(read)))
    if estimate.parameters:
        blocks.append(table("parameters", parameter_table(estimate)))
    if told := budget_line(estimate):
        blocks.append(_Block("budget", told, ()))
    if estimate.chain:
        blocks.append(table("chain", chain_table(estimate)))
    if estimate.derived:
        blocks.append(table("derived", derived_table(estimate)))
    if estimate.rmse:
        blocks.append(table("signals", signal_table(estimate)))
    if estimate.validation is not None:
        title = "Validation, on recordings that were not used for the fit:"
        blocks.append(_Block("validation", title, tuple(validation_lines(estimate))))
    if estimate.notes:
        blocks.append(_Block("notes", "Found in the data and used:", estimate.notes))
    if estimate.failures:
        blocks.append(_Block("failures", "Failed simulations:", estimate.failures))
    blocks.append(_Block("cost", "\n".join(cost_lines(estimate)), ()))
    return blocks


def _joined(blocks: Sequence[_Block], width: int | None) -> str:
    return "\n\n".join("\n".join(block.lines(width)) for block in blocks)


def _height(blocks: Sequence[_Block], width: int | None) -> int:
    return _joined(blocks, width).count("\n") + 1


def _wrapped(text: str, width: int | None, *, first: str = "", other: str | None = None) -> list[str]:
    """Return a text broken to a width, each of its lines for itself."""
    follow = first if other is None else other
    if width is None:
        return [first + part for part in text.split("\n")]
    found = []
    for part in text.split("\n"):
        found += textwrap.wrap(
            part,
            max(width, 20),
            initial_indent=first,
            subsequent_indent=follow,
            break_long_words=False,
            break_on_hyphens=False,
        )
    return found
