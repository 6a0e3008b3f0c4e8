"""Translate kernels to JavaScript: the browser runs the law as the program states it, with the same double numbers.

Kernels know few statements: assignments, loops over ranges, branches, and calls of other kernels and of numpy's
elementary functions. Whatever else stands in one stops the build. A record becomes an object with its fields, an array
of it an array; comparisons are loose, because a truth value stands for 0 or 1 in kernels.
"""

import ast
import inspect
import itertools
from collections.abc import Callable, Iterable
from types import ModuleType

import numpy as np

_NUMPY = {
    "cos": "Math.cos", "sin": "Math.sin", "sqrt": "Math.sqrt", "arctan2": "Math.atan2", "int64": "Math.trunc",
    "inf": "Infinity", "nan": "NaN", "tan": "Math.tan", "ceil": "Math.ceil", "floor": "Math.floor",
    "sign": "Math.sign", "isnan": "Number.isNaN", "rint": "rint",
    "pi": "Math.PI",
}  # fmt: skip
_PLAIN = {"min": "Math.min", "max": "Math.max", "abs": "Math.abs", "float": "Number"}
_BINARY = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.BitAnd: "&", ast.BitOr: "|", ast.LShift: "<<",
    ast.RShift: ">>", ast.Pow: "**",
}  # fmt: skip
_COMPARED = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=", ast.Is: "===",
             ast.IsNot: "!=="}  # fmt: skip
_RESERVED = {"new", "var", "let", "function", "this", "in", "of", "class", "delete", "default", "case", "switch"}
_MODULES = {"play", "table", "bed"}  # names under which kernels import a whole module
HELPERS = """\
export const rint = (v) => {
  const low = Math.floor(v), off = v - low;
  return off < 0.5 || (off === 0.5 && low % 2 === 0) ? low : low + 1;
};
export const mod = (a, b) => a - Math.floor(a / b) * b;
"""
_fresh = itertools.count()


def module_text(module: ModuleType, names: list[str]) -> str:
    """Return the functions ``names`` of a module of kernels as JavaScript, with the module's constants."""
    tree = ast.parse(inspect.getsource(module))
    functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
    used = {node.id for name in names for node in ast.walk(functions[name]) if isinstance(node, ast.Name)}
    lines = []
    for name in sorted(used):
        value = vars(module).get(name)
        if isinstance(value, int | float):
            lines.append(f"const {name} = {value!r};")
    lines += [f"export {_function(functions[name])}" for name in names]
    return "\n".join(lines) + "\n"


def file_of(name: str) -> str:
    """Return the file of JavaScript that a module of kernels becomes."""
    return name.removeprefix("printmend.").replace(".", "-") + ".js"


def whole_text(module: ModuleType, stubs: Iterable[str]) -> tuple[str, set[str]]:
    """Return all of a module as a module of JavaScript, and the names of those that it imports.

    Functions among ``stubs`` are left out there, and where they are imported.
    """
    tree, skipped = ast.parse(inspect.getsource(module)), set(stubs)
    lines, needed = ['import { mod, rint } from "./helpers.js";'], set()
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("printmend."):
            if node.module == "printmend.jit":
                continue
            if node.module == "printmend.machine.kernels":
                for each in node.names:
                    needed.add(f"{node.module}.{each.name}")
                    lines.append(f'import * as {each.name} from "./{file_of(f"{node.module}.{each.name}")}";')
                continue
            needed.add(node.module)
            names = ", ".join(each.name for each in node.names)
            lines.append(f'import {{ {names} }} from "./{file_of(node.module)}";')
    for name, value in vars(module).items():
        if isinstance(value, np.dtype) and _stands_in(tree, name):
            lines.append(f"export const {name} = () => ({_zeros(value)});")
        elif isinstance(value, int | float) and not isinstance(value, bool) and _stands_in(tree, name):
            lines.append(f"export const {name} = {_number(value)};")
        elif isinstance(value, tuple) and _stands_in(tree, name):
            lines.append(f"export const {name} = [{', '.join(map(_number, value))}];")
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            what = f"function {node.name}() {{ return 0; }}" if node.name in skipped else _function(node, apart=True)
            lines.append(f"export {what}")
    return "\n".join(lines) + "\n", needed


def _stands_in(tree: ast.Module, name: str) -> bool:
    """Say whether a module itself assigns a name."""
    return any(isinstance(each, ast.Name) and each.id == name and isinstance(each.ctx, ast.Store)
               for node in tree.body if isinstance(node, ast.Assign) for each in ast.walk(node))  # fmt: skip


def _number(value: object) -> str:
    return {"inf": "Infinity", "nan": "NaN"}.get(repr(value), repr(value))


def _zeros(kind: np.dtype) -> str:
    """Return a record of zeros as JavaScript."""
    if kind.subdtype is not None:
        inner, (length, *rest) = kind.subdtype[0], kind.shape
        inside = _zeros(np.dtype((inner, tuple(rest)))) if rest else _zeros(inner)
        return f"Array.from({{ length: {length} }}, () => ({inside}))"
    if kind.names is None:
        return "0"
    return "{ " + ", ".join(f"{name}: {_zeros(kind[name])}" for name in kind.names) + " }"


def _function(node: ast.FunctionDef, *, apart: bool = False) -> str:
    if not apart:  # of one module: what others are imported as is not said
        node = _Alone().visit(node)
    given = [_spelled(argument.arg) for argument in node.args.args]
    own = {
        _spelled(each.id) for each in ast.walk(node) if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store)
    }
    body = [each for each in node.body if not (isinstance(each, ast.Expr) and isinstance(each.value, ast.Constant))]
    declared = sorted(own - {*given})
    head = [f"let {', '.join(declared)};"] if declared else []
    return f"function {node.name}({', '.join(given)}) {{\n" + "\n".join([*head, *map(_statement, body)]) + "\n}"


def _statement(node: ast.stmt) -> str:
    if isinstance(node, ast.Return) and node.value is not None:
        return f"return {_value(node.value)};"
    if isinstance(node, ast.Return):
        return "return;"
    if isinstance(node, ast.Continue):
        return "continue;"
    if isinstance(node, ast.Expr):
        return f"{_value(node.value)};"
    if isinstance(node, ast.Assign):
        return " = ".join(map(_value, [*node.targets, node.value])) + ";"
    if isinstance(node, ast.AugAssign):
        return f"{_value(node.target)} {_BINARY[type(node.op)]}= {_value(node.value)};"
    if isinstance(node, ast.If):
        other = f" else {_block(node.orelse)}" if node.orelse else ""
        return f"if ({_value(node.test)}) {_block(node.body)}{other}"
    if isinstance(node, ast.While) and not node.orelse:
        return f"while ({_value(node.test)}) {_block(node.body)}"
    if isinstance(node, ast.For) and isinstance(node.iter, ast.Tuple):
        return f"for ({_value(node.target)} of [{', '.join(map(_value, node.iter.elts))}]) {_block(node.body)}"
    if isinstance(node, ast.For) and isinstance(node.iter, ast.Call) and _value(node.iter.func) == "range":
        bounds = [*map(_value, node.iter.args)]
        first, end = bounds if len(bounds) == 2 else ("0", bounds[0])
        at, last = f"$i{next(_fresh)}", f"$n{next(_fresh)}"
        body = "{\n" + "\n".join([f"{_value(node.target)} = {at};", *map(_statement, node.body)]) + "\n}"
        return f"for (let {at} = {first}, {last} = {end}; {at} < {last}; {at} += 1) {body}"
    if isinstance(node, ast.Break):
        return "break;"
    raise ValueError(f"no JavaScript for {ast.unparse(node)!r}; keep it out of this kernel, or add it here")


def _block(body: list[ast.stmt]) -> str:
    return "{\n" + "\n".join(map(_statement, body)) + "\n}"


def _value(node: ast.expr) -> str:
    made = _MADE.get(type(node))
    if made is None:
        raise ValueError(f"no JavaScript for {ast.unparse(node)!r}; keep it out of this kernel, or add it here")
    return made(node)


def _constant(node: ast.Constant) -> str:
    return {"True": "true", "False": "false", "None": "null"}.get(repr(node.value), repr(node.value))


class _Alone(ast.NodeTransformer):
    """Takes the names of modules off: all that is called stands in one file."""

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        self.generic_visit(node)
        if isinstance(node.value, ast.Name) and node.value.id in _MODULES:
            return ast.copy_location(ast.Name(node.attr, ast.Load()), node)
        return node


def _spelled(name: str) -> str:
    return f"{name}_" if name in _RESERVED else name


def _attribute(node: ast.Attribute) -> str:
    owner = _value(node.value)
    return _NUMPY[node.attr] if owner == "np" else f"{owner}.{node.attr}"


def _compare(node: ast.Compare) -> str:
    if isinstance(node.ops[0], ast.In) and isinstance(node.comparators[0], ast.Tuple):
        return f"{_value(node.comparators[0])}.includes({_value(node.left)})"
    sides = [_value(each) for each in (node.left, *node.comparators)]
    pairs = zip(sides, node.ops, sides[1:], strict=False)
    return "(" + " && ".join(f"{left} {_COMPARED[type(op)]} {right}" for left, op, right in pairs) + ")"


def _call(node: ast.Call) -> str:
    given = ", ".join(map(_value, node.args))
    return f"{given}.length" if _value(node.func) == "len" else f"{_value(node.func)}({given})"


def _binary(node: ast.BinOp) -> str:
    left, right = _value(node.left), _value(node.right)
    if isinstance(node.op, ast.Mod):
        return f"mod({left}, {right})"
    if isinstance(node.op, ast.FloorDiv):
        return f"Math.floor({left} / {right})"
    return f"({left} {_BINARY[type(node.op)]} {right})"


def _subscript(node: ast.Subscript) -> str:
    places = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
    if isinstance(node.value, ast.Attribute) and node.value.attr == "shape":
        return f"{_value(node.value.value)}.length"
    return _value(node.value) + "".join(f"[{_value(place)}]" for place in places)


def _unary(node: ast.UnaryOp) -> str:
    return f"({'!' if isinstance(node.op, ast.Not) else '-'}{_value(node.operand)})"


_MADE: dict[type, Callable] = {
    ast.Name: lambda node: _PLAIN.get(node.id, _spelled(node.id)),
    ast.Constant: _constant,
    ast.Attribute: _attribute,
    ast.Compare: _compare,
    ast.Subscript: _subscript,
    ast.UnaryOp: _unary,
    ast.BinOp: _binary,
    ast.BoolOp: lambda node: (
        "(" + (" && " if isinstance(node.op, ast.And) else " || ").join(map(_value, node.values)) + ")"
    ),
    ast.IfExp: lambda node: f"({_value(node.test)} ? {_value(node.body)} : {_value(node.orelse)})",
    ast.Tuple: lambda node: "[" + ", ".join(map(_value, node.elts)) + "]",
    ast.Call: _call,
}
