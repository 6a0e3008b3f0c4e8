"""The continuous inverse: find the commands that make a broken machine draw the target path.

`start` returns a `Planner` for a mechanism, whose `plan` turns the records of a file into pieces. Its running sums are
in arrays, whose fields `layout` names. `is_identity` says whether there is nothing to mend, `Fineness` how finely to
draw.
"""

from printmend.plan.inverse import Fineness, Planner, is_identity, lookup, start
from printmend.plan.kernels import layout

__all__ = ["Fineness", "Planner", "is_identity", "layout", "lookup", "start"]
