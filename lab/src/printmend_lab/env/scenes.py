"""What the one-print environments draw: a broken machine and a path on which knowing the fault pays."""

from dataclasses import dataclass

import numpy as np

from printmend.errors import ConfigError
from printmend.learn.mechanism_model import MechanismModel
from printmend.machine import Mechanism
from printmend.metrics import rmse
from printmend.printer import Printer
from printmend.twin import Twin
from printmend_lab.control.optimal import Optimal
from printmend_lab.env.fleet import mechanisms_of, random_layer
from printmend_lab.path import Layer
from printmend_lab.sampling import Severity, fault

# A scene is drawn again unless the optimum is this much better than Naive: below it the score would divide by nothing.
# Half the published lattice's rounding, 0.02 mm on the presets.
LEAST_GAIN_STEPS = 0.1
_DRAWS = 300  # after which a family counts as one with nothing to gain

_BOTH = (
    "radius", "eccentric", "fourier", "tabulated", "published", "pulley", "pulley-play", "pulley-loose",
    "pulley-set-screw", "elastic", "smooth", "frame", "everything",
)  # fmt: skip
# Families with something to gain on the lattice of full steps. Other faults of a well-kept machine are below its
# rounding, and so are friction and ripple even when damaged. Jumps cannot be foreseen; a screw moves no planar print.
SCENES: dict[Severity, tuple[str, ...]] = {
    "damaged": (*_BOTH, "ellipse", "polygon", "flat", "play", "loose", "set-screw"),
    "realistic": _BOTH,
}


@dataclass(frozen=True, eq=False)
class Scene:
    """A broken machine, the path to print on it, and the RMSE [full steps] there of two plans.

    The path commanded as it is scores 0, the best plan that the true machine allows scores 1.
    """

    mechanism: Mechanism
    layer: Layer
    naive_steps: float
    optimum_steps: float

    @property
    def gain_steps(self) -> float:
        """By how much the best plan beats Naive."""
        return self.naive_steps - self.optimum_steps


def scene_of(mechanism: Mechanism, layer: Layer) -> Scene:
    """Print a path as it is and as well as can be, and return the scene."""
    twin, nominal, start = Twin(mechanism), layer.nominal_steps, layer.start_steps
    plan = Optimal().plan(MechanismModel(mechanism), nominal[1:], start)
    naive, best = (rmse(nominal, twin.run(controls, start)) for controls in (layer.controls, plan.controls))
    return Scene(mechanism, layer, naive, min(naive, best))


def draw_scene(rng: np.random.Generator, printer: Printer, family: str, severity: Severity, ticks: int) -> Scene:
    """Draw a fault of a family and a path of ``ticks`` until there is something to gain.

    Raises `ConfigError` for a family that does not exist, has no hidden mechanics, or nothing to gain.
    """
    for _ in range(_DRAWS):
        (mechanism,) = mechanisms_of([fault(family, rng, severity)], printer)
        scene = scene_of(mechanism, random_layer(rng, printer, ticks))
        if scene.gain_steps >= LEAST_GAIN_STEPS:
            return scene
    raise ConfigError(
        "environment", wanted=f"a family with {LEAST_GAIN_STEPS} full steps to gain", came=f"{family}, {severity}",
        todo="choose another family, or damaged",
    )  # fmt: skip
