"""Random corruption of a valid FMU ends in a result or in one sentence, never in a traceback or a dead process.

Corrupted are bytes of the archive, bytes, attributes and elements of modelDescription.xml, and the library's functions,
of FMI 1.0, 2.0 and 3.0. Every case follows from its number. A sample runs by default, all of them with -m full.
"""

from __future__ import annotations

import collections
import io
import random
import re
import warnings
import zipfile

import pytest
from foreign_fmus import foreign_case, foreign_fmu
from motors import CML050, step_recording, write_recording

from estimator.cli import main

SAMPLE, CASES, PARTS = 24, 2000, 20
EVERY = {SAMPLE: 8, CASES: 25}  # so many cases between two that are executed; those that lack a function always are
SEED = 20_26
KINDS = ("bytes", "cut", "xml bytes", "attribute", "attribute gone", "element gone", "element twice", "function gone")
VALUES = ("", "nan", "-1", "1e999", "99999999999999999999", "true", "ø", "../x", "local", "input", "parameter", "0")
FUNCTION = re.compile(rb"\0((?:foreign_)?fmi[123]?[A-Z]\w+)(?=\0)")


@pytest.fixture(scope="module")
def originals(tmp_path_factory):
    """Return the bytes of valid FMUs of FMI 1.0, 2.0 and 3.0."""
    folder = tmp_path_factory.mktemp("valid")
    return [foreign_fmu(folder / str(v), version=v).read_bytes() for v in (1, 2, 3)]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "step.csv"
    write_recording(step_recording(CML050, lead=0.02, duration=0.2), path)
    return path


def corrupted(rng: random.Random, originals) -> tuple[str, bytes]:
    """Return the kind of corruption and the corrupted archive."""
    data, kind = rng.choice(originals), rng.choice(KINDS)
    if kind == "bytes":
        return kind, with_other_bytes(rng, data, rng.choice((1, 3, 30)))
    if kind == "cut":
        return kind, data[: rng.randrange(len(data))]
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    (library,) = [name for name in members if name.startswith("binaries/")]
    text = members["modelDescription.xml"]
    if kind == "xml bytes":
        members["modelDescription.xml"] = with_other_bytes(rng, text, rng.choice((1, 5)))
    elif kind == "function gone":
        members[library] = without_a_function(rng, members[library])
    else:
        members["modelDescription.xml"] = changed_text(rng, kind, text.decode()).encode()
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w") as archive:
        for name, member in members.items():
            archive.writestr(name, member)
    return kind, target.getvalue()


def with_other_bytes(rng: random.Random, data: bytes, count: int) -> bytes:
    changed = bytearray(data)
    for _ in range(count):
        changed[rng.randrange(len(changed))] = rng.randrange(256)
    return bytes(changed)


def without_a_function(rng: random.Random, library: bytes) -> bytes:
    """Return a library in which one function of the standard has another name."""
    name = rng.choice(sorted(set(FUNCTION.findall(library))))
    return library.replace(b"\0" + name + b"\0", b"\0" + name[:-1] + b"_\0")


def changed_text(rng: random.Random, kind: str, text: str) -> str:
    if kind.startswith("attribute"):
        found = rng.choice(list(re.finditer(r' (\w+)="([^"]*)"', text)))
        new = "" if kind == "attribute gone" else f' {found[1]}="{rng.choice((*VALUES, found[2] * 1000))}"'
        return text[: found.start()] + new + text[found.end() :]
    whole = r"<(ScalarVariable|Unit|UnitDefinitions|ModelVariables|ModelStructure|TypeDefinitions)\b.*?</\1>"
    found = rng.choice([*re.finditer(r"<\w+[^<>]*/>", text), *re.finditer(whole, text)])
    return text[: found.start()] + (found[0] * 2 if kind == "element twice" else "") + text[found.end() :]


def ended(capsys, *command: str) -> str:
    """Run a command; return how it ended: "result", or "sentence" if there is nothing but one."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # zipfile's about a name that is there twice
        status = main(command)
    out, err = capsys.readouterr()
    assert status in (0, 1, 2) and "Traceback" not in out + err and "internal error" not in err, err
    if status == 0:
        return "result"
    told = [line for line in err.splitlines() if "one simulation of this FMU takes" not in line]
    assert (len(told) == 1 and told[0].startswith("fmu-estimator: ")) or (status == 1 and "refused" in out), err
    return "sentence"


def run(folder, number, originals, recording, capsys, *, of: int) -> collections.Counter:
    """Return how the commands ended on one case, counted by kind and command."""
    kind, data = corrupted(random.Random(SEED + number), originals)
    fmu = folder / f"foreign{number}.fmu"
    fmu.write_bytes(data)
    ends = {"inspect --static": ended(capsys, "inspect", "--static", str(fmu))}
    if number % EVERY[of] == 0:
        ends["inspect"] = ended(capsys, "inspect", str(fmu), "--json")
    if number % EVERY[of] == 0 or kind == "function gone":
        ends["estimate"] = ended(capsys, "estimate", str(foreign_case(fmu, recording)), "--workers", "1")
    fmu.unlink()
    return collections.Counter((kind, command, end) for command, end in ends.items())


@pytest.mark.parametrize("part", [1, *(pytest.param(k, marks=pytest.mark.full) for k in (0, 2))])
def test_a_corrupt_fmu_ends_in_a_result_or_a_sentence(tmp_path, originals, recording, capsys, part):
    numbers = range(part, SAMPLE, 3)
    ends = sum((run(tmp_path, n, originals, recording, capsys, of=SAMPLE) for n in numbers), collections.Counter())
    assert sum(n for (_, command, _), n in ends.items() if command == "inspect --static") == len(numbers)


@pytest.mark.full
@pytest.mark.parametrize("part", range(PARTS))
def test_two_thousand_corrupt_fmus_end_in_a_result_or_a_sentence(tmp_path, originals, recording, capsys, part):
    numbers = range(part, CASES, PARTS)
    ends = sum((run(tmp_path, n, originals, recording, capsys, of=CASES) for n in numbers), collections.Counter())
    with capsys.disabled():
        print(*(f"fuzz\t{part}\t" + "\t".join(map(str, (*key, n))) for key, n in sorted(ends.items())), sep="\n")
    assert {kind for kind, _, _ in ends} == set(KINDS)
    assert {end for _, _, end in ends} == {"result", "sentence"}
