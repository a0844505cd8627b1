"""Why a library cannot be loaded: the loader's words become a sentence without paths."""

import fmpy
import pytest
from foreign_fmus import foreign_fmu

from estimator.fmus.fmu import describe
from estimator.fmus.probe import probe
from estimator.stepping.library import binaries
from estimator.stepping.loading import why_not_loaded

PREFIX = "Failed to load shared library {folder}/binaries/linux64/m.so. "
OWN = "{folder}/binaries/linux64/m.so"
WRONG = "its library is for x86 of 32 bit, not for this machine"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (
            PREFIX + "libgfortran.so.3: cannot open shared object file: No such file or directory",
            "its library needs libgfortran.so.3, which this machine does not have; install it",
        ),
        (PREFIX + OWN + ": wrong ELF class: ELFCLASS32", WRONG),
        (PREFIX + OWN + ": cannot open shared object file: No such file or directory", WRONG),
        (
            PREFIX + OWN + ": undefined symbol: usertab",
            "its library lacks the symbol usertab: a library that it needs is missing, or there in another version",
        ),
        (
            PREFIX + "/lib/libc.so.6: version `GLIBC_2.99' not found (required by " + OWN + ")",
            "its library needs GLIBC_2.99, which this machine's libraries are too old for",
        ),
        ("Cannot find shared library other.so.", "it has no library other.so in binaries/linux64, only m.so"),
        (PREFIX + "something else", "Failed to load shared library m.so. something else"),
    ],
)
def test_the_loaders_words_become_a_sentence(tmp_path, words, sentence):
    library = tmp_path / "binaries" / "linux64" / "m.so"
    library.parent.mkdir(parents=True)
    library.write_bytes(b"\x7fELF\x01\x01\x01" + bytes(11) + b"\x03\x00" + bytes(40))
    assert why_not_loaded(words.format(folder=tmp_path), str(tmp_path)) == sentence


def test_a_library_under_another_name_is_told_with_the_name_that_is_there(tmp_path):
    fmu = foreign_fmu(tmp_path, change=[('modelIdentifier="foreign"', 'modelIdentifier="other"')])
    problem = probe(describe(fmu)).problem
    assert problem == "it does not run: it has no library other.so in binaries/linux64, only foreign.so"


def test_the_folders_of_binaries_are_those_that_fmpy_looks_into():
    assert [binaries(number) for number in "123"] == [fmpy.platform, fmpy.platform, fmpy.platform_tuple]
