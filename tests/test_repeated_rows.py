"""Rows that a logger wrote again: known by their noise, and what its clock counted decided by the fit."""

import numpy as np
import pytest
from effect_bench import H, recording, worst

from estimator.cases.case import Case, OutputSpec
from estimator.errors import RecordingError
from estimator.estimating.estimate import estimate_recordings
from estimator.recordings.reading import read_recording, recording_from_arrays
from estimator.recordings.repeated_rows import repeated_rows, written_once

CASE = Case(inputs={"v": "voltage"}, outputs={"i": OutputSpec("current"), "w": OutputSpec("speed")})
AGAIN = (104, 106, 110, 118, 130, 131, 470)  # rows, in the responses to both levels and behind
LEVELS = {"v": np.repeat([0.0, 10.0], [100, 900])}


def noisy(n=1000, *, seed=0, quantum=(0.0, 0.0)):
    rng = np.random.default_rng(seed)
    found = {name: rng.standard_normal(n) for name in ("i", "w")}
    return {name: q * np.round(y / q) if q else y for (name, y), q in zip(found.items(), quantum, strict=True)}


def with_rows(signals, rows):
    """Return signals whose rows are the row before once more."""
    return {name: np.where(np.isin(np.arange(len(y)), rows), np.roll(y, 1), y) for name, y in signals.items()}


@pytest.mark.parametrize("quantum", [(0.0, 0.0), (0.0, 0.5), (1e-4, 1e-3)])
def test_rows_that_repeat_their_noise_are_known(quantum):
    signals = with_rows(noisy(quantum=quantum), [57, 640])
    assert repeated_rows(LEVELS, signals).tolist() == [57, 640]


@pytest.mark.parametrize("quantum", [(0.5, 0.5), (0.0, 0.0)])
@pytest.mark.parametrize("seed", range(20))
def test_rows_that_are_alike_by_chance_are_not(quantum, seed):
    """Where both signals have steps of half their noise, one row in fifty is as the one before."""
    assert not repeated_rows(LEVELS, noisy(seed=seed, quantum=quantum)).size


def test_what_one_sensor_repeats_is_no_row():
    signals = noisy()
    signals["i"] = np.repeat(signals["i"][::4], 4)
    signals["w"][:100] = 0.0  # an encoder at rest
    assert not repeated_rows(LEVELS, signals).size
    assert not repeated_rows(LEVELS, {"w": signals["i"]}).size  # nor where there is one


def test_a_resting_current_that_repeats_by_chance_beside_a_speed_of_zero_is_no_row():
    """As where a servomotor's current is a mean of a few of its converter's steps: 19 to 38 rows of 4 000."""
    rng = np.random.default_rng(2)
    rests = np.arange(4000) < 2000
    i = np.where(rests, np.round(rng.standard_normal((4000, 2)), 1) @ [0.3, 0.47], rng.standard_normal(4000))
    w = np.where(rests, 0.0, 100.0 + rng.standard_normal(4000))
    assert np.sum((np.diff(i) == 0) & (np.diff(w) == 0)) > 0
    assert not repeated_rows({"v": np.where(rests, 0.0, 6.0)}, {"i": i, "w": w}).size


def test_a_sensor_that_is_read_more_often_than_it_measures_repeats_no_rows():
    signals = {name: np.repeat(y[::2], 2) for name, y in noisy().items()}
    assert not repeated_rows(LEVELS, signals).size


def test_what_follows_a_row_that_was_written_twice_was_taken_a_step_earlier():
    time = np.arange(8) * 0.1
    assert written_once(time, np.array([3, 4])) == pytest.approx(
        [0, 0.1, 0.2, 0.2 + 1 / 30, 0.2 + 2 / 30, 0.3, 0.4, 0.5]
    )
    ends = written_once(time, np.array([7]))
    assert ends[:7] == pytest.approx(time[:7]) and 0.6 < ends[7] < 0.7


def logged(*, twice, seed=0):
    """Return a recording in which a logger wrote rows twice and counted them, or showed some again at their time."""
    whole = recording("two levels", seed=seed)
    rows = np.arange(len(whole.time))
    held = np.maximum.accumulate(np.where(np.isin(rows, AGAIN), 0, rows))
    shown = np.sort(np.r_[rows, AGAIN]) if twice else held
    names = {"voltage": "V", "current": "A", "speed": "rad/s"}
    columns = {f"{name} [{unit}]": whole.signals[name][shown] for name, unit in names.items()}
    return recording_from_arrays("logged", np.arange(len(shown)) * H, columns)


@pytest.mark.usefixtures("shared_workers")
@pytest.mark.parametrize(("twice", "said"), [(True, "written twice"), (False, "the clock is right")])
def test_the_fit_tells_whether_the_clock_counted_them(twice, said):
    """Rows written twice were told as a delay, dry friction, break-away, a late channel and a low-pass, in doubt."""
    result = estimate_recordings([CASE], [[logged(twice=twice)]], workers=1)[0]
    assert result.verdict == "ok" and worst(result) < 4.5, (result.reasons, result.parameters)
    (note,) = [note for note in result.notes if note.startswith("rows (")]
    assert "7 of logged" in note and said in note, note
    assert list(result.effects) == ["repeated rows"], result.effects


@pytest.mark.parametrize(
    ("again", "is_read"), [("0.003,6,0.3,", True), ("0.003,6,0.3,31", True), ("0.003,6,0.4,31", False)]
)
def test_a_row_that_is_stored_twice_with_its_time_is_left_out_though_a_cell_of_it_is_empty(tmp_path, again, is_read):
    rows = [f"{k * 1e-3:.3f},6,0.3,{28 + k}" for k in range(20)]
    rows.insert(4, again)
    path = tmp_path / "run.csv"
    path.write_text("\n".join(["time [s],voltage [V],current [A],speed [rad/s]", *rows]) + "\n")
    if not is_read:
        with pytest.raises(RecordingError, match="time does not increase"):
            read_recording(path)
        return
    found = read_recording(path)
    assert len(found.time) == 20 and found.signals["speed"].tolist() == [28 + k for k in range(20)]
