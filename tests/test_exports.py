"""Files as instruments and loggers export them, and as strangers did: read, or asked about in one sentence."""

import subprocess
import sys

import numpy as np
import pytest
from motors import CML050, step_recording

from estimator.cli import main
from estimator.recordings.clock_text import seconds_since_first

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


def test_samples_a_nanosecond_apart_are_refused_until_their_unit_is_said_again(write, capsys):
    path = write("time [us],voltage [V],current [A],speed [rad/s]", rows=zip(T, V, I, W, strict=True))
    status, out, _ = run(capsys, "estimate", path)
    assert status == 1 and "0 simulations" in out
    assert f"its samples are {1e-6 * (T[1] - T[0]):.4g} s apart" in out
    for unit in ("s", "us"):
        assert "apart" not in run(capsys, "check", path, "--unit", f"time={unit}")[1]


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


def test_a_parameter_that_the_fmu_lets_be_negative_is_searched_there_too():
    """A gain of -2 was searched from 1e-4 to 1e4 only, and the recording refused: the FMU allows -1000 to 1000."""
    from estimator.plans.free_parameters import _around

    assert _around(1.0, (None, None), (-1000.0, 1000.0), 1e4, None) == (-1000.0, 1000.0)
    assert _around(1.0, (None, None), (-1e9, None), 1e4, None) == (-1e4, 1e4)
    assert _around(1.0, (None, None), (0.0, None), 1e4, None) == (1e-4, 1e4)
    assert _around(1.0, (0.5, None), (-1000.0, 1000.0), 1e4, None) == (0.5, 1000.0)


# Headers


def test_of_a_scope_whose_channels_are_called_1_and_2_numbers_are_names_unless_the_time_is_counted_too(write, capsys):
    path = write("x-axis,1,2", "second,Volt,Ampere", rows=zip(T, V, I, strict=True))
    remedy = "(1 [Volt], 2 [Ampere]); say which it is with --column 'v=1 [Volt]' --column 'i=2 [Ampere]'"
    assert remedy in run(capsys, "check", path)[2]
    named = run(capsys, "check", path, "--column", "v=1", "--column", "i=2")[1]
    assert named.startswith("log.csv: v ← 1 [Volt] · i ← 2 [Ampere] · time ← x-axis [second]")
    counted = run(capsys, "check", path, "--column", "time=1", "--column", "v=2", "--column", "i=3")[1]
    assert counted.startswith("log.csv: v ← column 2 [Volt] · i ← column 3 [Ampere] · time ← column 1 [second]\n")


@pytest.mark.parametrize(
    "header",
    [["time_ms,voltage [V],current [mA],speed [rpm]"], ["a,b,c,d", "ms,V,mA,rpm"], ["# t (ms),U (V),I (mA),n (rpm)"]],
)
def test_of_columns_by_number_the_units_that_stand_above_them_are_read(write, capsys, header):
    path = write(*header, rows=zip(1e3 * T, V, 1e3 * I, W, strict=True))
    said = ["--column", "time=1", "--column", "v=2", "--column", "i=3"]
    told = run(capsys, "check", path, *said, "--column", "w=4")[1]
    assert "v ← column 2 [V] · i ← column 3 [mA] · w ← column 4 [rpm] · time ← column 1 [ms]\n" in told
    told = run(capsys, "check", path, *said, "--column", "load=4", "--unit", "i=A")[1]  # rpm are no torque
    assert "i ← column 3 [A] (unit as you said) · load ← column 4 (no unit: taken as N.m)" in told


def test_a_header_of_nothing_but_units_is_one(write, capsys):
    settings = ("Record Length,Analog:2001", "Sample Interval,Analog:0.001", "Source,CH1,CH2")
    path = write(*settings, "Second,Volt,Ampere", rows=zip(T, V, I, strict=True))
    assert run(capsys, "check", path)[1].startswith("log.csv: v ← Volt · i ← Ampere · time ← Second\n")


@pytest.mark.parametrize(("begin", "comma", "cell"), [(0, ",", "{}"), (1, " ", '"{}"')], ids=["pandas", "R"])
def test_rows_that_begin_with_their_number_need_no_name_for_it(write, capsys, begin, comma, cell):
    numbered = ((cell.format(k), *row) for k, row in enumerate(zip(T, V, I, W, strict=True), start=begin))
    path = write(comma.join(["time", "voltage", "current", "speed"]), rows=numbered, comma=comma)
    told = run(capsys, "check", path)[1]
    assert told.startswith("log.csv: v ← voltage ") and "not used: column 1\n" in told and "2001 samples" in told


def test_notes_beside_the_rows_are_no_header(write, capsys):
    """A spreadsheet writes commas for all its columns, also behind the names."""
    notes = {1: "J,0.1"}
    rows = ((*row, notes.get(k, ",")) for k, row in enumerate(zip(T, V, I, W, strict=True)))
    told = run(capsys, "check", write("time,voltage,current,speed,,", rows=rows))[1]
    assert told.startswith("log.csv: v ← voltage ") and "not used: column 5, column 6\n" in told


def test_decimal_commas_between_commas_are_no_row_numbers(write, capsys):
    path = write("time,voltage", rows=((f"0,{k:03}", f"{k % 7}") for k in range(40)))
    assert "with decimal commas, separate the columns by semicolons" in run(capsys, "check", path)[2]


def test_a_header_that_is_written_anew_begins_another_test(write, capsys):
    rows = [("time_ms", "pwm", "rpm") if k == 30 else (10.0 * (k % 30), 100.0, 5.0 * (k % 30)) for k in range(61)]
    path = write("# Step 1", "time_ms,pwm,rpm", rows=rows)
    out = run(capsys, "check", path, "--supply", "12/255")[1]
    assert "log.csv 1: v ← pwm × 12/255 V · w ← rpm · time ← time_ms" in out and "\nlog.csv 2: " in out


@pytest.mark.parametrize(
    ("rows", "example"),
    [
        (zip(T, V, strict=True), "--column time=1 --column v=2"),
        ((("", "", t, v) for t, v in zip(T, V, strict=True)), "--column time=3 --column v=4"),
        (((v,) for v in V), "--column v=1 --rate HZ"),
    ],
)
def test_the_example_of_columns_by_number_is_of_this_file(write, capsys, rows, example):
    asked = run(capsys, "check", write(rows=rows))[2]
    assert "there is no header" in asked and asked.endswith(f"as in {example}\n")


# Words


def test_a_batch_fills_in_a_pattern_as_an_estimate_does(write, capsys, tmp_path):
    for k in (1, 2):
        write("time,voltage,current,speed", rows=zip(T, V, I, W, strict=True), name=f"run_{k}.csv")
    status, out, _ = run(capsys, "batch", tmp_path / "run_*.csv", "-o", tmp_path / "out", "--workers", "1")
    assert status == 0 and "2 cases: 2 ok" in out
    assert "no file matches" in run(capsys, "batch", tmp_path / "nothing_*.csv", "-o", tmp_path / "out")[2]


def test_times_that_rows_share_are_taken_as_even_where_they_may_be_and_a_rate_is_asked_for_where_not(write, capsys):
    header = "time [s],voltage [V],current [A],speed [rad/s]"
    path = write(header, rows=zip(T // 0.01 * 0.01, V, I, W, strict=True))
    status, out, _ = run(capsys, "check", path)
    assert status == 0 and "2001 samples from 0 to 2 s, every 0.001 s" in out
    assert "they tell 0.01 s, and rows share them; taken as even, at 1000 Hz" in out
    lost = np.delete(np.arange(len(T)), np.s_[700:709])
    path = write(header, rows=((t // 0.01 * 0.01, v, i, w) for t, v, i, w in np.c_[T, V, I, W][lost]))
    assert "say with --rate HZ how often the rows were taken: some " in run(capsys, "check", path)[2]
    for times in (T[::-1], np.sort(np.append(T[1:], T[9]))):  # reversed; one row twice: a rate would be wrong
        other = write(header, rows=zip(times, V, I, W, strict=True), name="b.csv")
        assert run(capsys, "check", other)[2].endswith("printed with enough digits\n")
    status, out, _ = run(capsys, "check", path, "--rate", "1000")
    assert status == 0 and "1992 samples from 0 to 1.991 s, every 0.001 s" in out and "not used: time as logged" in out


def test_no_signal_is_offered_as_the_time(write, capsys):
    path = write("voltage [V],current [A],speed [rad/s]", rows=zip(V, I, W, strict=True))
    assert (
        "there is no time column (voltage [V], current [A], speed [rad/s]); one column" in run(capsys, "check", path)[2]
    )


@pytest.mark.parametrize(
    ("header", "told"),
    [
        (
            "Zeit in s;Spannung in mV;Strom in A;Drehzahl in U/min",
            "v ← Spannung in mV · i ← Strom in A · w ← Drehzahl in",
        ),
        (
            "t in seconds;U in V;I in amps;n in rev/s",
            "v ← U in V · i ← I in amps · w ← n in rev/s · time ← t in seconds",
        ),
        ("in s;C1 in V;C2 in A;C3", "there is no time column; did you mean 'in s'? (in s, C1 in V, C2 in A, C3)"),
        (
            "时间(s);电压(V);电流(A);转速",
            "v ← 电压(V) · i ← 电流(A) · w ← 转速 (no unit: taken as rpm) · time ← 时间(s)",
        ),
        (
            "Time - Plot 0;Plot 1;Plot 2;Plot 3",
            "there is no time column; did you mean 'Time - Plot 0'? (Time - Plot 0, Pl",
        ),
    ],
)
def test_units_in_words_and_names_between_semicolons(write, capsys, header, told):
    path = write(header, rows=zip(T, V, I, W, strict=True), comma=";")
    assert told in "".join(run(capsys, "check", path)[1:])


# Clocks


@pytest.mark.parametrize(("unit", "count"), [("ms", 10**3), ("us", 10**6), ("ns", 10**9)])
def test_a_clock_without_a_unit_that_can_only_count_from_1970_in_one_has_it(write, capsys, unit, count):
    stamps = [str(1_700_000_000 * count + k * count // 1000) for k in range(len(T))]
    path = write("timestamp,voltage,current,n", rows=zip(stamps, V, I, W, strict=True))
    told = run(capsys, "check", path)[1]
    assert f"time ← timestamp [{unit}]" in told and f"timestamp: counts {unit} since 1970" in told
    assert "every 0.001 s (1000 Hz)" in told
    assert "since 1970" not in run(capsys, "check", path, "--unit", "time=s")[1]


def test_a_counter_that_is_as_long_as_a_date_is_none(write, capsys):
    path = write(
        "timestamp,voltage,current,n",
        rows=zip((f"{12 * 10**11 + 10**6 * k}" for k in range(len(T))), V, I, W, strict=True),
    )
    assert "since 1970" not in run(capsys, "check", path)[1]  # ns of twenty minutes


@pytest.mark.parametrize(
    "cells",
    [
        ("0 days 00:00:00", "0 days 00:00:00.500000", "1 days 00:00:01.500000"),
        ("0 sec", "0.5 sec", "86401.5 sec"),
        ("0 s", "0.5 s", "86401.5 s"),
    ],
)
def test_durations_of_pandas_and_of_matlab_s_timetables_are_times(cells):
    found = seconds_since_first(cells)
    assert found is not None and found[0].tolist() == [0.0, 0.5, 86401.5]


@pytest.mark.parametrize("mark", [".", ",", ":"])
def test_minutes_and_seconds_and_thousandths_behind_a_colon_are_times(mark):
    found = seconds_since_first([f"59:59{mark}998", f"59:59{mark}999", f"00:00{mark}001"])
    assert found is not None and found[0].tolist() == [0.0, 0.001, 0.003] and found[1] == 0.0005
    found = seconds_since_first([f"23:59:59{mark}998", f"00:00:00{mark}001"])
    assert found is not None and found[0].tolist() == [0.0, 0.003]
    assert seconds_since_first(["10:00"]) is None  # hours or minutes


@pytest.mark.parametrize(
    "day",
    [
        "21/11/2026",
        "21-11-2026",
        "21.11.26",
        "21-Nov-2026",
        "21 März 2026",
        "Nov 21 2026",
        "November 21, 2026",
        "20261121",
    ],
)
def test_a_date_of_any_form_before_a_time_of_day_is_passed_over(day):
    found = seconds_since_first([f"{day} 23:59:59.998", f"{day} 00:00:00.001"])  # of the next day
    assert found is not None and found[0].tolist() == [0.0, 0.003]
