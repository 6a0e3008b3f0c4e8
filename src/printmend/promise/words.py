"""The causes of an expected error in an owner's words (JCGM 100:2008, 4.2 and 4.3), and the doubt about its scale."""

from collections.abc import Mapping, Sequence

import numpy as np

from printmend.effects import Scene, title_of
from printmend.effects.aspect import SHARES
from printmend.effects.effect import HARDLY_ANY, SCALE_MM
from printmend.effects.skew import leans_of_scales
from printmend.effects.stretch import basis
from printmend.infer.machine import DRAWS, Part
from printmend.measure.table import TOGETHER
from printmend.messages import say, say_large, together
from printmend.model import SavedModel
from printmend.model.model import WARNING
from printmend.promise.belief import Belief, parse_belief
from printmend.promise.filament import LEAST_DOUBT
from printmend.units import SELDOM_SDS

# Words for a scale error that may be the scan's own, until callipers settle it.
#
# It is the one finding of a scan that an owner can settle, and the one that mending may correct wrongly.


def scale_words(model: SavedModel) -> tuple[str, ...]:
    """Return a sentence about the scale, and one about the skew, that a model's scan showed; none where the scan leaves
    little open."""
    belief = parse_belief(model)
    shown = model.document.get("promise", {}).get("shown")
    if belief is None or belief.placed or not isinstance(shown, list) or len(shown) != 2:
        return ()
    lean = _lean_words(belief)
    acts, draws = axis_scales(belief.scene, belief.parts)
    doubt = float(np.sqrt(np.mean((draws - acts[:, None]) ** 2, axis=1)).max())
    beyond = float(np.abs(np.array(shown, float) - acts).max())  # as far as it is the printer's
    if beyond > SELDOM_SDS * instrument_of(model).get("scale_sd", np.inf):
        doubt = max(doubt, beyond)
    if doubt < LEAST_DOUBT:
        return lean
    cause = "scale-picture-causes-part"
    settles = "scale-settled-across" if knows_a_length(model) else "scale-settled-by-callipers"
    if knows_all_but_a_reading(model):
        settles = "scale-settled-by-reading"
    if is_on_paper(model):
        cause, settles = "scale-paper-causes-part", "scale-settled-by-travel"
    said = say(settles)
    if is_resized(belief):
        cause, said = "scale-picture-causes-all", say("scale-settled-by-scan", said)
    return (scale_in_words(np.array(shown, float), acts, doubt, said, cause), *lean)


def _lean_words(belief: Belief) -> tuple[str, ...]:
    """Return a sentence about a skew that the scanner may have made, so that it does not act."""
    parts = [(part, 1.0) for part in belief.of("skew")]
    parts += [(part, leans_of_scales(belief.scene)[part.where]) for part in belief.of("scale")]
    leans = sum((factor * part.draws_mm[0] for part, factor in parts), np.zeros(DRAWS)) / SCALE_MM
    if any(factor * part.acts_mm[0] for part, factor in parts) or np.sqrt(np.mean(leans**2)) < LEAST_DOUBT:
        return ()
    return (say(WARNING, say("skew-not-settled", f"{abs(np.degrees(np.median(leans[leans != 0]))):.2f}")),)


def shown_scales(scene: Scene, parts: Sequence[Part]) -> list[float]:
    """Return by which shares a print is too large in its picture in X and Y, the instrument's own included."""
    return [round(float(each), 6) for each in _in_picture(scene, parts).mean(axis=1)]


def seen_scales(scene: Scene, parts: Sequence[Part]) -> dict[str, list[float]]:
    """Return by which shares a print is too large in its picture in X and Y, shrinkage and the instrument's own
    included, with their standard deviations: what was measured, before anybody asks whose it is."""
    draws = _in_picture(scene, parts)
    for part in parts:
        if part.effect == "shrinkage":
            draws[part.where] -= part.draws_mm[0] / SCALE_MM
    found = {"mean": draws.mean(axis=1), "sd": draws.std(axis=1)}
    return {name: [round(float(each), 8) for each in of] for name, of in found.items()}


def _in_picture(scene: Scene, parts: Sequence[Part]) -> np.ndarray:
    """Return by which shares the drawn prints [2, D] are too large in their picture in X and Y."""
    _, draws = axis_scales(scene, parts)
    for part in parts:
        if part.effect in ("resized", "paper"):
            draws += part.draws_mm / SCALE_MM
        elif part.effect == "stretch":
            common, half, _ = basis(scene) @ part.draws_mm
            draws += np.stack([common + half, common - half])
    return draws


def axis_scales(scene: Scene, parts: Sequence[Part]) -> tuple[np.ndarray, np.ndarray]:
    """Return the scales of both bed axes that act [2], and those of the drawn machines [2, D], as shares."""
    of_motor = np.full((2, 2), 0.5) if scene.corexy else np.eye(2)
    acts, draws = np.zeros(2), np.zeros((2, parts[0].draws_mm.shape[1] if parts else 1))
    for part in parts:
        if part.effect in ("scale", "aspect"):
            shares = of_motor[part.where] if part.effect == "scale" else SHARES
            acts += shares * part.acts_mm[0] / SCALE_MM
            draws += np.outer(shares, part.draws_mm[0]) / SCALE_MM
    return acts, draws


def is_resized(belief: Belief | None) -> bool:
    """Say whether a measurement's picture is likely to be of another size than it says."""
    return belief is not None and any(part.is_likely for part in belief.of("resized"))


def knows_a_length(model: SavedModel) -> bool:
    """Say whether a length was given to a model's scan: then its scale and its axes are known together."""
    instrument = instrument_of(model)
    return any(instrument.get(name) for name in TOGETHER)


def knows_all_but_a_reading(model: SavedModel) -> bool:
    """Say whether a length and a second turn were given, so that only the callipers leave the scale open."""
    instrument = instrument_of(model)
    return knows_a_length(model) and 2 * instrument.get("axes_sd", 0.0) < instrument.get("scale_sd", 0.0)


def is_on_paper(model: SavedModel) -> bool:
    """Say whether the scale that a model's scan showed may be that of paper, which grew."""
    return instrument_of(model).get("paper_sd", 0.0) > 0


def instrument_of(model: SavedModel) -> dict[str, float]:
    """Return the open errors of a model's instrument, by name."""
    section = model.document.get("promise")
    instrument = section.get("instrument") if isinstance(section, dict) else None
    if not isinstance(instrument, dict):
        return {}
    return {name: value for name, value in instrument.items() if isinstance(value, int | float)}


def scale_in_words(
    shown: np.ndarray, acts: np.ndarray, doubt: float, settles: str, cause: str = "scale-picture-causes-part"
) -> str:
    """Say by which shares the print is too large in the picture in X and Y [2], which of them act [2], how sure that
    is, what else may be the ``cause`` (a message), and what ``settles`` it."""
    cause = say(cause)
    seen, taken, may_mm = map(say_large, shown), map(say_large, acts), f"{100 * doubt:.1f}"
    if np.abs(acts).max() >= LEAST_DOUBT / 10:
        return say(WARNING, say("scale-not-settled-taken-off", *seen, cause, *taken, may_mm, settles))
    return say(WARNING, say("scale-not-settled", *seen, cause, may_mm, settles))


# key of `Promise.made_of` → (in a line, in a table, type): type A is from the scatter of the measurement, B is not
_CAUSES = {
    "parameters": (say("cause-parameters"), say("budget-parameters"), "A"),
    "scatter": (say("cause-scatter"), say("budget-scatter"), "A"),
    "homing": (say("cause-homing"), say("budget-homing"), "B"),
    "instrument": (say("cause-instrument"), say("budget-instrument"), "B"),
    "filament": (say("cause-filament"), say("budget-filament"), "B"),
    "motion": (say("cause-motion"), say("budget-motion"), "B"),
    "rounding": (say("cause-rounding"), say("budget-rounding"), "B"),
    "planning": (say("cause-planning"), say("budget-planning"), "B"),
}  # fmt: skip


def in_a_table(cause: str) -> tuple[str, str]:
    """Return a cause in words, and its type; an effect that does not act is called as it calls itself."""
    return _CAUSES[cause][1:] if cause in _CAUSES else (in_words(cause), "A")


def in_words(cause: str) -> str:
    """Return a cause in a few words."""
    return _CAUSES[cause][0] if cause in _CAUSES else title_of(cause) or cause.replace("_", " ")


def in_a_line(made_of: Mapping[str, float]) -> str:
    """Return the causes of an error with their shares of its mean square, the largest first: ``the scale
    80 %; micro-steps 15 %``."""
    whole2_mm2 = sum(size_mm**2 for size_mm in made_of.values())
    shares = sorted(((size_mm**2 / whole2_mm2, name) for name, size_mm in made_of.items()), reverse=True)
    told = [(in_words(name), f"{100 * share:.0f}") for share, name in shares if share >= HARDLY_ANY]
    return together("; ", [say("cause-of-share", *each) for each in told])
