"""How far the sliders of the play screen go: faults large enough to be seen at once."""

from typing import Literal

Shape = Literal["round", "eccentric", "oval", "flat", "square"]
MOST_DENT_MM, MOST_PLAY_MM, MOST_SKEW_DEG, MOST_SCREW_MM = 1.5, 0.8, 2.0, 0.5
