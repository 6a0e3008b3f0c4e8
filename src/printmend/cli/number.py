"""Numbers that a user types."""

import math
from typing import Any

import click

from printmend.messages import say


class Finite(click.FloatRange):
    """A range of real numbers; nan, which no comparison excludes, is none of them."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(say("usage-real"), param, ctx)
        return number


class Percent(Finite):
    """A share as a percentage, with its sign or without: `5%` is 0.05."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        return super().convert(str(value).strip().removesuffix("%"), param, ctx) / 100.0
