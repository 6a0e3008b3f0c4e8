"""Which lengths a model's measurement was given: what settles whose scale a scan shows."""

from printmend.measure.table import TOGETHER
from printmend.saved import SavedModel


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
