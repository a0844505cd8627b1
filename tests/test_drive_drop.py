"""A drive that gives a constant voltage less than its command, and none for less than that."""

import numpy as np
import pytest
from effect_bench import H, worst
from motors import CML050, held_response, recording_of

from estimator import estimate_parameters

pytestmark = pytest.mark.usefixtures("shared_workers")

K = np.arange(700)
COMMANDS = {
    "triangle": 10.5 * np.interp(K, [0, 60, 220, 420, 600], [0, 0, 1, -1, 0]),
    "back to zero": np.where((K >= 100) & (K < 400), 10.5, 0.0),
}


def dropped(command, drop, seed=1):
    """Return the command's recording, and what the motor does at so much less."""
    voltage = np.sign(command) * np.maximum(np.abs(command) - drop, 0.0)
    shown = held_response(CML050, voltage, step=H)
    return recording_of("bench", K * H, command, shown, noise=(0.02, 1.0), seed=seed)


@pytest.mark.parametrize("drop", [0.9, pytest.param(0.3, marks=pytest.mark.full)])
def test_a_drop_of_the_drive_is_told_where_the_command_begins_slowly(drop):
    """Below the drop the motor has no voltage: that was told as steps of the load and a dry friction."""
    found = estimate_parameters(dropped(COMMANDS["triangle"], drop), workers=1)
    assert "drop of the drive" in found.effects, found.effects
    assert found.chain["drop of the drive"].value == pytest.approx(drop, abs=0.05)
    off = {
        n: (p.value - getattr(CML050, n)) / p.standard_error for n, p in found.parameters.items() if p.standard_error
    }
    assert max(map(abs, off.values())) < 4.5, (off, found.reasons)


def test_at_commands_of_one_size_it_is_named_as_what_is_not_visible():
    """It is a gain of the voltage there. A brush drop shows in the current that decays."""
    found = estimate_parameters(dropped(COMMANDS["back to zero"], 0.0), workers=1)
    assert found.verdict == "ok" and worst(found) < 4.5
    assert "drop of the drive" not in found.effects
    (hidden,) = [h for h in found.not_visible if h.effect == "drop of the drive"]
    assert hidden.whatever_size and hidden.off["K"][0] == pytest.approx(0.05, rel=0.1)
