"""Does it fit? How large a printed part came out, and which settings of a slicer make it come out right."""

from printmend.fit.estimate import Estimate, Known, Layer, Outline, Round, estimated, outline_of
from printmend.fit.setting import SLICERS, Setting, Slicer, settings_for, write_profiles
from printmend.fit.words import fit_json, fit_sizes, fit_words

__all__ = [
    "SLICERS",
    "Estimate",
    "Known",
    "Layer",
    "Outline",
    "Round",
    "Setting",
    "Slicer",
    "estimated",
    "fit_json",
    "fit_sizes",
    "fit_words",
    "outline_of",
    "settings_for",
    "write_profiles",
]
