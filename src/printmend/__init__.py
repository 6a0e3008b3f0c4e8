"""printmend: print straight on a broken 3-D printer."""

__version__ = "0.1.0"
