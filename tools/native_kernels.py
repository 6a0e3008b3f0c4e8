"""Make a library of compiled kernels that runs without numba (`printmend.native`); for `ship_kernels.py`.

Of each kernel numba has made LLVM's code. Here it becomes machine code that every processor of this kind can run, and
the system's compiler links it with the few functions that manage scratch memory (`nrt.c`).
"""

import ctypes
import hashlib
import json
import platform
import shutil
import subprocess
from pathlib import Path
from typing import Any

from printmend.native import NAME, SUFFIX, VERSION

# What processors of a kind surely have: x86-64-v2 is from 2009.
_KNOWN = {
    "NRT_MemInfo_alloc_aligned", "NRT_MemInfo_alloc", "NRT_MemInfo_new_varsize_dtor", "NRT_MemInfo_varsize_realloc",
    "NRT_MemInfo_call_dtor", "NRT_Allocate", "NRT_Free", "memcpy", "memset", "memmove", "malloc", "free",
    "acos", "asin", "atan", "atan2", "cos", "cosh", "exp", "expm1", "fmod", "hypot", "log", "log10", "log1p", "log2",
    "ceil", "erfc", "fabs", "floor", "pow", "rint", "round", "sin", "sinh", "sqrt", "tan", "tanh", "trunc",
}  # fmt: skip
_PROCESSORS = {"x86_64": "x86-64-v2", "AMD64": "x86-64-v2"}


def emit(calls: dict, modules: dict, folder: Path) -> list[tuple[str, str, list]]:
    """Write an object file for each kernel and kinds of arguments; return (name, digest of its source, [kinds, symbol,
    returned]) of each. What a library cannot be called with is left to numba."""
    made = []
    for (name, kinds), (kernel, sig) in calls.items():
        stamp = kernel.compiled._cache._stamp()
        taken = next((one for one in modules if one[0] == stamp and _may_be_called(one[1], sig)), None)
        if taken is None or "?" in str(kinds):
            continue
        code, described, signature = modules[taken]
        returned = _returned(signature.return_type)
        if returned is None:
            continue
        symbol = "k" + hashlib.sha256(f"{stamp}{taken[1]}".encode()).hexdigest()[:24]
        path = folder / f"{symbol}.o"
        if not path.exists():
            if (compiled := _object(code, described.mangled_name, symbol)) is None:
                continue
            path.write_bytes(compiled)
        made.append((name, kernel.digest(), [kinds, symbol, returned]))
    return made


def _may_be_called(compiled: tuple, sig: tuple) -> bool:
    """Say whether code for some types takes arguments of types ``sig``: the same, or arrays that it will not change."""
    from numba.core import types

    def fits(one: Any, other: Any) -> bool:
        read_only = isinstance(one, types.Array) and isinstance(other, types.Array) and not one.mutable
        return one == (other.copy(readonly=True) if read_only else other)

    return len(compiled) == len(sig) and all(map(fits, compiled, sig))


def link(made: list[tuple[str, str, list]], objects: Path, folder: Path) -> str:
    """Link the objects into the library, and write what is in it; return what came of it, in words."""
    for old in folder.glob(f"{NAME}.*"):
        old.unlink()
    compiler = shutil.which("cc")
    if compiler is None:
        return "no library without numba: there is no C compiler (cc)"
    files = sorted({objects / f"{call[1]}.o" for _, _, call in made})
    if not made:
        return f"no library in {folder}"
    target = folder / (NAME + SUFFIX)
    source = Path(__file__).with_name("nrt.c")
    subprocess.run([compiler, "-O2", "-shared", "-fPIC", "-s", "-o", target, source, *files, "-lm"], check=True)  # noqa: S603
    kernels: dict[str, Any] = {}
    for name, digest, call in made:
        section = kernels.setdefault(name, {"digest": digest, "calls": []})
        if json.loads(json.dumps(call)) not in section["calls"]:
            section["calls"].append(json.loads(json.dumps(call)))
    manifest = {"version": VERSION, "library": target.name, "kernels": kernels}
    (folder / f"{NAME}.json").write_text(json.dumps(manifest), encoding="utf-8")
    count = sum(len(section["calls"]) for section in kernels.values())
    ctypes.CDLL(str(target))  # is all there that it needs?
    return f"{target.name}: {count} ways to call {len(kernels)} kernels, {target.stat().st_size / 1e6:.1f} MB"


def _returned(kind: Any) -> Any:
    """Return a numba type as `printmend.native` reads it; None for one that it cannot."""
    from numba.core import types

    if isinstance(kind, types.NoneType):
        return "none"
    if isinstance(kind, types.Boolean):
        return "b1"
    if isinstance(kind, types.Float):
        return f"f{kind.bitwidth // 8}"
    if isinstance(kind, types.Integer):
        return f"{'i' if kind.signed else 'u'}{kind.bitwidth // 8}"
    if isinstance(kind, types.BaseTuple) and not isinstance(kind, types.BaseNamedTuple):
        parts = [_returned(each) for each in kind]
        return parts if all(isinstance(part, str) for part in parts) else None
    return None


def _object(code: bytes, function: str, symbol: str) -> bytes | None:
    """Return the object file of a module whose one function is ``function``, to be called by another name.

    None for one that needs more of numba or Python than `nrt.c` has.
    """
    from numba.core.codegen import ll

    module = ll.parse_bitcode(code)
    for each in module.functions:
        if not each.is_declaration and each.name != function:
            each.linkage = "internal"
    kept = module.get_function(function)
    kept.linkage, kept.name = "external", symbol
    machine = ll.Target.from_default_triple().create_target_machine(
        cpu=_PROCESSORS.get(platform.machine(), "generic"), opt=3, reloc="pic", codemodel="default"
    )
    passes = ll.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()  # numba's wrappers, which Python would call
    passes.run(module, ll.create_pass_builder(machine, ll.create_pipeline_tuning_options(speed_level=3)))
    needs = {each.name for each in module.functions if each.is_declaration and not each.name.startswith("llvm.")}
    return None if needs - _KNOWN else machine.emit_object(module)
