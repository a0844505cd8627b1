"""Recordings of motors with dry friction whose case says so, and nothing more: what else they show is found too."""

import numpy as np
import pytest

from estimator import estimate_parameters, simulate_fmu

pytestmark = pytest.mark.usefixtures("shared_workers")

MOTOR = {"R": 2.2, "K": 0.0123, "L": 1.2e-3, "J": 1.75e-5, "B": 1.55e-6}
FRICTION, COUNTS = 1.2e-3, 2248
KNOWN = {name: MOTOR[name] for name in ("R", "L", "B")}
TIMES = 0.01 * np.arange(400)


def counted(bench, v, seed):
    """Return the speed, rad/s, (n,), as counts of an encoder in each row."""
    motion = simulate_fmu("dc_motor_drive", times=TIMES, inputs={"v": v}, parameters=MOTOR | bench)
    turns = motion["angle"] / (2 * np.pi) + np.random.default_rng(seed).uniform(0, 1)
    return np.diff(np.floor(turns * COUNTS), prepend=np.floor(turns[0] * COUNTS)) / 0.01 * 2 * np.pi / COUNTS


def off_by(result, truth):
    """Return by how many standard errors each parameter is off."""
    return {n: (result.parameters[n].value - x) / result.parameters[n].uncertainty for n, x in truth.items()}


@pytest.mark.parametrize("seed", [1, *(pytest.param(k, marks=pytest.mark.full) for k in range(2, 6))])
def test_a_friction_that_falls_with_the_speed_is_found_beside_the_declared_one(seed):
    """It was taken for a fan, ok, and K and friction were 5 standard errors off; now they are known 20 times better."""
    bench = {"friction": FRICTION, "stribeck_torque": 0.2 * FRICTION, "stribeck_speed": 13.0}
    rise = np.clip((TIMES - 0.3) / 0.5, 0, 1) * np.clip((3.2 - TIMES) / 0.6, 0, 1)
    v = np.round(255 * rise * 0.33) * 12 / 255
    result = estimate_parameters(
        time=TIMES, v=v, w=counted(bench, v, seed), fmu="dc_motor_friction", fix=KNOWN, workers=1
    )
    off = off_by(result, {"K": MOTOR["K"], "J": MOTOR["J"], "friction": FRICTION})
    assert "Stribeck friction" in result.effects and "fan load" not in result.effects, result.notes
    assert result.verdict == "ok" and max(map(abs, off.values())) < 4.5, (off, result.reasons)


def coasting(result_of):
    """Return the result of a motor with dry friction that is switched off, and coasts."""
    times = 1e-3 * np.arange(1500)
    v = np.where((times >= 0.05) & (times < 0.8), 9.0, 0.0)
    bench = {"friction": 0.004, "coasts": 1.0}
    motion = simulate_fmu("dc_motor_drive", times=times, inputs={"v": v}, parameters=MOTOR | bench)
    noise = np.random.default_rng(2)
    i, w = (motion[n] + noise.normal(0, deviation, len(v)) for n, deviation in (("i", 0.01), ("w", 0.3)))
    return result_of(time=times, v=v, i=i, w=w, workers=1)


@pytest.mark.parametrize(
    "said",
    [{}, pytest.param({"friction": 0.004}, marks=pytest.mark.full), {"stiction": 0.0}],
    ids=["free", "fixed", "no stiction"],
)
def test_a_drive_that_opens_the_circuit_is_told_whatever_of_the_friction_is_said(said):
    """With the declared friction nothing of the drive could be found: a short circuit brakes a motor that coasts."""
    result = coasting(lambda **given: estimate_parameters(fmu="dc_motor_friction", fix=said, **given))
    off = off_by(result, MOTOR)
    assert {"coasting", "one-way current"} & set(result.effects) and result.verdict == "ok", (
        result.notes,
        result.reasons,
    )
    assert max(map(abs, off.values())) < 4.5, off
    if "friction" not in said:
        assert abs(off_by(result, {"friction": 0.004})["friction"]) < 4.5


def test_a_drives_current_limit_that_is_asked_for_begins_where_the_current_is_held(tmp_path):
    """It began at the FMU's start, 1e9 A, which limits nothing, and was refused as what moves no signal."""
    times = 1e-3 * np.arange(1200)
    v = np.select([times < 0.05, times < 0.5, times < 0.9], [0.0, 9.0, -6.0], 4.0)
    bench = {"current_limit": 2.5, "friction": 0.003}
    motion = simulate_fmu("dc_motor_drive", times=times, inputs={"v": v}, parameters=MOTOR | bench)
    rng = np.random.default_rng(5)
    i, w = (motion[n] + rng.normal(0, deviation, len(v)) for n, deviation in (("i", 0.01), ("w", 0.3)))
    np.savetxt(
        tmp_path / "log.csv",
        np.column_stack([times, v, i, w]),
        delimiter=",",
        header="t [s],v [V],i [A],w [rad/s]",
        comments="",
    )
    free = "".join(f"{name} = {{}}\n" for name in (*MOTOR, *bench))
    (tmp_path / "motor.case.toml").write_text(
        f'[fmu]\npath = "dc_motor_drive"\n[parameters]\n{free}[[recording]]\nfile = "log.csv"\n'
    )
    result = estimate_parameters(tmp_path / "motor.case.toml", workers=1)
    off = off_by(result, MOTOR | bench)
    assert result.verdict == "ok" and max(map(abs, off.values())) < 4.5, (off, result.reasons)
