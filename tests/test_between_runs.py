"""The random effect between runs: against closed forms, and over seeds."""

import dataclasses

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import chi2, norm
from scipy.stats import t as student

from estimator import estimate_parameters, recording_from_arrays, simulate_fmu
from estimator.explaining.between_runs import between_runs, sentence

pytestmark = pytest.mark.usefixtures("shared_workers")

ROWS = 60


def slices(count):
    return [slice(ROWS * r, ROWS * (r + 1)) for r in range(count)]


def joint(jacobian, measured):
    """Return estimate and residuals of the joint least-squares fit."""
    theta = np.linalg.lstsq(jacobian, measured, rcond=None)[0]
    return theta, measured - jacobian @ theta


def design(rng, count, n=3):
    """Return a Jacobian whose runs differ: each drives the parameters otherwise."""
    return (
        rng.standard_normal((ROWS * count, n))
        @ (np.eye(n) + 0.3)
        * np.repeat(rng.uniform(0.5, 2, count), ROWS)[:, None]
    )


def test_one_parameter_alone_is_the_closed_form_of_dersimonian_and_laird():
    """Their w_i = 1 / s_i^2, Q = sum w (y - mean)^2, tau^2 = (Q - k + 1) / (sum w - sum w^2 / sum w)."""
    rng = np.random.default_rng(1)
    own, errors = np.array([1.0, 1.3, 0.7, 1.4]), np.array([0.02, 0.05, 0.03, 0.04])
    jacobian = np.repeat(1 / errors, ROWS)[:, None] / np.sqrt(ROWS)
    noise = rng.standard_normal((4, ROWS))
    noise -= noise.mean(axis=1)[:, None]  # so that the estimate of each run is its own value
    measured = (jacobian[:, 0].reshape(4, ROWS) * own[:, None] + noise).ravel()
    _, z = joint(jacobian, measured)
    found = between_runs(jacobian, z, slices(4), tested=[0])
    w = errors**-2
    q = np.sum(w * (own - np.sum(w * own) / w.sum()) ** 2)
    tau2 = (q - 3) / (w.sum() - np.sum(w**2) / w.sum())
    (only,) = found.variations
    assert only.deviation == pytest.approx(np.sqrt(tau2), rel=1e-9) and only.told
    few = (student.ppf(0.975, 3) / norm.ppf(0.975)) ** 2  # four runs: G.4.1 of GUM
    assert found.covariance[0, 0] == pytest.approx(few * tau2 * np.sum((w / w.sum()) ** 2), rel=1e-6)
    rest = np.array([1, 0, 1, 1], bool)  # the second run against the mean of the others, for one
    apart = own - np.array([np.sum((w * own)[np.arange(4) != r]) / w[np.arange(4) != r].sum() for r in range(4)])
    assert only.apart == pytest.approx(apart[only.run], rel=1e-9) and rest.sum() == 3


@pytest.mark.parametrize(
    ("seeds", "least", "most", "sure"), [(1000, 10, 86, 9), pytest.param(2000, 20, 150, 10, marks=pytest.mark.full)]
)
def test_runs_that_agree_are_told_to_differ_no_more_often_than_stated(seeds, least, most, sure):
    """Fits of 3 parameters in 4 runs: 5 % and 0.1 % of them by chance; above these bounds: below 1e-5."""
    entered = told = 0
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        jacobian = design(rng, 4)
        _, z = joint(jacobian, jacobian @ [1.0, -2.0, 0.5] + rng.standard_normal(4 * ROWS))
        found = between_runs(jacobian, z, slices(4), tested=[0, 1, 2]).variations
        entered += bool(found)
        told += any(v.told for v in found)
    assert least < entered < most and told < sure


def test_a_parameter_that_varies_is_found_of_the_right_size_and_the_bars_hold():
    """400 seeds, 5 runs, T ten errors of a run: mean T^2 within 18 % (5 of its errors, below 1e-6 by chance).

    Two bars hold 95 % of the estimates: of 400 fewer than 90 % by chance 1e-5. The other two parameters' squares of
    errors over bars have the median of chi-square, 0.455: one of 400 is outside 0.3 to 0.75 by chance below 1e-4.
    """
    squares, ratios, named = [], [], []
    truth = np.array([1.0, -2.0, 0.5])
    for seed in range(400):
        rng = np.random.default_rng(seed)
        jacobian = design(rng, 5)
        own = truth + np.outer(rng.standard_normal(5), [1.0, 0.0, 0.0])
        measured = np.einsum("rkn,rn->rk", jacobian.reshape(5, ROWS, 3), own).ravel() + rng.standard_normal(5 * ROWS)
        theta, z = joint(jacobian, measured)
        found = between_runs(jacobian, z, slices(5), tested=[0, 1, 2])
        named.append([v.parameter for v in found.variations if v.told])
        squares.append(sum(v.deviation**2 for v in found.variations if v.parameter == 0))
        covariance = np.linalg.inv(jacobian.T @ jacobian) + found.covariance
        ratios.append((theta - truth) ** 2 / np.diag(covariance))
    assert sum(names == [0] for names in named) >= 0.97 * 400
    assert np.mean(squares) == pytest.approx(1.0, rel=0.18)
    assert np.mean(np.array(ratios)[:, 0] < norm.ppf(0.975) ** 2) > 0.9
    assert np.all((np.median(ratios, axis=0)[1:] > 0.25) & (np.median(ratios, axis=0)[1:] < 0.75))


def test_a_recording_that_disagrees_is_named():
    rng = np.random.default_rng(3)
    jacobian = design(rng, 4)
    own = np.ones((4, 3))
    own[2, 1] = 2.0
    measured = np.einsum("rkn,rn->rk", jacobian.reshape(4, ROWS, 3), own).ravel() + rng.standard_normal(4 * ROWS)
    (found,) = between_runs(jacobian, joint(jacobian, measured)[1], slices(4), tested=[0, 1, 2]).variations
    assert (found.parameter, found.run, found.told) == (1, 2, True)
    assert found.apart == pytest.approx(1.0, abs=0.3)


def test_what_only_one_recording_tells_cannot_vary():
    rng = np.random.default_rng(4)
    jacobian = design(rng, 3)
    jacobian[ROWS:, 2] = 0.0
    _, z = joint(jacobian, 5 * rng.standard_normal(3 * ROWS))
    found = between_runs(jacobian, z, slices(3), tested=[2])
    assert found.variations == () and not found.covariance.any()
    assert between_runs(jacobian, z, slices(1), tested=[0]).variations == ()


def test_the_variation_is_told_with_its_size_and_the_recording():
    rng = np.random.default_rng(5)
    jacobian = np.repeat([50.0, 50.0], ROWS)[:, None] / np.sqrt(ROWS)
    measured = jacobian[:, 0] * np.repeat([0.0, np.log(1.2)], ROWS) + 0 * rng.random(2 * ROWS)
    (found,) = between_runs(jacobian, joint(jacobian, measured)[1], slices(2), tested=[0]).variations
    told = sentence(found, name="B", unit="N.m.s/rad", is_log=True, runs=["run1", "run2"])
    assert told.startswith("between runs B varies by 13 % (6.4 standard errors of one run): ")
    assert told.endswith(("run2 has it 20 % above run1", "run1 has it 17 % below run2"))
    told = sentence(found, name="x", unit="m", is_log=False, runs=["a", "b", "c"])
    assert told.startswith("between runs x varies by 0.13 m (") and told.endswith(" the others")
    far = dataclasses.replace(found, run=0, apart=2000.0)
    assert sentence(far, name="B", unit="", is_log=True, runs=["a", "b"]).endswith(" has it 1e+04 % and more above b")


def emulated(resistance, seed, *, k=0.05, inertia=2e-5, noise=(0.01, 0.3)):
    """Return a step of a motor of this resistance, in Ohm, exact and with white noise."""
    rng, n, h = np.random.default_rng(seed), 1200, 1e-3
    inductance, friction = 3e-3, 2e-5
    whole = np.zeros((3, 3))
    whole[:2, :2] = [[-resistance / inductance, -k / inductance], [k / inertia, -friction / inertia]]
    whole[0, 2] = 1 / inductance
    step = expm(whole * h)
    v, x = np.where(np.arange(n) < 200, 0.0, 10.0), np.zeros((n, 2))
    for j in range(n - 1):
        x[j + 1] = step[:2, :2] @ x[j] + step[:2, 2] * v[j]
    shown = x + rng.standard_normal((n, 2)) * noise
    signals = {"voltage [V]": v, "current [A]": shown[:, 0], "speed [rad/s]": shown[:, 1]}
    return recording_from_arrays(f"run_{seed}", np.arange(n) * h, signals)


@pytest.mark.parametrize("spread", [pytest.param(0.0, marks=pytest.mark.full), 0.02])
def test_a_resistance_that_differs_from_run_to_run_is_found_through_the_fmu(spread):
    ohms = 3.1 * (1 + spread * np.array([-0.83, -1.37, 0.32, 1.19, 0.69]))  # of deviation 1 about
    found = estimate_parameters([emulated(r, k) for k, r in enumerate(ohms, start=1)], workers=1)
    told = [note for note in (*found.notes, *found.reasons) if "between runs R varies" in note]
    r = found.parameters["R"]
    if spread:
        assert np.std(ohms, ddof=1) / 2 < r.repeatability < 2 * np.std(ohms, ddof=1)
        assert r.standard_error > np.std(ohms, ddof=1) / 2 / np.sqrt(5) and told
    else:
        assert r.repeatability == 0 and not told
    assert abs(r.value - np.mean(ohms)) < 3 * r.standard_error
    assert found.parameters["K"].repeatability == 0


def test_errors_that_runs_share_are_no_variation_between_them():
    """Of a gain of the input that all runs share, known to 10 %: Q as by the whole covariance."""
    rng = np.random.default_rng(8)
    jacobian = design(rng, 3)
    shared = 30 * jacobian @ [1.0, 0.5, -0.4]  # 30 errors of what stands for it, in each run as much
    shared = np.column_stack([shared, rng.standard_normal(len(shared))])
    measured = jacobian @ [1.0, -2.0, 0.5] + shared @ [0.9, -0.5] + rng.standard_normal(3 * ROWS)
    measured[:ROWS] += 0.4 * jacobian[:ROWS, 1]
    whole = np.linalg.inv(np.linalg.cholesky(np.eye(len(shared)) + shared @ shared.T))
    _, z = joint(whole @ jacobian, whole @ measured)
    left = np.linalg.solve(whole, z)
    found = between_runs(jacobian, left, slices(3), tested=[1], shared=shared)
    own = np.zeros((3 * ROWS, 3))
    for r, rows in enumerate(slices(3)):
        own[rows, r] = jacobian[rows, 1]
    fits = [whole @ np.column_stack([jacobian[:, [0, 2]], own]), whole @ jacobian]
    one, alike = (np.sum(joint(columns, whole @ measured)[1] ** 2) for columns in fits)
    (only,) = found.variations
    assert only.told and only.parameter == 1
    assert only.probability == pytest.approx(chi2.sf(alike - one, 2), rel=1e-6)


@pytest.mark.parametrize(
    ("changed", "by", "noise"),
    [
        ("J", 0.6, (0.002, 0.03)),
        ("K", -0.08, (0.01, 0.3)),
        *(
            pytest.param(*case, marks=pytest.mark.full)
            for case in (("J", 0.6, (0.01, 0.3)), ("K", -0.08, (0.002, 0.03)))
        ),
    ],
)
def test_a_run_with_another_part_is_told_by_that_part_alone(changed, by, noise):
    """To first order a large change left a misfit, for which nine other effects were told in two minutes."""
    own = {"k": 0.05 * (1 + by)} if changed == "K" else {"inertia": 2e-5 * (1 + by)}
    runs = [emulated(3.1, seed, noise=noise) for seed in (1, 2)] + [emulated(3.1, 3, noise=noise, **own)]
    found = estimate_parameters(runs, workers=1)
    (told,) = [words for words in (*found.reasons, *found.notes) if "between runs" in words]
    assert told.startswith(f"between runs {changed} varies") and "run_3 has it" in told
    away = float(told.split("has it ")[1].split(" %")[0])
    assert away == pytest.approx(abs(100 * by), rel=0.02)
    assert [n for n, p in found.parameters.items() if p.repeatability] == [changed]
    truth = {"R": 3.1, "L": 3e-3, "B": 2e-5, "K": 0.05, "J": 2e-5}
    for name in truth.keys() - {changed}:
        p = found.parameters[name]
        assert abs(p.value - truth[name]) < 4.5 * p.standard_error, (name, p)
        assert p.standard_error < 0.02 * p.value, "what differs is another parameter's"


def test_what_differs_between_runs_moves_only_itself_where_it_is_estimated_for_each():
    """The mean of k values of variance T^2 has T^2 / k; by a joint fit that shares them the others would move, too."""
    rng = np.random.default_rng(2)
    jacobian = design(rng, 4)
    changes = np.array([-0.5, 0.8, 0.3, -0.6])
    measured = jacobian @ np.ones(3) + jacobian[:, 1] * np.repeat(changes, ROWS) + rng.standard_normal(len(jacobian))
    _, z = joint(jacobian, measured)
    shared, each = (between_runs(jacobian, z, slices(4), tested=[0, 1, 2], estimated=e) for e in ((), (1,)))
    (one,), (other,) = shared.variations, each.variations
    assert one == other and one.parameter == 1
    assert each.covariance[1, 1] == pytest.approx((one.deviation * one.widened) ** 2 / 4)
    assert np.count_nonzero(each.covariance) == 1 and np.count_nonzero(shared.covariance) == 9


def test_dry_friction_differs_from_run_to_run_as_the_viscous_one_does():
    """Bearings that run warm or cold: shared by all runs, the dry one made B of one of them 25 % too large."""
    times, volts = np.arange(1400) * 1e-3, np.repeat([0.0, 5.0, 10.0], [100, 600, 700])
    motor, rubs = {"R": 2.0, "K": 0.05, "L": 3e-3, "J": 4e-5, "B": 5e-5}, (1.0, 1.06, 0.97)
    recordings = []
    for seed, times_as_much in enumerate(rubs):
        own = motor | {"B": 5e-5 * times_as_much, "friction": 0.012 * times_as_much}
        shown = simulate_fmu("dc_motor_friction", times=times, inputs={"v": volts}, parameters=own)
        rng = np.random.default_rng(seed)
        i, w = (shown[n] + s * rng.standard_normal(len(times)) for n, s in (("i", 0.01), ("w", 0.3)))
        columns = {"voltage [V]": volts, "current [A]": i, "speed [rad/s]": w}
        recordings.append(recording_from_arrays(f"run{seed + 1}", times, columns))
    result = estimate_parameters(recordings, workers=1)
    told = next(note for note in result.notes if note.startswith("between runs B"))
    assert result.verdict == "ok" and "run2 has it" in told and "above the others" in told, (result.reasons, told)
    assert not any(note.startswith("between runs") and note is not told for note in result.notes)
    apart = float(told.split("run2 has it ")[1].split(" %")[0])
    assert apart == pytest.approx(100 * (1.06 / 0.985 - 1), abs=0.5)
