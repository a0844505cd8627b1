"""The command `simulate`: one simulation of an FMU, as CSV. Estimates nothing."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from estimator.commands.csv_text import csv_bytes
from estimator.commands.options import unique
from estimator.commands.terminal import OK, say
from estimator.errors import FmuError, InputError, SimulationError
from estimator.output import check_not_read, write_files

if TYPE_CHECKING:
    from estimator.fmus.fmu import FmuDescription
    from estimator.results.result import FloatArray

DEFAULT_STOP, DEFAULT_STEP = 2.8, 1e-3  # s


def simulate(args: argparse.Namespace) -> int:
    """Simulate an FMU once and give what comes out as CSV, in SI units."""
    from estimator.cases.si_units import in_si_units
    from estimator.commands.drive import settable
    from estimator.fmus.fmu import describe, with_kind
    from estimator.fmus.probe import driven

    if args.output and args.input is not None:
        check_not_read(Path(args.output), [args.input], option="-o")
    read = with_kind(describe(args.fmu), args.kind)
    description = in_si_units(read)
    settings = unique(args.settings, option="--set")
    parameters = {name: value for name, value in settings.items() if settable(description, name) == "parameter"}
    times, inputs = _drive(description, args)
    for name, value in settings.items():
        if name not in parameters:
            if name in inputs:
                raise InputError(f"the input {name!r} is given twice, by --set and by the drive; leave one out")
            inputs[name] = times * 0 + value
    from estimator.fmus.simulate import simulate as simulate_fmu

    try:
        outputs = simulate_fmu(in_si_units(driven(read)), parameters=parameters, inputs=inputs, times=times)
    except SimulationError as error:
        raise FmuError(str(error)) from error
    units = {variable.name: variable.unit for variable in description.variables}
    columns = {"time [s]": times}
    for signals in (inputs, outputs):
        columns |= {f"{n} [{units[n]}]" if units.get(n) else n: signal for n, signal in signals.items()}
    if args.output:
        write_files({Path(args.output): csv_bytes(columns)})
    else:
        say(csv_bytes(columns).decode())
    return OK


def _drive(description: FmuDescription, args: argparse.Namespace) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return the times and the inputs over them that the arguments of `simulate` mean."""
    from estimator.commands.drive import inputs_from, instants, stepped_voltage, voltage_input

    if args.input is not None:
        if args.stop is not None or args.step is not None:
            raise InputError("--stop and --step come from the file of --input; leave them out")
        return inputs_from(Path(args.input), description)
    stop, step = args.stop or DEFAULT_STOP, args.step or DEFAULT_STEP
    if step > stop:
        raise InputError(f"--step {step:g} is longer than --stop {stop:g}; give a smaller step")
    times = instants(stop=stop, step=step)
    if args.voltage_step is None:
        return times, {}
    level, at = args.voltage_step
    if at > stop:
        raise InputError(f"the voltage step at {at:g} s is after the end at {stop:g} s; give a longer --stop")
    return times, {voltage_input(description): stepped_voltage(times, level=level, at=at)}
