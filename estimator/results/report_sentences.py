"""What an estimate says in sentences, for text and page alike. Knows only the result; computes nothing new."""

from __future__ import annotations

import math
from collections.abc import Mapping

from estimator.conventions import NUMERICAL
from estimator.results.numbers import counted, finite_text, number_text
from estimator.results.phases import PHASES
from estimator.results.result import Estimate, OtherValues, Validation, Verdict

TITLES: Mapping[Verdict, str] = {"ok": "OK", "doubtful": "Doubtful", "refused": "Refused"}
MEANINGS: Mapping[Verdict, str] = {
    "ok": "Every free parameter is identified",
    "doubtful": "An estimate with known weaknesses; read the reasons before using it.",
    "refused": "No estimate that could be relied on.",
}
SMALL = "the residuals are as small as the noise"
ALIKE = 1.2  # residuals over noise: up to that they are called as small


def meaning(estimate: Estimate) -> str:
    """Return what the verdict means, in a sentence or two; of residuals no other than the table of the fit shows."""
    if estimate.verdict != "ok":
        return MEANINGS[estimate.verdict]
    free = [p for p in estimate.parameters.values() if p.free]
    larger = _above_sample_noise(estimate)
    if free and all(p.standard_error is None for p in free):
        told = f"the residuals pass as noise ({larger})" if larger else SMALL
        return f"{told[0].upper()}{told[1:]}; this method gives no standard errors."
    if not larger:
        return f"{MEANINGS['ok']}, and {SMALL}.{_guessed_speed(estimate)}"
    return (
        f"{MEANINGS['ok']}, and the residuals pass as noise that grows with the motion or"
        f" wanders ({larger}); the standard errors hold it.{_guessed_speed(estimate)}"
    )


def _above_sample_noise(estimate: Estimate) -> str:
    """Say how much larger the residuals are than the noise that the recording alone shows; "" where they are not.

    Of a simulation's own output neither is any noise.
    """
    times = []
    for name, rmse in estimate.rmse.items():
        shown = estimate.sample_noise.get(name, math.nan)
        found = estimate.noise.get(name, rmse)
        is_exact = 100 - estimate.fit_percent.get(name, math.nan) < 100 * NUMERICAL
        if found > ALIKE * shown and not is_exact:
            size = f"{number_text(found / shown, digits=2)} times" if shown else "far above"
            times.append(f"those of {name} {size}")
    if not times:
        return ""
    return f"{', '.join(times)} the noise that the recording alone shows, at rest or from sample to sample"


def _guessed_speed(estimate: Estimate) -> str:
    """Say what depends on the unit of a speed or angle that nobody said: any unit fits as well."""
    for read in estimate.read:
        for signal, told in read.get("signals", {}).items():
            names = [n for n in ("K", "J", "B") if n in estimate.parameters]
            if names and signal in ("w", "angle") and told["unit_from"] == "name":
                return f" {', '.join(names)} hold if {told['column']!r} is in {told['unit']}, which nobody said."
    return ""


def read_lines(estimate: Estimate) -> list[str]:
    """Return what was read of each recording, those that were read alike in one line."""
    named: dict[str, list[str]] = {}
    for read in estimate.read:
        named.setdefault(str(read["text"]), []).append(str(read["recording"]))
    return [f"read {', '.join(names)}: {text}" for text, names in named.items()]


def about_line(estimate: Estimate) -> str:
    """Return what the user says of the estimate, in a line."""
    return ", ".join(f"{name} {value}" for name, value in estimate.about.items())


def cost_lines(estimate: Estimate) -> list[str]:
    """Return sentences about what the estimate cost and how it was made."""
    by_phase = estimate.simulations_by_phase.items()
    phases = ", ".join(f"{count} {PHASES.get(phase, phase)}" for phase, count in by_phase if count)
    fmu = str(estimate.fmu.get("name", "")) or "unknown FMU"
    kind, restart = estimate.fmu.get("kind"), estimate.fmu.get("restart")
    told = [f"FMI {version}"] if (version := estimate.fmu.get("fmi_version")) else []
    told += ["model exchange"] if kind == "model-exchange" else []
    told += [f"restarted by {restart}"] if restart not in (None, "reset") else []
    workers = f"{estimate.workers} worker{'' if estimate.workers == 1 else 's'}"
    return [
        f"{counted(estimate.simulations, 'simulation')}{f' ({phases})' if phases else ''}, "
        f"{estimate.failed_simulations} failed, {counted(estimate.steps, 'step')}, "
        f"{estimate.seconds:.2f} s, {workers}",
        f"method {estimate.method}, seed {estimate.seed}, FMU {fmu}" + (f" ({', '.join(told)})" if told else ""),
    ]


def validation_lines(estimate: Estimate) -> list[str]:
    """Return a line an output: its RMSE on the validation's recordings beside that of the fit."""
    assert estimate.validation is not None
    lines = []
    for name, rmse in estimate.validation.rmse.items():
        unit = next((c.units[name] for c in estimate.validation.comparisons if name in c.units), "")
        shown = f"{name}: RMSE {finite_text(rmse, '.4g')} {unit}".rstrip()
        fitted = finite_text(estimate.rmse.get(name, math.nan), ".4g")
        lines.append(f"{shown} ({fitted} where it was fitted)")
    others = estimate.validation.others
    return [*lines, fitted_here(estimate.validation), *([] if others is None else [others_text(others)])]


def fitted_here(validation: Validation) -> str:
    """Return what was fitted to the recordings of the validation all the same, in a sentence."""
    if not validation.chain:
        return "Nothing was fitted to these recordings."
    own = [
        f"{name} = {number_text(value, digits=4)} {validation.units.get(name, '')}".rstrip()
        for name, value in validation.chain.items()
    ]
    return f"Fitted to these recordings: {', '.join(own)}; nothing else was."


def others_text(others: OtherValues) -> str:
    """Say how the values that these recordings alone want agree with the estimate's."""
    return (
        f"their own parameters against the estimate's: chi-square {others.chi_square:.3g} of {others.degrees} degrees"
        f" of freedom, by chance {others.chance:.2g}"
    )
