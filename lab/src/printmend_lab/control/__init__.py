"""Planners on the lattice: which controls a machine needs for the targets it has.

The doors are modules, so that a planner is imported only where it is used: `registry` gives planners by name, `space`
plans three axes, `check` is what every planner asks of its input and its model's tables.
"""
