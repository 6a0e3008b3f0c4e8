"""A short way through numba's compiler: the passes that a kernel needs, and LLVM once for a whole entry.

Numba compiles every function as if Python called it: it makes two wrappers, links all that the function calls,
optimises the whole and emits machine code for it, again at each level of calls. Here a function that only kernels call
is lowered to LLVM's language and left there; the entry links all of them, is optimised and emitted once. Kernels are
written for it: they make no closures and no objects.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba import _dynfunc
from numba.core import funcdesc, lowering, typed_passes, typeinfer, types, untyped_passes
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, Flags, _LowerResult
from numba.core.compiler_machinery import AnalysisPass, LoweringPass, PassManager, _pass_registry, register_pass
from numba.core.errors import NumbaWarning, WarningsFixer  # type: ignore[attr-defined]
from numba.np import arrayobj


class _Part(JITCodeLibrary):
    """The code of a function that only kernels call: neither linked, optimised nor emitted by itself."""

    def add_llvm_module(self, ll_module: Any) -> None:
        self._final_module.link_in(ll_module)

    def finalize(self) -> None:
        self._finalized = True


class _Whole(JITCodeLibrary):
    """The code of an entry, which links all that its functions call, directly or not."""

    def add_llvm_module(self, ll_module: Any) -> None:
        self._final_module.link_in(ll_module)

    def finalize(self) -> None:
        self._own = {each.name for each in self._final_module.functions if not each.is_declaration}
        libraries = self._linking_libraries
        for library in libraries:  # it grows on the way
            if isinstance(library, _Part):
                libraries.extend(more for more in library._linking_libraries if more not in libraries)
        super().finalize()

    def _optimize_final_module(self) -> None:
        """Optimise the whole. LLVM is told that nobody else calls the inner functions, so it may fit them to callers.

        It then drops the parameters that a function does not use, most of an array's seven, and inlines more.
        """
        for function in self._final_module.functions:
            if not function.is_declaration and function.name not in self._own:
                function.linkage = "internal"
        super()._optimize_final_module()

    def _finalize_final_module(self) -> None:
        self.optimised = self._final_module.as_bitcode()  # making machine code of a module changes it
        super()._finalize_final_module()


@register_pass(mutates_CFG=True, analysis_only=False)
class _LowerPart(LoweringPass):
    """Lower a function that only kernels call: no wrapper, no address."""

    _name = "printmend_lower_part"

    def __init__(self) -> None:  # abstract in every pass
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        library, context, flags = state.library, state.targetctx, state.flags
        described = funcdesc.PythonFunctionDescriptor.from_specialized_function(
            state.func_ir, state.typemap, state.return_type, state.calltypes, mangler=context.mangler,
            inline=flags.forceinline, noalias=flags.noalias, abi_tags=[flags.get_mangle_string()],
        )  # fmt: skip
        with context.push_code_library(library):
            lower = _Lower(context, library, described, state.func_ir, metadata=state.metadata)
            lower.lower()
        module, name = described.lookup_module(), described.qualname.split(".")[-1]
        called = _dynfunc.make_function(module, described.qualname, name, 0, lower.env, (library,))
        context.insert_user_function(called, described, [library])
        state["cr"] = _LowerResult(described, lower.call_helper, cfunc=called, env=lower.env)
        return True


@contextmanager
def _from_the_front() -> Iterator[None]:
    """Let every index count from the front: numba would ask of each whether it is negative, and count from the back.

    No kernel has such an index. With NUMBA_BOUNDSCHECK=1 one would be out of bounds.
    """
    before = arrayobj.fix_integer_index
    arrayobj.fix_integer_index = _as_it_is
    try:
        yield
    finally:
        arrayobj.fix_integer_index = before


def _as_it_is(context: Any, builder: Any, kind: Any, index: Any, _size: Any) -> Any:
    return context.cast(builder, index, kind, types.intp)


class _Lower(lowering.Lower):
    """Lowering without a text about each instruction, in case of an error."""

    def lower(self) -> None:
        with _from_the_front():
            super().lower()

    def lower_block(self, block: Any) -> None:
        self.pre_block(block)
        for instruction in block.body:
            self.loc = instruction.loc
            self.lower_inst(instruction)
        self.post_block(block)


@register_pass(mutates_CFG=True, analysis_only=False)
class _LowerWhole(typed_passes.NativeLowering):
    @property
    def lowering_class(self) -> type[lowering.Lower]:
        return _Lower


_SIGNATURES: dict[tuple, Any] = {}


class _Infer(typeinfer.TypeInferer):
    """Type inference that asks once what an operation on values of certain types returns.

    A kernel is called with numbers as numbers: numba would compile it once for each literal 0, 1, 2 that it is given.
    """

    flags: Flags

    def resolve_call(self, fnty: Any, pos_args: Any, kw_args: Any) -> Any:
        if isinstance(fnty, types.Dispatcher):
            pos_args = tuple(map(types.unliteral, pos_args))  # type: ignore[attr-defined]
        if not isinstance(fnty, types.Function) or kw_args:
            return super().resolve_call(fnty, pos_args, kw_args)
        key = fnty, tuple(pos_args), self.flags
        if key not in _SIGNATURES:
            _SIGNATURES[key] = super().resolve_call(fnty, pos_args, kw_args)
        return _SIGNATURES[key]


@register_pass(mutates_CFG=True, analysis_only=False)
class _InferTypes(AnalysisPass):
    _name = "printmend_infer_types"

    def __init__(self) -> None:  # abstract in every pass
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        warnings = WarningsFixer(NumbaWarning)
        infer = _Infer(state.typingctx, state.func_ir, warnings)
        infer.flags = state.flags
        with state.typingctx.callstack.register(state.targetctx.target, infer, state.func_id, state.args), warnings:
            for index, (name, kind) in enumerate(zip(state.func_ir.arg_names, state.args, strict=True)):
                infer.seed_argument(name, index, kind)
            if state.return_type is not None:
                infer.seed_return(state.return_type)
            infer.build_constraint()
            infer.propagate()
            state.typemap, state.return_type, state.calltypes = infer.unify()
        return True


class _Passes(PassManager):
    """Passes that run one after the other, without checks and book-keeping between them."""

    def run(self, state: Any) -> None:
        for kind, _ in self.passes:
            one = _pass_registry.get(kind).pass_inst
            one.analysis = self._analysis
            one.run_pass(state)


class _Flags(Flags):
    """Flags that are quickly compared: numba looks its overloads up by them."""

    def __hash__(self) -> int:
        return hash(tuple(self._values))

    def __eq__(self, other: object) -> bool:
        return (isinstance(other, _Flags) and self._values == other._values) or super().__eq__(other)


class _ShortCompiler(CompilerBase):
    library: type[JITCodeLibrary]
    lower: type[LoweringPass]
    rewrites: tuple[type, ...] = ()

    def __init__(self, *arguments: Any) -> None:
        *others, flags, names = arguments
        super().__init__(*others, _Flags(flags), names)

    def define_pipelines(self) -> list[PassManager]:
        state = self.state
        state.library = self.library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        state.type_annotation = ""  # a listing for people
        passes = _Passes("kernel")
        for kind in (
            untyped_passes.TranslateByteCode,
            untyped_passes.FixupArgs,
            untyped_passes.RewriteSemanticConstants,
            untyped_passes.DeadBranchPrune,  # of what is not done for an argument that is None
            untyped_passes.GenericRewrites,
            untyped_passes.ReconstructSSA,
            _InferTypes,
            typed_passes.PreLowerStripPhis,
            *self.rewrites,
            typed_passes.IRLegalization,
            self.lower,
            typed_passes.NoPythonBackend,
        ):
            passes.add_pass(kind, "")
        passes.finalize()
        return [passes]


class InnerCompiler(_ShortCompiler):
    """The compiler of a function that only kernels call."""

    library, lower = _Part, _LowerPart


class EntryCompiler(_ShortCompiler):
    """The compiler of a kernel that Python calls."""

    library, lower = _Whole, _LowerWhole
    rewrites = (typed_passes.NopythonRewrites,)  # arithmetic on whole arrays becomes one loop
