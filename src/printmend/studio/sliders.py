"""How far the sliders of the play screen go."""

from typing import Literal

Shape = Literal["round", "eccentric", "oval", "flat", "square"]
MOST_DENT_MM, MOST_PLAY_MM, MOST_SKEW_DEG, MOST_SCREW_MM = 1.5, 0.8, 2.0, 0.5
