"""Random corruption of a valid FMU ends in a result or in one sentence, never in a traceback or a dead process.

Every case follows from its number. A sample runs by default, all of them with -m full.
"""

from __future__ import annotations

import io
import random
import re
import warnings
import zipfile

import numpy as np
import pytest
from foreign_fmus import SOURCES, foreign_fmu

from estimator.errors import EstimatorError
from estimator.fmu import check_usable, describe
from estimator.inspection import inspection_mapping, inspection_text
from estimator.probe import probe
from estimator.simulate import simulate
from fmu_build.compiler import compile_library, fmi_headers

SAMPLE, CASES = 24, 2000
EXECUTED = {SAMPLE: 6, CASES: 25}  # every so many cases is also run: probe and simulation
SEED = 20_26


@pytest.fixture(scope="module")
def originals(tmp_path_factory):
    """Return the bytes of valid FMUs of FMI 1.0, 2.0 and 3.0."""
    folder = tmp_path_factory.mktemp("valid")
    return [foreign_fmu(folder / str(v), version=v).read_bytes() for v in (1, 2, 3)]


@pytest.fixture(scope="module")
def crippled(tmp_path_factory):
    """Return libraries that lack a function each."""
    folder = tmp_path_factory.mktemp("crippled")
    text = (SOURCES / "fmi2.c").read_text()
    libraries = []
    for k, name in enumerate(("fmi2DoStep", "fmi2GetReal", "fmi2SetupExperiment", "fmi2Terminate", "fmi2GetStatus")):
        source = folder / f"{k}.c"
        source.write_text(text.replace(f"{name},", f"gone_{k},").replace(f"{name}(", f"gone_{k}("))
        compile_library(source, folder / f"{k}.so", include=[SOURCES, fmi_headers()])
        libraries.append((folder / f"{k}.so").read_bytes())
    return libraries


def corrupted(rng: random.Random, originals, crippled) -> bytes:
    data = rng.choice(originals)
    kind = rng.choice(("bytes", "cut", "xml bytes", "attribute", "attribute gone", "element gone", "twice", "function"))
    if kind == "bytes":
        changed = bytearray(data)
        for _ in range(rng.choice((1, 3, 30))):
            changed[rng.randrange(len(changed))] = rng.randrange(256)
        return bytes(changed)
    if kind == "cut":
        return data[: rng.randrange(len(data))]
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    text = members["modelDescription.xml"].decode()
    if kind == "xml bytes":
        raw = bytearray(text.encode())
        for _ in range(rng.choice((1, 5))):
            raw[rng.randrange(len(raw))] = rng.randrange(256)
        members["modelDescription.xml"] = bytes(raw)
    elif kind == "function":
        members = {n: (rng.choice(crippled) if n.startswith("binaries/") else m) for n, m in members.items()}
    else:
        members["modelDescription.xml"] = changed_text(rng, kind, text).encode()
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w") as archive:
        for name, member in members.items():
            archive.writestr(name, member)
    return target.getvalue()


def changed_text(rng: random.Random, kind: str, text: str) -> str:
    if kind.startswith("attribute"):
        found = rng.choice(list(re.finditer(r' (\w+)="([^"]*)"', text)))
        values = ("", "nan", "-1", "1e999", "99999999999999999999", "true", "ø", "../x", "local", found[2] * 1000)
        new = "" if kind == "attribute gone" else f' {found[1]}="{rng.choice(values)}"'
        return text[: found.start()] + new + text[found.end() :]
    found = rng.choice(list(re.finditer(r"<(\w+)[^<>]*/>|<(ScalarVariable|Unit)\b.*?</\2>", text)))
    return text[: found.start()] + (found[0] * 2 if kind == "twice" else "") + text[found.end() :]


def run(path, number, originals, crippled, *, of: int) -> str:
    """Return what became of a case: "result", or the sentence."""
    path.write_bytes(corrupted(random.Random(SEED + number), originals, crippled))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # zipfile's about a name that is there twice
            description = describe(path, validate=number % 2 == 0)
        found = {description.kind: probe(description, limit=20)} if number % EXECUTED[of] == 0 else {}
        assert inspection_text(description, found) and inspection_mapping(description, found)
        check_usable(description)
        if found:
            simulate(description, parameters={}, inputs={}, times=np.arange(10) * 1e-3, time_limit=5.0)
    except EstimatorError as error:
        sentence = str(error)
        assert sentence and "\n" not in sentence and "Traceback" not in sentence
        return sentence
    return "result"


@pytest.mark.parametrize("part", range(4))
def test_a_corrupt_fmu_ends_in_a_result_or_a_sentence(tmp_path, originals, crippled, part):
    ends = [run(tmp_path / "bad.fmu", n, originals, crippled, of=SAMPLE) for n in range(part, SAMPLE, 4)]
    assert len(ends) == SAMPLE // 4


@pytest.mark.full
@pytest.mark.parametrize("part", range(20))
def test_two_thousand_corrupt_fmus_end_in_a_result_or_a_sentence(tmp_path, originals, crippled, part):
    ends = [run(tmp_path / "bad.fmu", n, originals, crippled, of=CASES) for n in range(part, CASES, 20)]
    assert "result" in ends and len(set(ends)) > 10
