"""A model's table to the modelDescription.xml of FMI 2.0 and 3.0. Knows no C and no files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from xml.etree import ElementTree

from .model import Kind, Model
from .units import DISPLAY_UNITS, base_exponents, derivative_unit

GENERATION_TOOL = "fmu_build"
STOP_TIME = 2.8  # s, the default experiment: a step response
STEP = 1e-3  # s

# causality, variability, initial
_CAUSALITY = {
    "input": ("input", "continuous", None),
    "parameter": ("parameter", "tunable", "exact"),
    "state": ("output", "continuous", "exact"),
    "output": ("output", "continuous", "calculated"),
    "mode": ("local", "discrete", "calculated"),
}


@dataclass(frozen=True)
class _Unknowns:
    """A list of ModelStructure: each variable's place, with the places that it depends on; places count from 0."""

    outputs: list[tuple[int, list[int]]]
    derivatives: list[tuple[int, list[int]]]
    initial: list[tuple[int, list[int]]]
    indicators: list[tuple[int, list[int]]]


def model_description(
    model: Model,
    *,
    fmi: int,
    guid: str,
    description: str,
    dependencies: Mapping[str, frozenset[str]],
    source_file: str,
) -> bytes:
    """Return modelDescription.xml for co-simulation and model exchange.

    Parameters
    ----------
    model : Model
        The table.
    fmi : int
        The version of FMI: 2 or 3.
    guid : str
        What the FMU checks when it is instantiated.
    description : str
        What the model is, in one sentence.
    dependencies : mapping of str to frozenset of str
        For each calculated output, each state's derivative and each mode's margin, the variables that change it.
    source_file : str
        The translation unit in sources/.
    """
    root = _element(
        None,
        "fmiModelDescription",
        fmiVersion=f"{fmi}.0",
        modelName=model.name,
        **{"guid" if fmi == 2 else "instantiationToken": guid},
        description=description,
        generationTool=GENERATION_TOOL,
        variableNamingConvention="structured",
        **({"numberOfEventIndicators": str(len(model.of_kind("mode")))} if fmi == 2 else {}),
    )
    for interface in ("ModelExchange", "CoSimulation"):
        element = _element(root, interface, modelIdentifier=model.name, **_abilities(interface, fmi))
        if fmi == 2:
            _element(_element(element, "SourceFiles"), "File", name=source_file)
    _add_units(root, model)
    categories = _element(root, "LogCategories")
    for category in model.log_categories:
        _element(categories, "Category", name=category.name, description=category.description)
    _element(root, "DefaultExperiment", startTime="0.0", stopTime=repr(STOP_TIME), stepSize=repr(STEP))
    _add_variables(root, model, fmi)
    unknowns = _unknowns(model, dependencies)
    if fmi == 2:
        _add_structure_of_fmi2(root, unknowns)
    else:
        _add_structure_of_fmi3(root, unknowns, first_derivative=len(model.variables))
    return _text(root)


def build_description(model_name: str, *, source_file: str) -> bytes:
    """Return sources/buildDescription.xml of FMI 3.0: one C file is to be compiled."""
    root = _element(None, "fmiBuildDescription", fmiVersion="3.0")
    configuration = _element(root, "BuildConfiguration", modelIdentifier=model_name)
    _element(_element(configuration, "SourceFileSet", language="C11"), "SourceFile", name=source_file)
    return _text(root)


def _text(root: ElementTree.Element) -> bytes:
    ElementTree.indent(root)
    text: bytes = ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True)
    return text + b"\n"


def _element(parent: ElementTree.Element | None, tag: str, **attributes: str) -> ElementTree.Element:
    if parent is None:
        return ElementTree.Element(tag, attributes)
    return ElementTree.SubElement(parent, tag, attributes)


def _abilities(interface: str, fmi: int) -> dict[str, str]:
    if fmi == 2:
        names = ["canNotUseMemoryManagementFunctions", "canGetAndSetFMUstate", "canSerializeFMUstate"]
        names += ["providesDirectionalDerivative"]
        own = "completedIntegratorStepNotNeeded"
    else:
        names = ["canGetAndSetFMUState", "canSerializeFMUState"]
        names += ["providesDirectionalDerivatives", "providesAdjointDerivatives"]
        own = ""
    if interface == "CoSimulation":
        own = "canHandleVariableCommunicationStepSize"
    return dict.fromkeys([own, *names] if own else names, "true")


def _add_units(root: ElementTree.Element, model: Model) -> None:
    definitions = _element(root, "UnitDefinitions")
    units = [v.unit for v in model.variables] + [derivative_unit(v.unit) for v in model.of_kind("state")] + ["s"]
    for name in dict.fromkeys(units):
        unit = _element(definitions, "Unit", name=name)
        _element(unit, "BaseUnit", **{base: str(exponent) for base, exponent in base_exponents(name).items()})
        if name in DISPLAY_UNITS:
            display_name, factor = DISPLAY_UNITS[name]
            _element(unit, "DisplayUnit", name=display_name, factor=repr(factor))


def _add_variables(root: ElementTree.Element, model: Model, fmi: int) -> None:
    """List the variables, then the derivatives, then the margins of the modes.

    The time is a variable in FMI 3.0 only, where it must be: FMI Library before 2024 logs an error where it is in 2.0.
    """
    variables = _element(root, "ModelVariables")

    def add(reference: int, attributes: dict[str, str], real: dict[str, str]) -> None:
        attributes = {"name": attributes.pop("name"), "valueReference": str(reference)} | attributes
        if fmi == 2:
            _element(_element(variables, "ScalarVariable", **attributes), "Real", **real)
        else:
            _element(variables, "Float64", **attributes, **real)

    for reference, variable in enumerate(model.variables):
        causality, variability, initial = _CAUSALITY[variable.kind]
        attributes = {"name": variable.name, "description": variable.description}
        attributes |= {"causality": causality, "variability": variability}
        attributes |= {"initial": initial} if initial else {}
        real = {"unit": variable.unit}
        if variable.unit in DISPLAY_UNITS:
            real["displayUnit"] = DISPLAY_UNITS[variable.unit][0]
        real |= {"min": repr(variable.min), "max": repr(variable.max), "nominal": repr(variable.nominal)}
        real |= {"start": repr(variable.start)} if variable.kind not in ("output", "mode") else {}
        add(reference, attributes, real)
    count = len(model.variables)
    if fmi == 3:
        attributes = {"name": "time", "description": "Time", "causality": "independent", "variability": "continuous"}
        add(count, attributes, {"unit": "s"})
    for number, state in enumerate(model.of_kind("state"), start=1):
        attributes = {"name": f"der({state.name})", "description": f"Derivative of {state.name}", "causality": "local"}
        attributes |= {"variability": "continuous", "initial": "calculated"}
        place = model.variables.index(state)
        real = {"unit": derivative_unit(state.unit), "derivative": str(place + 1 if fmi == 2 else place)}
        add(count + number, attributes, real)
    count += 1 + len(model.of_kind("state"))
    for number, mode in enumerate(model.of_kind("mode")):
        attributes = {"name": f"margin_of_{mode.name}", "causality": "local", "variability": "continuous"}
        attributes |= {"description": f"How far {mode.name} is from its end", "initial": "calculated"}
        add(count + number, attributes, {})


def _unknowns(model: Model, dependencies: Mapping[str, frozenset[str]]) -> _Unknowns:
    """List what is calculated. A state that is an output depends on itself only.

    In initialisation, the modes are found: what depends on a mode depends on what its margin does.
    """
    place = {variable.name: k for k, variable in enumerate(model.variables)}
    states = model.of_kind("state")

    modes = {v.name for v in model.of_kind("mode")}

    def known(name: str, *kinds: Kind) -> list[int]:
        names = dependencies[name]
        if "parameter" in kinds:
            names = names.union(*(dependencies[mode] for mode in names & modes))
        return sorted(place[v.name] for v in model.of_kind(*kinds) if v.name in names)

    outputs = [
        (place[v.name], [place[v.name]] if v.kind == "state" else known(v.name, "input", "state"))
        for v in model.of_kind("state", "output")
    ]
    calculated = [(place[v.name], known(v.name, "input", "parameter", "state")) for v in model.of_kind("output")]
    rates = [(len(place) + k, state.name) for k, state in enumerate(states)]
    margins = [(len(place) + len(states) + k, mode.name) for k, mode in enumerate(model.of_kind("mode"))]
    return _Unknowns(
        outputs,
        [(number, known(name, "input", "state")) for number, name in rates],
        calculated + [(number, known(name, "input", "parameter", "state")) for number, name in rates],
        [(number, known(name, "input", "state")) for number, name in margins],
    )


def _add_structure_of_fmi2(root: ElementTree.Element, unknowns: _Unknowns) -> None:
    """Name variables by their index in the list of variables, from 1."""
    structure = _element(root, "ModelStructure")
    lists = {"Outputs": unknowns.outputs, "Derivatives": unknowns.derivatives, "InitialUnknowns": unknowns.initial}
    for tag, entries in lists.items():
        parent = _element(structure, tag)
        for place, known in entries:
            _element(parent, "Unknown", index=str(place + 1), dependencies=_joined(k + 1 for k in known))


def _add_structure_of_fmi3(root: ElementTree.Element, unknowns: _Unknowns, *, first_derivative: int) -> None:
    """Name variables by their value reference: the time's is before those of the derivatives."""
    structure = _element(root, "ModelStructure")
    lists = {
        "Output": unknowns.outputs,
        "ContinuousStateDerivative": unknowns.derivatives,
        "InitialUnknown": unknowns.initial,
        "EventIndicator": unknowns.indicators,
    }
    for tag, entries in lists.items():
        for place, known in entries:
            reference = place + (1 if place >= first_derivative else 0)
            _element(structure, tag, valueReference=str(reference), dependencies=_joined(known))


def _joined(numbers: Iterable[int]) -> str:
    return " ".join(map(str, numbers))
