"""An FMU's compiled library: where it lies for this machine, loaded, what it may lack. Knows no instance."""

from __future__ import annotations

import ctypes
import os
from ctypes import CFUNCTYPE, c_int
from functools import cache
from pathlib import Path
from typing import Any

from estimator.stepping.library import SUFFIX, binaries
from estimator.stepping.loading import why_not_loaded

CO_SIMULATION, MODEL_EXCHANGE = "co-simulation", "model-exchange"

# What a simulation calls, as the standards name it without their prefix; any other function may be missing.
STATES = ("SetTime", "SetContinuousStates", "GetContinuousStates")
NEEDED = {
    "1": ("SetReal", "GetReal"),
    "2": ("Instantiate", "FreeInstance", "SetupExperiment", "SetReal", "GetReal"),
    "3": ("FreeInstance", "SetFloat64", "GetFloat64"),
}
MODES = ("EnterInitializationMode", "ExitInitializationMode")  # of FMI 2.0 and 3.0
NEEDED_BY_KIND = {
    ("1", CO_SIMULATION): ("InstantiateSlave", "FreeSlaveInstance", "InitializeSlave", "DoStep"),
    ("1", MODEL_EXCHANGE): ("InstantiateModel", "FreeModelInstance", "Initialize", *STATES, "GetDerivatives"),
    ("2", CO_SIMULATION): (*MODES, "DoStep"),
    ("2", MODEL_EXCHANGE): (*MODES, *STATES, "GetDerivatives"),
    ("3", CO_SIMULATION): ("InstantiateCoSimulation", *MODES, "DoStep"),
    ("3", MODEL_EXCHANGE): ("InstantiateModelExchange", *MODES, *STATES, "GetContinuousStateDerivatives"),
}


class FmuLibrary:
    """A library in which a function that is missing and not needed is one that returns Error.

    Parameters
    ----------
    number : "1", "2" or "3", the first of its version of FMI
    """

    def __init__(self, library: ctypes.CDLL, number: str, kind: str) -> None:
        prefix = "fmi" if number == "1" else f"fmi{number}"
        self._needed = frozenset(prefix + name for name in (*NEEDED[number], *NEEDED_BY_KIND[number, kind]))
        self._library = library

    def find(self, name: str) -> Any:
        """Return a function, or None where it is missing."""
        return getattr(self._library, name, None)

    def __getattr__(self, name: str) -> Any:
        try:
            found = getattr(self._library, name)
        except AttributeError:
            if name[name.rfind("fmi") :] in self._needed:
                raise RuntimeError(f"its library has no function {name}") from None
            found = CFUNCTYPE(c_int)(lambda: 3)
        setattr(self, name, found)  # to look for one that is missing takes 20 us
        return found


@cache
def co_simulation_library(folder: str, identifier: str, number: str) -> FmuLibrary:
    """Return the library of an extracted FMU of FMI 2.0 or 3.0, loaded (and never unloaded).

    Raises
    ------
    RuntimeError
        It cannot be loaded; a sentence.
    """
    own, before = Path(folder).absolute() / "binaries" / binaries(number), Path.cwd()
    path = own / (identifier + SUFFIX)
    try:
        if not path.is_file():
            raise OSError(f"Cannot find shared library {path}.")
        os.chdir(own)  # where some find the libraries that they need
        return FmuLibrary(ctypes.CDLL(str(path)), number, CO_SIMULATION)
    except OSError as error:
        words = f"Failed to load shared library {path}. {error}" if path.is_file() else str(error)  # as fmpy says it
        raise RuntimeError(why_not_loaded(words, folder)) from error
    finally:
        os.chdir(before)
