"""The effects: causes of error of a printer, its print or its measurement. Each has one file with everything about it.

`EFFECTS` lists them by name; others come by the entry points of the group ``printmend.effects``.
"""

import numpy as np

from printmend.effects.aspect import Aspect
from printmend.effects.bead import Bead
from printmend.effects.bend import Bend
from printmend.effects.bent import Bent
from printmend.effects.breathing import Breathing
from printmend.effects.bump import Bump
from printmend.effects.calibration import Calibration
from printmend.effects.carriage import Carriage
from printmend.effects.carriage_wave import CarriageWave
from printmend.effects.creep import Creep
from printmend.effects.crooked import Crooked
from printmend.effects.digits import Digits
from printmend.effects.distortion import Distortion
from printmend.effects.drift import Drift
from printmend.effects.effect import Acts, Effect, Of, Places, Scene, Term, home_of, places_of, scene_of
from printmend.effects.elastic import Elastic
from printmend.effects.friction import Friction
from printmend.effects.halves import Halves
from printmend.effects.idler import Idler
from printmend.effects.joint import Joint
from printmend.effects.lag import Lag
from printmend.effects.lag_wear import LagWear
from printmend.effects.layer import Layer
from printmend.effects.lens import Lens
from printmend.effects.loose import Loose
from printmend.effects.origin import Origin
from printmend.effects.paper import Paper
from printmend.effects.place import Place
from printmend.effects.play import Play
from printmend.effects.pulley import Pulley
from printmend.effects.racking import Racking
from printmend.effects.rail import Rail
from printmend.effects.resized import Resized
from printmend.effects.rub import Rub
from printmend.effects.scale import Scale
from printmend.effects.sheet import Sheet
from printmend.effects.shift import Shift
from printmend.effects.shrinkage import Shrinkage
from printmend.effects.skew import Skew
from printmend.effects.skip import Skip
from printmend.effects.soft_play import SoftPlay
from printmend.effects.speed import Speed
from printmend.effects.splice import Splice
from printmend.effects.step import Step
from printmend.effects.stretch import Stretch
from printmend.effects.teeth import Teeth
from printmend.effects.tilt import Tilt
from printmend.effects.turn import Turn
from printmend.effects.two_motors import TwoMotors
from printmend.effects.uneven import Uneven
from printmend.effects.uneven_play import UnevenPlay
from printmend.effects.wander import Wander
from printmend.effects.warmth import Warmth
from printmend.effects.wear import Wear
from printmend.effects.wobble import Wobble
from printmend.errors import ConfigError
from printmend.messages import catalogue, say
from printmend.plugins import EFFECTS as GROUP
from printmend.plugins import load_plugin, plugin_names

_ALL: tuple[Effect, ...] = (
    Place(), Scale(), Bend(), Pulley(), Play(), Breathing(), Friction(), Elastic(), Uneven(), Splice(), Bump(), Rub(),
    Idler(), Teeth(), Skew(), Aspect(), Bent(), Rail(), Crooked(), Joint(), Distortion(), Racking(), Tilt(), Lag(),
    LagWear(), Loose(), SoftPlay(), Speed(), TwoMotors(), UnevenPlay(), Drift(), Creep(), Step(), Sheet(), Skip(),
    Warmth(), Wear(), Wander(), Wobble(), Layer(), Origin(), Shift(), Turn(), Stretch(), Resized(), Carriage(),
    CarriageWave(), Lens(), Paper(), Halves(), Bead(), Shrinkage(), Digits(), Calibration(),
)  # fmt: skip
_NEEDS = ("name", "of", "acts", "from_home", "fate", "most", "terms", "columns", "finer")


EFFECTS: dict[str, Effect] = {effect.name: effect for effect in _ALL}


def _added(point: str) -> str:
    """Add an effect of another package to `EFFECTS`, and return its name.

    Raises `ConfigError` where there is none at this ``point``, or where its name is another's.
    """
    effect: Effect = load_plugin(GROUP, point, wanted=say("effect-2"), has=_NEEDS)
    if EFFECTS.setdefault(effect.name, effect) is not effect:
        raise ConfigError(point, wanted=say("effect-name-own"), came=f"{effect.name!r}", todo=say("give-another-name"))
    return effect.name


for _point in plugin_names(GROUP):
    _added(_point)


def registered(name: str) -> str:
    """Return an effect's name; one at a place ``module:NAME`` is added to `EFFECTS`.

    Raises `ConfigError` where there is none, or where its name is another's.
    """
    return _added(name) if ":" in name else name


def title_of(name: str) -> str | None:
    """Return what an owner calls an effect, None for another package's."""
    own = name.replace("_", "-")
    return say(f"effect-{own}") if f"effect-{own}" in catalogue() else None


def columns_of(name: str, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
    """Return where an effect moves places [N, 2, P] mm for one unit of each size.

    If the print began at the end stops, the machine's error there counts as zero: homing removes it.
    """
    effect = EFFECTS[name]
    columns = effect.columns(places, where, shape, scene)
    if scene.homed and effect.of is Of.MACHINE and effect.from_home:
        columns = columns - effect.columns(home_of(scene), where, shape, scene)
    return columns


__all__ = [
    "EFFECTS",
    "Acts",
    "Effect",
    "Of",
    "Places",
    "Scene",
    "Term",
    "columns_of",
    "home_of",
    "places_of",
    "registered",
    "scene_of",
]
