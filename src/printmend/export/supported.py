"""Which settings of a firmware a model supports: each must help by more than its own doubt."""

from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from printmend.errors import RefusedError
from printmend.export.firmware import EXPORTS, NO_BACKLASH, Export, Simple, simple_part
from printmend.promise.budget import Budget, parse_budget
from printmend.promise.effects import CARRIED, LEARNED, parse_effects
from printmend.promise.misfit import misfit_sizes, refusals
from printmend.promise.predict import UNSHOWN_MM, UNSHOWN_SD
from printmend.saved import SavedModel

SURE_SIGMAS = 2.0  # standard deviations: the coverage factor k of an expanded uncertainty (JCGM 100, 6.3)
UNSHOWN_MOST_MM = UNSHOWN_MM * float(np.exp(1.645 * UNSHOWN_SD))  # what 19 of 20 printers' test prints do not show
GAIN_MM = 0.001  # a setting that lowers the error over the bed by less is not worth typing
_PLACES = 400  # of an axis at which two laws are compared


@dataclass(frozen=True)
class _Setting:
    """One value of a firmware: its name, and its standard deviation as an error over the bed [mm]."""

    name: str
    doubt_mm: float


def export_supported(model: SavedModel, firmware: str) -> Export:
    """Return what helps of a model's fault as settings of a firmware, and what was left out.

    Raises `RefusedError` where nothing would help by more than its doubt, or the model does not fit its measurement.
    """
    if said := refusals(model.document):
        raise RefusedError(
            "export", wanted="a model that fits its own measurement", came=said[0], todo="measure again and learn"
        )
    mechanism = model.mechanism
    make = EXPORTS[firmware]
    if firmware == "linuxcnc":  # one table a joint holds all of it
        export, left_out = make(mechanism), []
        doubt = max(each.doubt_mm for each in _settings(model))
        if export.before_mm - export.after_mm < max(GAIN_MM, SURE_SIGMAS * doubt):
            left_out = [_why("the tables", export.before_mm - export.after_mm, doubt)]
        return _judged(model, export, ("tables of both joints",) if not left_out else (), tuple(left_out))
    budget = parse_budget(model)
    whole = simple_part(mechanism, None if budget is None else budget.turns_mm)
    settings = [each for each in _settings(model) if _without(whole, each.name) != whole]
    kept, left_out, homeless = whole, [], []
    for each in sorted(settings, key=lambda setting: -setting.doubt_mm):
        without = _without(kept, each.name)
        gain = make(mechanism, without).after_mm - make(mechanism, kept).after_mm
        alone_mm = _alone_mm(model, whole, each.name)
        known = alone_mm >= SURE_SIGMAS * each.doubt_mm
        if gain == 0.0:  # this firmware has no such setting
            kept = without
            homeless += [each.name] if known and alone_mm >= GAIN_MM else []
        elif gain < GAIN_MM or not known:
            kept = without
            left_out.append(_why(each.name, gain, each.doubt_mm))
    if homeless:
        left_out.append(f"{' and '.join(sorted(homeless))}: {NO_BACKLASH[firmware]}")
    names = tuple(each.name for each in settings if _without(kept, each.name) != kept)
    return _judged(model, make(mechanism, kept), names, tuple(left_out))


def _judged(model: SavedModel, export: Export, names: tuple[str, ...], left_out: tuple[str, ...]) -> Export:
    """Return an export with what is said of it. Raise `RefusedError` where none of its settings helps."""
    if not names:
        came = "; ".join(left_out) or "its settings change nothing of what was learned"
        raise RefusedError(
            model.printer.name, wanted="a fault that this firmware can hold", came=f"none ({came})",
            todo="leave its settings as they are" + (
                ": there is nothing to mend" if model.is_healthy else ": `printmend mend` mends the files instead"
            ),
        )  # fmt: skip
    budget = parse_budget(model)
    unknown_mm2 = sum(each.unexplained_mm2 for each in budget.motors) if budget is not None else 0.0
    doubt_mm2 = unknown_mm2 + sum(each.doubt_mm**2 for each in _settings(model)) + _misfit_mm2(model)
    doubt_mm = float(np.hypot(SURE_SIGMAS * np.sqrt(doubt_mm2), UNSHOWN_MOST_MM))
    return replace(export, settings=names, left_out=left_out, doubt_mm=doubt_mm)


def _misfit_mm2(model: SavedModel) -> float:
    """Return the variance [mm²] over the test print of what does not fit and may come again: no setting takes it."""
    again = {each.kind for each in parse_effects(model.document) if each.state not in (LEARNED, CARRIED)}
    return sum(size_mm**2 for kind, size_mm in misfit_sizes(model.document) if kind in again)


def _why(name: str, gain_mm: float, doubt_mm: float) -> str:
    """Say why a setting is left out."""
    if gain_mm <= -GAIN_MM:
        return f"{name} alone would make prints {-gain_mm:.3f} mm worse, typically, over the bed"
    if gain_mm < GAIN_MM:
        return f"{name} would help by less than {GAIN_MM:.3f} mm over the bed"
    return f"{name} is not known well enough (± {SURE_SIGMAS * doubt_mm:.3f} mm over the bed)"


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
    """Return the error over the bed that one setting stands for [mm]."""
    what, _, motor = name.partition(" of ")
    reach = _spread_mm(model)
    if what == "skew":
        return abs(simple.skew) * reach[1]
    at = 0 if motor in ("X", "A") else 1
    return abs(simple.gain[at] - 1) * reach[at] if what == "scale" else simple.play_mm[at] / 2


def _spread_mm(model: SavedModel) -> np.ndarray:
    """Return the root mean square distance from the bed's middle along x and y [2], over its middle 80 %."""
    return 0.8 * np.array([model.printer.x.length_mm, model.printer.y.length_mm]) / np.sqrt(12)


def _settings(model: SavedModel) -> list[_Setting]:
    """Return every setting that a firmware may have, with its doubt."""
    budget, reach = parse_budget(model), _spread_mm(model)
    found = []
    stretch = np.zeros(3) if budget is None else _stretch_sds(budget)
    for at, name in enumerate(each.upper() for each in model.printer.motors):
        scale, play = (0.0, 0.0) if budget is None else _motor_sds(model, budget, at)
        scale = float(np.hypot(scale, np.hypot(stretch[0], stretch[1])))
        found += [_Setting(f"scale of {name}", scale * reach[at]), _Setting(f"backlash of {name}", play / 2)]
    return [*found, _Setting("skew", 2 * float(stretch[2]) * reach[1])]


def _motor_sds(model: SavedModel, budget: Budget, at: int) -> tuple[float, float]:
    """Return the standard deviations of a motor's scale and of its mean play [mm], by the scatter of the points."""
    low, high = model.printer.motor_range_mm(at)
    motor = np.linspace(low, high, _PLACES)
    zero = np.zeros(_PLACES)
    back, forth = (budget.motors[at].columns(motor, zero, zero, zero + side) for side in (-1.0, 1.0))
    if not back.shape[1]:
        return 0.0, 0.0
    slopes = np.polyfit(motor - motor.mean(), (back + forth) / 2, 1)[0]
    each = sqrt(back.shape[1]) if budget.together else 1.0  # one of so many machines
    return float(np.linalg.norm(slopes)) / each, float(np.linalg.norm((back - forth).mean(axis=0))) / each


def _stretch_sds(budget: Budget) -> np.ndarray:
    """Return the standard deviations [3] of what the instrument cannot tell."""
    if not budget.stretch:
        return np.zeros(3)
    weights = np.array([weight for weight, _, _ in budget.stretch])
    second = np.array([np.diag(covariance) + mean**2 for _, mean, covariance in budget.stretch])
    return np.asarray(np.sqrt(weights @ second / weights.sum()))
