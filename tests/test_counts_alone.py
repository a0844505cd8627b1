"""A speed from the counts of an encoder and no other noise: good recordings are not doubted, however it is printed."""

import numpy as np
import pytest
from scipy.signal import cont2discrete

from estimator.cases.case import Case, OutputSpec
from estimator.estimating.estimate import estimate_recordings
from estimator.recordings.quantum import quantum
from estimator.recordings.reading import recording_from_arrays

pytestmark = pytest.mark.usefixtures("shared_workers")

CASE = Case(inputs={"v": "voltage"}, outputs={"i": OutputSpec("current"), "w": OutputSpec("speed")})
TRUE = {"R": 1.2, "K": 0.05, "L": 2.5e-3, "J": 6e-5, "B": 5e-5}
STEP = 1e-3  # s
LEVELS = {"two levels": (0, 5, 10, 3), "step": (0, 10, 10), "reversal": (0, 10, -10), "back to zero": (0, 10, 0)}


def moved(v):
    """Return current and angle, (n, 2), of the motor by a voltage, (n,), that is held over each row."""
    p = TRUE
    a = np.array([[-p["R"] / p["L"], -p["K"] / p["L"], 0], [p["K"] / p["J"], -p["B"] / p["J"], 0], [0, 1, 0]])
    f, g, *_ = cont2discrete((a, np.array([[1 / p["L"]], [0], [0]]), np.eye(3), np.zeros((3, 1))), STEP)
    x, states = np.zeros(3), []
    for u in v:
        states.append(x)
        x = f @ x + g[:, 0] * u
    return np.array(states)[:, [0, 2]]


def counted(angle, lines, *, phase=0.3, digits=4):
    counts = np.floor(angle * lines / (2 * np.pi) + phase)
    return np.round(np.diff(counts, prepend=counts[0]) * 2 * np.pi / (lines * STEP), digits)


@pytest.mark.parametrize("lines", [1024, pytest.param(4096, marks=pytest.mark.full)])
@pytest.mark.parametrize("levels", LEVELS)
def test_a_slow_motor_behind_counts_is_estimated_and_not_doubted(levels, lines):
    """The speed settles slowly: the errors of counts there are nearly periodic, and in transients they are not."""
    v = np.repeat(np.array(LEVELS[levels], dtype=float), 500)
    i, angle = moved(v).T
    shown = np.round((i + 0.01 * np.random.default_rng(3).standard_normal(len(v))) * 409.6) / 409.6
    columns = {"voltage [V]": v, "current [A]": shown, "speed [rad/s]": counted(angle, lines)}
    found = estimate_recordings([CASE], [[recording_from_arrays("c", np.arange(len(v)) * STEP, columns)]], workers=1)[0]
    assert found.verdict == "ok" and found.effects == (), (found.reasons, found.effects)
    assert all(abs(found.parameters[n].value - TRUE[n]) < 5 * found.parameters[n].standard_error for n in TRUE)


@pytest.mark.parametrize("digits", [2, 4, 9])
def test_the_step_of_counts_that_are_printed_with_few_digits(digits):
    speed = counted(moved(np.full(1500, 10.0))[:, 1], 4096, digits=digits)
    true, range_ = 2 * np.pi / (4096 * STEP), np.ptp(speed)
    assert quantum(speed) == pytest.approx(true, abs=2 * 10.0**-digits * true / range_)


@pytest.mark.parametrize("step", [1.279, 5.884])
def test_a_step_that_few_digits_round_is_told_over_many_of_its_multiples(step):
    """Of 1.27 and 1.28, or 5.8 and 5.9, the smallest is a whole part of no larger one."""
    digits = 2 if step < 2 else 1
    speed = np.round(step * np.rint(230 * (1 - np.exp(-np.arange(600) / 40)) / step), digits)
    assert quantum(speed) == pytest.approx(step, rel=2e-3)


@pytest.mark.parametrize(("lines", "digits"), [(500, 6), (500, 7), (1000, 6), (1000, 7), (2000, 7)])
def test_counts_of_an_angle_that_is_printed_with_few_digits(lines, digits):
    """What the digits tell apart was taken for the count: residuals that were "no plain noise", of 18 in 40."""
    count = 2 * np.pi / lines
    angle = np.floor(moved(np.repeat([0.0, 10.0, 4.0], [100, 500, 500]))[:, 1] / count) * count
    printed = np.array([float(f"{x:.{digits}g}") for x in angle])
    assert quantum(printed) == pytest.approx(count, rel=0.02)


@pytest.mark.parametrize("digits", [6, 12])
@pytest.mark.parametrize(("cpr", "part"), [(500, 0.5), (2000, 0.1), (8192, 0.1)])
def test_counts_that_are_read_so_seldom_that_hardly_a_level_repeats(cpr, part, digits):
    """Of 40 rows of a speed its rounding was white noise, and that a filter: of eight recordings four were doubted."""
    count, v = 2 * np.pi / cpr, np.repeat([0.0, 5.0, 3.0], [8, 60, 32])
    angle = np.floor(part * moved(v)[:, 1] / count) * count  # behind a gear
    printed = np.array([float(f"{x:.{digits}g}") for x in angle])
    assert len(np.unique(printed)) > 0.6 * len(v) and quantum(printed) == pytest.approx(count, rel=1e-3)


@pytest.mark.parametrize("seed", range(20))
def test_a_few_samples_with_noise_are_on_no_lattice(seed):
    rng, t = np.random.default_rng(seed), np.linspace(0, 1, 50)
    signals = 10 * (1 - np.exp(-5 * t)), np.sin(9 * t), 3 * t
    for y in (*signals, *(y + 0.05 * rng.standard_normal(50) for y in signals)):
        assert quantum(y) == 0


@pytest.mark.parametrize("cpr", [1336, 8192])
def test_counts_of_a_motor_that_is_never_seen_to_move_by_one_of_them(cpr):
    """The nearest samples are many counts apart: 12 of 37 encoders had no step that way, and a filter was told."""
    count, v = 2 * np.pi / cpr, np.repeat([0.0, 10.0, 7.0], [8, 200, 192])
    angle = np.floor(moved(v)[:, 1] / count) * count
    shown = np.array([float(f"{x:.8g}") for x in angle])
    first = int(np.argmax(shown > 20 * count))
    assert np.min(np.diff(np.unique(shown[first:]))) > 1.5 * count
    assert quantum(shown[first:]) == pytest.approx(count, rel=1e-3)
