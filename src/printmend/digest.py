"""A digest of all that goes into a kernel: its code, that of every function that it calls, and their constants."""

import hashlib
import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

_HOW = (Path(__file__).parent / "compiler.py").read_bytes()  # how kernels are compiled: other code of the same kernel


def digest(kernel: Any) -> str:
    """Return a digest of a compiled function: its code and options, those of all that it calls, and their constants.

    Raises `TypeError` for a kernel that uses a value without a digestible content.
    """
    bounds = b"bounds checked" if is_set("NUMBA_BOUNDSCHECK") else b""  # other code of the same kernel
    total = hashlib.sha256(_HOW + bounds)
    waiting, seen = [kernel], {id(kernel)}
    while waiting:
        value = waiting.pop()
        function = getattr(value, "py_func", value)
        options = getattr(value, "options", {})
        whose = function.__module__, function.__qualname__  # compiled code looks its constants up there
        total.update(repr((*whose, sorted(options.items()), function.__defaults__)).encode())
        for text in _code(function.__code__):
            total.update(text.encode())
        for name, used in _used(function):
            if hasattr(used, "py_func") or (isinstance(used, FunctionType) and not _is_library(used.__module__)):
                total.update(f"{name}()".encode())
                if id(used) not in seen:
                    seen.add(id(used))
                    waiting.append(used)
            else:
                total.update(f"{name}={_content(name, used, function)}".encode())
    return total.hexdigest()


def is_set(name: str) -> bool:
    """Say whether one of numba's variables of the environment is set and not 0."""
    return os.environ.get(name, "0") not in ("", "0")


def _code(code: CodeType) -> Iterator[str]:
    """Yield what a function does: its instructions and constants, and those of the functions inside it."""
    constants = [value for value in code.co_consts if not isinstance(value, CodeType)]
    yield repr((code.co_code, constants, code.co_names, code.co_varnames, code.co_freevars))
    for value in code.co_consts:
        if isinstance(value, CodeType):
            yield from _code(value)


def _used(function: Callable) -> Iterator[tuple[str, Any]]:
    """Yield what a function finds outside itself: globals, what it names of a module of ours, closed-over values."""
    names, codes = {}, [function.__code__]  # type: ignore[attr-defined]
    for code in codes:
        names.update(dict.fromkeys(code.co_names))
        codes.extend(value for value in code.co_consts if isinstance(value, CodeType))
    outside = function.__globals__  # type: ignore[attr-defined]
    for name in names:
        if name in outside:
            yield from _in_modules(name, outside[name], names, ())
    closure = function.__closure__ or ()  # type: ignore[attr-defined]
    yield from zip(codes[0].co_freevars, (cell.cell_contents for cell in closure), strict=True)


def _in_modules(name: str, value: Any, names: Iterable[str], within: tuple) -> Iterator[tuple[str, Any]]:
    """Yield a value, or of a module of ours all that ``names`` name of it; nothing of a library's module."""
    if not isinstance(value, ModuleType):
        yield name, value
    elif not _is_library(value.__name__) and value not in within:
        for field in names:
            if hasattr(value, field):
                yield from _in_modules(f"{name}.{field}", getattr(value, field), names, (*within, value))


def _is_library(module: str | None) -> bool:
    """Say whether a module is one whose code changes with its version only: numba's version is part of every key."""
    return (module or "").partition(".")[0] in ("numpy", "numba", "math")


def _content(name: str, value: Any, function: Callable) -> str:
    """Return a text that changes with a constant's content."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype}{value.shape}{hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, type) and issubclass(value, tuple) and hasattr(value, "_fields"):
        return f"{value.__qualname__}{value._fields}"
    if isinstance(value, int | float | complex | str | bytes | tuple | np.generic | np.dtype | type(None)):
        return repr(value)
    if isinstance(value, type | FunctionType) or _is_library(type(value).__module__):
        return f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', value)}"
    raise TypeError(f"{function.__qualname__} uses {name}, a {type(value)}: make it a number, a tuple or an array")
