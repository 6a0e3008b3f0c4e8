"""Kernels compiled by numba on this machine, and kept on disk.

An entry's machine code is kept under a digest of all that went into the entry. Numba's own key is the date of the
entry's file, so that after an edit elsewhere the old code would go on running.
"""

import hashlib
from typing import Any

import numpy as np
from numba import njit
from numba.core import types
from numba.core.caching import FunctionCache
from numba.core.event import Event, Listener, register
from numba.core.registry import CPUDispatcher
from numba.core.runtime import rtsys
from numba.core.typing.typeof import typeof_impl

from printmend import compiler
from printmend.compilations import compilations
from printmend.digest import digest
from printmend.shipped import Shipped, shipped


class _Watch(Listener):
    def on_start(self, event: Event) -> None:
        compilations.begin()

    def on_end(self, event: Event) -> None:
        compilations.end()


register("numba:compile", _Watch())


def entry_of(kernel: Any) -> Any:
    """Return what Python calls for a kernel: compiled when first needed, kept on disk, run beside other threads."""
    compiled = njit(nogil=True, pipeline_class=compiler.EntryCompiler, **kernel.options)(kernel.py_func)
    compiled._cache = _Kept(compiled, kernel)
    return compiled


def inner_of(kernel: Any) -> Any:
    """Return what other kernels call: compiled with each of them."""
    options = {"nopython": True, **kernel.options}
    return CPUDispatcher(kernel.py_func, targetoptions=options, pipeline_class=compiler.InnerCompiler)


def take_for_kernels(kind: type) -> None:
    """Let numba see a kernel in what the program calls one."""
    typeof_impl.register(kind)(lambda kernel, _context: types.Dispatcher(kernel.compiled))


class _Kept(FunctionCache):
    """Numba's cache of a function, keyed on the content of all that was compiled."""

    def __init__(self, compiled: Any, kernel: Any) -> None:
        super().__init__(compiled.py_func)
        self._kernel, self._shipped = kernel, shipped(kernel.package)
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
        """Return the kept code of a signature; a file that is unreadable, torn or of older code holds none."""
        try:
            return self._load_overload(sig, target_context)
        except OSError:
            raise
        except Exception:  # numba reads it before it checks whose it is: a torn file may raise anything
            self._cache_file.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        stamp = self._stamp()
        super().save_overload(sig, data)
        if Shipped.fill:
            self._shipped.save(stamp, sig, data)

    def _stamp(self) -> str:
        if self._cache_file._source_stamp is None:
            whole = f"{np.__version__} {digest(self._kernel)}"
            self._cache_file._source_stamp = hashlib.sha256(whole.encode()).hexdigest()
        return self._cache_file._source_stamp
