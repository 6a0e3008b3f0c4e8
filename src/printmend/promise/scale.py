"""A scale that a scan shows and that may as well be its own: what is said of it, until callipers settle it.

Of all that a scan tells this is what an owner can settle, and the one fault that mending may carry wrongly.
"""

import numpy as np

from printmend.measure.table import TOGETHER
from printmend.promise.apply import stretch_of_model
from printmend.promise.budget import parse_budget
from printmend.saved import SavedModel

LEAST_DOUBT = 0.001  # share: a tenth of a millimetre in 100; a smaller doubt is said in the expected error alone
_PARTS = {"scale of both axes": (0, 100.0), "difference of the axes' scales": (1, 200.0)}  # of what was left out


def scale_words(model: SavedModel) -> tuple[str, ...]:
    """Return a sentence about the scale that a model's scan showed, none where the scan leaves little open."""
    budget, section = parse_budget(model), model.document.get("promise")
    if budget is None or not budget.stretch or not isinstance(section, dict):
        return ()
    instrument, left_out = section.get("instrument"), section.get("left_out", [])
    if not isinstance(instrument, dict) or not instrument.get("scale_sd") or not isinstance(left_out, list):
        return ()
    to_axes = np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0]])
    weights = np.array([weight for weight, _, _ in budget.stretch])
    squares = [
        np.square(to_axes @ mean) + np.diag(to_axes @ covariance @ to_axes.T) for _, mean, covariance in budget.stretch
    ]
    doubt = np.sqrt(np.maximum(weights @ np.array(squares) / max(weights.sum(), 1e-9), 0.0))
    if not doubt.max() >= LEAST_DOUBT:
        return ()
    acts = to_axes @ stretch_of_model(model)
    beyond = np.zeros(3)
    for one in left_out:
        if isinstance(one, dict) and one.get("part") in _PARTS and isinstance(one.get("value"), int | float):
            at, factor = _PARTS[one["part"]]
            beyond[at] = one["value"] / factor
    return (in_words(acts + to_axes @ beyond, acts, float(doubt.max()), length_given=knows_a_length(model)),)


def knows_a_length(model: SavedModel) -> bool:
    """Say whether a length was given to a model's scan: then its scale and its axes are known together."""
    instrument = _instrument(model)
    return any(instrument.get(name) for name in TOGETHER)


def knows_all_but_a_reading(model: SavedModel) -> bool:
    """Say whether a length and a second turn were given, so that only the callipers leave the scale open."""
    instrument = _instrument(model)
    return knows_a_length(model) and 2 * instrument.get("axes_sd", 0.0) < instrument.get("scale_sd", 0.0)


def _instrument(model: SavedModel) -> dict[str, float]:
    section = model.document.get("promise")
    instrument = section.get("instrument") if isinstance(section, dict) else None
    if not isinstance(instrument, dict):
        return {}
    return {name: value for name, value in instrument.items() if isinstance(value, int | float)}


def in_words(shown: np.ndarray, acts: np.ndarray, doubt: float, *, length_given: bool = False) -> str:
    """Say by which shares the print is too large in the picture in X and Y [2], which of them act [2], how sure that
    is, and what would settle it beyond a length that was given."""
    seen, taken = (" and ".join(f"{100 * v:+.2f} % in {a}" for v, a in zip(each, "XY", strict=True))
                   for each in (shown, acts))  # fmt: skip
    does = f"Mending takes off {taken}" if np.abs(acts).max() >= LEAST_DOUBT / 10 else "Mending takes nothing of it off"
    todo = (
        "Callipers settle it: measure again with each --distance that it names; for dots with a second scan, turned by "
        "a quarter, too"
    )
    if length_given:
        todo = (
            "Along the length that was given it is known; across that a second scan of the same plate settles it, "
            "turned by a quarter: measure again with both scans and that length"
        )
    return (
        f"warning: the scale is not settled: the print is {seen} too large in the picture, and nobody knows how much "
        f"of that is the picture's own (scanners: 0.1 to 0.2 %). {does}, which may be wrong by {100 * doubt:.1f} mm in "
        f"100 mm. {todo}"
    )
