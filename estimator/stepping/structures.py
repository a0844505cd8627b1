"""The memory of ``stepper.c``, as ctypes sees it: its structures, field by field. That file says what they mean."""

from __future__ import annotations

import ctypes
from ctypes import c_char, c_char_p, c_double, c_int64, c_uint64, c_void_p

MAX_SECTIONS = 16  # as in sensors.h
# Types of settings, as in fmi3_adapter.h.
SETTING_TYPES = {"Integer": 0, "Boolean": 1, "String": 2, "Float32": 3, "Int8": 4, "UInt8": 5, "Int16": 6, "UInt16": 7}
SETTING_TYPES |= {"Int32": 8, "UInt32": 9, "Int64": 10, "UInt64": 11}


class Log(ctypes.Structure):
    """The FMU's words."""

    _fields_ = [("messages", c_int64), ("last", c_char * 512)]


class FmuStruct(ctypes.Structure):
    """The FMU's instance and functions."""

    _fields_ = [
        ("reinstantiate", c_int64),
        ("component", c_void_p),
        ("instantiate", c_void_p),
        ("free_instance", c_void_p),
        ("reset", c_void_p),
        ("setup_experiment", c_void_p),
        ("enter_initialization", c_void_p),
        ("exit_initialization", c_void_p),
        ("set_real", c_void_p),
        ("get_real", c_void_p),
        ("do_step", c_void_p),
        ("instance_name", c_char_p),
        ("guid", c_char_p),
        ("resources", c_char_p),
        ("callbacks", c_void_p),
        ("restore_every_step", c_int64),
        ("set_integer", c_void_p),
        ("set_boolean", c_void_p),
        ("set_string", c_void_p),
        ("set_other", c_void_p),
        ("set_derivatives", c_void_p),
        ("horizon", c_void_p),
    ]


class CallbacksStruct(ctypes.Structure):
    """FMI 2.0's callbacks, as the standard orders them."""

    _fields_ = [
        ("logger", c_void_p),
        ("allocate_memory", c_void_p),
        ("free_memory", c_void_p),
        ("step_finished", c_void_p),
        ("environment", c_void_p),
    ]


class SettingStruct(ctypes.Structure):
    """A value that is no real number, set before every initialisation."""

    _fields_ = [
        ("type", c_int64),
        ("reference", c_int64),
        ("whole", c_int64),
        ("real", c_double),
        ("text", c_char_p),
    ]


class Fmi3Struct(ctypes.Structure):
    """The functions of an FMU of FMI 3.0."""

    _fields_ = [
        ("instantiate", c_void_p),
        ("free_instance", c_void_p),
        ("reset", c_void_p),
        ("enter_initialization", c_void_p),
        ("exit_initialization", c_void_p),
        ("set_float64", c_void_p),
        ("get_float64", c_void_p),
        ("do_step", c_void_p),
        ("set_other", c_void_p * len(SETTING_TYPES)),
        ("log", c_void_p),
        ("log_message", c_void_p),
    ]


# SUNDIALS' functions that CVode needs, in the order of bdf.h; each beside the library of fmpy's that holds it.
SUNDIALS = (
    ("sundials_core", "SUNContext_Create"),
    ("sundials_core", "SUNContext_ClearErrHandlers"),
    ("sundials_core", "SUNContext_Free"),
    ("sundials_nvecserial", "N_VNew_Serial"),
    ("sundials_core", "N_VGetArrayPointer"),
    ("sundials_core", "N_VDestroy"),
    ("sundials_sunmatrixdense", "SUNDenseMatrix"),
    ("sundials_core", "SUNMatDestroy"),
    ("sundials_sunlinsoldense", "SUNLinSol_Dense"),
    ("sundials_core", "SUNLinSolFree"),
    ("sundials_cvode", "CVodeCreate"),
    ("sundials_cvode", "CVodeInit"),
    ("sundials_cvode", "CVodeReInit"),
    ("sundials_cvode", "CVodeSVtolerances"),
    ("sundials_cvode", "CVodeSetLinearSolver"),
    ("sundials_cvode", "CVodeSetUserData"),
    ("sundials_cvode", "CVodeSetStopTime"),
    ("sundials_cvode", "CVode"),
    ("sundials_cvode", "CVodeGetDky"),
    ("sundials_cvode", "CVodeFree"),
)


class EquationsStruct(ctypes.Structure):
    """The functions of an FMU for model exchange, or of FMI 1.0, and its solver's."""

    _fields_ = [
        ("version", c_int64),
        ("is_model", c_int64),
        ("states", c_int64),
        ("indicators", c_int64),
        ("tolerance", c_double),
        ("horizon", c_double),
        ("instantiate", c_void_p),
        ("free_instance", c_void_p),
        ("reset", c_void_p),
        ("setup", c_void_p),
        ("enter", c_void_p),
        ("exit", c_void_p),
        ("initialize", c_void_p),
        ("set_real", c_void_p),
        ("get_real", c_void_p),
        ("do_step", c_void_p),
        ("set_time", c_void_p),
        ("set_states", c_void_p),
        ("get_states", c_void_p),
        ("get_derivatives", c_void_p),
        ("get_indicators", c_void_p),
        ("get_nominals", c_void_p),
        ("enter_event", c_void_p),
        ("update", c_void_p),
        ("enter_continuous", c_void_p),
        ("completed", c_void_p),
        ("count_states", c_void_p),
        ("count_indicators", c_void_p),
        ("set_other", c_void_p * len(SETTING_TYPES)),
        ("callbacks", c_void_p),
        ("log", c_void_p),
        ("log_message", c_void_p),
        ("words", c_void_p),
        ("location", c_char_p),
        ("sundials", c_void_p * len(SUNDIALS)),
    ]


class ChainStruct(ctypes.Structure):
    """What stands between one output and what its sensor shows."""

    _fields_ = [("average", c_int64), ("sections", c_int64), ("section", c_double * 5 * MAX_SECTIONS)]


class ExperimentStruct(ctypes.Structure):
    """One recording as the stepper sees it."""

    _fields_ = [
        ("samples", c_int64),
        ("substeps", c_int64),
        ("start", c_double),
        ("interval", c_double),
        ("inputs", c_void_p),
        ("measured", c_void_p),
        ("weights", c_void_p),
        ("complete", c_int64),
        ("chains", c_void_p),
        ("times", c_void_p),
        ("ends", c_void_p),
    ]


class JobStruct(ctypes.Structure):
    """What to set, read and compare."""

    _fields_ = [
        ("parameters", c_int64),
        ("inputs", c_int64),
        ("outputs", c_int64),
        ("experiments", c_int64),
        ("parameter_references", c_void_p),
        ("input_references", c_void_p),
        ("output_references", c_void_p),
        ("sensors", c_void_p),
        ("experiment", c_void_p),
        ("sensor_values", c_int64),
        ("even_steps", c_int64),
        ("settings", c_int64),
        ("setting", c_void_p),
        ("scale", c_void_p),
        ("linear", c_void_p),
    ]


class BatchStruct(ctypes.Structure):
    """Candidates in shared memory."""

    _fields_ = [
        ("next", c_void_p),
        ("claim", c_void_p),
        ("candidates", c_int64),
        ("quota", c_int64),
        ("refine", c_int64),
        ("values", c_void_p),
        ("bounds", c_void_p),
        ("costs", c_void_p),
        ("steps", c_void_p),
        ("outcomes", c_void_p),
        ("shown", c_void_p),
    ]


class PlacesStruct(ctypes.Structure):
    """Where parameters go in candidates, of ``fits.h``."""

    _fields_ = [
        ("parameters", c_int64),
        ("low", c_void_p),
        ("high", c_void_p),
        ("lower", c_void_p),
        ("upper", c_void_p),
        ("log", c_void_p),
        ("column", c_void_p),
        ("gain", c_void_p),
        ("shift", c_void_p),
        ("simulations", c_int64),
        ("steps", c_int64),
    ]


class FitsStruct(ctypes.Structure):
    """Whole fits, of ``fits.h``."""

    _fields_ = [
        ("places", PlacesStruct),
        ("starts", c_int64),
        ("evaluations", c_int64),
        ("ftol", c_double),
        ("xtol", c_double),
        ("least_step", c_double),
        ("known_cost", c_double),
        ("known", c_void_p),
        ("start", c_void_p),
        ("weights", c_void_p),
        ("ends", c_void_p),
        ("costs", c_void_p),
        ("ended", c_void_p),
    ]


class DescentStruct(ctypes.Structure):
    """A descent, of ``fits.h``."""

    _fields_ = [
        ("places", PlacesStruct),
        ("iterations", c_int64),
        ("rounds", c_int64),
        ("fine", c_int64),
        ("told", c_int64),
        ("tolerance", c_double),
        ("limit", c_double),
        ("least_part", c_double),
        ("most_part", c_double),
        ("known_cost", c_double),
        ("known", c_void_p),
        ("bars", c_void_p),
        ("longest", c_void_p),
        ("steps", c_void_p),
        ("x", c_void_p),
        ("samples", c_void_p),
        ("cost", c_double),
        ("ended", c_int64),
        ("knows", c_int64),
    ]


assert ctypes.sizeof(c_uint64) == ctypes.sizeof(c_void_p), "the stepping loop needs a 64-bit platform"
