"""A print becomes a trace: a table that anything can write, or an image of a printed plate."""

from printmend.measure.plan import ProbePlan, read_plan, write_plan
from printmend.measure.table import read_trace, write_trace

__all__ = ["ProbePlan", "read_plan", "read_trace", "write_plan", "write_trace"]
