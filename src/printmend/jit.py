"""The one door to machine code: every kernel is an `entry`, which Python calls, or an `inner`, which only kernels call.

An entry runs from the library that came with the program, where that holds it (`native`). Else numba compiles it here
(`compiling`), which takes half a minute once; numba is not even imported before that. Both make it of the same code.
"""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from printmend.compilations import compilations
from printmend.digest import digest, is_set
from printmend.extras import require
from printmend.native import arguments_of, library_of, recording

_LEAN = {"error_model": "numpy", "_nrt": False}


def entry(function: Callable | None = None, **options: Any) -> Any:
    """Decorate a kernel that Python calls. ``options`` are njit's."""
    if function is None:
        return lambda function: entry(function, **options)
    return function if is_set("NUMBA_DISABLE_JIT") else _Entry(function, options)


def inner(function: Callable | None = None, **options: Any) -> Any:
    """Decorate a kernel that only other kernels call: compiled with each of them. ``options`` are njit's.

    Unless they say otherwise it makes no arrays, so that none need be counted, and divides by 0 as numpy does.
    """
    if function is None:
        return lambda function: inner(function, **options)
    return function if is_set("NUMBA_DISABLE_JIT") else _Inner(function, {**_LEAN, **options})


def record(kind: np.dtype) -> Any:
    """Return one record of zeros, whose fields are its attributes; kernels change it in place."""
    return np.zeros(1, kind).view(np.recarray)[0]


class _Kernel:
    """A kernel, as Python and numba see it."""

    def __init__(self, function: Callable, options: dict[str, Any]) -> None:
        self.__module__, self.__qualname__, self.__doc__ = function.__module__, function.__qualname__, function.__doc__
        self.py_func, self.options = function, options

    @property
    def package(self) -> str:
        """The package that it belongs to, and in whose folder it is kept."""
        package = self.py_func.__module__.partition(".")[0]
        return package if package == "printmend_lab" else "printmend"

    def __reduce__(self) -> str:  # pickled by its name
        return self.py_func.__qualname__


class _Inner(_Kernel):
    """A kernel that only kernels call. Called from Python, from a test, it runs as Python."""

    def __call__(self, *arguments: Any) -> Any:
        return self.py_func(*arguments)

    @functools.cached_property
    def compiled(self) -> Any:
        _numba_sees_kernels()
        from printmend.compiling import inner_of

        return inner_of(self)


class _Entry(_Kernel):
    """A kernel that Python calls."""

    def __call__(self, *arguments: Any) -> Any:
        kinds, flat = arguments_of(arguments)
        found = self._native.get(kinds)
        if found is not None:
            return found(flat)
        result = self.compiled(*arguments)
        if recording.on:
            recording.add(self, kinds, arguments)
        return result

    def digest(self) -> str:
        """Return the digest of all that went into it."""
        return digest(self)

    @functools.cached_property
    def _native(self) -> dict[Any, Any]:
        """What the library holds of this kernel, by the kinds of its arguments."""
        name = f"{self.py_func.__module__}.{self.py_func.__qualname__}"
        return library_of(self.package).found(name, self.digest)

    @functools.cached_property
    def compiled(self) -> Any:
        require(f"kernel {self.__qualname__}", "numba")
        _numba_sees_kernels()
        from printmend.compiling import entry_of

        return entry_of(self)


@functools.cache
def _numba_sees_kernels() -> None:
    from printmend.compiling import take_for_kernels

    take_for_kernels(_Entry)
    take_for_kernels(_Inner)


__all__ = ["compilations", "digest", "entry", "inner", "record"]
