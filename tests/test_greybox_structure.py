"""The grey box chooses parts that a trace can tell apart, and its tables say what its fit says."""

import numpy as np
import pytest

from printmend.bench.drawn_body import drawn_body
from printmend.corruption import sample
from printmend.printer import read_printer
from printmend.twin import Twin
from printmend.worldmodel.greybox import Greybox
from printmend.worldmodel.transitions import layer_trace

ENDER5 = read_printer("ender5")


@pytest.mark.parametrize("seed", [2, 4, 6])
def test_a_learned_machine_prints_its_own_layer_again(seed: int) -> None:
    """Whole steps meet the ripple of one step at one phase: it is no ripple then, but an offset."""
    rng = np.random.default_rng(seed)
    twin = Twin.of(sample("everything", rng, "realistic"), ENDER5)
    layer = drawn_body(rng, ENDER5, size_mm=100.0).layers[0]
    printed = twin.run(layer.controls, layer.start_steps)
    model = Greybox().fit(layer_trace(layer, printed, ENDER5), ENDER5, rng=rng)
    again = Twin(model.mechanism).run(layer.controls, layer.start_steps)
    off_um = 200 * (again - printed)
    assert np.sqrt(np.mean(off_um**2)) < 5.0
