"""The live line."""

import io
import os
import pty
import termios
import time
from pathlib import Path

import pytest

from estimator import estimate_parameters
from estimator.estimating import progress
from estimator.estimating.progress import LiveLine, Progress, fitted, is_live, is_terminal, progress_line

EXAMPLE = Path(__file__).parent.parent / "examples" / "cml050_step.csv"


class Clock:
    """A clock that is set by hand."""

    now = 100.0

    def __call__(self) -> float:  # noqa: D102
        return self.now


def test_a_line_tells_phase_runs_rate_remaining_time_cost_and_values():
    event = Progress("search", 1200, 4000, 0.0125, {"R": 3.1, "J": 9e-6})
    assert progress_line(event, seconds=3.0) == (
        "search  1200 of 4000 simulations  400/s  search ends in 7 s  cost 0.0125  R 3.1  J 9e-06"
    )


@pytest.mark.parametrize(
    ("event", "seconds", "line"),
    [
        (Progress("probe", 0), 0.0, "probe  0 simulations  time left not known"),
        (Progress("polish", 500, 400), 10.0, "polish  500 simulations  50/s  10 s so far, time left not known"),
        (
            Progress("search", 3, None, float("inf"), None),
            6.0,
            "search  3 simulations  0.5/s  6 s so far, time left not known",
        ),
        (Progress("search", 100, 100_100), 10.0, "search  100 of 100100 simulations  10/s  search ends in 2.8 h"),
        (Progress("search", 100, 1_100), 10.0, "search  100 of 1100 simulations  10/s  search ends in 2 min"),
    ],
)
def test_a_line_says_what_is_known_and_when_no_end_is_in_sight(event, seconds, line):
    assert progress_line(event, seconds=seconds) == line


@pytest.mark.parametrize("method", ["cuckoo", "original"])
def test_an_estimation_never_promises_an_end_that_it_passes(method, tmp_path):
    case, events = tmp_path / "step.case.toml", []
    case.write_text(f'[search]\nmethod = "{method}"\nnests = 10\niterations = 3\n\n[[recording]]\nfile = "{EXAMPLE}"\n')
    estimate_parameters(case, workers=1, progress=events.append)
    promised = {event.phase: event.expected for event in events}
    assert promised["search"] is not None
    assert all(event.expected is None or event.simulations <= event.expected for event in events)
    assert {phase for phase, expected in promised.items() if expected is not None} == {"search"}


def test_the_line_is_drawn_at_most_ten_times_a_second_and_wiped_at_the_end():
    stream, clock = io.StringIO(), Clock()
    with LiveLine(stream, clock=clock) as line:
        for k in range(100):
            line(Progress("search", k))
            clock.now += 0.01
    drawn = stream.getvalue()
    assert 9 <= drawn.count("search") <= 11
    assert "\n" not in drawn
    assert drawn.endswith("\r" + " " * len("search  90 simulations  100/s  time left not known") + "\r")


def test_a_shorter_line_covers_a_longer_one():
    stream, clock = io.StringIO(), Clock()
    with LiveLine(stream, clock=clock) as line:
        line(Progress("a long phase", 1))
        clock.now += 0.2
        line(Progress("b", 1))
        assert stream.getvalue().endswith("\rb  1 simulations  time left not known" + " " * 11)


def test_a_line_goes_on_while_nothing_is_simulated_until_it_is_wiped(monkeypatch):
    monkeypatch.setattr(progress, "REPEAT", 0.02)
    stream = io.StringIO()
    with LiveLine(stream) as line:
        line(Progress("rivals", 1))
        assert waited(lambda: stream.getvalue().count("alternatives") > 2)
        line.wipe()
        drawn = stream.getvalue()
        time.sleep(0.06)
        assert stream.getvalue() == drawn


def waited(is_so):
    """Return whether something becomes so within some seconds."""
    end = time.monotonic() + 10
    while not is_so() and time.monotonic() < end:
        time.sleep(0.01)
    return is_so()


def test_nothing_is_written_when_nothing_happens():
    stream = io.StringIO()
    with LiveLine(stream):
        pass
    assert stream.getvalue() == ""


def test_a_line_is_never_wider_than_the_terminal():
    master, slave = pty.openpty()
    termios.tcsetwinsize(slave, (24, 30))
    with os.fdopen(slave, "w") as terminal, LiveLine(terminal) as line:
        line(Progress("search", 1, parameters={f"p{k}": 1.0 for k in range(50)}))
        drawn = ""
        while len(drawn) < 22:  # a terminal delivers in pieces
            drawn += os.read(master, 1000).decode()
    os.close(master)
    assert drawn == "\rsearch  1 simulations"


def test_a_line_is_cut_between_two_values_and_never_within_one():
    line = progress_line(Progress("search", 1, parameters={"R": 3.125, "J": 0.00125}), seconds=0.0)
    assert line == "search  1 simulations  time left not known  R 3.125  J 0.00125"
    for width in range(1, len(line)):
        cut = fitted(line, width)
        assert len(cut) <= width
        assert cut == line[:width] if width < len("search") else line[len(cut) :].startswith("  ")
    assert fitted(line, len(line)) == line


def test_a_line_that_something_else_interrupts_makes_room_first():
    stream, clock = io.StringIO(), Clock()
    with LiveLine(stream, clock=clock) as line:
        line(Progress("probe", 1))
        line.wipe()
        stream.write("a sentence\n")
        clock.now += 1
        line(Progress("probe", 2))
    assert stream.getvalue().split("\r")[2:4] == [
        " " * len("probe  1 simulations  time left not known"),
        "a sentence\n",
    ]


def test_a_dumb_terminal_draws_nothing_over(monkeypatch):
    master, slave = pty.openpty()
    with os.fdopen(slave, "w") as terminal:
        monkeypatch.setenv("TERM", "xterm")
        assert is_live(terminal) and not is_live(io.StringIO())
        monkeypatch.setenv("TERM", "dumb")
        assert not is_live(terminal)
    os.close(master)


def test_only_a_terminal_is_a_terminal():
    master, slave = pty.openpty()
    with os.fdopen(slave, "w") as terminal:
        assert is_terminal(terminal)
    assert not is_terminal(terminal), "closed"
    assert not is_terminal(io.StringIO())
    assert not is_terminal(None)
    os.close(master)
