"""Tables and arrays in memory give what the same file gives; names that do not exist are answered."""

from html import escape

import numpy as np
import pandas as pd
import polars as pl
import pytest
from made_estimates import estimate
from test_recording_files import CURRENT, RPM, TIME, N, V, check

import estimator
from estimator.errors import RecordingError
from estimator.recordings.in_memory import recording_from_table
from estimator.recordings.read_as import ReadAs
from estimator.recordings.reading import recording_from_arrays
from estimator.results.report_tables import derived_table
from estimator.results.shown_result import Result

pytestmark = pytest.mark.usefixtures("shared_workers")

COLUMNS = {"time [s]": TIME, "voltage [V]": V, "current [A]": CURRENT, "speed [rpm]": RPM}
PLAIN = {"time": TIME, "voltage": V, "current": CURRENT, "speed": RPM}
STAMPS = np.datetime64("2026-11-21T12:00:00", "us") + np.round(TIME * 1e6).astype("timedelta64[us]")


def with_attributes(frame: pd.DataFrame) -> pd.DataFrame:
    frame.attrs["units"] = {"speed": "rpm"}
    return frame


TABLES = {
    "a dictionary": (COLUMNS, None),
    "lists": ({name: x.tolist() for name, x in COLUMNS.items()}, None),
    "units apart": (PLAIN, {"speed": "rpm"}),
    "pandas": (pd.DataFrame(COLUMNS), None),
    "pandas with attributes": (with_attributes(pd.DataFrame(PLAIN)), None),
    "pandas with an index": (pd.DataFrame(COLUMNS).set_index("time [s]"), None),
    "pandas with dates": (pd.DataFrame({**COLUMNS, "time [s]": STAMPS}).rename(columns={"time [s]": "time"}), None),
    "pandas with an index of dates": (pd.DataFrame(COLUMNS, index=STAMPS).drop(columns="time [s]"), None),
    "pandas with dates of a time zone": (
        pd.DataFrame({**PLAIN, "time": pd.DatetimeIndex(STAMPS).tz_localize("UTC")}),
        {"speed": "rpm"},
    ),
    "texts of dates": ({**PLAIN, "time": [str(stamp) for stamp in STAMPS]}, {"speed": "rpm"}),
    "durations of Python": ({**PLAIN, "time": (STAMPS - STAMPS[0]).tolist()}, {"speed": "rpm"}),
    "polars": (pl.DataFrame(COLUMNS), None),
    "polars with durations": (pl.DataFrame({**PLAIN, "time": STAMPS - STAMPS[0]}), {"speed": "rpm"}),
    "a column of text": (pd.DataFrame({**COLUMNS, "note": ["x"] * N}), None),
}


@pytest.mark.parametrize("kind", TABLES)
def test_every_usual_table_is_read(kind):
    table, units = TABLES[kind]
    check(recording_from_table("table", table, ReadAs(units=units or {})))


def test_none_and_null_are_missing_samples():
    current = [None if k == 7 else x for k, x in enumerate(CURRENT.tolist())]
    for table in ({**COLUMNS, "current [A]": current}, pl.DataFrame({**COLUMNS, "current [A]": current})):
        found = recording_from_table("table", table).signal("current")
        assert np.flatnonzero(np.isnan(found)).tolist() == [7]


def test_dates_and_masked_samples_of_arrays_are_read():
    signals = {name: x for name, x in COLUMNS.items() if name != "time [s]"}
    check(recording_from_arrays("arrays", STAMPS, signals))
    masked = np.ma.masked_array(CURRENT, np.arange(N) == 7)
    found = recording_from_arrays("arrays", TIME, {**signals, "current [A]": masked}).signal("current")
    assert np.flatnonzero(np.isnan(found)).tolist() == [7]
    with pytest.raises(RecordingError, match=r"'current \[A\]' is not an array of numbers"):
        recording_from_arrays("arrays", TIME, {**signals, "current [A]": CURRENT + 0j})


@pytest.mark.parametrize(
    ("table", "units", "sentence"),
    [
        ({"voltage [V]": V}, None, "table: there is no time column"),
        ({**COLUMNS, "current [A]": CURRENT[:5]}, None, r"table: 'current \[A\]' has shape \(5,\); it should be"),
        (PLAIN, {"sped": "rpm"}, "table: there is no column 'sped' to give a unit; did you mean 'speed'"),
        ({name: column[:0] for name, column in COLUMNS.items()}, None, "table has 0 samples; at least 10 are needed"),
        ({name: column[:1] for name, column in COLUMNS.items()}, None, "table has 1 sample; at least 10 are needed"),
        ({**COLUMNS, "current [A]": CURRENT * np.inf}, None, "table sample 0: current is inf, which nothing measures"),
    ],
)
def test_a_table_that_does_not_do_is_told(table, units, sentence):
    with pytest.raises(RecordingError, match=sentence):
        recording_from_table("table", table, ReadAs(units=units or {})).column("current")


@pytest.fixture(scope="module")
def bench():
    """Return t, v, i, w of the bundled motor, 400 samples with a little noise."""
    t = np.arange(400) * 1e-3
    v = np.where(t < 0.02, 0.0, 10.0)
    motor = {"R": 3.1, "K": 0.0488, "L": 0.013, "J": 9e-6, "B": 1.7e-4}
    shown = estimator.simulate_fmu("dc_motor", times=t, inputs={"v": v}, parameters=motor)
    noise = np.random.default_rng(3)
    return t, v, shown["i"] + noise.normal(0, 0.01, 400), shown["w"] + noise.normal(0, 0.2, 400)


def test_arrays_tables_and_files_give_the_same_estimate(bench, tmp_path):
    t, v, i, w = bench
    frame = pd.DataFrame({"time [s]": t, "voltage [V]": v, "current [A]": i, "speed [rad/s]": w})
    frame.to_csv(tmp_path / "run.csv", index=False)
    named = estimator.estimate_parameters(time=t, v=v, i=i, w=w, workers=1)
    assert named.verdict == "ok"
    for source in (frame, pl.DataFrame(frame.to_dict("list")), dict(frame), tmp_path / "run.csv"):
        assert estimator.estimate_parameters(source, workers=1).values == named.values


def test_several_recordings_of_any_kind_are_fitted_together(bench, tmp_path):
    t, v, i, w = bench
    frame = pd.DataFrame({"time [s]": t, "voltage [V]": v, "current [A]": i, "speed [rad/s]": w})
    for name in ("run_1.csv", "run_2.csv"):
        frame.to_csv(tmp_path / name, index=False)
    paths = [tmp_path / "run_1.csv", tmp_path / "run_2.csv"]
    found = estimator.estimate_parameters(paths, workers=1)
    assert [c.name for c in found.comparisons] == ["run_1", "run_2"]
    assert estimator.estimate_parameters(str(tmp_path / "run_*.csv"), workers=1).values == found.values
    mixed = estimator.estimate_parameters([frame, paths[1]], workers=1)
    assert [c.name for c in mixed.comparisons] == ["table 1", "run_2"]
    assert mixed.values == pytest.approx(found.values, rel=1e-9)


@pytest.mark.parametrize(
    ("arguments", "error", "sentence"),
    [
        ({"fixed": {"L": 1}}, TypeError, "no argument 'fixed'; did you mean 'fix'?"),
        ({"voltage": V}, TypeError, "no argument 'voltage'; did you mean 'v'?"),
        ({"file": "run.csv"}, TypeError, "no argument 'file'; did you mean 'source'?"),
        ({"source": "a.csv", "units": {"w": 60}}, ValueError, "units={'w': 60} is no mapping of names; give such as"),
        ({"source": "a.csv", "columns": "i"}, ValueError, "columns='i' is no mapping of names; give such as columns="),
        ({"source": COLUMNS, "test": "2"}, ValueError, "table is read as one test; give its rows of test '2' alone"),
        ({"bound": {}}, TypeError, "no argument 'bound'; did you mean 'bounds'?"),
        ({}, ValueError, "nothing to estimate from; give a recording's file"),
        ({"v": V}, ValueError, "time is missing; give time=, v= and i= or w="),
        ({"time": TIME}, ValueError, "the signals are missing; give time="),
        ({"time": TIME, "v": V}, ValueError, "nothing is measured: i, w and angle are missing; give time=, v= and"),
        ({"time": TIME, "v": V, "i": V, "method": 3}, ValueError, r"there is no method 3 \(cuckoo, paper"),
        ({"time": TIME, "v": V, "i": V, "loss": 3}, ValueError, r"there is no loss 3 \(linear, huber\)"),
        ({"time": TIME, "w": V}, ValueError, "v is missing; give time=, v= and i= or w="),
        ({"source": "x.csv", "time": TIME}, ValueError, "signals are given twice, as a source and as arrays"),
        ({"source": []}, ValueError, "the list of recordings is empty"),
        ({"source": np.eye(4)}, ValueError, "ndarray is no recording; give a file, a DataFrame, a mapping such as"),
        ({"source": 3}, ValueError, "int is no recording"),
        ({"source": ["a.case.toml", "b.csv"]}, ValueError, "a.case.toml is a case file; give it alone"),
        ({"source": ["a.csv", "a.csv"]}, ValueError, "a.csv is given twice; leave one out"),
        ({"source": [estimator.Case, "a.csv"]}, ValueError, "type is no recording"),
        ({"source": [estimator.Case(), "a.csv"]}, ValueError, "a Case stands for its own recordings; give it alone"),
        ({"source": "no_*.csv"}, ValueError, r"no file matches 'no_\*.csv'"),
    ],
)
def test_what_cannot_be_estimated_from_is_told(arguments, error, sentence):
    with pytest.raises(error, match=sentence):
        estimator.estimate_parameters(**arguments)


def test_a_name_that_a_result_does_not_have_is_answered_with_those_it_has():
    made = Result.of(estimate())
    for found in (made.parameters, made.values, made.standard_errors):
        with pytest.raises(KeyError, match="there is no 'Rs'; did you mean 'R'"):
            found["Rs"]
    assert made.parameters == estimate().parameters and "Rs" not in made.parameters


def test_a_result_is_a_figure_and_a_table():
    made = Result.of(estimate())
    assert len(made.plot().axes) > 1
    frame = made.to_dataframe()
    assert frame.index.name == "name" and set(made.parameters) <= set(frame.index)
    for name, parameter in made.parameters.items():
        row = frame.loc[name]
        assert (row["kind"], row["value"], row["unit"]) == ("parameter", parameter.value, parameter.unit)
    assert set(frame[frame["kind"] == "derived"].index) == set(made.derived)


def test_a_result_without_a_figure_or_without_pandas_is_told(monkeypatch):
    refused = Result.of(estimate(verdict="refused", reasons=("no step",), parameters={}, comparisons=()))
    with pytest.raises(estimator.InputError, match=r"nothing to plot: the estimate is refused \(no step\)"):
        refused.plot()
    assert "<img" not in refused._repr_html_()
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    with pytest.raises(estimator.InputError, match="to_dataframe needs pandas; install it with: pip install pandas"):
        refused.to_dataframe()


def test_a_notebook_shows_the_figure_and_what_follows(bench):
    t, v, i, w = bench
    found = estimator.estimate_parameters(time=t, v=v, i=i, w=w, workers=1)
    page = found._repr_html_()
    assert page.index(escape(found.read[0]["text"])) < page.index("Every free parameter"), "what was read stands first"
    assert page.count("data:image/png;base64,") == 1 and found.derived
    assert all(escape(row[0]) in page for row in derived_table(found).rows)


def test_columns_and_units_are_those_of_the_command_line_for_files_and_tables(tmp_path):
    rows = zip(*PLAIN.values(), strict=True)
    path = tmp_path / "run.csv"
    path.write_text("t,u,first,n\n" + "\n".join(",".join(repr(float(x)) for x in row) for row in rows) + "\n")
    said = {"columns": {"i": "first"}, "units": {"w": "rad/s"}, "workers": 1, "method": "integral"}  # reading matters
    read = estimator.estimate_parameters(path, **said).read[0]["signals"]
    assert read["i"]["column"] == "first" and read["w"]["unit_from"] == "user"
    table = np.genfromtxt(path, delimiter=",", names=True)
    found = estimator.estimate_parameters({name: table[name] for name in table.dtype.names}, **said)
    assert found.read[0]["signals"] == read


def test_a_duty_cycle_and_counts_are_read_of_a_table_as_of_a_file(bench, tmp_path):
    t, v, _, w = (signal[:200] for signal in bench)
    counts = np.floor(np.cumsum(w) * np.diff(t, prepend=t[0]) * 2048 / (2 * np.pi))
    table = {"time_ms": 1e3 * t, "duty": v / 12.0, "Battery (V)": np.full(len(t), 12.0), "enc_counts": counts}
    rows = zip(*table.values(), strict=True)
    path = tmp_path / "odd.csv"
    path.write_text(",".join(table) + "\n" + "\n".join(",".join(repr(float(x)) for x in row) for row in rows) + "\n")
    said = {"supply": "Battery (V)", "counts": 2048, "fix": {"R": 3.1, "L": 0.013}, "workers": 1}
    of_table, of_file = (estimator.estimate_parameters(source, **said) for source in (table, path))
    assert of_table.values == pytest.approx(of_file.values, rel=1e-6)
    assert of_table.read[0]["signals"] == of_file.read[0]["signals"]
    assert "supply" in of_table.read[0]["text"] or "Battery" in of_table.read[0]["text"]


def test_columns_and_units_of_what_is_read_already_are_an_error():
    with pytest.raises(estimator.InputError, match="a Recording is read already"):
        estimator.estimate_parameters(
            time=np.arange(30) * 1e-3, v=np.ones(30), i=np.ones(30), units={"i": "mA"}, workers=1
        )
    with pytest.raises(estimator.InputError, match="'q', given for a column, is no signal"):
        estimator.estimate_parameters("nowhere.csv", columns={"q": "x"})
