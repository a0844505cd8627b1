"""Files as instruments and loggers export them, and as strangers did: read, or asked about in one sentence."""

import subprocess
import sys

import pytest
from motors import CML050, step_recording

from estimator.cli import main

STEP = step_recording(CML050, noise=(0.02, 1.0), seed=7, lead=0.2, duration=2.0)
T, V, I, W = STEP.time, *(STEP.signals[name] for name in ("voltage", "current", "speed"))  # noqa: E741


@pytest.fixture
def write(tmp_path):
    def write(*head, rows, name="log.csv", comma=","):
        lines = [comma.join(x if isinstance(x, str) else f"{x:.9g}" for x in row) for row in rows]
        path = tmp_path / name
        path.write_text("\n".join([*head, *lines]) + "\n")
        return path

    return write


def run(capsys, *words):
    status = main([str(word) for word in words])
    return status, *capsys.readouterr()


# Times


@pytest.mark.parametrize("times", [T // 0.002 * 0.002, 0 * T], ids=["each twice", "all the same"])
def test_repeated_times_are_told_in_one_sentence_and_nothing_else(write, times):
    path = write("time [s],voltage [V],current [A],speed [rad/s]", rows=zip(times, V, I, W, strict=True))
    command = [sys.executable, "-m", "estimator", "check", str(path)]
    asked = subprocess.run(command, capture_output=True, text=True, check=False)
    assert asked.returncode == 2 and asked.stdout == ""
    assert asked.stderr.startswith("fmu-estimator: log.csv line 3: time does not increase")
    assert asked.stderr.count("\n") == 1


@pytest.mark.parametrize(("factor", "unit"), [(1e6, "us"), (1e9, "ns")])
def test_seconds_that_last_for_hours_are_refused_with_the_unit_that_they_are_in(write, capsys, factor, unit):
    path = write("time,voltage,current,speed", rows=zip(T * factor, V, I, W, strict=True))
    status, out, _ = run(capsys, "estimate", path)
    assert status == 1 and "REFUSED" in out and "0 simulations" in out
    assert f"the time looks like {unit}; say so with --unit time={unit}" in out


def test_a_motor_that_follows_within_microseconds_is_doubted_until_its_unit_is_said_again(write, capsys):
    path = write("time [ms],voltage [V],current [A],speed [rad/s]", rows=zip(T, V, I, W, strict=True))
    assert (
        "no motor's: the unit of the time looks too small; say so with --unit time=s" in run(capsys, "check", path)[1]
    )
    for unit in ("s", "ms"):
        assert "no motor's" not in run(capsys, "check", path, "--unit", f"time={unit}")[1]


def test_a_guess_outside_of_what_the_fmu_allows_is_moved_to_its_end():
    from estimator.plans.free_parameters import _within

    assert [_within(guess, (0.0, 1000.0)) for guess in (None, -1.0, 2.0, 14803.0)] == [None, 0.0, 2.0, 1000.0]
    assert _within(14803.0, (None, None)) == 14803.0
