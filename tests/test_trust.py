"""A sample of the tables of docs/trust.md, with fixed seeds: the same recordings at every run.

`benchmarks/trust.py` makes the tables; here each line has a few recordings, and the long ones are `full`.
"""

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "benchmarks"))

import bound
from bound import cramer_rao, from_the_truth, likelihood
from paper_bench import CML050, MOTORS, NAMES, PAPER_BENCH, Bench, random_motor
from trust import TABLES, Hand, aliases, five_lost, named

from estimator.cases.case import Case, OutputSpec
from estimator.estimating.estimate import estimate_recordings

pytestmark = pytest.mark.usefixtures("shared_workers")

COLOURED = pytest.mark.xfail(reason="right, but doubted: neighbours are alike (+0.15)", strict=True)

PLAIN = Case(fmu="dc_motor", recordings=(Path("bench.csv"),), inputs={"v": "voltage"})


@pytest.fixture(scope="module")
def hand():
    hand = Hand()
    yield hand
    hand.crew.close()


def entries(hand, table, title, seeds):
    index = [row.title for row in TABLES[table].rows].index(title)
    return [hand.run((table, index, seed))[1] for seed in seeds]


def deviations(found):
    """Return errors over standard errors, (n, 5)."""
    return np.array([[(e["found"][n][0] - e["truth"][n]) / e["found"][n][1] for n in NAMES] for e in found])


def run(bench, seed=1, **changes):
    return estimate_recordings([dataclasses.replace(PLAIN, **changes)], [[bench.record(seed)]], workers=1)[0]


@pytest.mark.full
def test_the_bound_is_what_maximum_likelihood_from_the_truth_reaches():
    bench, errors = Bench(duration=1.5), []
    for seed in range(30):  # a ratio outside comes by chance less than once in 100 000 draws of 30
        recording = bench.record(seed)
        measured = np.column_stack([recording.signals["current"], recording.signals["speed"]])
        errors.append(np.log(from_the_truth(bench, measured)[0] / [CML050[n] for n in NAMES]))
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / cramer_rao(bench)
    assert np.all((ratio > 0.5) & (ratio < 1.6)), ratio


def test_a_free_delay_or_phase_only_raises_the_bound():
    for bench in (Bench(), dataclasses.replace(PAPER_BENCH, counts=True)):
        assert np.all(cramer_rao(bench, nuisances=["delay", "offset i"]) > cramer_rao(bench))


@pytest.mark.parametrize(
    ("motor", "seeds"),
    [("CML-050", [11]), *(pytest.param(m, [3, 11], marks=pytest.mark.full) for m in ("CML-050", "RMCS2004"))],
)
def test_encoder_counts_come_near_the_bound(hand, motor, seeds):
    found = entries(hand, "bound", f"{motor}, encoder counts", seeds)  # 11 stalls by one-sided differences
    errors = np.array([[np.log(e["found"][n][0] / e["truth"][n]) for n in NAMES] for e in found])
    assert np.all(np.sqrt(np.mean(errors**2, axis=0)) < 3 * cramer_rao(PAPER_BENCH_OF[motor]))


@pytest.mark.parametrize(
    ("motor", "seeds"),
    [*(pytest.param("CML-050", [k], marks=pytest.mark.full) for k in (116, 131)), ("RMCS2004", [113])],
)
def test_a_false_optimum_is_left_before_the_chain_could_explain_it(hand, motor, seeds):
    """Here the first search ends at L → 0, which a delay, a mean and a sag explain to 1.4 times the noise."""
    found = entries(hand, "bound", f"{motor}, encoder counts", seeds)
    assert [e["verdict"] for e in found] == ["ok"] * len(seeds)
    assert np.max(np.abs(deviations(found))) < 4


@pytest.mark.parametrize("motor", ["CML-050", pytest.param("RMCS2004", marks=pytest.mark.full)])
def test_counts_at_a_steady_speed_are_not_doubted(hand, motor):
    """Their errors repeat themselves there: taken for a colour of the noise, they made that of transients too small."""
    found = entries(hand, "coverage", f"{motor}, differenced counts", [0, 1, 4])
    assert [e["verdict"] for e in found] == ["ok"] * 3
    assert np.max(np.abs(deviations(found))) < 4


@pytest.mark.parametrize("motor", ["RMCS2004", pytest.param("CML-050", marks=pytest.mark.full)])
def test_the_papers_bench_behind_its_filter_is_not_doubted(hand, motor):
    """Behind a filter counts are lines at a steady speed, and nothing at rest: no colour, and no growth."""
    found = entries(hand, "bound", f"{motor}, filtered speed", [1, 3])
    assert [e["verdict"] for e in found] == ["ok"] * 2
    assert all(set(e["named"]) <= {"ripple"} for e in found)
    assert np.max(np.abs(deviations(found))) < 4


@pytest.mark.full  # that it is found: test_effects.py
def test_an_eccentric_encoder_moves_no_k():
    """By the angle that it shows its ripple has a mean that is not 0: K was 1.2e-3 off."""
    bench = Bench(current_noise=0.0, speed_noise=0.0, lines=100_000, duration=2.5)
    share = 0.05
    whole = dataclasses.replace(bench, speed_ripple=share * float(bench.response(np.array([2.0]))[1][0]), speed_order=1)
    found = run(whole)
    assert found.parameters["K"].value == pytest.approx(CML050["K"], rel=share**2 / 20)


@pytest.mark.full
def test_a_friction_that_drifts_stands_for_its_mean_over_the_turns():
    """The rest before the voltage is no part of it: with half a second of it B was 0.6 % too large."""
    found = run(Bench(drift=0.05, lines=1000))
    assert found.parameters["B"].value == pytest.approx(CML050["B"], rel=2e-3)


@pytest.mark.parametrize(
    ("motor", "seed"),
    [
        *(pytest.param("CML-050", seed, marks=pytest.mark.full) for seed in (8, 10, 21)),
        *(pytest.param("RMCS2004", seed, marks=pytest.mark.full) for seed in (1, 6)),
        pytest.param("RMCS2004", 4, marks=(pytest.mark.full, COLOURED)),
    ],
)
def test_a_mean_of_the_current_behind_a_ripple_is_told_as_a_mean(hand, motor, seed):
    """A lag has the better score, and a wrong form of a ripple a mean of the speed: a limit or friction made up for it.

    J was up to 9 % off, and doubted.
    """
    (found,) = entries(hand, "real", f"{motor}, real bench", [seed])
    assert found["verdict"] == "ok", found["reasons"]
    assert {"average", "ripple"} <= set(found["named"]) and not {"lag", "dry friction"} & set(found["named"])
    assert np.max(np.abs(deviations([found]))) < 4


@pytest.mark.full  # ten seconds each
@pytest.mark.parametrize("seed", [15, 19])
def test_a_ripple_that_is_seen_in_a_transient_only_is_no_motors(hand, seed):
    """No winding makes it: by a resistance alone R, K and J were 3.2 to 4.6 standard errors off."""
    found = entries(hand, "real", "CML-050, real bench", [seed])
    assert np.max(np.abs(deviations(found))) < 4


@pytest.mark.full
@pytest.mark.parametrize(
    ("motor", "seed"),
    [
        ("RMCS2004", 20),
        ("CML-050", 20),
        ("RMCS2004", 12),
    ],
)
def test_a_ripple_is_at_the_angle_where_the_shaft_is_when_the_current_is_sampled(hand, motor, seed):
    """Half a row before, as differenced counts tell it, a ripple of order 22 moved K and J by 3 to 6 errors."""
    found = entries(hand, "real", f"{motor}, real bench", [seed])
    assert np.max(np.abs(deviations(found))) < 3


@pytest.mark.full  # half a minute each
@pytest.mark.parametrize("seed", [194, 238])
def test_a_ripple_is_found_where_a_mean_takes_the_noise_at_another_order(hand, seed):
    """A mean over n samples leaves no noise at 1/n of the rate: an order there stands out however small it is."""
    found = entries(hand, "real", "RMCS2004, real bench", [seed])
    assert [set(e["named"]) for e in found] == [{"average", "delay", "drift", "ripple"}]
    assert np.max(np.abs(deviations(found))) < 4


@pytest.mark.full  # half a minute each
@pytest.mark.parametrize("seed", [247, 156])
def test_a_drift_beside_a_ripple_and_a_mean_is_taken_out_by_the_weights_of_the_fit(hand, seed):
    """By the weights from before the ripple was taken out R is 8 and 7 standard errors off."""
    found = entries(hand, "real", "RMCS2004, real bench", [seed])
    assert np.max(np.abs(deviations(found))) < 4


PAPER_BENCH_OF = {name: dataclasses.replace(PAPER_BENCH, motor=motor, counts=True) for name, motor in MOTORS.items()}


@pytest.mark.parametrize(
    ("table", "title"),
    [
        ("coverage", "CML-050, white noise"),
        pytest.param("coverage", "RMCS2004, differenced counts", marks=pytest.mark.full),
        pytest.param("real", "CML-050, real bench", marks=pytest.mark.full),
        pytest.param("robust", "delay 0–300 ms", marks=pytest.mark.full),
        ("robust", "offsets ±20 mA, ±1 rad/s"),
        ("robust", "1 % outliers"),
    ],
)
def test_errors_are_within_five_standard_errors(hand, table, title):
    found = entries(hand, table, title, [24])
    assert not [e for e in found if e["verdict"] == "refused"]
    assert np.max(np.abs(deviations(found))) < 5


@pytest.mark.full  # half a minute; of seed 194, above, all four are named; here the drift is left to the noise
def test_a_mean_that_is_not_found_yet_is_not_taken_for_lost_samples(hand):
    found = entries(hand, "real", "RMCS2004, real bench", [3])
    assert {"average", "delay", "ripple"} <= set(found[0]["named"]) <= {"average", "delay", "drift", "ripple"}
    assert np.max(np.abs(deviations(found))) < 5


LONG = {  # and what is asked instead by default
    "delay 5–250 ms": "one delay in test_nuisance.py",
    "current averaged over 2–5": "a mean of four in test_nuisance.py",
    "supply sags by 5 %, 30 ms": "a supply that sags in test_nuisance.py",
    "five samples lost": "half a minute at its full length; below, shorter",
    "gain of the current 0.9 or 1.1, B known": "below, of another seed, beside a dry friction",
}
ASKED = [pytest.param(r, marks=pytest.mark.full if r.title in LONG else ()) for r in TABLES["named"].rows if r.asked]


@pytest.mark.parametrize("row", ASKED, ids=lambda row: row.title)
def test_a_wrong_assumption_is_named(hand, row):
    found = entries(hand, "named", row.title, [3])[0]
    visible = row.title != "gain of the current 0.9 or 1.1"  # no recording tells it where nothing is known
    assert (row.asked in found["named"]) == visible


@pytest.mark.parametrize(("duration", "seed"), [(0.8, 5), pytest.param(0.9, 3, marks=pytest.mark.full)])
def test_five_lost_samples_are_named(duration, seed):
    assert "lost samples" in named(run(dataclasses.replace(five_lost(seed), duration=duration), seed))


def test_a_speed_that_agrees_with_the_angle_beside_it_is_not_accused(hand):
    """Over these seeds the gain's deviations are Student's t of 48 degrees: above 5 once in 60 000 draws of two."""
    found = entries(hand, "named", "good, angle logged beside the speed", [1, 2])
    assert [(e["verdict"], e["named"]) for e in found] == [("ok", [])] * 2


def test_a_gain_between_speed_and_angle_is_estimated_where_both_are_compared():
    outputs = {"i": OutputSpec("current"), "w": OutputSpec("speed"), "angle": OutputSpec("angle")}
    found = run(Bench(beside=True, speed_gain=0.95), outputs=outputs)
    gain = found.chain["gain w"]
    assert gain.value == pytest.approx(0.95, abs=5 * gain.standard_error) and gain.standard_error < 1e-3
    assert [r for r in found.reasons if "contradict each other" in r] == list(found.reasons)
    for name, value in CML050.items():
        assert abs(found.parameters[name].value - value) < 5 * found.parameters[name].standard_error
    sound = run(Bench(beside=True), outputs=outputs)
    assert sound.verdict == "ok" and set(sound.chain) == {"offset angle"}  # that an angle goes on is not unsettled


def test_a_gain_and_a_dry_friction_that_explain_a_recording_as_well_are_both_told(hand):
    found = entries(hand, "named", "gain of the current 0.9 or 1.1, B known", [2])[0]  # the friction by a little
    assert found["verdict"] == "doubtful" and set(found["named"]) == {"dry friction", "gain"}


def test_lost_samples_of_a_logger_that_averages_are_put_back():
    bench = Bench(average=2, clock_loss=(14, 5))  # on the wrong clock a mean of the speed and a delay are found
    result = run(bench, 2)
    assert result.reasons[0].startswith("5 samples seem to be missing before t = 0.514 s"), result.reasons
    assert not result.chain and result.sensors["i"]["average"] == 2 and result.sensors["w"]["sensor"] == "identity"
    for n in NAMES:
        assert abs(result.parameters[n].value - bench.motor[n]) < 5 * result.parameters[n].standard_error


def test_how_large_a_dry_friction_would_go_unnoticed_is_told():
    slow = {"R": 1.8, "K": 0.034, "L": 2.5e-3, "J": 1.2e-5, "B": 2e-5}  # L / R a tenth of the mechanical time constant
    for bench, least, most in ((Bench(), 0.1, 0.5), (Bench(motor=slow, voltage=6.0, coulomb=0.008), 0.2, 1.01)):
        found = run(bench)
        hidden = {h.effect: h for h in found.not_visible}
        friction = hidden["dry friction"]
        torque = bench.motor["B"] * float(np.nanmedian(found.comparisons[0].measured["w"][-100:])) + bench.coulomb
        assert least < friction.size / torque < most and found.verdict == "ok"
        assert friction.whatever_size == bool(bench.coulomb)  # what is there, unseen, is larger than the usual size
        how = "even if larger" if friction.whatever_size else "if no larger"
        (told,) = [note for note in found.notes if note.startswith(f"not visible {how} than this")]
        assert f"dry friction {friction.size:.2g} N.m (B +" in told


def test_the_scaled_information_is_that_of_the_closed_form():
    told = run(Bench()).information
    columns = np.column_stack([bound._sensitivity(Bench(), name) for name in NAMES])
    _, singular, rows = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    assert told["eigenvalues"] == pytest.approx(np.sort(singular**2), rel=0.1)
    assert abs(rows[-1] @ [told["least_told"][n] for n in NAMES]) > 0.99


def test_an_invisible_gain_is_said_to_be_invisible():
    assert any("J and B 1 % too large" in note for note in run(Bench()).notes)


def test_good_recordings_are_not_accused(hand):
    for entry in entries(hand, "named", "good", range(2)):
        assert (entry["verdict"], entry["named"]) == ("ok", [])


@pytest.mark.full  # that it is not refused: test_refusal.py
def test_a_fast_motor_is_estimated_from_few_samples():
    bench = Bench(motor=random_motor(130))  # 3 045 rad/s, hardly damped: one basin in fifty starts
    recording = bench.record(130)
    measured = np.column_stack([recording.signals["current"], recording.signals["speed"]])
    result = estimate_recordings([PLAIN], [[recording]], workers=1)[0]
    values = np.array([result.parameters[n].value for n in NAMES])
    # the noise is estimated, too, so that the optimum is another by a part of a standard error; other basins are far
    assert likelihood(bench, values, measured) < from_the_truth(bench, measured)[1] + 0.5


@pytest.mark.full
def test_an_aliased_motor_is_said_to_be():
    refused = {10, 12, 30, 73, 137, 193, 197}  # over within a sample
    seeds = [s for s in range(200) if aliases(random_motor(s))]
    assert refused < set(seeds)
    for seed in (12, next(s for s in seeds if s not in refused)):
        result = run(Bench(motor=random_motor(seed)), seed)
        told = "may be what is lost (aliasing)" if seed in refused else "the motor oscillates at"
        assert told in " ".join(result.reasons)
        assert all(p.status != "ok" for p in result.parameters.values())


@pytest.mark.parametrize(
    ("outputs", "untold", "missing"),
    [
        ({"w": OutputSpec("speed")}, {"R", "K", "L", "J", "B"}, "fix 2 of them (--fix NAME=VALUE), or record i, too"),
        ({"i": OutputSpec("current")}, {"K", "J", "B"}, "fix 1 of them (--fix NAME=VALUE), or record w or angle, too"),
    ],
)
def test_what_the_outputs_cannot_tell_is_said_before_the_search(outputs, untold, missing):
    result = run(Bench(duration=1.2), outputs=outputs)
    assert {n for n, p in result.parameters.items() if p.status == "not identified"} >= untold
    assert any("alone cannot tell" in reason and missing in reason for reason in result.reasons), result.reasons


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.full)])
def test_whether_a_friction_that_drifts_is_dry_or_viscous_is_in_the_errors(seed):
    """B drifts by a tenth: taken for a dry friction's drift alone, J was 2.1 standard errors off in both seeds."""
    result = run(Bench(drift=0.1), seed)
    wanders = any("wanders over" in note for note in result.notes)  # as likely in half a second
    assert "friction drift" in result.chain or wanders, result.notes
    assert abs(result.parameters["J"].value - CML050["J"]) < 1.2 * result.parameters["J"].standard_error


def test_a_coloured_noise_is_told_and_the_errors_allow_for_it():
    recording = Bench().record(5)
    noise = np.zeros(len(recording.time))
    draws = np.random.default_rng(5).standard_normal(len(noise))
    for k in range(1, len(noise)):
        noise[k] = 0.4 * noise[k - 1] + 0.02 * draws[k]
    signals = {**recording.signals, "current": recording.signals["current"] + noise}
    coloured = dataclasses.replace(recording, signals=signals)
    result = estimate_recordings([PLAIN], [[coloured]], workers=1)[0]
    assert result.verdict == "ok", result.reasons
    assert result.noise["i"] == pytest.approx(0.02 * np.sqrt(1 + 1 / (1 - 0.4**2)), rel=0.1)
    for n in NAMES:
        assert abs(result.parameters[n].value - CML050[n]) < 3 * result.parameters[n].standard_error


def test_an_offset_that_is_too_small_to_be_found_is_within_the_errors():
    result = run(Bench(current_offset=0.0025), 3)
    for n in NAMES:
        assert abs(result.parameters[n].value - CML050[n]) < 3 * result.parameters[n].standard_error


@pytest.mark.full
def test_two_hundred_good_recordings_are_not_refused_and_two_at_most_accused(hand):
    found = [e for name in MOTORS for e in entries(hand, "coverage", f"{name}, white noise", range(100))]
    assert not [e["seed"] for e in found if e["verdict"] == "refused"]
    assert sum(e["verdict"] != "ok" or bool(e["named"]) for e in found) <= 2


@pytest.mark.parametrize(
    "seeds", [[65, 128], pytest.param(range(200), marks=pytest.mark.full)], ids=["far from the first guess", "all"]
)
def test_random_motors_reach_the_optimum_and_none_is_falsely_sure(hand, seeds):
    found = entries(hand, "motors", "random motors", seeds)
    told = [e for e in found if e["verdict"] != "refused"]
    assert len(told) >= 0.94 * len(found)
    assert sum(e["reached"] < e["best"] + 0.05 for e in told) >= 0.97 * len(told)
    for e in found:
        for n in NAMES if e["found"] else ():
            value, error, status = e["found"][n]
            assert status != "ok" or abs(value - e["truth"][n]) < 5 * error, (e["seed"], n)
