"""The paper's figures 3 to 10, drawn again with this program. Knows the paper; draws, but writes no file.

Source: Rodríguez-Abreo et al., IEEE Access 2021, doi 10.1109/ACCESS.2021.3078578. Figures 3 to 6 are simulated there
and here. Figures 7 to 10 show a bench whose recording was never published: here it is emulated (see demo.py), and every
such figure says so.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from estimator.cases.case import Case, SearchSpec
from estimator.commands.drive import instants, stepped_voltage
from estimator.commands.paper_bench import NOMINAL, STEP, STEP_AT, STOP, VOLTAGE, emulated_recording
from estimator.recordings.reading import recording_from_arrays
from estimator.results.figure_layout import INPUT, MEASURED, RESIDUAL, SIMULATED
from estimator.results.plots import finish
from estimator.results.result import Estimate, FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RMCS2004 = {"R": 0.921042, "K": 0.073472, "L": 0.007759, "J": 1.36e-4, "B": 6.78e-4}  # Table II, SI units
ORDER, RIPPLE, CUTOFF = 3, 0.5, 50.0  # -, dB, Hz; the paper says Chebyshev, type I, and no more
GREEN = "#009e73"  # Okabe-Ito
EMULATED = "bench emulated: the paper's recording was not published"
TITLES = {
    3: "Fig. 3: speed of the RMCS2004, nominal and estimated",
    4: "Fig. 4: current of the RMCS2004, nominal and estimated",
    5: "Fig. 5: speed of the CML-050, nominal and estimated",
    6: "Fig. 6: current of the CML-050, nominal and estimated",
    7: "Fig. 7: measured speed of the CML-050 before and after the Chebyshev filter",
    8: "Fig. 8: measured current of the CML-050",
    9: "Fig. 9: speed of the CML-050, measured and estimated",
    10: "Fig. 10: current of the CML-050, measured and estimated",
}
UNITS = {"i": "A", "w": "rad/s"}


@dataclass(frozen=True)
class Paper:
    """Figures by number, and a line of text about every estimate that they show."""

    figures: Mapping[int, Figure]
    lines: tuple[str, ...]


def paper_figures(
    *,
    nests: int | None = None,
    iterations: int | None = None,
    seed: int = 1,
    workers: int | None = None,
    tell: Callable[[str], None] = lambda sentence: None,
) -> Paper:
    """Run the paper's experiments and draw its figures.

    Parameters
    ----------
    nests, iterations : int, optional
        Of the searches; by default the paper's 400 and 100, of some minutes in all.
    tell : callable
        Told what is being done.
    """
    times = instants(stop=STOP, step=STEP)
    voltage = stepped_voltage(times, level=VOLTAGE, at=STEP_AT)
    search = SearchSpec(seed=seed, nests=nests, iterations=iterations)
    lines: list[str] = []

    def estimated(title: str, signals: Mapping[str, FloatArray], motor: Mapping[str, float], method: str) -> Estimate:
        tell(f"{title}: {method}")
        found = _estimated(title, times, voltage, signals, search=replace(search, method=method), workers=workers)
        lines.append(_line(title, found, motor))
        return found

    rmcs, cml = (_simulated(motor, times, voltage) for motor in (RMCS2004, NOMINAL))
    columns = emulated_recording()
    bench = {"i": columns["current [A]"], "w": columns["speed [rad/s]"]}
    smooth = {"i": bench["i"], "w": filtered(bench["w"])}
    second = estimated("RMCS2004, simulated", rmcs, RMCS2004, "paper")
    original = estimated("CML-050, simulated", cml, NOMINAL, "original")
    proposed = estimated("CML-050, simulated", cml, NOMINAL, "paper")
    steiglitz = estimated("CML-050, bench emulated", bench, NOMINAL, "steiglitz-mcbride")
    measured = estimated("CML-050, bench emulated", smooth, NOMINAL, "paper")
    figures = {}
    for number, name in ((3, "w"), (4, "i")):
        figures[number] = _figure(
            number, name, times, [("nominal", MEASURED, rmcs[name]), ("proposed", SIMULATED, _shown(second, name))]
        )
    for number, name in ((5, "w"), (6, "i")):
        figures[number] = _figure(
            number,
            name,
            times,
            [
                ("nominal", MEASURED, cml[name]),
                ("original", RESIDUAL, _shown(original, name)),
                ("proposed", SIMULATED, _shown(proposed, name)),
            ],
        )
    figures[7] = _figure(
        7, "w", times, [("measured", MEASURED, bench["w"]), ("filtered", INPUT, smooth["w"])], emulated=True
    )
    figures[8] = _figure(8, "i", times, [("measured", MEASURED, bench["i"])], emulated=True)
    for number, name in ((9, "w"), (10, "i")):
        curves = [
            ("measured, speed filtered" if name == "w" else "measured", MEASURED, smooth[name]),
            ("Steiglitz-McBride", GREEN, _shown(steiglitz, name)),
            ("proposed", SIMULATED, _shown(measured, name)),
        ]
        figures[number] = _figure(number, name, times, curves, emulated=True)
    return Paper(figures, tuple(lines))


def filtered(speed: FloatArray) -> FloatArray:
    """Return a speed, (n,), behind the low-pass filter of section V; it starts in the first sample's steady state."""
    from scipy.signal import cheby1, lfilter, lfilter_zi

    b, a = cheby1(ORDER, RIPPLE, CUTOFF, fs=1 / STEP)
    shown, _ = lfilter(b, a, speed, zi=lfilter_zi(b, a) * speed[0])
    return np.asarray(shown)


def _simulated(motor: Mapping[str, float], times: FloatArray, voltage: FloatArray) -> dict[str, FloatArray]:
    from estimator.fmus.simulate import simulate

    return simulate("dc_motor", parameters=motor, inputs={"v": voltage}, times=times)


def _estimated(
    title: str,
    times: FloatArray,
    voltage: FloatArray,
    signals: Mapping[str, FloatArray],
    *,
    search: SearchSpec,
    workers: int | None,
) -> Estimate:
    from estimator.estimating.estimate import estimate_recordings

    columns = {"voltage [V]": voltage, "current [A]": signals["i"], "speed [rad/s]": signals["w"]}
    recording = recording_from_arrays(title, times, columns)
    (found,) = estimate_recordings([Case(search=search)], [[recording]], workers=workers)
    return found


def _shown(estimate: Estimate, name: str) -> FloatArray:
    if not estimate.comparisons or name not in estimate.comparisons[0].simulated:
        return np.array([])
    return estimate.comparisons[0].simulated[name]


def _line(title: str, estimate: Estimate, motor: Mapping[str, float]) -> str:
    errors = ", ".join(
        f"{name} {100 * (estimate.parameters[name].value / value - 1):+.2f} %"
        for name, value in motor.items()
        if name in estimate.parameters
    )
    rmse = ", ".join(f"{name} {value:.3g} {UNITS.get(name, '')}" for name, value in estimate.rmse.items())
    return f"{title}, {estimate.method}: errors {errors or '-'}; RMSE {rmse or '-'}; {estimate.simulations} simulations"


def _figure(
    number: int,
    name: str,
    times: FloatArray,
    curves: Sequence[tuple[str, str, FloatArray]],
    *,
    emulated: bool = False,
) -> Figure:
    """Return curves over the whole record, left, and enlarged over the transient, right."""
    from matplotlib.figure import Figure

    fig = Figure(figsize=(9.0, 3.7))
    title = TITLES[number] + (f"\n({EMULATED})" if emulated else "")
    fig.text(0.085, 0.98, title, ha="left", va="top", fontsize="medium")
    windows = [(0.0, STOP), (STEP_AT - 0.01, STEP_AT + 0.12)]
    for column, (start, end) in enumerate(windows):
        ax = fig.add_axes((0.085 + 0.475 * column, 0.145, 0.42, 0.6))
        seen = (times >= start) & (times <= end)
        for k, (label, colour, values) in enumerate(curves):
            if len(values):
                width, style = (
                    (3.6, "-")
                    if k == 0 and len(curves) > 1 and not emulated
                    else (2.4, "-")
                    if k == 0
                    else (1.4, "--" if k == 1 and len(curves) > 2 else "-")
                )
                ax.plot(times[seen], values[seen], color=colour, lw=width, ls=style, label=label)
        ax.set_xlim(start, end)
        ax.set_xlabel("time [s]")
        if column == 0:
            ax.set_ylabel({"w": "speed w [rad/s]", "i": "current i [A]"}[name])
        finish(ax)
    handles, texts = fig.axes[0].get_legend_handles_labels()
    fig.legend(handles, texts, loc="upper right", bbox_to_anchor=(0.99, 0.87), ncols=3, frameon=False, fontsize="small")
    return fig
