"""Model exchange, directional derivatives, dependencies in FMI 2.0 and 3.0: against the equations by hand."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from ctypes import POINTER, c_double, cast
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi2 import FMU2Model
from fmpy.fmi3 import FMU3Model
from fmu_instances import DISCARD, ERROR, OK, status
from numpy.typing import NDArray

import fmu_build

pytestmark = pytest.mark.usefixtures("compiled_quickly")

MODELS = Path(__file__).parent / "models"
LINEAR_PART = {"dc_motor": ("i", "w", "angle"), "dc_motor_elastic": ("w2", "angle2", "i", "w", "angle")}


class Exchanged:
    """One instance for model exchange, in event mode, the same to use in both versions of FMI."""

    def __init__(self, folder: str, *, start: float = 0.0) -> None:
        self.description = fmpy.read_model_description(folder)
        self.version = int(self.description.fmiVersion[0])
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        derivatives = [v for v in self.description.modelVariables if v.derivative is not None]
        self.states = [v.derivative.name for v in derivatives]
        kind = FMU2Model if self.version == 2 else FMU3Model
        self.fmi: Any = kind(
            guid=self.description.guid if self.version == 2 else self.description.instantiationToken,
            unzipDirectory=folder,
            modelIdentifier=self.description.modelExchange.modelIdentifier,
            instanceName="motor",
        )
        self.fmi.instantiate()
        if self.version == 2:
            self.fmi.setupExperiment(startTime=start)
            self.fmi.enterInitializationMode()
        else:
            self.fmi.enterInitializationMode(startTime=start)
        self.fmi.exitInitializationMode()

    def set(self, **values: float) -> None:
        put = self.fmi.setReal if self.version == 2 else self.fmi.setFloat64
        put([self.references[name] for name in values], list(values.values()))

    def get(self, *names: str) -> list[float]:
        get = self.fmi.getReal if self.version == 2 else self.fmi.getFloat64
        return list(get([self.references[name] for name in names]))

    def update(self) -> tuple[bool, ...]:
        answer = self.fmi.newDiscreteStates() if self.version == 2 else self.fmi.updateDiscreteStates()
        return tuple(bool(value) for value in answer)

    def move(self, states: Sequence[float]) -> None:
        self.fmi.setContinuousStates((c_double * len(states))(*states), len(states))

    def vector(self, what: str) -> list[float]:
        values = (c_double * len(self.states))()
        if what == "derivatives" and self.version == 3:
            what = "continuousStateDerivatives"
        getattr(self.fmi, f"get{what[0].upper()}{what[1:]}")(cast(values, POINTER(c_double)), len(values))
        return list(values)

    def directional(self, unknowns: Sequence[str], seeds: dict[str, float]) -> list[float]:
        references = ([self.references[name] for name in names] for names in (unknowns, seeds))
        return list(self.fmi.getDirectionalDerivative(*references, list(seeds.values())))

    def jacobian(self, unknowns: Sequence[str], knowns: Sequence[str]) -> NDArray[np.float64]:
        return np.array([self.directional(unknowns, {known: 1.0}) for known in knowns]).T

    def free(self) -> None:
        getattr(self.fmi, f"fmi{self.version}FreeInstance")(self.fmi.component)


@pytest.fixture(scope="module", params=[2, 3], ids=["FMI2", "FMI3"])
def make(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Callable[..., Exchanged]]:
    """Return what makes instances of a model, by its name."""
    folders: dict[str, str] = {}
    made: list[Exchanged] = []

    def instance(name: str, **keywords: float) -> Exchanged:
        if name not in folders:
            output = tmp_path_factory.mktemp(name) / f"{name}.fmu"
            own = MODELS / f"{name}.c"
            fmu_build.build(own if own.is_file() else name, output=output, fmi=request.param)
            folders[name] = fmpy.extract(str(output))
        made.append(Exchanged(folders[name], **keywords))
        return made[-1]

    yield instance
    for one in made:
        one.free()
    for folder in folders.values():
        shutil.rmtree(folder)


def fan_by_hand(p: dict[str, float]) -> tuple[dict[str, float], dict[tuple[str, str], float]]:
    """Return the fan's derivatives and outputs, and all their partial derivatives that are not zero."""
    bent = abs(p["w"])
    rates = {
        "der(i)": (p["v"] - p["R"] * p["i"] - p["K"] * p["w"]) / p["L"],
        "der(w)": (p["K"] * p["i"] - p["B"] * p["w"] - p["drag"] * p["w"] * bent) / p["J"],
        "power": p["v"] * p["i"],
        "torque": p["drag"] * p["w"] * bent,
    }
    slopes = {
        ("der(i)", "v"): 1 / p["L"],
        ("der(i)", "R"): -p["i"] / p["L"],
        ("der(i)", "i"): -p["R"] / p["L"],
        ("der(i)", "K"): -p["w"] / p["L"],
        ("der(i)", "w"): -p["K"] / p["L"],
        ("der(i)", "L"): -rates["der(i)"] / p["L"],
        ("der(w)", "K"): p["i"] / p["J"],
        ("der(w)", "i"): p["K"] / p["J"],
        ("der(w)", "B"): -p["w"] / p["J"],
        ("der(w)", "w"): (-p["B"] - 2 * p["drag"] * bent) / p["J"],
        ("der(w)", "drag"): -p["w"] * bent / p["J"],
        ("der(w)", "J"): -rates["der(w)"] / p["J"],
        ("power", "v"): p["i"],
        ("power", "i"): p["v"],
        ("torque", "w"): 2 * p["drag"] * bent,
        ("torque", "drag"): p["w"] * bent,
        ("w", "w"): 1.0,
        ("i", "i"): 1.0,
    }
    return rates, slopes


POINTS = [
    {"i": 1.5, "w": 120.0, "v": 9.0},
    {"i": -0.02, "w": -35.0, "v": -24.0, "L": 1e-6, "drag": 3e-5},
    {"i": 30.0, "w": 0.7, "v": 0.0, "J": 1e-3, "B": 0.0, "R": 0.05},
]


@pytest.mark.parametrize("point", POINTS)
def test_derivatives_and_their_derivatives_are_those_of_the_equations(
    make: Callable[..., Exchanged], point: dict[str, float]
) -> None:
    fan = make("dc_motor_fan")
    names = [v.name for v in fan.description.modelVariables if v.name != "time"]
    assert fan.states == ["w", "i"]
    fan.set(**{name: value for name, value in point.items() if name not in ("i", "w")})
    assert not any(fan.update())
    fan.fmi.enterContinuousTimeMode()
    fan.move([point["w"], point["i"]])
    values = dict(zip(names, fan.get(*names), strict=True))
    assert point.items() <= values.items()
    rates, slopes = fan_by_hand(values)
    for name, rate in rates.items():
        assert values[name] == pytest.approx(rate, rel=1e-14)
    assert fan.vector("derivatives") == [values["der(w)"], values["der(i)"]]
    unknowns, knowns = [*rates, "i", "w"], ["v", "i", "w", "R", "K", "L", "J", "B", "drag"]
    jacobian = fan.jacobian(unknowns, knowns)
    for row, unknown in enumerate(unknowns):
        # rounding of the largest term, over the way that the differences go
        terms = max(abs(slopes.get((unknown, known), 0.0) * values[known]) for known in knowns)
        for column, known in enumerate(knowns):
            expected = slopes.get((unknown, known), 0.0)
            room = 1e-12 * terms / (abs(values[known]) or 1e-2)
            assert jacobian[row, column] == pytest.approx(expected, rel=1e-10, abs=room), (unknown, known)
    seeds = dict(zip(knowns, [1.0, -2.0, 30.0, 0.1, -1e-3, 1e-9, 1e-7, 1e-5, 1e-8], strict=True))
    directional = fan.directional(unknowns, seeds)
    scales = np.abs(jacobian) @ np.abs(list(seeds.values()))
    assert np.all(np.abs(directional - jacobian @ list(seeds.values())) <= 1e-8 * scales)


@pytest.mark.parametrize("name", LINEAR_PART)
def test_derivatives_by_the_states_of_a_linear_model_are_exact(make: Callable[..., Exchanged], name: str) -> None:
    motor = make(name)
    motor.update()
    motor.fmi.enterContinuousTimeMode()
    motor.set(v=7.3, load=0.01)
    states = LINEAR_PART[name]
    rates = [f"der({state})" for state in states]
    somewhere = motor.jacobian(rates, states)
    motor.move([3.7, -2e5, 0.1, 1e3, 1e-7][: len(states)])
    assert np.array_equal(motor.jacobian(rates, states), somewhere)
    p = dict(zip("RKLJB", motor.get(*"RKLJB"), strict=True))
    damping = motor.get("damping")[0] if "damping" in motor.references else 0.0
    for row, column, value in [
        ("i", "i", -p["R"] / p["L"]),
        ("i", "w", -p["K"] / p["L"]),
        ("w", "i", p["K"] / p["J"]),
        ("w", "w", -(p["B"] + damping) / p["J"]),
        ("angle", "w", 1.0),
        ("angle", "angle", 0.0),
    ]:
        assert somewhere[states.index(row), states.index(column)] == pytest.approx(value, rel=1e-15)


def test_adjoint_derivatives_are_the_transposed_ones(make: Callable[..., Exchanged]) -> None:
    fan = make("dc_motor_fan")
    if fan.version == 2:
        pytest.skip("FMI 3.0 only")
    fan.set(v=3.0)
    unknowns, knowns, seed = ["der(i)", "power", "w"], ["v", "i", "w", "R"], [0.3, -2.0, 5.0]
    references = [[fan.references[name] for name in names] for names in (unknowns, knowns)]
    adjoint = fan.fmi.getAdjointDerivative(*references, seed, nSensitivity=4)
    assert list(adjoint) == pytest.approx(list(fan.jacobian(unknowns, knowns).T @ seed), rel=1e-12, abs=1e-12)
    assert status(fan.fmi.getAdjointDerivative, *references, seed[:2], nSensitivity=4) == ERROR
    assert status(fan.fmi.getDirectionalDerivative, *references, seed) == ERROR


@pytest.mark.parametrize("name", ["dc_motor", "dc_motor_fan", "dc_motor_elastic", "dc_motor_geared", "pmsm_dq"])
def test_declared_dependencies_are_those_that_derivatives_show(make: Callable[..., Exchanged], name: str) -> None:
    motor = make(name)
    kinds = {v.name: v.causality for v in motor.description.modelVariables}
    settable = [n for n, causality in kinds.items() if causality in ("input", "parameter")]
    inputs = [n for n in settable if kinds[n] == "input"]
    knowns = [*settable, *motor.states]
    structure = motor.description
    declared = {
        "outputs": (structure.outputs, lambda n: kinds[n] != "parameter"),
        "derivatives": (structure.derivatives, lambda n: kinds[n] != "parameter"),
        "initial": (structure.initialUnknowns, lambda n: True),
    }
    rng = np.random.default_rng(3)
    moved = {u.variable.name: set[str]() for unknowns, _ in declared.values() for u in unknowns}
    assert set(moved) == set(kinds) - set(settable) - {"time"}
    for _ in range(4):
        motor.set(**{n: v * rng.uniform(0.5, 2) for n, v in zip(settable, motor.get(*settable), strict=True)})
        motor.set(**{n: rng.uniform(-10, 10) for n in inputs})
        motor.update()
        motor.fmi.enterContinuousTimeMode()
        motor.move(list(rng.uniform(-10, 10, len(motor.states))))
        jacobian = motor.jacobian(list(moved), knowns)
        motor.fmi.enterEventMode()
        scale = np.abs(jacobian * np.abs(motor.get(*knowns))).max(axis=1)
        for row, unknown in enumerate(moved):
            there = np.abs(jacobian[row] * np.abs(motor.get(*knowns))) > 1e-9 * scale[row]
            moved[unknown] |= {known for column, known in enumerate(knowns) if there[column]}
    for unknowns, counts in declared.values():
        for unknown in unknowns:
            expected = {n for n in moved[unknown.variable.name] if counts(n)}
            assert {known.name for known in unknown.dependencies} == expected, unknown.variable.name


def test_declared_dependencies_of_a_model_with_modes_are_those_that_changes_show(
    make: Callable[..., Exchanged],
) -> None:
    """In all modes, what changes when one variable is changed; in initialisation, the modes follow."""
    motor = make("dc_motor_friction")
    kinds = {v.name: v.causality for v in motor.description.modelVariables}
    settable = [n for n, causality in kinds.items() if causality in ("input", "parameter")]
    knowns = [n for n in settable if kinds[n] == "input"] + motor.states
    rates = [f"der({state})" for state in motor.states]
    margins = ["margin_of_motion", "margin_of_conduction"]
    rng = np.random.default_rng(4)
    usual = dict(zip(settable, motor.get(*settable), strict=True))
    seen: dict[str, set[str]] = {name: set() for name in rates + margins}
    at_start: dict[str, set[str]] = {name: set() for name in rates}
    for _ in range(400):
        point = {"v": rng.uniform(-3, 3), "load": rng.uniform(-0.02, 0.02), "stiction": 0.01, "brush": 1.0}
        states = rng.choice([-1.0, 0.0, 1.0], len(motor.states)) * rng.uniform(0.01, 1, len(motor.states))
        start = dict(zip(motor.states, map(float, states), strict=True))

        def begun(values: dict[str, float]) -> None:
            motor.fmi.reset()
            motor.set(**values)
            if motor.version == 2:
                motor.fmi.setupExperiment(startTime=0.0)
                motor.fmi.enterInitializationMode()
            else:
                motor.fmi.enterInitializationMode(startTime=0.0)

        base = usual | point | start
        begun(base)
        here = dict(zip(rates, motor.get(*rates), strict=True))
        known = str(rng.choice(list(base)))
        changed = base | {known: base[known] * 1.5 + (0.004 if known in ("v", "load", "i", "w", "angle") else 0.0)}
        begun(changed)
        for name, value in zip(rates, motor.get(*rates), strict=True):
            if value != here[name]:
                at_start[name].add(known)
        if known not in knowns:
            continue
        begun(base)
        motor.fmi.exitInitializationMode()
        motor.update()
        motor.fmi.enterContinuousTimeMode()
        before = motor.get(*seen)
        if known in motor.states:
            motor.move([changed[state] for state in motor.states])
        else:
            motor.set(**{known: changed[known]})
        for name, old, new in zip(seen, before, motor.get(*seen), strict=True):
            if old != new:
                seen[name].add(known)
    declared = {u.variable.name: {k.name for k in u.dependencies} for u in motor.description.derivatives}
    assert {name: seen[name] for name in rates} == declared
    initial = {u.variable.name: {k.name for k in u.dependencies} for u in motor.description.initialUnknowns}
    assert at_start == initial
    if motor.version == 3:
        indicators = {u.variable.name: {k.name for k in u.dependencies} for u in motor.description.eventIndicators}
        assert {name: seen[name] for name in margins} == indicators


@pytest.mark.parametrize("name", ["dc_motor", "dc_motor_fan", "dc_motor_elastic"])
def test_a_solver_gets_what_co_simulation_gets(make: Callable[..., Exchanged], name: str) -> None:
    folder = make(name).fmi.unzipDirectory
    step = np.array([(0.0, 0.0), (0.1, 0.0), (0.1, 10.5), (0.4, 10.5)], dtype=[("time", float), ("v", float)])
    results = [
        fmpy.simulate_fmu(
            folder,
            fmi_type=kind,
            input=step,
            stop_time=0.4,
            output_interval=1e-3,
            relative_tolerance=1e-10,
            start_values={"load": 0.0} if name != "dc_motor_fan" else {},
            logger=None,
        )
        for kind in ("CoSimulation", "ModelExchange")
    ]
    for column in LINEAR_PART.get(name, ("i", "w")):
        stepped, solved = (np.interp(np.linspace(0, 0.4, 400), r["time"], r[column]) for r in results)
        assert np.abs(stepped - solved).max() <= 2e-6 * np.abs(stepped).max()


def test_modes_of_model_exchange_allow_what_fmi_allows(make: Callable[..., Exchanged]) -> None:
    motor = make("dc_motor", start=2.0)
    fmi, states = motor.fmi, [1.0, 2.0, 3.0]
    assert motor.vector("nominalsOfContinuousStates") == [1.0, 100.0, 1.0]
    assert status(motor.move, states) == ERROR  # in event mode
    assert status(fmi.completedIntegratorStep) == ERROR
    assert status(motor.set, R=2.0) == OK
    assert status(motor.set, i=2.0) == ERROR
    assert not any(motor.update())
    fmi.enterContinuousTimeMode()
    assert status(fmi.enterContinuousTimeMode) == ERROR
    assert status(motor.update) == ERROR
    fmi.setTime(2.5)
    assert status(fmi.setTime, np.nan) == status(fmi.setTime, 1e10) == ERROR
    motor.move(states)
    assert status(motor.move, [1.0, np.nan, 0.0]) == DISCARD
    assert status(motor.move, states[:2]) == ERROR
    assert motor.vector("continuousStates") == motor.get("i", "w", "angle") == states
    assert status(motor.set, R=3.0) == ERROR
    assert status(motor.set, v=5.0) == OK
    assert motor.get("R", "v") == [2.0, 5.0]
    if motor.version == 3:
        assert motor.get("time") == [2.5]
        assert fmi.getNumberOfContinuousStates() == 3 and fmi.getNumberOfEventIndicators() == 0
    assert not any(map(bool, fmi.completedIntegratorStep()))
    state = fmi.getFMUState()
    motor.move([0.0, 0.0, 0.0])
    fmi.setFMUState(state)
    assert motor.vector("continuousStates") == states
    fmi.freeFMUState(state)
    fmi.enterEventMode()
    assert status(fmi.enterEventMode) == ERROR
    fmi.terminate()
    assert motor.vector("continuousStates") == states
    assert status(motor.set, v=5.0) == ERROR
    fmi.reset()
    assert motor.get("i", "w", "angle", "R") == [0.0, 0.0, 0.0, 3.1363]


def test_derivative_that_is_not_finite_is_discarded(make: Callable[..., Exchanged]) -> None:
    fan = make("dc_motor_fan")
    fan.update()
    fan.fmi.enterContinuousTimeMode()
    fan.move([1e200, 0.0])
    assert status(fan.vector, "derivatives") == DISCARD
    assert status(fan.get, "der(w)") == ERROR
    assert status(fan.directional, ["der(w)"], {"w": 1.0}) == DISCARD
    fan.move([1.0, 0.0])
    assert np.isfinite(fan.vector("derivatives")).all()


def test_directional_derivative_of_what_is_none_is_an_error(make: Callable[..., Exchanged]) -> None:
    fan = make("dc_motor_fan")
    for unknown, known in [("v", "i"), ("R", "i"), ("i", "power"), ("i", "der(i)")]:
        assert status(fan.directional, [unknown], {known: 1.0}) == ERROR
    assert status(fan.directional, ["der(i)"], {"i": np.nan}) == ERROR
    assert fan.directional(["der(i)"], {}) == [0.0]
