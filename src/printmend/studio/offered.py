"""Offer every effect on the play screen: its title, its possible motors or axes, and a slider for each number.

Registered effects of other packages are included; their title is the first sentence of their docstring. The sliders
reach faults that are large enough to be seen at once.
"""

import math
from typing import Any, Literal

from printmend.corruption.cause import Cause, named_keys, offered, said, typical_shape
from printmend.effects import EFFECTS
from printmend.effects.effect import SCALE_MM, Effect, Term, terms_of
from printmend.effects.sized import scene_of_printer
from printmend.effects.words import AXES, limits_of
from printmend.messages import say
from printmend.printer import Printer

Shape = Literal["round", "eccentric", "oval", "flat", "square"]
MOST_DENT_MM, MOST_PLAY_MM, MOST_SKEW_DEG, MOST_SCREW_MM = 1.5, 0.8, 2.0, 0.5


_FURTHEST = 5.0  # a size's slider ends at this multiple of the example
_STEEPNESS = 8.0  # a wave's size is at most its period over this, so that the belt still moves forwards
_STEPS = 200  # steps of a slider

_LABELS = {
    "size_mm": "number-size", "percent": "number-percent", "square_mm": "number-square", "cube_mm": "number-cube",
    "harmonic": "number-harmonic", "phase_rad": "number-phase", "at_mm": "number-at", "width_mm": "number-width",
    "period_mm": "number-period", "angle_deg": "number-angle", "across_mm": "number-across", "axis": "number-axis",
    "after_share": "number-after", "at_share": "number-moment", "grow_x_mm": "number-grow-x",
    "grow_y_mm": "number-grow-y", "lean_x_mm": "number-lean-x", "lean_y_mm": "number-lean-y",
    "move_x_mm": "number-move-x", "move_y_mm": "number-move-y", "x_mm": "number-along-x", "y_mm": "number-along-y",
    "scale_percent": "number-scale", "axes_percent": "number-axes", "lean_percent": "number-lean",
    "zero_x_mm": "number-zero-x", "zero_y_mm": "number-zero-y",
}  # fmt: skip
_OF = {"machine": "of-machine", "session": "of-session", "instrument": "of-instrument", "material": "of-material"}


def offered_effects(printer: Printer) -> list[dict[str, Any]]:
    """Return the effects as plain values, in the order in which the program lists them.

    ``possible`` says whether ``printer`` can have it.
    """
    scene = scene_of_printer(printer)
    return [_card(effect) | {"possible": bool(terms_of(effect, scene))} for effect in EFFECTS.values()]


def _card(effect: Effect) -> dict[str, Any]:
    name = effect.name
    terms = offered(effect)
    places = sorted({term.where for term in terms})
    return {
        "name": name, "title": said(effect),
        "of": say(_OF[effect.of.value]), "on": ["x", "y"] if len(places) > 1 else [],
        "sliders": _sliders(effect, [term for term in terms if term.where == places[0]]) if terms else [],
    }  # fmt: skip


def _sliders(effect: Effect, terms: list[Term]) -> list[dict[str, Any]]:
    keys = named_keys(effect)
    of_shape: tuple[str, ...] = getattr(keys, "shape", ())
    shape, sliders, first = typical_shape(keys, terms), [], True
    for name in keys.names:
        row: dict[str, Any] = {"key": name, "label": say(_LABELS[name]) if name in _LABELS else name.replace("_", " "),
               "unit": _unit(name), "choices": []}  # fmt: skip
        if name == "axis":
            row |= {"choices": list(AXES), "value": AXES[int(shape[name])]}
        elif name == "harmonic":
            row |= {"choices": list(keys.harmonics), "value": keys.harmonics[0]}  # type: ignore[attr-defined]
        elif name in shape:
            each = [term.shape[of_shape.index(name)] for term in terms]
            low, high = min(each), max(each)
            if low == high:  # a place at 0 is anywhere about it
                low, high = (low / _FURTHEST, low * _FURTHEST) if low else (-SCALE_MM, SCALE_MM)
            row |= _range(low, high, shape[name])
        elif name == "phase_rad":
            row |= _range(-math.pi, math.pi, 0.0)
        else:
            most = min(limits_of(name)[2] * _FURTHEST, shape.get("period_mm", math.inf) / _STEEPNESS)
            least = 0.0 if all(term.sign > 0 for term in terms) else -most
            row |= _range(least, most, most / _FURTHEST if first else 0.0)
            first = False
        sliders.append(row)
    return sliders


def _range(low: float, high: float, value: float) -> dict[str, float]:
    step = 10.0 ** math.floor(math.log10((high - low) / _STEPS)) if high > low else 1.0
    step = next(step * k for k in (1, 2, 5, 10) if (high - low) / (step * k) <= _STEPS) if high > low else 1.0
    low, high = math.floor(low / step) * step, math.ceil(high / step) * step
    return {name: round(number, 9) for name, number in
            (("low", low), ("high", high), ("step", step), ("value", round(value / step) * step))}  # fmt: skip


def _unit(name: str) -> str:
    return {"mm": "mm", "rad": "rad", "deg": "°", "percent": "%"}.get(name.rpartition("_")[2], "")


def causes_of(rows: list[dict[str, Any]]) -> tuple[Cause, ...]:
    """Return the effects that the page names. Raises `ConfigError` for an unknown effect, or a number out of range."""
    return tuple(Cause(row["name"], row["on"], tuple(row["values"].items())) for row in rows)
