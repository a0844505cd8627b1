"""The paper's figures, with small searches."""

import io
import re
from contextlib import redirect_stderr, redirect_stdout

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from scipy.signal import cheby1, sosfilt

from estimator.cli import main
from estimator.commands import paper_figures
from estimator.results import plots
from estimator.results.plots import rendered


@pytest.fixture(scope="module")
def command(tmp_path_factory):
    """Return what the command drew, the folder that it wrote, and what it said on both its outputs."""
    folder = tmp_path_factory.mktemp("paper") / "figures"
    drawn, out, err = [], io.StringIO(), io.StringIO()

    def kept(**how):
        drawn.append(made(**how))
        return drawn[0]

    def one_of_each(figure, kind):
        """Render a figure, but for those that take longest: as SVG and PDF only the eighth."""
        eighth = figure is drawn[0].figures[8]
        return rendered(figure, kind) if eighth or kind == "png" else b"rendered"

    made = paper_figures.paper_figures
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr(paper_figures, "paper_figures", kept)
        patch.setattr(plots, "rendered", one_of_each)
        assert main(["demo", "--paper-figures", "--nests", "8", "--iterations", "3", "-o", str(folder)]) == 0
    return drawn[0], folder, out.getvalue(), err.getvalue()


@pytest.fixture(scope="module")
def paper(command):
    return command[0]


def test_all_eight_figures_are_there_with_units_and_those_of_the_bench_say_that_it_is_emulated(paper):
    assert list(paper.figures) == [3, 4, 5, 6, 7, 8, 9, 10]
    for number, figure in paper.figures.items():
        title = figure.texts[0].get_text()
        assert title.startswith(f"Fig. {number}: ") and ("emulated" in title) == (number >= 7)
        whole, enlarged = figure.axes
        assert whole.get_ylabel() == ("current i [A]" if number in (4, 6, 8, 10) else "speed w [rad/s]")
        assert whole.get_xlim() == (0.0, 2.8) and enlarged.get_xlim() == pytest.approx((0.49, 0.62))
        labels = [text.get_text() for text in figure.legends[0].get_texts()]
        assert len(labels) == {3: 2, 4: 2, 7: 2, 8: 1}.get(number, 3)


def test_no_text_covers_another(paper):
    for number, figure in paper.figures.items():
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        renderer = canvas.get_renderer()
        texts = [figure.texts[0], *figure.legends[0].get_texts()]
        texts += [label for ax in figure.axes for label in (ax.xaxis.label, ax.yaxis.label) if label.get_text()]
        boxes = [text.get_window_extent(renderer) for text in texts]
        assert all(b.x0 >= 0 and b.x1 <= figure.bbox.x1 and b.y1 <= figure.bbox.y1 for b in boxes), number
        assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[k + 1 :]), number


def test_each_estimate_is_told_with_its_errors(paper):
    methods = [re.search(r", (paper|original|steiglitz-mcbride): errors", line)[1] for line in paper.lines]
    assert methods == ["paper", "original", "paper", "steiglitz-mcbride", "paper"]


def test_the_filter_is_a_chebyshev_filter_that_starts_settled():
    step = np.where(np.arange(400) < 100, 5.0, 9.0)
    sections = cheby1(3, 0.5, 50.0, fs=1000.0, output="sos")
    np.testing.assert_allclose(paper_figures.filtered(step), 5.0 + sosfilt(sections, step - 5.0), atol=1e-9)


@pytest.mark.parametrize(("kind", "start"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_a_figure_is_rendered_as_every_kind_and_always_to_the_same_bytes(command, kind, start):
    paper, folder, _, _ = command
    written = (folder / f"figure8.{kind}").read_bytes()
    assert written.startswith(start) and written == rendered(paper.figures[8], kind)


def test_the_command_writes_them(command):
    _, folder, out, err = command
    assert "RMCS2004, simulated, paper: errors R " in out and "CML-050, bench emulated: steiglitz-mcbride" in err
    assert len(list(folder.iterdir())) == 24


def test_sizes_of_the_searches_without_the_figures_are_told(capsys):
    assert main(["demo", "--nests", "4"]) == 2
    assert "--nests and --iterations are those of --paper-figures; give that too" in capsys.readouterr().err
