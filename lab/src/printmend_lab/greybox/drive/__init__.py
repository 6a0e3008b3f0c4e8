"""One motor's drive: which parts it has, and their parameters, from the rows that the motor made.

`greybox.layout` names the columns of a drive and `design` sums their normal equations; `fit` finds contacts and
parameters in turn; `select` chooses the parts, and `left_out` says what the others may still do; `machines` are what a
part of a turn allows. `jumps` and `ladder` take out skipped teeth and missed steps, `rest` finds where the belts
rested, and `seen_share` says how much of a turn the rows saw.
"""

from printmend_lab.greybox.drive.design import Contacts, Rows, contacts, normal_equations
from printmend_lab.greybox.drive.fit import ALL_SEEN
from printmend_lab.greybox.drive.jumps import Jump, jumped
from printmend_lab.greybox.drive.select import NOTHING, Choice, Structure
from printmend_lab.greybox.layout import CROSS, Design, bed_middle

__all__ = [
    "ALL_SEEN",
    "CROSS",
    "NOTHING",
    "Choice",
    "Contacts",
    "Design",
    "Jump",
    "Rows",
    "Structure",
    "bed_middle",
    "contacts",
    "jumped",
    "normal_equations",
]
