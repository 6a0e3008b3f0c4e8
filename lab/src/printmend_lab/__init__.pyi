"""The public names and where they live; `printmend_lab/__init__.py` imports each when it is first used."""

from .bench.table1 import evaluate

__all__ = ["evaluate"]

__version__: str
