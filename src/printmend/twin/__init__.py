"""The digital twin of a broken printer, compiled."""

from printmend.twin.twin import Twin

__all__ = ["Twin"]
