"""Why an FMU's simulations failed: the FMU's answer, its likely cause, and what to do. Runs nothing."""

from __future__ import annotations

from collections.abc import Sequence

from estimator.fmus.fmu import FmuDescription
from estimator.fmus.job import Failure

NEAR = 1e-6  # of a step


def with_values(failure: Failure, variables: Sequence[str]) -> str:
    """Return a sentence with the FMU's variables of the first candidate that failed so, to be simulated again."""
    values = ", ".join(f"{name} = {value!r}" for name, value in zip(variables, failure.values, strict=False))
    return f"{failure.reason} (first with {values})"


def with_cause(failure: Failure, description: FmuDescription, variables: Sequence[str]) -> str:
    """Return why all simulations failed, from the first that did."""
    if failure.step is None:
        is_refused = failure.reason.startswith("set returned")
        return with_values(failure, variables) if is_refused and variables else failure.reason
    begin, end = failure.step
    h = end - begin
    stop, step = (description.default_experiment.get(name) for name in ("stop_time", "step_size"))
    answer, colon, words = failure.reason.partition(": ")
    told = f"{answer} at t = {begin:g} s{colon}{words}"
    if stop is not None and end > stop + NEAR * h and begin < stop + h:
        return (
            f"{told}; the FMU's own stop time is {stop:g} s and it goes no further; use a shorter recording, or export"
            " the FMU with a later stop time"
        )
    start = description.default_experiment.get("start_time") or 0.0
    if step is not None and abs(h - step) > NEAR * h and begin <= start + NEAR * h:
        return f"{told}; the FMU's own step size is {step:g} s, not {h:g} s; set step = {step:g} under [fmu]"
    return told
