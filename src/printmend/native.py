"""The library of compiled kernels that comes with the program and is called without numba.

`tools/ship_kernels.py` makes it. A kernel takes its arguments as numba lays them out: a number as it is, a record as
its address, an array as its parts, a tuple as its members, one after the other. `kernels.json` names for each kernel
the digest of its source and, for each list of kinds of arguments, its symbol and what it returns. Code of another
source is never run.
"""

import ctypes
import hashlib
import json
import sys
from collections.abc import Callable, Iterator
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from printmend.digest import is_set

FOLDER = "compiled"
NAME = "kernels"
SUFFIX = {"darwin": ".dylib", "win32": ".dll"}.get(sys.platform, ".so")
VERSION = 1
_NUMBERS: dict[str, Any] = {
    "f8": ctypes.c_double, "f4": ctypes.c_float, "i8": ctypes.c_int64, "i4": ctypes.c_int32, "i2": ctypes.c_int16,
    "i1": ctypes.c_int8, "u8": ctypes.c_uint64, "u4": ctypes.c_uint32, "u2": ctypes.c_uint16, "u1": ctypes.c_uint8,
    "b1": ctypes.c_int8,
}  # fmt: skip
_MOST_INT = 2**63 - 1
_address = ctypes.c_void_p.from_address
_ORDERS, _WRITEABLE = {1: "C", 2: "F", 3: "C", 0: "A"}, 0x400
_OK, _OK_NONE = 0, -2
_DATA = object.__basicsize__  # where an array holds the address of its numbers (NumPy's binary interface)
_names: dict[int, tuple[np.dtype, str]] = {}
"""The name of each data type by its identity; it is kept, so that no other one gets that identity."""


def _name_of(kind: np.dtype) -> str:
    """Return a name of a data type that changes with its fields and where they lie."""
    known = _names.get(id(kind))
    if known is None:
        name = kind.str[1:] if kind.names is None else hashlib.sha256(str(kind).encode()).hexdigest()[:16]
        if kind.names is None and kind.byteorder == (">" if sys.byteorder == "little" else "<"):
            name = kind.str
        known = _names[id(kind)] = kind, name
    return known[1]


def arguments_of(values: tuple) -> tuple[tuple, list[Any]]:
    """Return the kinds of values, one each, and their parts one after the other, as a kernel takes them."""
    flat: list[Any] = []
    return tuple([_take(value, flat) for value in values]), flat


def _take(value: Any, flat: list[Any]) -> Any:
    """Add a value's parts; return its kind."""
    what = type(value)
    if what is float:
        flat.append(value)
        return "f8"
    if what is int:
        flat.append(value)
        return "i8" if -_MOST_INT <= value <= _MOST_INT else "int"
    if isinstance(value, np.ndarray):
        address, flags = _address(id(value) + _DATA).value, value.flags.num  # `value.ctypes` takes ten times as long
        flat += (None, None, value.size, value.itemsize, address, *value.shape, *value.strides)
        order = _ORDERS[flags & 3] if value.ndim else "C"
        aligned = "" if flags & 0x100 else "u"
        return f"{value.ndim}{order}{'' if flags & _WRITEABLE else 'r'}{aligned} {_name_of(value.dtype)}"
    if isinstance(value, np.void):
        flat.append(np.frombuffer(value, np.uint8).ctypes.data)
        return f"@{_name_of(value.dtype)}"
    if isinstance(value, tuple):
        return (what.__qualname__, *[_take(each, flat) for each in value])
    if value is None:
        flat.append(None)
        return "none"
    if what is bool:
        flat.append(value)
        return "b1"
    if isinstance(value, np.generic):
        flat.append(value.item())
        return _name_of(value.dtype)
    return f"?{what.__qualname__}"


def _parts(kind: Any) -> list[Any]:
    """Return the types, in C, of a kind's parts."""
    if isinstance(kind, tuple):
        return [part for each in kind[1:] for part in _parts(each)]
    if kind == "none" or kind.startswith("@"):
        return [ctypes.c_void_p]
    if kind in _NUMBERS:
        return [_NUMBERS[kind]]
    dimensions = int(kind[0])
    return [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64, ctypes.c_void_p] + (
        [ctypes.c_int64] * (2 * dimensions)
    )


class Function:
    """A kernel for arguments of certain kinds. ``returned`` is a number's type, a list of them, or none."""

    def __init__(self, called: Any, kinds: tuple, returned: Any, name: str) -> None:
        parts = [part for kind in kinds for part in _parts(kind)]
        called.restype, called.argtypes = ctypes.c_int32, [ctypes.c_void_p, ctypes.c_void_p, *parts]
        self._called, self._name, self._many = called, name, isinstance(returned, list)
        kinds_back = returned if self._many else [returned]
        fields = [(f"f{i}", ctypes.c_void_p if kind == "none" else _NUMBERS[kind]) for i, kind in enumerate(kinds_back)]
        self._result = type("Result", (ctypes.Structure,), {"_fields_": fields})
        self._back = [(f"f{i}", kind) for i, kind in enumerate(kinds_back)]

    def __call__(self, flat: list[Any]) -> Any:
        result, error = self._result(), ctypes.c_void_p()
        status = self._called(ctypes.byref(result), ctypes.byref(error), *flat)
        if status not in (_OK, _OK_NONE):
            raise RuntimeError(f"{self._name} failed: its kernel returned {status}")
        values = tuple([_python(getattr(result, field), kind) for field, kind in self._back])
        return values if self._many else values[0]


def _python(value: Any, kind: str) -> Any:
    return None if kind == "none" else bool(value) if kind == "b1" else value


class Library:
    """The kernels in a folder, read when the first of them is asked for."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._loaded: Any = None
        self._manifest: dict[str, Any] | None = None

    def found(self, name: str, digest: Callable[[], str]) -> dict[tuple, Function]:
        """Return what there is of a kernel of that source, by the kinds of its arguments."""
        if self._manifest is None:
            self._manifest = self._read()
        section = self._manifest.get(name)
        if section is None or section["digest"] != digest():
            return {}
        functions: dict[tuple, Function] = {}
        for kinds, symbol, returned in section["calls"]:
            kinds = _tuples(kinds)
            function = Function(self._loaded[symbol], kinds, returned, name)
            for fitting in _fitting(kinds):
                functions.setdefault(fitting, function)
        return functions

    def _read(self) -> dict[str, Any]:
        path = self._folder / f"{NAME}.json"
        if is_set("PRINTMEND_NUMBA") or is_set("NUMBA_BOUNDSCHECK") or not path.is_file():
            return {}
        try:
            manifest = json.loads(path.read_text(encoding="utf-8"))
            if manifest["version"] != VERSION:
                return {}
            self._loaded = ctypes.CDLL(str(self._folder / manifest["library"]))
        except (OSError, ValueError, KeyError):  # of another platform, or torn: numba compiles the kernels here
            return {}
        return manifest["kernels"]


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def _fitting(kinds: tuple) -> Iterator[tuple]:
    """Yield the kinds of arguments that code for ``kinds`` takes: for an array that it only reads, one that it could
    change, too."""
    for each in product(*[_alternatives(kind) for kind in kinds]):
        yield tuple(each)


def _alternatives(kind: Any) -> tuple:
    if isinstance(kind, tuple):
        return tuple((kind[0], *fitting) for fitting in _fitting(kind[1:]))
    reads_only = kind[:1].isdigit() and kind[2:3] == "r"
    return (kind, kind[:2] + kind[3:]) if reads_only else (kind,)


class Recording:
    """What kernels were called with while it is ``on``, for `tools/ship_kernels.py`."""

    def __init__(self) -> None:
        self.on = False
        self.calls: dict[tuple[str, tuple], tuple[Any, tuple]] = {}

    def add(self, kernel: Any, kinds: tuple, arguments: tuple) -> None:
        name = f"{kernel.py_func.__module__}.{kernel.py_func.__qualname__}"
        if (name, kinds) not in self.calls:
            self.calls[name, kinds] = kernel, tuple(map(kernel.compiled.typeof_pyval, arguments))


@cache
def library_of(package: str) -> Library:
    """Return the library of a package, `printmend` or `printmend_lab`, from its folder `compiled`."""
    return Library(Path(str(sys.modules[package].__file__)).parent / FOLDER)


recording = Recording()
