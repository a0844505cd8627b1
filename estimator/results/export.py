"""An estimate as files: JSON, HTML report, figure, SSP parameter set. Knows no search and no FMU."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Mapping, Sequence

from estimator.results.figure_process import draw
from estimator.results.result import Estimate, Setting

Begin = Callable[[Estimate, Sequence[str]], Callable[[], dict[str, bytes]]]

FIGURE_FORMATS = ("png", "svg", "pdf")
RESULT_FILES = ("result.json", "report.html", "parameters.ssv", *(f"figure.{kind}" for kind in FIGURE_FORMATS))

SSV = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
SSV_TYPES = ("Real", "Integer", "Boolean")
# Exponents of the SI base units, and rad, which SSP counts as one.
BASE_UNITS: Mapping[str, Mapping[str, int]] = {
    **{name: {name: 1} for name in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "Ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "H": {"kg": 1, "m": 2, "s": -2, "A": -2},
    "Wb": {"kg": 1, "m": 2, "s": -2, "A": -1},
    "T": {"kg": 1, "s": -2, "A": -1},
    "F": {"kg": -1, "m": -2, "s": 4, "A": 2},
    "C": {"s": 1, "A": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "Hz": {"s": -1},
}


def result_files(
    estimate: Estimate,
    *,
    command: str = "",
    sources: Iterable[str | os.PathLike[str]] = (),
    figures: Iterable[str] = (),
    begin: Begin | None = None,
) -> dict[str, bytes]:
    """Return the content of all result files that this estimate has, by name.

    Parameters
    ----------
    command : str
        The command line that repeats the estimate, for the report.
    sources : paths
        FMU, case file and recordings; the report lists their SHA-256.
    figures : "svg", "pdf"
        Formats of the figure besides PNG.
    begin : callable, optional
        Begins to draw the figure elsewhere, as `FigureProcess.begin`, while the rest is made here.

    Notes
    -----
    A refused estimate has no parameter set: other tools would load it and never see the verdict. Without a
    recording to show there is no figure.
    """
    from estimator.results.report_html import html_report
    from estimator.results.result_json import to_json

    drawn = (begin or _here)(estimate, tuple(dict.fromkeys(("png", *figures))))
    files = {"result.json": to_json(estimate).encode()}
    html = html_report(estimate, command=command, checksums=checksums(sources))
    files |= drawn()
    files["report.html"] = html.encode()
    if estimate.parameters and estimate.verdict != "refused":
        files["parameters.ssv"] = parameter_set(estimate)
    return files


def parameter_set(estimate: Estimate) -> bytes:
    """Return the estimates as an SSP 1.0 parameter set (.ssv): XML, values in full precision, with units.

    Names and numbers are those of the FMU's own variables; values of the measurement chain are not among them.
    """
    ET.register_namespace("ssv", SSV)
    ET.register_namespace("ssc", SSC)
    root = ET.Element(
        f"{{{SSV}}}ParameterSet",
        {
            "version": "1.0",
            "name": str(estimate.fmu.get("name", "estimate")),
            "description": f"estimate by fmu-estimator, verdict: {estimate.verdict}",
            "generationTool": "fmu-estimator",
        },
    )
    listed = ET.SubElement(root, f"{{{SSV}}}Parameters")
    units: dict[str, Mapping[str, int]] = {}
    for parameter in estimate.parameters.values():
        for setting in parameter.set_in_fmu:
            if setting.type not in SSV_TYPES:
                continue
            texts = {"name": setting.variable}
            if parameter.status != "ok":
                texts["description"] = parameter.status
            entry = ET.SubElement(listed, f"{{{SSV}}}Parameter", texts)
            value = ET.SubElement(entry, f"{{{SSV}}}{setting.type}", {"value": value_text(setting)})
            exponents = unit_exponents(setting.unit)
            if setting.type == "Real" and exponents is not None:
                value.set("unit", setting.unit)
                units[setting.unit] = exponents
    if units:
        defined = ET.SubElement(root, f"{{{SSV}}}Units")
        for unit, powers in units.items():
            element = ET.SubElement(defined, f"{{{SSC}}}Unit", {"name": unit})
            ET.SubElement(element, f"{{{SSC}}}BaseUnit", {base: str(power) for base, power in powers.items()})
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def value_text(setting: Setting) -> str:
    """Return a variable's value as XML spells it, every bit of it."""
    if setting.type == "Boolean":
        return "true" if setting.value else "false"
    return str(round(setting.value)) if setting.type == "Integer" else repr(float(setting.value))


def unit_exponents(unit: str) -> dict[str, int] | None:
    """Return the exponents of the SI base units in a unit, None when it is not made of SI units.

    >>> unit_exponents("V.s/rad")
    {'kg': 1, 'm': 2, 's': -2, 'A': -1, 'rad': -1}
    """
    if unit == "1":
        return {}
    total: dict[str, int] = {}
    over, under = (unit.split("/", 1) + [""])[:2]
    for sign, side in ((1, over), (-1, under)):
        for factor in side.strip("()").split(".") if side else ():
            match = re.fullmatch(r"([A-Za-z]+)(-?\d+)?", factor)
            if factor == "1":
                continue
            if match is None or match[1] not in BASE_UNITS:
                return None
            for base, power in BASE_UNITS[match[1]].items():
                total[base] = total.get(base, 0) + sign * power * int(match[2] or 1)
    return {base: power for base, power in total.items() if power} if unit else None


def checksums(paths: Iterable[str | os.PathLike[str]]) -> dict[str, str]:
    """Return the SHA-256 of files that can be read, by path."""
    found = {}
    for path in paths:
        with contextlib.suppress(OSError), open(path, "rb") as stream:
            found[os.fspath(path)] = hashlib.file_digest(stream, "sha256").hexdigest()
    return found


def _here(estimate: Estimate, kinds: Sequence[str]) -> Callable[[], dict[str, bytes]]:
    return lambda: draw(estimate, kinds)
