"""Models with modes: dry friction that holds and lets go, against solve_ivp from event to event."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import fmpy
import numpy as np
import pytest
from dry_friction import DryMotor
from fmu_instances import ERROR, FmuInstance, Opened, status
from numpy.typing import NDArray

import fmu_build
from fmu_build.sources import find_source

pytestmark = pytest.mark.usefixtures("compiled_quickly")
FAN = Path(__file__).parent / "models" / "dc_motor_friction_fan.c"
OUTPUTS = ("i", "w", "angle")
MOTOR = {"R": 3.1363, "K": 0.048774, "L": 0.01307, "J": 9e-6, "B": 5e-5}
DRY = MOTOR | {"friction": 0.01, "stiction": 0.004, "brush": 0.6}
FREE = MOTOR | {"friction": 0.0, "stiction": 0.0, "brush": 0.0}

# V: up and down in steps through zero, a step up, a reversal; N.m: a load that pulls both ways
LEVELS = [0, 0.5, 1, 2, 3, 6, 3, 1, 0.5, 0, -0.5, -1, -3, -6, 6, -6, 2, 0, 0, 10.5, 10.5, -10.5, 0]
LOADS = [0] * 12 + [0.02, 0.02, 0, -0.03, 0, 0.061, -0.057, 0, 0.043, 0, 0]


@pytest.fixture(scope="module")
def opened() -> Iterator[Opened]:
    with Opened(fmu_build.bundled("dc_motor_friction")) as opened:
        yield opened


@pytest.fixture
def motor(opened: Opened) -> FmuInstance:
    return opened.instance()


def held(levels: list[float], *, steps: int) -> list[float]:
    return [float(level) for level in levels for _ in range(steps)]


def difference(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Return the largest difference over the other's peak, of the worst signal."""
    return float((np.abs(one - other).max(axis=0) / np.abs(other).max(axis=0)).max())


@pytest.mark.parametrize(
    ("changes", "step"),
    [
        pytest.param({}, 5e-3, id="all at once"),
        pytest.param({}, 1e-3, id="at 1 ms"),
        pytest.param({"stiction": 0.0, "brush": 0.0}, 2e-3, id="Coulomb friction alone"),
        pytest.param({"friction": 0.0, "stiction": 0.0}, 2e-3, id="brushes alone"),
        pytest.param({"friction": 0.03, "stiction": 0.02, "B": 0.0}, 2e-3, id="strong friction, never free below 3 V"),
        pytest.param({"L": 5e-4, "brush": 2.0}, 2e-3, id="carbon brushes, little inductance"),
        pytest.param({"J": 1e-6, "R": 1.0}, 5e-3, id="swinging"),
    ],
)
def test_dry_friction_agrees_with_solve_ivp_from_event_to_event(
    motor: FmuInstance, changes: dict[str, float], step: float
) -> None:
    p = DRY | changes
    v, load = held(LEVELS, steps=5), held(LOADS, steps=5)
    motor.start(**p)
    found = motor.run({"v": v, "load": load}, OUTPUTS, step=step)
    expected = DryMotor(p).response(v, load, step=step)
    assert difference(found, expected) < 1e-9  # 1e-6 is asked for
    if p["friction"]:
        still = expected[:, 1] == 0
        assert still.sum() > 10 and np.array_equal(found[:, 1] == 0, still)  # to the last bit


@pytest.mark.full
def test_dry_friction_agrees_with_solve_ivp_for_many_motors(motor: FmuInstance) -> None:
    rng = np.random.default_rng(1)
    for _ in range(60):
        p = {name: float(value * 10 ** rng.uniform(-0.5, 0.5)) for name, value in DRY.items()}
        v, load = rng.uniform(-6, 6, 12).repeat(5).tolist(), rng.uniform(-0.03, 0.03, 12).repeat(5).tolist()
        step = float(10 ** rng.uniform(-3, -2))
        motor.fmi.reset()
        motor.start(**p)
        found = motor.run({"v": v, "load": load}, OUTPUTS, step=step)
        assert difference(found, DryMotor(p).response(v, load, step=step)) < 1e-8, p


def test_margins_of_which_nothing_is_told_give_the_same_bits(tmp_path: Path, motor: FmuInstance) -> None:
    text = find_source("dc_motor_friction").read_text().replace("= dry_friction", "= untold")
    untold = """#include "model.h"
static Switch untold(double mode, double x, double push, double hold)
{
    Switch s = dry_friction(mode, x, push, hold);
    s.linear = s.most = 0;
    return s;
}"""
    model = tmp_path / "untold.c"
    model.write_text(text.replace('#include "model.h"', untold))
    v, load = held(LEVELS, steps=5), held(LOADS, steps=5)
    motor.start(**DRY)
    found = motor.run({"v": v, "load": load}, OUTPUTS, step=2e-3)
    with Opened(fmu_build.build(model, output=tmp_path / "untold.fmu")) as opened:
        other = opened.instance()
        other.start(**DRY)
        assert np.array_equal(other.run({"v": v, "load": load}, OUTPUTS, step=2e-3), found)


def test_what_is_kept_of_modes_inputs_and_steps_changes_no_bit(motor: FmuInstance) -> None:
    """A state that is restored before every step keeps nothing."""
    rng = np.random.default_rng(4)
    v = np.array(LEVELS).repeat(20) + rng.choice([0.0, 0.0, 0.3, -6.0], 20 * len(LEVELS))
    steps = rng.choice([3e-4, 7e-4, 1e-3, 2e-3, 5e-3], len(v))
    runs = []
    for restores in (False, True):
        motor.fmi.reset()
        motor.start(**DRY)
        shown, now = [], 0.0
        for level, step in zip(v, steps, strict=True):
            motor.set(v=level)
            if restores:
                state = motor.fmi.getFMUState()
                motor.fmi.setFMUState(state)
                motor.fmi.freeFMUState(state)
            motor.step(now, step)
            now += step
            shown.append(motor.get(*OUTPUTS))
        runs.append(np.array(shown))
    assert np.array_equal(*runs)


def test_modes_of_a_model_that_is_not_linear_agree_with_solve_ivp(tmp_path: Path) -> None:
    p = DRY | {"drag": 1e-6}
    v, load = held(LEVELS, steps=2), held(LOADS, steps=2)
    with Opened(fmu_build.build(FAN, output=tmp_path / "fan.fmu")) as opened:
        fan = opened.instance()
        fan.start(**p)
        found = fan.run({"v": v, "load": load}, OUTPUTS, step=5e-3)
    assert difference(found, DryMotor(p, drag=1e-6).response(v, load, step=5e-3)) < 1e-8


def test_long_steps_of_a_model_that_is_not_linear_see_what_short_steps_see(tmp_path: Path) -> None:
    """Inputs that had changed since the last step did not change its modes."""
    rng = np.random.default_rng(0)
    with Opened(fmu_build.build(FAN, output=tmp_path / "fan.fmu")) as opened:
        fan = opened.instance()
        for _ in range(5):
            v, load, runs = rng.uniform(-4, 4, 30), rng.uniform(-0.02, 0.02, 30), []
            for parts in (1, 10):
                fan.fmi.reset()
                fan.start(**DRY, drag=1e-6)
                signals = {"v": list(v.repeat(parts)), "load": list(load.repeat(parts))}
                runs.append(fan.run(signals, OUTPUTS, step=5e-3 / parts)[parts - 1 :: parts])
            assert difference(runs[0], runs[1]) < 1e-7


def test_without_friction_and_brushes_it_is_dc_motor(motor: FmuInstance) -> None:
    v = held(LEVELS, steps=5)
    with Opened(fmu_build.bundled("dc_motor")) as free:
        plain = free.instance()
        plain.start(**MOTOR, load=0.01)
        expected = plain.run({"v": v}, OUTPUTS, step=1e-3)
    motor.start(**FREE, load=0.01)
    assert difference(motor.run({"v": v}, OUTPUTS, step=1e-3), expected) < 1e-12


@pytest.mark.parametrize(
    "changes",
    [
        {"J": 1e-6, "R": 0.5, "B": 0.0},
        {"L": 1e-9},
        *(pytest.param(change, marks=pytest.mark.full) for change in ({}, {"L": 1e-6}, {"L": 0.1})),
    ],
    ids=str,
)
def test_long_steps_see_every_standstill_that_short_steps_see(motor: FmuInstance, changes: dict[str, float]) -> None:
    rng = np.random.default_rng(2)
    p, v, load = DRY | changes, rng.uniform(-4, 4, 40), rng.uniform(-0.02, 0.02, 40)
    runs = []
    for parts in (1, 7, 350):
        motor.fmi.reset()
        motor.start(**p)
        signals = {"v": list(v.repeat(parts)), "load": list(load.repeat(parts))}
        runs.append(motor.run(signals, OUTPUTS, step=35e-3 / parts)[parts - 1 :: parts])
    assert difference(runs[0], runs[2]) < 1e-9 and difference(runs[1], runs[2]) < 1e-9


def swings(motor: FmuInstance, *, v: list[float], step: float, **changes: float) -> tuple[NDArray[np.float64], float]:
    """Return what a motor that swings at 28 000 rad/s shows, and the least processor time of three runs, s."""
    spent = []
    for _ in range(3):
        motor.fmi.reset()
        motor.start(**DRY | {"R": 0.1, "K": 1.5, "L": 2e-3, "J": 1.4e-6, "B": 1e-6} | changes)
        begun = time.process_time()
        shown = motor.run({"v": v}, OUTPUTS, step=step)
        spent.append(time.process_time() - begun)
    return shown, min(spent)


@pytest.mark.parametrize("changes", [{}, {"brush": 0.0}, {"friction": 0.0, "stiction": 0.0, "brush": 0.01}], ids=str)
def test_a_step_of_many_swings_shows_what_short_steps_show(motor: FmuInstance, changes: dict[str, float]) -> None:
    v = np.array([4.0, 5.0, -3.0, -3.1, 0.0, 1.0])
    long, _ = swings(motor, v=v.tolist(), step=0.01, **changes)
    short, _ = swings(motor, v=v.repeat(200).tolist(), step=0.01 / 200, **changes)
    assert difference(long, short[199::200]) < 1e-9


def test_a_step_of_a_thousand_swings_costs_little_more_than_one_of_few(motor: FmuInstance) -> None:
    v = [5.0, 5.1] * 100
    assert swings(motor, v=v, step=0.3)[1] < 4 * swings(motor, v=v, step=1e-5)[1]


def test_a_held_motor_breaks_away_at_the_current_that_it_takes(motor: FmuInstance) -> None:
    p = DRY | {"brush": 0.0}
    current = (p["friction"] + p["stiction"]) / p["K"]
    motor.start(**p, v=current * p["R"] * (1 - 1e-9))
    motor.run({"v": [current * p["R"] * (1 - 1e-9)] * 100}, OUTPUTS, step=0.01)
    assert motor.get("w", "angle", "motion") == [0.0, 0.0, 0.0]
    rows = motor.run({"v": [current * p["R"] * (1 + 1e-6)] * 100}, OUTPUTS, step=0.01, start=1.0)
    assert rows[-1, 1] > 1 and motor.get("motion") == [1.0]


def test_state_set_in_initialisation_is_the_mode_that_it_starts_in(motor: FmuInstance) -> None:
    motor.fmi.setupExperiment()
    motor.fmi.enterInitializationMode()
    motor.set(**DRY, w=100.0, i=0.5)
    assert motor.get("w", "motion", "conduction") == [100.0, 1.0, 1.0]
    motor.set(w=-50.0)
    assert motor.get("w", "i", "motion") == [-50.0, 0.5, -1.0]
    motor.set(w=0.0, i=0.0, v=0.5)
    assert motor.get("motion", "conduction", "der(i)") == [0.0, 0.0, 0.0]
    motor.set(v=0.7)
    assert motor.get("conduction", "der(i)") == [1.0, pytest.approx(0.1 / DRY["L"])]
    motor.fmi.exitInitializationMode()
    assert status(motor.set, motion=1.0) == ERROR


def test_restored_state_of_a_motor_at_standstill_repeats_itself_to_the_bit(opened: Opened, motor: FmuInstance) -> None:
    v = held([3, 0.2, 0.2, 5, -5, 0, 0, 0, 0], steps=7)
    motor.start(**DRY)
    motor.run({"v": v}, OUTPUTS, step=2e-3)
    assert motor.get("w", "motion") == [0.0, 0.0]
    state = motor.fmi.getFMUState()
    serialised = motor.fmi.serializeFMUState(state)
    first = motor.run({"v": v}, OUTPUTS, step=1e-3)
    motor.fmi.setFMUState(state)
    assert np.array_equal(motor.run({"v": v}, OUTPUTS, step=1e-3), first)
    other = opened.instance()
    other.fmi.setFMUState(other.fmi.deSerializeFMUstate(serialised))
    assert np.array_equal(other.run({"v": v}, OUTPUTS, step=1e-3), first)
    motor.fmi.freeFMUState(state)


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_solver_that_follows_the_event_indicators_gets_what_co_simulation_gets(tmp_path: Path, fmi: int) -> None:
    fmu = fmu_build.build("dc_motor_friction", output=tmp_path / "motor.fmu", fmi=fmi)
    levels = [0.0, 2.0, 6.0, 0.5, -6.0, 6.0, 0.0]  # V
    times = [0.05 * k for k in range(len(levels) + 1)]
    rows = [(t, v) for k, v in enumerate(levels) for t in (times[k], times[k + 1])]
    signal = np.array(rows, dtype=[("time", float), ("v", float)])
    runs = [
        fmpy.simulate_fmu(
            str(fmu),
            fmi_type=kind,
            input=signal,
            output=["i", "w", "angle", "motion"],
            stop_time=times[-1],
            output_interval=1e-3,
            relative_tolerance=1e-10,
            start_values=DRY,
            logger=None,
        )
        for kind in ("CoSimulation", "ModelExchange")
    ]
    stepped, solved = (np.array([run[name] for name in OUTPUTS]).T for run in runs)
    solved = solved[np.searchsorted(runs[1]["time"], runs[0]["time"] - 1e-9)]  # there are rows at events too
    assert (runs[1]["w"] == 0).sum() > 50  # held by the mode, not by chance
    assert {-1.0, 0.0, 1.0} == set(runs[1]["motion"])
    assert difference(solved, stepped) < 1e-6


def test_modes_that_change_without_end_are_an_error(tmp_path: Path) -> None:
    model = tmp_path / "restless.c"
    model.write_text("""/* Never content. */
#define MODEL_LINEAR 1
#define MODEL_VARIABLES(X) \\
    X(input, v, 0, 1, -1, 1, "V", "Drives it") \\
    X(state, x, 0, 1, -1, 1, "1", "Position") \\
    X(mode, way, 1, 1, -1, 1, "1", "Way")
#include "model.h"
static void derivatives(const Variables *m, Derivatives *d) { d->x = m->v; }
static void switches(const Variables *m, Switches *s) { s->way = (Switch){m->v > 0.5 ? -1 : 1 + 0 * m->x, -m->way}; }
static void enter(Variables *m) { (void)m; }
""")
    with Opened(fmu_build.build(model, output=tmp_path / "restless.fmu")) as opened:
        logs: list[tuple[int, str, str]] = []
        instance = opened.instance(logs=logs)
        instance.start()
        instance.step(0.0, 0.1)
        instance.set(v=1.0)
        assert status(instance.step, 0.1, 0.1) == ERROR
        assert logs == [(ERROR, "logStatusError", "the step from 0.1 s did not end in a finite state")]
        instance.fmi.reset()
        assert status(instance.start, v=1.0) == ERROR
        assert logs[-1][2] == "the modes of the model change without end"
