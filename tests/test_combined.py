"""The second bench itself: its motor against scipy's integrator, its effects, its reference fit, its table."""

import json
import sys
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

BENCHMARKS = Path(__file__).resolve().parent.parent / "benchmarks"
sys.path.insert(0, str(BENCHMARKS))

import combined  # noqa: E402
from combined import bench_of, deviations, named, wilson, wrong_and_ok  # noqa: E402
from emulated_bench import MOTOR, measure, motor_response, physics, shown, write  # noqa: E402
from emulated_effects import EMULATED_EFFECTS, draw, with_noise  # noqa: E402
from exact_effects import ExactEffects  # noqa: E402

pytestmark = pytest.mark.usefixtures("shared_workers")

PLAIN = {"R": 3.0, "K": 0.05, "L": 6e-3, "J": 1e-5, "B": 1e-4, "Tc": 0.0, "Ts": 0.0, "ws": 5.0, "Vb": 0.0, "ib": 0.05}
PLAIN |= {"limit": np.inf, "Rs": 0.0, "Rsag": 0.0, "ts": 0.0, "heat": 0.0}


def response(motor, *, volts, dt=5e-5, n=8000, speed=0.0, opened=None):
    times = 0.1 * np.arange(len(volts))
    opened = np.zeros(len(volts), int) if opened is None else np.array(opened)
    return motor_response(motor, times, np.array(volts, float), opened, n, dt, np.ones(n), speed)


def integrated(motor, volts, dt=5e-5, n=8000):
    """Return current and speed by solve_ivp at 1e-11, level by level; the rotor turns one way all the time."""
    m = motor

    def slope(t, x, v):
        i, w, drop, q = x
        friction = m["B"] * w + np.sign(w) * (m["Tc"] + (m["Ts"] - m["Tc"]) * np.exp(-abs(w) / m["ws"]))
        u = v - drop - (m["R"] * (1 + m["heat"] * q) + m["Rs"]) * i - m["K"] * w - m["Vb"] * np.tanh(i / m["ib"])
        sag = (m["Rsag"] * i - drop) / m["ts"] if m["ts"] else 0.0
        return np.array([u / m["L"], (m["K"] * i - friction) / m["J"], sag, i * i])

    def breaks_away(t, x, v):
        return m["K"] * x[0] - m["Ts"]

    breaks_away.terminal = True
    grid, x, still, rows = np.arange(n) * dt, np.zeros(4), m["Ts"] > 0, []
    for k, v in enumerate(volts):
        now, end = 0.1 * k, 0.1 * (k + 1)
        while now < end - 1e-12:
            use = (lambda t, x, v: slope(t, x, v) * np.array([1, 0, 1, 1])) if still else slope
            done = solve_ivp(use, (now, end), x, "DOP853", args=(v,), rtol=1e-11, atol=1e-13, dense_output=True,
                             events=breaks_away if still else None)  # fmt: skip
            inside = grid[(grid >= now - 1e-12) & (grid < done.t[-1] - 1e-12)]
            rows.append(done.sol(inside)[:2])
            x, now = done.y[:, -1], done.t[-1]
            if still and now < end:
                still, x[1] = False, 1e-12
    return np.concatenate(rows, axis=1).T


def test_a_linear_motor_is_exact():
    levels = [12.0, 6.0, 12.0, 3.0]
    ours = response(PLAIN, volts=levels)[:, :2]
    theirs = integrated(PLAIN, levels)
    assert (np.abs(ours - theirs).max(axis=0) < 1e-9 * np.abs(theirs).max(axis=0)).all()


def test_a_motor_with_brushes_sag_heat_and_dry_friction_agrees_with_scipy():
    motor = PLAIN | {"Vb": 0.6, "Rsag": 0.2, "ts": 5e-3, "heat": 0.3, "Rs": 0.1, "Tc": 2e-3, "Ts": 3e-3}
    levels = [6.0, 12.0, 9.0, 12.0]
    theirs = integrated(motor, levels)

    def worst(dt, n, every):
        return np.abs(response(motor, volts=levels, dt=dt, n=n)[::every, :2] - theirs)[50:].max(axis=0)

    coarse, fine = worst(5e-5, 8000, 1), worst(1.25e-5, 32000, 4)
    assert (coarse < theirs.max(axis=0) * 1e-4).all()
    assert (fine < coarse / 8.0).all()  # second order: 16


def test_a_rotor_below_its_break_away_torque_stands_still():
    motor = PLAIN | {"Tc": 4e-3, "Ts": 8e-3}
    held = response(motor, volts=[0.99 * 8e-3 / 0.05 * 3.0] * 4)
    assert np.all(held[:, 1] == 0.0)
    assert held[-1, 0] == pytest.approx(0.99 * 8e-3 / 0.05)
    assert response(motor, volts=[1.01 * 8e-3 / 0.05 * 3.0] * 4)[-1, 1] > 0.1


def test_a_rotor_that_coasts_with_dry_friction_stops_when_the_equation_says_so():
    motor = PLAIN | {"Tc": 2e-3, "Ts": 2e-3}
    y = response(motor, volts=[0.0] * 4, opened=[1, 1, 1, 1], speed=100.0)
    stop = 1e-5 / 1e-4 * np.log1p(1e-4 * 100.0 / 2e-3)  # J w' = -B w - Tc
    t = np.arange(len(y)) * 5e-5
    assert np.all(y[t > stop, 1] == 0.0)
    moving = t < stop
    exact = (100.0 + 20.0) * np.exp(-t[moving] * 10.0) - 20.0
    assert np.abs(y[moving, 1] - exact).max() < 1e-9
    assert np.all(y[:, 0] == 0.0)
    assert y[moving, 3] == pytest.approx(0.05 * exact)


def test_a_reversal_passes_through_zero_speed_without_a_jump():
    motor = PLAIN | {"Tc": 2e-3, "Ts": 2e-3}
    y = response(motor, volts=[12.0, -12.0, 12.0, -12.0])
    acceleration = np.abs(np.diff(y[:, 1])).max()
    assert acceleration <= (0.05 * np.abs(y[:, 0]).max() + 1e-4 * 300 + 2e-3) / 1e-5 * 5e-5
    assert y[3900, 1] == pytest.approx(-y[1900, 1], rel=1e-4)


def test_the_current_stays_on_a_limited_supplys_plateau_and_leaves_it():
    motor = PLAIN | {"limit": 1.5}
    y = response(motor, volts=[12.0] * 4)
    plateau = y[:, 0] == 1.5
    assert y[:, 0].max() == 1.5 and plateau.sum() > 100
    end = np.flatnonzero(plateau)[-1]
    # J w' = K limit - B w from where the plateau begins; it ends where the voltage is used up
    assert y[end, 1] == pytest.approx((12.0 - 3.0 * 1.5) / 0.05, rel=0.01)
    assert y[-1, 0] == pytest.approx(response(PLAIN, volts=[12.0] * 4)[-1, 0], rel=1e-6)


def test_every_kind_of_trouble_changes_what_is_written(tmp_path):
    assert len(EMULATED_EFFECTS) >= 24
    for name in EMULATED_EFFECTS:
        if name in ("runs_differ", "on_from_row_0", "lost_rows", "repeated_rows"):
            continue  # these need several runs, or change the rows
        excitation = "zero" if name == "open_circuit" else "step"
        good, bad = (draw(3, effects=names, excitation=excitation) for names in ((), (name,)))
        assert set(bad.effects) == {name}
        (a,), (b,) = (write(bench, tmp_path) and [(tmp_path / "run1.csv").read_text()] for bench in (good, bad))
        assert a != b, name


def test_the_same_seed_writes_the_same_files(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    first, second = write(draw(11), tmp_path / "a"), write(draw(11), tmp_path / "b")
    assert [p.read_bytes() for p in first] == [p.read_bytes() for p in second]
    assert first[0].read_text().startswith("time [s],voltage [V],current [A],speed [rad/s]\n")


def test_counts_of_an_encoder_are_whole_numbers():
    bench = draw(3, effects=("encoder",), excitation="step")
    rec, counts = bench.recordings[0], bench.story["counts", -1]
    steps = measure(bench, 0).w * rec.h * counts / (2 * np.pi)
    assert np.abs(steps - np.round(steps)).max() < 1e-6
    assert np.ptp(steps) > 3


def test_a_filter_that_is_fast_against_the_rows_shows_the_speed_itself():
    bench = draw(3, effects=(), excitation="step")
    slow = shown(bench, bench.story | {("tau_w", -1): 1e-5 * bench.recordings[0].h}, 0)
    assert slow[1] == pytest.approx(shown(bench, bench.story, 0)[1])


def test_a_gain_of_the_voltage_cannot_be_told_and_scales_all_five():
    bench = draw(0, effects=("voltage_gain",), excitation="reversal")
    told = ExactEffects(bench).tell()
    assert told.untold == ("voltage_gain",)
    g = bench.story["gain_v", -1]
    for name in MOTOR:
        assert told.alike[name] * (1 + g) == pytest.approx(told.truth[name], rel=1e-5)


def test_dry_friction_is_told_by_two_levels_and_not_by_one():
    two = draw(6, effects=("dry_friction",), excitation="two levels")
    assert ExactEffects(two).untold()[0] == ()
    one = draw(6, effects=("dry_friction",), excitation="step")
    one = with_noise(one, lambda n: replace(n, i=20 * n.i, w=20 * n.w))
    (left, story), w = ExactEffects(one).untold(), physics(one, one.story, 0)[0][-1, 1]
    assert left == ("dry_friction",)
    total = one.story["B", -1] * w + one.story["Tc", -1]
    assert story["B", -1] * w == pytest.approx(total, rel=0.05)


def test_the_true_storys_bars_hold_for_noise_alone():
    """Deviations of 8 motors (40, each motor's correlated): a right bench fails with a probability below 1e-3."""
    z = []
    for seed in range(8):
        told = ExactEffects(bench_of("good", seed)).tell()
        assert told.alike == told.truth
        z += [(told.value[name] - told.truth[name]) / told.bar[name] for name in MOTOR]
    assert 0.45 < np.sqrt(np.mean(np.square(z))) < 1.65
    assert np.mean(np.abs(z) < 1.96) > 0.75


def line(**more):
    told = asdict(ExactEffects(bench_of("good", 0)).tell())
    for key in ("truth", "alike", "lower", "upper"):
        told[key] = dict.fromkeys(MOTOR, 1.0)
    found = {"verdict": "ok", "parameters": {n: {"value": 1.0, "standard_error": 0.1} for n in MOTOR}}
    return {"told": told, "found": found, "effects": ["dry_friction"]} | more


def test_an_error_counts_in_bars_that_hold_all_that_is_uncertain():
    one = line()
    one["found"]["parameters"]["R"]["value"] = 1.5
    assert deviations(one)["R"] == pytest.approx(5.0)
    assert wrong_and_ok(one)
    one["found"]["parameters"]["R"]["uncertainty"] = 0.25
    assert deviations(one)["R"] == pytest.approx(2.0)
    assert not wrong_and_ok(one)
    one["found"]["parameters"]["R"]["status"] = "not identified"
    assert "R" not in deviations(one)


def test_the_motor_that_cannot_be_told_from_the_truth_is_right_too_but_not_half_of_each():
    one = line()
    one["told"]["alike"] = {name: 2.0 for name in MOTOR}
    for name in MOTOR:
        one["found"]["parameters"][name]["value"] = 2.0
    assert not wrong_and_ok(one)
    one["found"]["parameters"]["R"]["value"] = 1.0
    assert wrong_and_ok(one)


def test_a_parameter_that_changed_while_it_was_recorded_is_right_between_its_ends():
    one = line()
    one["told"]["lower"]["B"] = 0.5
    one["found"]["parameters"]["B"]["value"] = 0.6
    assert deviations(one)["B"] == 0.0
    one["found"]["parameters"]["B"]["value"] = 0.4
    assert deviations(one)["B"] == pytest.approx(1.0)


def test_a_parameter_that_changed_is_right_between_its_ends_of_the_motor_that_cannot_be_told_too():
    one = line()
    one["told"]["alike"] = {name: 2.0 for name in MOTOR}
    one["told"]["lower"]["B"] = 0.5
    for name in MOTOR:
        one["found"]["parameters"][name]["value"] = 2.0
    one["found"]["parameters"]["B"]["value"] = 1.2
    assert max(deviations(one).values()) == 0.0
    one["found"]["parameters"]["B"]["value"] = 0.9
    assert deviations(one)["B"] == pytest.approx(1.0)


def test_what_a_recording_could_not_show_does_not_name_a_trouble():
    one = line()
    one["found"]["notes"] = ["not visible in such a recording: a dry friction of up to 23 %"]
    assert not named(one)
    one["found"]["reasons"] = ["dry friction explains the recording better"]
    assert named(one)


def test_wilsons_interval_of_none_of_a_hundred():
    assert wilson(0, 100) == "0.0 % (0 of 100; 0.0–3.7)"
    assert wilson(0, 0) == "–"


def test_the_seeds_of_the_end_are_not_run_by_accident(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["combined.py", "--seeds", "1000000:1000001"])
    with pytest.raises(SystemExit) as end:
        combined.main()
    assert end.value.code == 2
    assert "kept unseen for the end" in capsys.readouterr().err


def test_a_run_writes_a_line_and_is_not_repeated(tmp_path, monkeypatch, capsys):
    def here(*arguments):
        monkeypatch.setattr(sys, "argv", ["combined.py", *arguments])
        combined.main()
        return capsys.readouterr()

    out = tmp_path / "dev.jsonl"
    done = here("--set", "good", "--seeds", "0:1", "--jobs", "1", "--out", str(out))
    (one,) = map(json.loads, out.read_text().splitlines())
    assert one["found"]["verdict"] in ("ok", "doubtful")
    assert set(one["found"]["parameters"]) == set(MOTOR)
    again = here("--set", "good", "--seeds", "0:1", "--jobs", "1", "--out", str(out))
    assert again.out == done.out and again.err == ""
    assert "| good, wrongly doubted or refused |" in here("--table", str(out)).out
