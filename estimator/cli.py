"""The command line: exit status, and one sentence where something is wrong. Knows no command's work.

Exit status: 0 done (an estimate may be doubtful), 1 refused or failed, 2 bad input or usage, 130 interrupted,
141 nobody reads the output any more. Nothing heavy is imported here: ``--help`` and ``--version`` answer at once.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import shlex
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from types import FrameType

from estimator.commands.arguments import parse
from estimator.commands.terminal import (
    BAD_INPUT,
    FAILED,
    INTERRUPTED,
    PROGRAM,
    StdoutClosed,
    StdoutFull,
    complain,
    give_up_stdout,
    make_printable,
    say,
)

MOMENT = 0.01  # s
DEBUG = "FMU_ESTIMATOR_DEBUG"  # environment variable: a traceback besides the sentence
_interrupts: list[int] = []  # signals that have come


def main(argv: Sequence[str] | None = None, *, begins: Callable[[], None] | None = None) -> int:
    """Run one command; return its exit status.

    Parameters
    ----------
    argv : list of str, optional
        The command's words; by default those that the program was started with.
    begins : callable, optional
        Called once an interrupt is reported in one sentence here.
    """
    arguments = sys.argv[1:] if argv is None else list(argv)
    if argv is None:
        sys.unraisablehook = interrupt_again
    make_printable()
    # The matrices here are small, and the cores simulate: more threads in the linear algebra only get in their way.
    if "numpy" not in sys.modules:  # which reads it when it is loaded; later an estimation asks for one thread itself
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        args = parse(arguments)
        args.command_line = shlex.join([PROGRAM, *arguments])
        if begins is not None:
            begins()
        status = _run(args)
        if argv is None:  # the program ends here, and Ctrl-C can only spoil its end
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        return status
    except KeyboardInterrupt:
        complain("interrupted")
        return INTERRUPTED
    except SystemExit as end:  # argparse: --help, --version, wrong usage
        status = int(end.code or 0)
        try:
            say("")
        except StdoutClosed:
            status = give_up_stdout()
        except StdoutFull as error:
            give_up_stdout()
            complain(str(error))
            status = BAD_INPUT
        return status


def interrupt(number: int, frame: FrameType | None) -> None:
    """Raise Ctrl-C's exception, and note it: an extension that is being imported makes another exception of it."""
    _interrupts.append(number)
    raise KeyboardInterrupt


def interrupt_again(lost: sys.UnraisableHookArgs) -> None:
    """Let a Ctrl-C that fell into a callback of the interpreter, where exceptions are ignored, come a moment later."""
    if not issubclass(lost.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(lost)
        return
    import _thread
    import threading

    threading.Timer(MOMENT, _thread.interrupt_main).start()


def _run(args: argparse.Namespace) -> int:
    """Run the command; turn whatever goes wrong into a sentence and an exit status."""
    from estimator.errors import EstimatorError, InputError, is_build_error

    try:
        return int(args.run(args))
    except StdoutClosed:
        return give_up_stdout()
    except StdoutFull as error:
        give_up_stdout()
        return _failed(args, str(error), status=BAD_INPUT)
    except InputError as error:
        return _failed(args, str(error), status=BAD_INPUT)
    except EstimatorError as error:
        return _failed(args, str(error), status=FAILED)
    except KeyboardInterrupt as interrupt:
        best = getattr(interrupt, "best", None)
        so_far = " ".join(f"{name}={value:.6g}" for name, value in (best or {}).items())
        complain("interrupted" + (f"; the best so far: {so_far}" if so_far else ""))
        return INTERRUPTED
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _failed(args, f"{where}{error.strerror or error}", status=BAD_INPUT if where else FAILED)
    except MemoryError:
        return _failed(args, "not enough memory; make it shorter, or give fewer --workers", status=FAILED)
    except Exception as error:
        if is_build_error(error):
            return _failed(args, str(error), status=BAD_INPUT)
        remedy = "" if os.environ.get(DEBUG) else f"; set {DEBUG}=1 to see where"
        return _failed(args, f"internal error, {type(error).__name__}: {error}{remedy}", status=FAILED)


def _failed(args: argparse.Namespace, sentence: str, *, status: int) -> int:
    """Report a failure on stderr and, if JSON was asked for and the input was good, as an object on stdout."""
    if os.environ.get(DEBUG):
        traceback.print_exc()
    if _interrupts:  # what failed is what Ctrl-C fell into
        complain("interrupted")
        return INTERRUPTED
    complain(sentence)
    if status == FAILED and getattr(args, "json", False) and args.command == "estimate":
        from estimator.results.result_json import refusal_json

        with contextlib.suppress(StdoutClosed, StdoutFull):
            say(refusal_json(sentence, method=args.method, seed=args.seed))
    return status
