"""Figures drawn in a process of their own, which loads matplotlib while an estimation runs. Knows only results."""

from __future__ import annotations

import contextlib
import gc
import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from estimator.results.reason import Place, places_of
from estimator.results.result import Comparison, Estimate

Files = dict[str, bytes]


class FigureProcess:
    """A process that is ready to draw; it ends with the ``with`` statement, whatever happens in it."""

    def __enter__(self) -> FigureProcess:
        """Start the process; it loads what it needs on its own."""
        root = str(Path(__file__).resolve().parents[2])
        code = f"import sys; sys.path.insert(0, {root!r}); from estimator.results.figure_process import main; main()"
        self._process: subprocess.Popen[bytes] | None = None
        with contextlib.suppress(OSError):  # then it is drawn here
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", code],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
                start_new_session=os.name == "posix",  # Ctrl-C is the owner's
            )
        return self

    def __exit__(self, *_: object) -> None:
        """End the process."""
        if self._process is None:
            return
        self._process.kill()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()

    def begin(self, estimate: Estimate, kinds: Sequence[str]) -> Callable[[], Files]:
        """Begin to draw an estimate's figure; the result waits for it, and returns it by file name."""
        shown = drawable(estimate)
        process = self._process
        if process is None or not shown:
            return lambda: draw(estimate, kinds)
        order = pickle.dumps(
            (shown, dict(estimate.noise), places_of(estimate.reasons), tuple(kinds)), protocol=pickle.HIGHEST_PROTOCOL
        )
        answers: list[bytes] = []

        def talk() -> None:
            with contextlib.suppress(OSError, ValueError):
                answers.append(process.communicate(order)[0])

        thread = threading.Thread(target=talk, daemon=True)
        thread.start()

        def drawn() -> Files:
            thread.join()
            if process.returncode == 0 and answers:
                files: Files = pickle.loads(answers[0])
                return files
            return draw(estimate, kinds)

        return drawn


def drawable(estimate: Estimate) -> list[Comparison]:
    """Return the recordings that have something to draw."""
    return [c for c in estimate.comparisons if c.measured and len(c.time) > 1]


def draw(estimate: Estimate, kinds: Sequence[str]) -> Files:
    """Draw an estimate's figure here, by file name; nothing where there is nothing to draw."""
    shown = drawable(estimate)
    return _drawn(shown, dict(estimate.noise), places_of(estimate.reasons), kinds) if shown else {}


def main() -> None:
    """Serve one order: read from stdin what to draw, and write the files to stdout."""
    gc.disable()  # an eighth of loading matplotlib; the process ends with its figure
    from estimator.results import plots

    plots.warm_up()
    order = sys.stdin.buffer.read()
    if order:
        comparisons, noise, places, kinds = pickle.loads(order)
        sys.stdout.buffer.write(pickle.dumps(_drawn(comparisons, noise, places, kinds)))
        sys.stdout.buffer.flush()


def _drawn(
    comparisons: Sequence[Comparison], noise: dict[str, float], places: Sequence[Place], kinds: Sequence[str]
) -> Files:
    from estimator.results.picture import comparison_png

    files = {"figure.png": comparison_png(comparisons, noise=noise, places=places)} if "png" in kinds else {}
    if rest := [kind for kind in kinds if kind != "png"]:
        from estimator.results.plots import comparison_figure, rendered

        figure = comparison_figure(comparisons, noise=noise, places=places)
        files |= {f"figure.{kind}": rendered(figure, kind) for kind in rest}
    return files
