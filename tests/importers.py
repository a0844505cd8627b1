"""One simulation by one importer, run as a program of its own, since a bad FMU can take these down with it.

``python importers.py NAME FMU`` (FMI 2.0 or 3.0, made by fmu_build) changes every parameter, holds inputs that jump,
and prints all outputs after every step as hexadecimal floating-point numbers, one line a step.
"""

from __future__ import annotations

import sys
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

STEP = 1e-3  # s
STEPS = 300


@dataclass(frozen=True)
class Plan:
    """What is set and read, by name: parameters' values, nominal values of the inputs, outputs."""

    parameters: dict[str, float]
    inputs: dict[str, float]
    outputs: list[str]

    def held(self, step: int) -> dict[str, float]:
        """Return the inputs during a step: each jumps every seventh, through zero, each in its own order."""
        return {
            name: nominal * ((step // 7 + k) * 5 % 11 - 5) / 5 for k, (name, nominal) in enumerate(self.inputs.items())
        }


def plan_of(path: str) -> Plan:
    """Return what to do with an FMU, by its description: each parameter moves by some percent of its nominal value."""
    with zipfile.ZipFile(path) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    found: dict[str, list[tuple[str, dict[str, str]]]] = {}
    for variable in root.iterfind("ModelVariables/*"):
        real = variable.find("Real")
        attributes = dict(variable.attrib) | (dict(real.attrib) if real is not None else {})
        found.setdefault(attributes["causality"], []).append((attributes["name"], attributes))
    parameters = {name: 0.9 * float(a["start"]) + 0.05 * float(a["nominal"]) for name, a in found.get("parameter", [])}
    inputs = {name: float(a["nominal"]) for name, a in found.get("input", [])}
    return Plan(parameters, inputs, [name for name, _ in found["output"]])


def fmpy(path: str, plan: Plan) -> Iterator[tuple[float, ...]]:
    """Step by fmpy's FMU2Slave or FMU3Slave."""
    from fmpy import extract, read_model_description
    from fmpy.fmi2 import FMU2Slave
    from fmpy.fmi3 import FMU3Slave

    description = read_model_description(path)
    references = {v.name: v.valueReference for v in description.modelVariables}
    third = description.fmiVersion == "3.0"
    slave = (FMU3Slave if third else FMU2Slave)(
        guid=description.instantiationToken if third else description.guid,
        unzipDirectory=extract(path),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="motor",
    )
    put, get = (slave.setFloat64, slave.getFloat64) if third else (slave.setReal, slave.getReal)
    slave.instantiate()
    if not third:
        slave.setupExperiment(startTime=0.0)
    put([references[name] for name in plan.parameters], list(plan.parameters.values()))
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    for step in range(STEPS):
        held = plan.held(step)
        put([references[name] for name in held], list(held.values()))
        slave.doStep(currentCommunicationPoint=step * STEP, communicationStepSize=STEP)
        yield tuple(get([references[name] for name in plan.outputs]))


def libcosimpy(path: str, plan: Plan) -> Iterator[tuple[float, ...]]:
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
    for name, value in (plan.parameters | plan.held(0)).items():
        execution.real_initial_value(slave, references[name], value)
    manipulator, observer = CosimManipulator.create_override(), CosimObserver.create_last_value()
    execution.add_manipulator(manipulator)
    execution.add_observer(observer)
    for step in range(STEPS):
        held = plan.held(step)
        manipulator.slave_real_values(slave, [references[name] for name in held], list(held.values()))
        if not execution.step():
            raise RuntimeError(f"step {step} failed")
        yield tuple(observer.last_real_values(slave, [references[name] for name in plan.outputs]))


def ecospy(path: str, plan: Plan) -> Iterator[tuple[float, ...]]:
    """Step by ecos."""
    from ecospy import EcosSimulation, EcosSimulationStructure

    structure = EcosSimulationStructure()
    structure.add_model("motor", Path(path).as_posix())
    structure.add_parameter_set("given", {f"motor::{name}": value for name, value in plan.parameters.items()})
    with EcosSimulation(structure=structure, step_size=STEP) as simulation:
        simulation.init(parameter_set="given")
        for step in range(STEPS):
            for name, value in plan.held(step).items():
                simulation.set_real(f"motor::{name}", value)
            simulation.step()
            yield tuple(simulation.get_real(f"motor::{name}") for name in plan.outputs)
        simulation.terminate()


def estimator(path: str, plan: Plan) -> Iterator[tuple[float, ...]]:
    """Step by this package's loop in C."""
    import numpy as np

    from estimator.fmus.simulate import simulate

    inputs = {name: np.array([plan.held(step)[name] for step in range(STEPS + 1)]) for name in plan.inputs}
    shown = simulate(path, parameters=plan.parameters, inputs=inputs, times=np.arange(STEPS + 1) * STEP)
    for step in range(STEPS):
        yield tuple(float(shown[name][step + 1]) for name in plan.outputs)


IMPORTERS = {"fmpy": fmpy, "libcosimpy": libcosimpy, "ecospy": ecospy, "estimator": estimator}

if __name__ == "__main__":
    for values in IMPORTERS[sys.argv[1]](sys.argv[2], plan_of(sys.argv[2])):
        print(*(value.hex() for value in values))
