"""Numbers that a user types."""

import math
from typing import Any

import click


class Finite(click.FloatRange):
    """A range of real numbers; nan, which no comparison excludes, is none of them."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a number.", param, ctx)
        return number
