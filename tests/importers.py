"""One simulation by one importer, run as a program of its own, since a bad FMU can take these down with it.

``python importers.py NAME FMU`` (FMI 2.0 or 3.0) holds `voltage` and prints i, w, angle after every step as hexadecimal
floating-point numbers, one line a step.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

STEP = 1e-3  # s
STEPS = 300
PARAMETERS = {"R": 0.921042, "K": 0.073472, "L": 0.007759, "J": 0.000136, "B": 0.000678}
OUTPUTS = ("i", "w", "angle")


def voltage(step: int) -> float:
    """Return the voltage that is held during a step, V: it changes every seventh."""
    return 12.0 * (step // 7 * 5 % 11 - 5) / 5


def fmpy(path: str) -> Iterator[tuple[float, ...]]:
    """Step by fmpy's FMU2Slave."""
    from fmpy import extract, read_model_description
    from fmpy.fmi2 import FMU2Slave
    from fmpy.fmi3 import FMU3Slave

    description = read_model_description(path)
    references = {v.name: v.valueReference for v in description.modelVariables}
    if description.fmiVersion == "3.0":
        third = FMU3Slave(
            guid=description.instantiationToken,
            unzipDirectory=extract(path),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="motor",
        )
        third.instantiate()
        third.setFloat64([references[name] for name in PARAMETERS], list(PARAMETERS.values()))
        third.enterInitializationMode(startTime=0.0)
        third.exitInitializationMode()
        for step in range(STEPS):
            third.setFloat64([references["v"]], [voltage(step)])
            third.doStep(currentCommunicationPoint=step * STEP, communicationStepSize=STEP)
            yield tuple(third.getFloat64([references[name] for name in OUTPUTS]))
        return
    slave = FMU2Slave(
        guid=description.guid,
        unzipDirectory=extract(path),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="motor",
    )
    slave.instantiate()
    slave.setupExperiment(startTime=0.0)
    slave.setReal([references[name] for name in PARAMETERS], list(PARAMETERS.values()))
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    for step in range(STEPS):
        slave.setReal([references["v"]], [voltage(step)])
        slave.doStep(currentCommunicationPoint=step * STEP, communicationStepSize=STEP)
        yield tuple(slave.getReal([references[name] for name in OUTPUTS]))


def libcosimpy(path: str) -> Iterator[tuple[float, ...]]:
    """Step by libcosim."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    log_output_level(CosimLogLevel.WARNING)  # it logs to standard output
    execution = CosimExecution.from_step_size(round(STEP * 1e9))  # ns
    motor = CosimLocalSlave(fmu_path=path, instance_name="motor")
    slave = execution.add_local_slave(motor)
    references = {v.name.decode(): v.reference for v in execution.slave_variables(slave)}
    for name, value in {**PARAMETERS, "v": voltage(0)}.items():
        execution.real_initial_value(slave, references[name], value)
    manipulator, observer = CosimManipulator.create_override(), CosimObserver.create_last_value()
    execution.add_manipulator(manipulator)
    execution.add_observer(observer)
    for step in range(STEPS):
        manipulator.slave_real_values(slave, [references["v"]], [voltage(step)])
        if not execution.step():
            raise RuntimeError(f"step {step} failed")
        yield tuple(observer.last_real_values(slave, [references[name] for name in OUTPUTS]))


def ecospy(path: str) -> Iterator[tuple[float, ...]]:
    """Step by ecos."""
    from ecospy import EcosSimulation, EcosSimulationStructure

    structure = EcosSimulationStructure()
    structure.add_model("motor", Path(path).as_posix())
    structure.add_parameter_set("given", {f"motor::{name}": value for name, value in PARAMETERS.items()})
    with EcosSimulation(structure=structure, step_size=STEP) as simulation:
        simulation.init(parameter_set="given")
        for step in range(STEPS):
            simulation.set_real("motor::v", voltage(step))
            simulation.step()
            yield tuple(simulation.get_real(f"motor::{name}") for name in OUTPUTS)
        simulation.terminate()


if __name__ == "__main__":
    for values in {"fmpy": fmpy, "libcosimpy": libcosimpy, "ecospy": ecospy}[sys.argv[1]](sys.argv[2]):
        print(*(value.hex() for value in values))
