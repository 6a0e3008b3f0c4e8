"""Corruptions: what is broken in a machine, as frozen values that TOML stores and that lower to arrays."""

from printmend.corruption.cause import Cause, cause_of
from printmend.corruption.corruption import HEALTHY, Corruption, Drive, Fault
from printmend.corruption.event import EVENTS, Beads
from printmend.corruption.frame import CrookedFrame, Screw
from printmend.corruption.toml import corruption_of, corruption_toml, parse_corruption, read_corruption
from printmend.corruption.transmission import (
    EccentricBore,
    ElasticBelt,
    Ellipse,
    FlatSpot,
    FourierHull,
    Friction,
    GainTable,
    LooseBelt,
    MissedSteps,
    Play,
    Polygon,
    PublishedHull,
    Ripple,
    SetScrew,
    TabulatedHull,
    ToothSkips,
    Warp,
    WrongRadius,
    published_names,
)

__all__ = [
    "EVENTS",
    "HEALTHY",
    "Beads",
    "Cause",
    "Corruption",
    "CrookedFrame",
    "Drive",
    "EccentricBore",
    "ElasticBelt",
    "Ellipse",
    "Fault",
    "FlatSpot",
    "FourierHull",
    "Friction",
    "GainTable",
    "LooseBelt",
    "MissedSteps",
    "Play",
    "Polygon",
    "PublishedHull",
    "Ripple",
    "Screw",
    "SetScrew",
    "TabulatedHull",
    "ToothSkips",
    "Warp",
    "WrongRadius",
    "cause_of",
    "corruption_of",
    "corruption_toml",
    "parse_corruption",
    "published_names",
    "read_corruption",
]
