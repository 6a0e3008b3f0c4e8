"""The model file: a learned machine as readable, versioned JSON, and the values that it is made of.

`SavedModel` is the machine with its document, `Branches` and `ScrewSeries` a motor and Z as short series. `values`
holds the checks of what was read.
"""

from printmend.model.branches import SCALE_MM, Branches, ScrewSeries, Wave
from printmend.model.model import (
    SavedModel,
    branches_of,
    exact_model,
    model_text,
    parse_model,
    read_model,
    saved_model,
    screw_of,
    with_screw,
    write_model,
)

__all__ = [
    "SCALE_MM",
    "Branches",
    "SavedModel",
    "ScrewSeries",
    "Wave",
    "branches_of",
    "exact_model",
    "model_text",
    "parse_model",
    "read_model",
    "saved_model",
    "screw_of",
    "with_screw",
    "write_model",
]
