"""Text that is no header above rows, but can be written so: the ways there are. Knows none of their lines."""

from __future__ import annotations

from collections.abc import Callable

from estimator.recordings.barred_lines import with_bars_read
from estimator.recordings.html_lines import with_html_read
from estimator.recordings.long_lines import with_influx_read, with_names_read, with_teleplot_read, with_twincat_read
from estimator.recordings.scope_lines import with_settings_read, with_start_and_step, with_times

WAYS = (
    with_html_read,
    with_times,
    with_settings_read,
    with_start_and_step,
    with_twincat_read,
    with_teleplot_read,
    with_influx_read,
    with_names_read,
    with_bars_read,
)


def rewriter(head: list[str]) -> Callable[[list[str]], list[str]] | None:
    """Return what writes all lines of a file that begins so as a header above rows; None where it needs none."""
    return next((way for way in WAYS if way(head) is not head), None)
