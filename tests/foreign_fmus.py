"""FMUs as other tools write them: compiled from the sources in foreign/, with names, units and faults of their own."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Sequence
from pathlib import Path

import fmpy
from faulty import QUICKLY
from motors import CML050, Motor

from fmu_build.compiler import compile_library, fmi_headers

SOURCES = Path(__file__).parent / "foreign"
GUID = "{foreign-motor}"
# name, value reference, causality, unit, start
VARIABLES = (
    ("motor.Ra", 0, "parameter", "Ohm", 3.0),
    ("motor.La", 1, "parameter", "H", 0.012),
    ("motor.Ke", 2, "parameter", "V.s/rad", 0.05),
    ("motor.Km", 3, "parameter", "N.m/A", 0.05),
    ("motor.Jm", 4, "parameter", "kg.m2", 1e-5),
    ("motor.c", 5, "parameter", "N.m.s/rad", 1.5e-4),
    ("u_in", 6, "input", "V", 0.0),
    ("shaft.w", 7, "output", "rad/s", 0.0),
    ("motor.ia", 8, "local", "A", 0.0),
    ("motor.power", 9, "local", "W", None),
)
WORKSHOP = {"motor.La": ("mH", 12.0), "motor.Jm": ("g.cm2", 100.0), "shaft.w": ("rpm", 0.0), "motor.ia": ("mA", 0.0)}
UNITS = {"g.cm2": 'kg="1" m="2" factor="1e-7"', "rpm": 'rad="1" s="-1" factor="0.104719755119659775"'}

CASE = """
[fmu]
path = "{fmu}"
[inputs]
v = {{ column = "voltage", fmu = "u_in" }}
[outputs]
i = {{ column = "current", fmu = "motor.ia" }}
w = {{ column = "speed", fmu = "shaft.w" }}
[parameters]
R = {{ fmu = "motor.Ra" }}
K = {{ fmu = ["motor.Ke", "motor.Km"] }}
L = {{ fmu = "motor.La" }}
J = {{ fmu = "motor.Jm" }}
B = {{ fmu = "motor.c" }}
[[recording]]
file = "{recording}"
"""


def foreign_fmu(
    folder: Path,
    *defines: str,
    version: int = 2,
    kinds: Sequence[str] = ("co-simulation",),
    name: str = "foreign",
    change: Sequence[tuple[str, str]] = (),
) -> Path:
    """Build an FMU.

    Parameters
    ----------
    defines : what foreign/motor.h is to do, such as "EULER" or "STOPS_AT 0.5"
    change : (regular expression, replacement) pairs applied to modelDescription.xml
    """
    folder.mkdir(parents=True, exist_ok=True)
    source = folder / f"{name}.c"
    glue = "fmi1_model.c" if version == 1 and "model-exchange" in kinds else f"fmi{version}.c"
    source.write_text("".join(f"#define {d}\n" for d in defines) + f'#include "{glue}"\n')
    library = folder / f"{name}{fmpy.sharedLibraryExtension}"
    compile_library(source, library, include=[SOURCES, fmi_headers()], options=QUICKLY)
    units = WORKSHOP if "WORKSHOP_UNITS" in defines else {}
    text = {1: _description1, 2: _description2, 3: _description3}[version](kinds, units, "SELF_DRIVEN" in defines)
    for pattern, replacement in change:
        text, count = re.subn(pattern, replacement, text)
        assert count, f"{pattern} is not in the description"
    tuple_ = fmpy.platform_tuple if version == 3 else fmpy.platform
    fmu = folder / f"{name}.fmu"
    with zipfile.ZipFile(fmu, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", text)
        archive.write(library, f"binaries/{tuple_}/foreign{fmpy.sharedLibraryExtension}")
    return fmu


def foreign_case(fmu: Path, recording: Path, *, text: str = CASE) -> Path:
    """Write a case file beside the FMU."""
    case = fmu.with_suffix(".case.toml")
    case.write_text(text.format(fmu=fmu.name, recording=recording.as_posix()))
    return case


def truth(motor: Motor = CML050) -> dict[str, float]:
    """Return the motor's parameters by their roles."""
    return motor.parameters


def _description2(kinds: Sequence[str], units: dict[str, tuple[str, float]], no_input: bool) -> str:
    rows = []
    for name, reference, causality, unit, start in _variables(units, no_input):
        variability = "fixed" if causality == "parameter" else "continuous"
        exact = ' initial="exact"' if name in ("shaft.w", "motor.ia") else ""
        given = f' start="{start}"' if start is not None else ""
        rows.append(
            f'<ScalarVariable name="{name}" valueReference="{reference}" causality="{causality}"'
            f' variability="{variability}"{exact}><Real unit="{unit}"{given}/></ScalarVariable>'
        )
    rows.append(
        '<ScalarVariable name="friction" valueReference="0" causality="parameter" variability="fixed">'
        '<Enumeration declaredType="Friction" start="1"/></ScalarVariable>'
        '<ScalarVariable name="enabled" valueReference="0" causality="parameter" variability="fixed">'
        '<Boolean start="true"/></ScalarVariable>'
        '<ScalarVariable name="centispeed" valueReference="1" causality="output" variability="discrete">'
        "<Integer/></ScalarVariable>"
    )
    offered = {
        "co-simulation": '<CoSimulation modelIdentifier="foreign" canHandleVariableCommunicationStepSize="true"/>',
        "model-exchange": '<ModelExchange modelIdentifier="foreign"/>',
    }
    names = [v[0] for v in _variables(units, no_input)]
    speed = names.index("shaft.w") + 1
    return (
        (
            '<?xml version="1.0" encoding="UTF-8"?>\n<fmiModelDescription fmiVersion="2.0" modelName="foreign"'
            f' guid="{GUID}" generationTool="A foreign tool" numberOfEventIndicators="0">'
            + "".join(offered[k] for k in reversed(kinds))
            + f"<UnitDefinitions>{_units(units, 'BaseUnit')}</UnitDefinitions>"
            '<TypeDefinitions><SimpleType name="Friction"><Enumeration><Item name="none" value="0"/>'
            '<Item name="viscous" value="1"/></Enumeration></SimpleType></TypeDefinitions>'
            '<DefaultExperiment startTime="0" stopTime="1" stepSize="0.001"/>'
            f"<ModelVariables>{''.join(rows)}</ModelVariables>"
            f'<ModelStructure><Outputs><Unknown index="{speed}"/><Unknown index="{len(names) + 3}"/></Outputs>'
            + (
                '<Derivatives><Unknown index="98"/><Unknown index="99"/></Derivatives>'
                if "model-exchange" in kinds
                else ""
            )
            + "</ModelStructure></fmiModelDescription>\n"
        )
        .replace('index="98"', f'index="{speed}"')
        .replace('index="99"', f'index="{speed + 1}"')
    )


def _description3(kinds: Sequence[str], units: dict[str, tuple[str, float]], no_input: bool) -> str:
    rows = ['<Float64 name="time" valueReference="99" causality="independent" variability="continuous"/>']
    for name, reference, causality, unit, start in _variables(units, no_input):
        variability = "fixed" if causality == "parameter" else "continuous"
        exact = ' initial="exact"' if name in ("shaft.w", "motor.ia") else ""
        given = f' start="{start}"' if start is not None else ""
        rows.append(
            f'<Float64 name="{name}" valueReference="{reference}" causality="{causality}"'
            f' variability="{variability}"{exact} unit="{unit}"{given}/>'
        )
    rows.append('<Int64 name="mode" valueReference="20" causality="parameter" variability="fixed" start="1"/>')
    rows.append('<Boolean name="enabled" valueReference="21" causality="parameter" variability="fixed" start="true"/>')
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<fmiModelDescription fmiVersion="3.0" modelName="foreign"'
        f' instantiationToken="{GUID}" generationTool="A foreign tool">'
        '<CoSimulation modelIdentifier="foreign" canHandleVariableCommunicationStepSize="true"/>'
        f"<UnitDefinitions>{_units(units, 'BaseUnit')}</UnitDefinitions>"
        f"<ModelVariables>{''.join(rows)}</ModelVariables>"
        '<ModelStructure><Output valueReference="7"/></ModelStructure></fmiModelDescription>\n'
    )


def _description1(kinds: Sequence[str], units: dict[str, tuple[str, float]], no_input: bool) -> str:
    rows = []
    for name, reference, causality, unit, start in _variables(units, no_input):
        said = {"parameter": "internal", "local": "internal"}.get(causality, causality)
        variability = "parameter" if causality == "parameter" else "continuous"
        given = f' start="{start}"' if causality in ("parameter", "input") else ""
        rows.append(
            f'<ScalarVariable name="{name}" valueReference="{reference}" causality="{said}"'
            f' variability="{variability}"><Real unit="{unit}"{given}/></ScalarVariable>'
        )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<fmiModelDescription fmiVersion="1.0" modelName="foreign"'
        f' modelIdentifier="foreign" guid="{GUID}" generationTool="A foreign tool"'
        ' numberOfContinuousStates="2" numberOfEventIndicators="0">'
        f"<UnitDefinitions>{_units(units, '')}</UnitDefinitions><ModelVariables>{''.join(rows)}</ModelVariables>"
        + (
            '<Implementation><CoSimulation_StandAlone><Capabilities canHandleVariableCommunicationStepSize="true"/>'
            "</CoSimulation_StandAlone></Implementation>"
            if "co-simulation" in kinds
            else ""
        )
        + "</fmiModelDescription>\n"
    )


def _variables(units: dict[str, tuple[str, float]], no_input: bool) -> list[tuple[str, int, str, str, float | None]]:
    rows = []
    for name, reference, causality, unit, start in VARIABLES:
        if no_input and causality == "input":
            continue
        own, own_start = units.get(name, (unit, start))
        rows.append((name, reference, causality, own, own_start))
    return rows


def _units(units: dict[str, tuple[str, float]], base: str) -> str:
    names = dict.fromkeys(v[3] for v in _variables(units, False))
    tag = "BaseUnit" if not base else "Unit"
    attribute = "unit" if not base else "name"
    inside = {n: f"<{base} {UNITS[n]}/>" if base and n in UNITS else "" for n in names}
    return "".join(f'<{tag} {attribute}="{n}">{inside[n]}</{tag}>' for n in names)
