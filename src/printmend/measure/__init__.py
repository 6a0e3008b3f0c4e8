"""A print becomes a trace: a table that anything can write, or an image of a printed plate."""

from printmend.measure.table import read_trace, write_trace

__all__ = ["read_trace", "write_trace"]
