"""Find out whether a printed part fits: its sizes, and the slicer settings that make it right."""

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
