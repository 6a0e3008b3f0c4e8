"""Kernels that come with the program, compiled except for the last step. They cut the first use from half a minute to
two seconds.

What is kept is LLVM's code of an entry after all optimisation, which is the same for every processor of a kind
(x86-64, ARM): this machine's own instructions are made of it when the entry is first needed. It is found by the digest
of all that went into the entry, so that what belongs to another source is never run. It is made by
`tools/ship_kernels.py`.
"""

import hashlib
import lzma
import sys
from functools import cache
from pathlib import Path
from typing import Any

from numba.core.caching import IndexDataCacheFile
from numba.core.codegen import ll


class Shipped:
    """The kernels in a folder; `used` are the names of the files that were asked for, or made.

    While it is filled, `modules` holds of each of them LLVM's code, what numba says of its function, and its signature.
    """

    fill = False  # set it on the class: keep what is compiled

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.used: set[str] = set()
        self.modules: dict[tuple[str, Any], tuple[bytes, Any, Any]] = {}

    def load(self, digest: str, sig: Any, codegen: Any) -> tuple | None:
        """Return an entry as numba's cache has it, with machine code for this processor; None where it is not here."""
        key = _key(sig, codegen)
        try:
            found = self._file(digest, key).load(key)
        except ImportError:  # the named tuple of an argument lived in another module when this was made
            return None
        if found is None:
            return None
        name, optimised, shared, *rest = found
        if self.fill:
            self.modules[digest, sig] = lzma.decompress(optimised), rest[0], rest[2]
        module = ll.parse_bitcode(lzma.decompress(optimised))
        code = codegen._tm.emit_object(module)
        return (name, "object", (code, lzma.decompress(shared))), *rest

    def save(self, digest: str, sig: Any, result: Any) -> None:
        """Keep an entry that was compiled just now."""
        self.folder.mkdir(exist_ok=True)
        (name, _, (_, shared)), *rest = result._reduce()
        self.modules[digest, sig] = result.library.optimised, result.fndesc, result.signature
        packed = lzma.compress(result.library.optimised), lzma.compress(shared)
        key = _key(sig, result.codegen)
        self._file(digest, key).save(key, (name, *packed, *rest))

    def forget_others(self) -> None:
        """Remove what no entry asked for: code of sources that are gone."""
        for path in self.folder.glob("*.nb?"):
            if path.name.partition(".")[0] not in self.used:
                path.unlink()

    def _file(self, digest: str, key: tuple) -> IndexDataCacheFile:
        """Return the place of an entry for arguments of one type: processes that fill the folder meet in no file."""
        name = hashlib.sha256(f"{digest}{key}".encode()).hexdigest()
        self.used.add(name)
        return IndexDataCacheFile(str(self.folder), f"{name}.{sys.implementation.cache_tag}", digest)


def _key(sig: Any, codegen: Any) -> tuple:
    """Return what code depends on beside its source and numba's version, which numba's file knows."""
    triple, _cpu, _features = codegen.magic_tuple()
    return sig, triple, codegen._data_layout


@cache
def shipped(package: str) -> Shipped:
    """Return the kernels of a package, `printmend` or `printmend_lab`, from its folder `compiled`."""
    return Shipped(Path(str(sys.modules[package].__file__)).parent / "compiled")
