"""Choose the firmware settings that a model supports: each must help by more than its own uncertainty."""

from dataclasses import dataclass, replace

import numpy as np

from printmend.effects import EFFECTS
from printmend.effects.effect import SCALE_MM, belt_places, drawn_places, held_mm
from printmend.effects.play import PLAYS
from printmend.errors import RefusedError
from printmend.export.firmware import EXPORTS, NO_BACKLASH, Export, Simple, simple_part
from printmend.infer.machine import DRAWS
from printmend.messages import is_one_of, say, together
from printmend.model import SavedModel
from printmend.model.model import refusals
from printmend.promise.belief import Belief, parse_belief
from printmend.promise.filament import UNTOLD
from printmend.promise.predict import UNSHOWN_MM, UNSHOWN_SD

SURE = 0.95  # share of the drawn machines that must have a fault for its setting to be written
SURE_SIGMAS = 2.0  # standard deviations: the coverage factor k of an expanded uncertainty (JCGM 100, 6.3)
UNSHOWN_MOST_MM = UNSHOWN_MM * float(np.exp(1.645 * UNSHOWN_SD))  # in 95 % of printers, test prints miss less than this
GAIN_MM = 0.001  # a setting that lowers the error over the bed by less is not worth typing
_PLACES = 400  # places of an axis at which two laws are compared


@dataclass(frozen=True)
class _Setting:
    """One value of a firmware: its name, its standard deviation as an error over the bed [mm], and the share of the
    drawn machines that have such a fault."""

    name: str
    doubt_mm: float
    chance: float = 1.0


def export_supported(model: SavedModel, firmware: str) -> Export:
    """Return the firmware settings that help against a model's faults, and those left out.

    Raises `RefusedError` if no setting would help by more than its uncertainty, or if the model does not fit its data.
    """
    if said := refusals(model.document):
        raise RefusedError(
            "printmend export", wanted=say("model-fits-own-measurement"), came=said[0], todo=say("measure-again-learn")
        )
    mechanism, belief = model.mechanism, parse_belief(model)
    make, every = EXPORTS[firmware], _settings(model, belief)
    if firmware == "linuxcnc":  # one table per joint holds the whole fault
        export, left_out = make(mechanism), []
        doubt = max(each.doubt_mm for each in every)
        if export.before_mm - export.after_mm < max(GAIN_MM, SURE_SIGMAS * doubt):
            left_out = [_why(say("setting-tables"), export.before_mm - export.after_mm, doubt)]
        return _judged(model, belief, export, ("tables of both joints",) if not left_out else (), tuple(left_out))
    may_skew = next(each.chance >= SURE for each in every if each.name == "skew")
    whole = simple_part(mechanism, None if belief is None else belief.scene.turns_mm, may_skew=may_skew)
    settings = [each for each in every if _without(whole, each.name) != whole]
    kept, left_out, homeless = whole, [], []
    for each in sorted(settings, key=lambda setting: -setting.doubt_mm):
        without = _without(kept, each.name)
        gain = make(mechanism, without).after_mm - make(mechanism, kept).after_mm
        alone_mm = _alone_mm(model, whole, each.name)
        known = each.chance >= SURE and alone_mm >= SURE_SIGMAS * each.doubt_mm
        if gain == 0.0:  # this firmware has no such setting
            kept = without
            homeless += [each.name] if known and alone_mm >= GAIN_MM else []
        elif gain < GAIN_MM or not known:
            kept = without
            left_out.append(_why(_words(each.name), gain, each.doubt_mm, each.chance))
    if homeless:
        names = [_words(name) for name in sorted(homeless)]
        whose = say("and", *names) if len(names) == 2 else together(", ", names)
        left_out.append(say("setting-homeless", whose, say(NO_BACKLASH[firmware])))
    left_out += [gap for gap in model.findings if is_one_of(gap, UNTOLD)]
    helping = tuple(each.name for each in settings if _without(kept, each.name) != kept)
    return _judged(model, belief, make(mechanism, kept), helping, tuple(left_out))


def _judged(
    model: SavedModel, belief: Belief | None, export: Export, names: tuple[str, ...], left_out: tuple[str, ...]
) -> Export:
    """Return an export with notes. Raise `RefusedError` if none of its settings helps."""
    if not names:
        came = together("; ", left_out) if left_out else say("settings-change-nothing")
        raise RefusedError(
            model.printer.name, wanted=say("fault-firmware-can-hold"), came=came,
            todo=say("leave-settings-they-there-nothing-mend") if model.is_healthy
            else say("terminal-leave-settings-they-printmend-mend-mends"),
        )  # fmt: skip
    doubt_mm2 = sum(each.doubt_mm**2 for each in _settings(model, belief)) + _beside_mm2(belief)
    doubt_mm = float(np.hypot(SURE_SIGMAS * np.sqrt(doubt_mm2), UNSHOWN_MOST_MM))
    return replace(export, settings=names, left_out=left_out, doubt_mm=doubt_mm)


def _why(name: str, gain_mm: float, doubt_mm: float, chance: float = 1.0) -> str:
    """Say why a setting is left out."""
    if gain_mm <= -GAIN_MM:
        return say("setting-worse", name, f"{-gain_mm:.3f}")
    if gain_mm < GAIN_MM:
        return say("setting-useless", name, f"{GAIN_MM:.3f}")
    if chance < SURE:
        return say("setting-may-be-none", name, f"{100 * (1 - chance):.0f}")
    return say("setting-unsure", name, f"{SURE_SIGMAS * doubt_mm:.3f}")


def _words(name: str) -> str:
    """Return a setting's name as a message."""
    what, _, motor = name.partition(" of ")
    return say(f"setting-{what}", *filter(None, [motor]))


def _without(simple: Simple, name: str) -> Simple:
    """Return the simple part without one of its settings."""
    what, _, motor = name.partition(" of ")
    if what == "skew":
        return replace(simple, skew=0.0)
    at = 0 if motor in ("X", "A") else 1
    if what == "scale":
        return replace(simple, gain=(1.0, simple.gain[1]) if at == 0 else (simple.gain[0], 1.0))
    return replace(simple, play_mm=(0.0, simple.play_mm[1]) if at == 0 else (simple.play_mm[0], 0.0))


def _alone_mm(model: SavedModel, simple: Simple, name: str) -> float:
    """Return the error over the bed that one setting corrects [mm]."""
    what, _, motor = name.partition(" of ")
    reach = _spread_mm(model)
    if what == "skew":
        return abs(simple.skew) * reach[1]
    at = 0 if motor in ("X", "A") else 1
    return abs(simple.gain[at] - 1) * reach[at] if what == "scale" else simple.play_mm[at] / 2


def _spread_mm(model: SavedModel) -> np.ndarray:
    """Return the root mean square distance from the bed's middle along x and y [2], over its middle 80 %."""
    return 0.8 * np.array([model.printer.x.length_mm, model.printer.y.length_mm]) / np.sqrt(12)


def _settings(model: SavedModel, belief: Belief | None) -> list[_Setting]:
    """Return every setting that a firmware may have, with its uncertainty; none without drawn machines."""
    reach, axes = _spread_mm(model), _chance(belief, ("aspect",))
    found = []
    for at, name in enumerate(each.upper() for each in model.printer.motors):
        scale = _drawn(belief, "scale", where=at) / SCALE_MM
        found += [
            _Setting(f"scale of {name}", float(scale.std()) * reach[at], max(_chance(belief, ("scale",), at), axes)),
            _Setting(f"backlash of {name}", float(_plays_mm(belief, at).std()) / 2, _chance(belief, PLAYS, at)),
        ]
    skew = sum(_drawn(belief, "skew", where=axis) for axis in range(2)) / SCALE_MM
    return [*found, _Setting("skew", float(np.std(skew)) * reach[1], _chance(belief, ("skew",)))]


def _drawn(belief: Belief | None, effect: str, *, where: int) -> np.ndarray:
    """Return the first size [D] of an effect at one place in each drawn machine."""
    parts = () if belief is None else belief.of(effect, where)
    return np.asarray(sum((part.draws_mm[0] for part in parts), np.zeros(DRAWS)))


def _chance(belief: Belief | None, effects: tuple[str, ...], where: int | None = None) -> float:
    """Return the share of the drawn machines that have one of some effects."""
    if belief is None:
        return 1.0
    parts = [part for effect in effects for part in belief.of(effect, where)]
    return float(np.any([part.draws_mm.any(axis=0) for part in parts], axis=0).mean()) if parts else 0.0


def _plays_mm(belief: Belief | None, motor: int) -> np.ndarray:
    """Return the mean play [D] of a motor over the measured span, in each drawn machine."""
    plays = np.zeros(DRAWS)
    if belief is None:
        return plays
    places = belt_places(motor, np.linspace(*belief.scene.motor_span_mm[motor], _PLACES), 1.0)
    for effect in PLAYS:
        for part in belief.of(effect, motor):
            moved = EFFECTS[effect].columns(places, motor, part.shape, belief.scene).mean(axis=0)  # [2, P]
            plays = plays + 2 * belief.scene.printer.to_motor(moved.T)[:, motor] @ part.draws_mm
    return np.asarray(plays)


def _beside_mm2(belief: Belief | None) -> float:
    """Return the variance [mm²] over a print that no setting corrects: effects that recur but cannot be corrected, and
    the marks' scatter beyond the instrument's noise."""
    if belief is None:
        return 0.0
    places, rng = drawn_places(belief.scene), np.random.default_rng(0)
    total = float(belief.scatter.quantiles_mm2((np.arange(DRAWS) + 0.5) / DRAWS).mean())
    total += float(belief.outliers.drawn_mm2(DRAWS, rng).mean())
    for part in belief.parts:
        effect = EFFECTS[part.effect]
        left_mm = part.draws_mm - held_mm(effect, part.draws_mm)
        if left_mm.any():
            comes = rng.uniform(size=left_mm.shape[1]) < effect.fate.anew + effect.fate.stays
            again = left_mm * comes
            moved = np.einsum("ncp,pd->ncd", effect.columns(places, part.where, part.shape, belief.scene), again)
            total += float(np.square(moved).sum(axis=1).mean())
    return total
