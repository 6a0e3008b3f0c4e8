"""The continuous inverse: the commands that make a broken machine draw what was wanted.

`start` returns a `Planner` for a mechanism: its `plan` turns the records of a file into pieces. What it adds up on the
way lies in its arrays, whose fields `layout` names. `is_identity` says whether there is nothing to do,
`Fineness` how finely to draw.
"""

from printmend.plan.inverse import Fineness, Planner, is_identity, lookup, start
from printmend.plan.kernels import layout

__all__ = ["Fineness", "Planner", "is_identity", "layout", "lookup", "start"]
