"""Turn a print into a trace: from a table, or from an image of the plate with its rulers, paper, tags and outlines."""

from printmend.measure.plan import ProbePlan, read_plan, write_plan
from printmend.measure.table import read_trace, write_trace

__all__ = ["ProbePlan", "read_plan", "read_trace", "write_plan", "write_trace"]
