"""Compiled kernels of the G-code layer: arrays and scalars in, arrays out. They import numpy and numba only.

A *statement* is one command with its words: usually a line, but `G91 G1 X5` holds two, and each has its own span.
`interpret` keeps the whole modal state of a machine (`numbers`, `counts`) between calls, so a file of any length
passes through in chunks of whole lines. Every statement that can move the carriage, shift its coordinates or make
its place uncertain becomes a RECORD; everything else (comments, temperatures, fans, unknown text) has none and is
copied as it is.
"""

from printmend.gcode.kernels.commands import arc_chords as arc_chords
from printmend.gcode.kernels.emit import emit as emit
from printmend.gcode.kernels.emit import renumber as renumber
from printmend.gcode.kernels.interpret import interpret as interpret
from printmend.gcode.kernels.layout import *  # noqa: F403 (the layout is the package's interface)
from printmend.gcode.kernels.meatpack import pack as pack
from printmend.gcode.kernels.meatpack import unpack as unpack
from printmend.gcode.kernels.text import parse_number as parse_number
