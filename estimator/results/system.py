"""An FMU and its estimated parameters as one file for system tools: SSP 1.0 (.ssp). Knows no search.

The archive holds SystemStructure.ssd, resources/<model>.fmu and resources/parameters.ssv. The system has no
connectors of its own: libcosim and ecos know connections between components only. An annotation of the Open Simulation
Platform tells libcosim which step to take.
"""

from __future__ import annotations

import io
import xml.etree.ElementTree as ET
import zipfile
from typing import TYPE_CHECKING

from estimator.results.export import SSC, SSV_TYPES, parameter_set, unit_exponents
from estimator.results.result import Estimate

if TYPE_CHECKING:
    from estimator.fmus.fmu import FmuDescription

SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
OSP = "http://opensimulationplatform.com/SSP/OSPAnnotations"
COMPONENT = "motor"
STEP, STOP = 1e-3, 2.8  # s, where the estimate does not say


def system_archive(estimate: Estimate, description: FmuDescription) -> bytes:
    """Return an SSP archive that runs the FMU with the estimated parameters.

    Parameters
    ----------
    description : FmuDescription
        Of the FMU that was estimated.
    """
    stream = io.BytesIO()
    content = {
        "SystemStructure.ssd": system_description(estimate, description),
        f"resources/{description.path.name}": description.path.read_bytes(),
        "resources/parameters.ssv": parameter_set(estimate),
    }
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in content.items():
            entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, data)
    return stream.getvalue()


def system_description(estimate: Estimate, description: FmuDescription) -> bytes:
    """Return SystemStructure.ssd: one component, its connectors, and the parameters bound to it."""
    for prefix, namespace in (("ssd", SSD), ("ssc", SSC), ("osp", OSP)):
        ET.register_namespace(prefix, namespace)
    root = ET.Element(f"{{{SSD}}}SystemStructureDescription", {"version": "1.0", "name": description.name})
    system = ET.SubElement(root, f"{{{SSD}}}System", {"name": "system"})
    units: dict[str, dict[str, int]] = {}
    elements = ET.SubElement(system, f"{{{SSD}}}Elements")
    component = ET.SubElement(
        elements,
        f"{{{SSD}}}Component",
        {"name": COMPONENT, "type": "application/x-fmu-sharedlibrary", "source": f"resources/{description.path.name}"},
    )
    _connectors(component, description, units)
    bindings = ET.SubElement(component, f"{{{SSD}}}ParameterBindings")
    ET.SubElement(bindings, f"{{{SSD}}}ParameterBinding", {"source": "resources/parameters.ssv"})
    if units:
        defined = ET.SubElement(root, f"{{{SSD}}}Units")
        for unit, powers in units.items():
            element = ET.SubElement(defined, f"{{{SSC}}}Unit", {"name": unit})
            ET.SubElement(element, f"{{{SSC}}}BaseUnit", {base: str(power) for base, power in powers.items()})
    _experiment(root, estimate, description)
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def _signals(description: FmuDescription) -> list[tuple[str, str, str, str]]:
    """Return name, kind, type and unit of every input and output, and every parameter, that SSP can show."""
    return [
        (v.name, v.causality, "Real" if v.is_real else v.type, v.unit)
        for v in description.variables
        if v.causality in ("input", "output", "parameter") and (v.is_real or v.type in SSV_TYPES)
    ]


def _connectors(parent: ET.Element, description: FmuDescription, units: dict[str, dict[str, int]]) -> None:
    connectors = ET.SubElement(parent, f"{{{SSD}}}Connectors")
    for name, kind, type_, unit in _signals(description):
        connector = ET.SubElement(connectors, f"{{{SSD}}}Connector", {"name": name, "kind": kind})
        shape = ET.SubElement(connector, f"{{{SSC}}}{type_}")
        exponents = unit_exponents(unit)
        if type_ == "Real" and exponents is not None:
            shape.set("unit", unit)
            units[unit] = exponents


def _experiment(root: ET.Element, estimate: Estimate, description: FmuDescription) -> None:
    known = description.default_experiment
    start = known.get("start_time") or 0.0
    stop = max(known.get("stop_time") or STOP, start + 1e-3)
    step = float(estimate.fmu.get("communication_step") or known.get("step_size") or STEP)
    experiment = ET.SubElement(root, f"{{{SSD}}}DefaultExperiment", {"startTime": repr(start), "stopTime": repr(stop)})
    annotations = ET.SubElement(experiment, f"{{{SSD}}}Annotations")
    annotation = ET.SubElement(annotations, f"{{{SSC}}}Annotation", {"type": "com.opensimulationplatform"})
    algorithm = ET.SubElement(annotation, f"{{{OSP}}}Algorithm")
    ET.SubElement(algorithm, f"{{{OSP}}}FixedStepAlgorithm", {"baseStepSize": repr(step)})
