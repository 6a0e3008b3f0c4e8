"""The one door to the compiler: every kernel is an `entry`, which Python calls, or an `inner`, which only kernels call.

An entry's machine code is kept on disk under a digest of all that went into it: its own code, that of every function
that it calls in whatever file, their modules, the constants and named tuples that they use, and how they are compiled.
Numba's own key is the date of the entry's file, so that after an edit elsewhere the old code would go on running.
"""

import hashlib
import logging
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba import njit
from numba.core import config
from numba.core.caching import FunctionCache
from numba.core.event import Event, Listener, register
from numba.core.registry import CPUDispatcher
from numba.core.runtime import rtsys

from printmend import compiler
from printmend.shipped import Shipped, shipped

log = logging.getLogger(__name__)

_HOW = Path(compiler.__file__).read_bytes()  # how kernels are compiled: other code comes of the same kernel


class Compilations(Listener):
    """What was compiled since the program began: how many entries, in how many seconds.

    Says once why nothing happens for a while. Kernels are compiled when they are first used on a machine.
    """

    def __init__(self) -> None:
        self.entries, self.seconds = 0, 0.0
        self._began: list[float] = []  # an entry's functions are compiled within it

    def on_start(self, event: Event) -> None:
        if not self.entries and not self._began:
            log.info("compiling for this machine, this one time: up to 30 s (`printmend warm` does it beforehand)")
        self._began.append(time.perf_counter())

    def on_end(self, event: Event) -> None:
        took_s = time.perf_counter() - self._began.pop()
        if not self._began:
            self.entries, self.seconds = self.entries + 1, self.seconds + took_s


compilations = Compilations()
register("numba:compile", compilations)


def entry(function: Callable | None = None, **options: Any) -> Any:
    """Decorate a kernel that Python calls: compiled, kept on disk, run beside other threads. ``options`` are njit's."""
    if function is None:
        return lambda function: entry(function, **options)
    if config.DISABLE_JIT:
        return function
    compiled = njit(nogil=True, pipeline_class=compiler.EntryCompiler, **options)(function)
    compiled._cache = _Kept(compiled)
    return compiled


def inner(function: Callable | None = None, **options: Any) -> Any:
    """Decorate a kernel that only other kernels call: compiled with each of them. ``options`` are njit's."""
    if function is None:
        return lambda function: inner(function, **options)
    if config.DISABLE_JIT:
        return function
    return _Inner(function, targetoptions={"nopython": True, **options}, pipeline_class=compiler.InnerCompiler)


def record(kind: np.dtype) -> Any:
    """Return one record of zeros, whose fields are its attributes; kernels change it in place."""
    return np.zeros(1, kind).view(np.recarray)[0]


class _Inner(CPUDispatcher):
    """A kernel that only kernels call. Called from Python, from a test, it runs as Python."""

    def __call__(self, *arguments: Any) -> Any:
        return self.py_func(*arguments)


class _Kept(FunctionCache):
    """Numba's cache of a function, keyed on the content of all that was compiled."""

    def __init__(self, compiled: Any) -> None:
        super().__init__(compiled.py_func)
        self._compiled = compiled
        package = compiled.py_func.__module__.partition(".")[0]
        self._shipped = shipped(package if package == "printmend_lab" else "printmend")
        self._cache_file._source_stamp = None  # a digest; what the entry calls may stand below it in its file

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load kept code; numba would first read in all that it could compile, 0.2 s of every command."""
        stamp, codegen = self._stamp(), target_context.codegen()
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            found = self._kept(sig, target_context)
            if found is None and (data := self._shipped.load(stamp, sig, codegen)) is not None:
                self._impl.locator.ensure_cache_path()
                self._cache_file.save(self._index_key(sig, codegen), data)
                found = self._impl.rebuild(target_context, data)
            return found

    def _kept(self, sig: Any, target_context: Any) -> Any:
        """Return what is kept of a signature; a file that cannot be read, of older code or torn, holds nothing."""
        try:
            return self._load_overload(sig, target_context)
        except OSError:
            raise
        except Exception:  # numba reads it before it looks whose it is: what a torn one raises is anybody's guess
            self._cache_file.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        stamp = self._stamp()
        super().save_overload(sig, data)
        if Shipped.fill:
            self._shipped.save(stamp, sig, data)

    def _stamp(self) -> str:
        if self._cache_file._source_stamp is None:
            self._cache_file._source_stamp = digest(self._compiled)
        return self._cache_file._source_stamp


def digest(kernel: Any) -> str:
    """Return a digest of a compiled function: its code and options, those of all that it calls, and their constants.

    Raises `TypeError` for a kernel that uses a value whose content cannot be told.
    """
    bounds = b"bounds checked" if config.BOUNDSCHECK else b""  # NUMBA_BOUNDSCHECK=1: other code of the same kernel
    total = hashlib.sha256(np.__version__.encode() + _HOW + bounds)
    waiting, seen = [kernel], {id(kernel)}
    while waiting:
        value = waiting.pop()
        function = getattr(value, "py_func", value)
        options = getattr(value, "targetoptions", {})
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
