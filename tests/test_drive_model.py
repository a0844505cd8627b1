"""dc_motor_drive: what drives and supplies do, against solve_ivp from event to event; nothing where nothing is set."""

from __future__ import annotations

from collections.abc import Iterator

import fmpy
import numpy as np
import pytest
from driven_motor import NEUTRAL, DrivenMotor
from fmu_instances import FmuInstance, Opened
from numpy.typing import NDArray

import fmu_build
from estimator.cases.case import Case
from estimator.commands.drive import instants
from estimator.estimating.estimate import estimate_recordings
from estimator.fmus.simulate import simulate
from estimator.recordings.reading import recording_from_arrays

OUTPUTS = ("i", "w", "angle")
MOTOR = {"R": 3.1363, "K": 0.048774, "L": 0.01307, "J": 9e-6, "B": 1.69e-4}
EFFECTS = {
    "friction": {"friction": 0.01, "stiction": 0.004},
    "Stribeck": {"friction": 0.01, "stribeck_torque": 0.004, "stribeck_speed": 40.0},
    "steep Stribeck": {"friction": 0.003, "stiction": 0.002, "stribeck_torque": 0.01, "stribeck_speed": 15.0},
    "brush": {"brush": 0.6},
    "limit": {"current_limit": 1.3},
    "limit that gives way": {"current_limit": 1.3, "limit_slope": 0.02},
    "limit that gives way and brushes": {"current_limit": 0.9, "limit_slope": 0.3, "brush": 0.6},
    "dead band": {"dead_band": 1.5},
    "coasting": {"coasts": 1.0},
    "one way": {"one_way": 1.0},
    "one way and brushes": {"one_way": 1.0, "brush": 0.6, "dead_band": 0.7},
    "buffered supply": {"supply_resistance": 0.8, "supply_time": 0.02},
    "unbuffered supply": {"supply_resistance": 0.8},
    "amplifier": {"supply_resistance": 0.8, "supply_time": 0.02, "supply_series": 1.0},
    "amplifier with a dead band": {
        "supply_resistance": 0.8,
        "supply_time": 0.02,
        "supply_series": 1.0,
        "dead_band": 1.5,
    },
    "regulated supply": {"supply_resistance": -0.8, "supply_time": 0.02},
}
EXCITATIONS = {  # V, each level for 60 ms
    "step": [0, 10.5, 10.5],
    "two levels": [0, 6, 10.5, 3],
    "reversal": [0, 10.5, -10.5, 10.5],
    "back to zero": [0, 10.5, 0, 0, -6, 0],
    "small and large": [0, 1, -1, 8, 1, -1, 0.4, -8, 0],
}


@pytest.fixture(scope="module")
def opened() -> Iterator[Opened]:
    with Opened(fmu_build.bundled("dc_motor_drive")) as opened:
        yield opened


@pytest.fixture
def motor(opened: Opened) -> FmuInstance:
    return opened.instance()


def held(levels: list[float], *, steps: int) -> list[float]:
    return [float(level) for level in levels for _ in range(steps)]


def difference(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Return the largest difference over the other's peak, of the worst signal."""
    return float((np.abs(one - other).max(axis=0) / np.abs(other).max(axis=0)).max())


def check(
    motor: FmuInstance, p: dict[str, float], v: list[float], load: list[float], *, step: float
) -> NDArray[np.float64]:
    motor.start(**p)
    found = motor.run({"v": v, "load": load}, OUTPUTS, step=step)
    expected = DrivenMotor(p).response(v, load, step=step)
    assert difference(found, expected[:, :3]) < 2e-9
    return found


@pytest.mark.parametrize("excitation", EXCITATIONS)
@pytest.mark.parametrize("effect", EFFECTS)
def test_each_effect_agrees_with_solve_ivp_from_event_to_event(
    motor: FmuInstance, effect: str, excitation: str
) -> None:
    v = held(EXCITATIONS[excitation], steps=15)
    check(motor, MOTOR | EFFECTS[effect], v, [0.0] * len(v), step=4e-3)


@pytest.mark.parametrize("excitation", EXCITATIONS)
@pytest.mark.parametrize(
    "effects",
    [
        pytest.param(("friction", "brush", "limit"), id="friction, brush, limit"),
        pytest.param(("coasting", "dead band", "brush", "limit"), id="coasting, dead band, brush, limit"),
        pytest.param(("coasting", "brush", "Stribeck"), id="coasting, brush, Stribeck"),
        pytest.param(("buffered supply", "limit", "friction"), id="supply, limit, friction"),
        pytest.param(("friction", "brush", "limit", "dead band", "coasting", "buffered supply"), id="all"),
        pytest.param(("friction", "one way", "limit", "dead band", "buffered supply"), id="one way, and all"),
    ],
)
def test_effects_together_agree_with_solve_ivp(motor: FmuInstance, effects: tuple[str, ...], excitation: str) -> None:
    p = MOTOR.copy()
    for effect in effects:
        p |= EFFECTS[effect]
    v = held(EXCITATIONS[excitation], steps=15)
    load = [
        0.02 if k % 40 > 30 else 0.0 for k in range(len(v))
    ]  # it lets a current fall below its limit, and rise again
    check(motor, p, v, load, step=4e-3)


@pytest.mark.full
def test_all_effects_agree_with_solve_ivp_for_many_motors(motor: FmuInstance) -> None:
    rng = np.random.default_rng(1)
    for _ in range(60):
        p = {name: float(value * 10 ** rng.uniform(-0.5, 0.5)) for name, value in MOTOR.items()}
        for effect in rng.permutation(list(EFFECTS))[: rng.integers(1, 6)]:
            p |= {
                name: value * (1 if name in ("coasts", "one_way", "supply_series") else rng.uniform(0.5, 2))
                for name, value in EFFECTS[effect].items()
            }
        v, load = rng.uniform(-9, 9, 12).round(0).repeat(5).tolist(), rng.uniform(-0.03, 0.03, 12).repeat(5).tolist()
        step = float(10 ** rng.uniform(-3, -2))
        motor.fmi.reset()
        motor.start(**p)
        found = motor.run({"v": v, "load": load}, OUTPUTS, step=step)
        assert difference(found, DrivenMotor(p).response(v, load, step=step)[:, :3]) < 1e-7, p


@pytest.mark.parametrize("step", [1e-4, 1e-3, 10e-3])
@pytest.mark.parametrize("excitation", [*EXCITATIONS, "prbs"])
def test_with_nothing_set_it_is_dc_motor(motor: FmuInstance, excitation: str, step: float) -> None:
    levels = (
        list(np.random.default_rng(3).choice([-10.5, 10.5], 200)) if excitation == "prbs" else EXCITATIONS[excitation]
    )
    v = held(levels, steps=1 if excitation == "prbs" else 30)
    with Opened(fmu_build.bundled("dc_motor")) as free:
        plain = free.instance()
        plain.start(**MOTOR, load=0.01)
        expected = plain.run({"v": v}, OUTPUTS, step=step)
    motor.start(**MOTOR, load=0.01)
    assert difference(motor.run({"v": v}, OUTPUTS, step=step), expected) < 1e-12  # 1e-9 is asked for


def test_with_friction_and_brushes_alone_it_is_dc_motor_friction(motor: FmuInstance) -> None:
    p = MOTOR | EFFECTS["friction"] | EFFECTS["brush"]
    v = held(EXCITATIONS["small and large"], steps=50)
    with Opened(fmu_build.bundled("dc_motor_friction")) as dry:
        plain = dry.instance()
        plain.start(**p)
        expected = plain.run({"v": v}, OUTPUTS, step=1e-3)
    motor.start(**p)
    assert difference(motor.run({"v": v}, OUTPUTS, step=1e-3), expected) < 1e-12


def test_a_limited_current_stays_at_its_limit_to_the_last_bit_and_leaves_it_by_itself(motor: FmuInstance) -> None:
    motor.start(**MOTOR, current_limit=1.3, v=10.5)
    i = motor.run({"v": [10.5] * 200}, OUTPUTS, step=1e-3)[:, 0]
    at_limit = np.flatnonzero(i == 1.3)
    assert np.max(i) == 1.3 and len(at_limit) > 5 and np.array_equal(np.diff(at_limit), np.ones(len(at_limit) - 1))
    assert i[-1] < 1.0 and motor.get("limiting") == [0.0]


def test_a_coasting_motor_has_no_current_at_once_and_slows_by_its_friction_alone(motor: FmuInstance) -> None:
    motor.start(**MOTOR, coasts=1, dead_band=0.2)
    running = motor.run({"v": [10.0] * 300}, OUTPUTS, step=1e-3)
    rows = motor.run({"v": [0.2] * 100}, OUTPUTS, step=1e-3, start=0.3)
    assert running[-1, 0] > 0.1 and not rows[:, 0].any()
    times = 1e-3 * np.arange(1, 101)
    assert rows[:, 1] == pytest.approx(running[-1, 1] * np.exp(-times * MOTOR["B"] / MOTOR["J"]), rel=1e-9)
    assert motor.run({"v": [0.21]}, OUTPUTS, step=1e-3, start=0.4)[0, 0] < 0  # closed again, it generates


@pytest.mark.parametrize(
    ("name", "at"),
    [
        ("friction", 0.01),
        ("stiction", 0.004),
        ("stribeck_torque", 0.004),
        ("stribeck_speed", 40.0),
        ("brush", 0.6),
        ("current_limit", 1.3),
        ("supply_resistance", 0.8),
        ("supply_time", 0.02),
        ("R", 3.1363),
        ("J", 9e-6),
    ],
)
def test_signals_change_smoothly_with_each_parameter(motor: FmuInstance, name: str, at: float) -> None:
    """Differences over steps of 1e-6 and 1e-5 of a parameter agree: instants of events are exact, not rounded."""
    p = MOTOR.copy()
    for effect in ("friction", "Stribeck", "brush", "limit", "buffered supply"):
        p |= EFFECTS[effect]
    assert p[name] == at
    v = held(EXCITATIONS["reversal"], steps=60)

    def shown(value: float) -> NDArray[np.float64]:
        motor.fmi.reset()
        motor.start(**p | {name: value})
        return motor.run({"v": v}, ("i", "w"), step=1e-3)

    slopes = [(shown(at * (1 + h)) - shown(at * (1 - h))) / (2 * h) for h in (1e-6, 1e-5)]
    changed = np.sqrt(np.mean(slopes[0] ** 2, axis=0))
    assert np.all(changed > 0) and np.all(np.sqrt(np.mean((slopes[1] - slopes[0]) ** 2, axis=0)) < 1e-4 * changed)


def test_a_solver_that_follows_the_event_indicators_gets_what_co_simulation_gets() -> None:
    p = MOTOR | EFFECTS["friction"] | EFFECTS["limit"] | EFFECTS["buffered supply"] | EFFECTS["coasting"]
    levels = EXCITATIONS["back to zero"]
    times = [0.06 * k for k in range(len(levels) + 1)]
    rows = [(t, v) for k, v in enumerate(levels) for t in (times[k], times[k + 1])]
    runs = [
        fmpy.simulate_fmu(
            str(fmu_build.bundled("dc_motor_drive")),
            fmi_type=kind,
            input=np.array(rows, dtype=[("time", float), ("v", float)]),
            output=[*OUTPUTS, "command", "limiting", "limiting_back"],
            stop_time=times[-1],
            output_interval=1e-3,
            relative_tolerance=1e-10,
            start_values=p,
            logger=None,
        )
        for kind in ("CoSimulation", "ModelExchange")
    ]
    stepped, solved = (np.array([run[name] for name in OUTPUTS]).T for run in runs)
    solved = solved[np.searchsorted(runs[1]["time"], runs[0]["time"] - 1e-9)]  # there are rows at events too
    assert set(runs[1]["command"]) == {-1.0, 0.0, 1.0}
    assert set(runs[1]["limiting"]) == set(runs[1]["limiting_back"]) == {0.0, 1.0}
    assert difference(solved[:, 1:], stepped[:, 1:]) < 1e-6


def random_drive(rng: np.random.Generator) -> tuple[dict[str, float], float]:
    """Return parameters of a drive with some of the effects, and a communication step, s, both over wide ranges."""
    p = {name: float(value * 10 ** rng.uniform(-1, 1)) for name, value in MOTOR.items()}
    p["L"] *= 10 ** rng.uniform(-4, 0)
    sizes = {"friction": 0.005, "stiction": 0.005, "brush": 0.6, "current_limit": 0.5, "dead_band": 1.0}
    p |= {name: float(size * 10 ** rng.uniform(-1, 0.5)) for name, size in sizes.items() if rng.random() < 0.6}
    if rng.random() < 0.5:
        p["coasts"] = 1.0
    if rng.random() < 0.4:
        p["supply_resistance"] = p["R"] * float(rng.uniform(0.01, 0.5))
    return p, float(10 ** rng.uniform(-4, -1.7))


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.full) for k in range(1, 12))])
def test_long_steps_of_a_drive_see_all_changes_that_short_steps_see(motor: FmuInstance, seed: int) -> None:
    """A current that shot over its limit and came back within a step, to or from the other sign, was not seen."""
    rng = np.random.default_rng(seed)
    for _ in range(50):
        p, step = random_drive(rng)
        v, load, runs = rng.uniform(-6, 6, 30), rng.uniform(-0.02, 0.02, 30), []
        for parts in (1, 40):
            motor.fmi.reset()
            motor.start(**p)
            signals = {"v": list(v.repeat(parts)), "load": list(load.repeat(parts))}
            runs.append(motor.run(signals, OUTPUTS, step=step / parts)[parts - 1 :: parts])
        scale = np.maximum(np.abs(runs[1]).max(axis=0), 1e-12)
        assert np.all(np.abs(runs[0] - runs[1]) < 1e-8 * scale), (p, step)


def test_restored_state_of_a_limited_motor_repeats_itself_to_the_bit(opened: Opened, motor: FmuInstance) -> None:
    p = MOTOR | EFFECTS["limit"] | EFFECTS["buffered supply"] | EFFECTS["friction"]
    motor.start(**p)
    motor.run({"v": [10.5] * 8}, OUTPUTS, step=1e-3)
    assert motor.get("i", "limiting", "command", "conduction") == [1.3, 1.0, 1.0, 2.0]
    state = motor.fmi.getFMUState()
    first = motor.run({"v": held([10.5, -10.5, 0], steps=30)}, OUTPUTS, step=1e-3)
    motor.fmi.setFMUState(state)
    assert np.array_equal(motor.run({"v": held([10.5, -10.5, 0], steps=30)}, OUTPUTS, step=1e-3), first)
    motor.fmi.freeFMUState(state)


def test_parameters_set_between_steps_take_effect_at_once(motor: FmuInstance) -> None:
    """A friction that comes on the way acts against the motion, whatever the way was before it came."""
    motor.start(**MOTOR)
    motor.run({"v": held([10.5, -10.5], steps=100)}, OUTPUTS, step=1e-3)
    before = motor.get("w")[0]
    assert before < -100 and motor.get("motion") == [2.0]
    motor.set(friction=0.002)
    after = motor.run({"v": [-10.5] * 200}, OUTPUTS, step=1e-3, start=0.2)[-1, 1]
    assert motor.get("motion") == [-1.0] and before < after < 0.8 * before


@pytest.mark.parametrize("fixed", [{}, NEUTRAL], ids=["as it is", "all fixed"])
def test_a_recording_of_dc_motor_gives_its_parameters_again(fixed: dict[str, float]) -> None:
    times = instants(stop=0.3, step=1e-3)
    v = np.where(times >= 0.02 - 1e-9, 10.5, 0.0)
    shown = simulate("dc_motor", parameters=MOTOR, inputs={"v": v}, times=times)
    signals = {"v [V]": v, "i [A]": shown["i"], "w [rad/s]": shown["w"]}
    measured = recording_from_arrays("run", times, signals)
    (estimate,) = estimate_recordings([Case(fmu="dc_motor_drive", fixed={"friction": 0.0} | fixed)], [[measured]])
    for name, value in MOTOR.items():
        assert estimate.parameters[name].value == pytest.approx(value, rel=1e-6), name
