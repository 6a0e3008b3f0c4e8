"""Translate kernels to JavaScript: the browser runs the law as the program states it, with the same double numbers.

Kernels know few statements: assignments, loops over ranges, branches, and calls of other kernels and of numpy's
elementary functions. Whatever else stands in one stops the build.
"""

import ast
import inspect
from collections.abc import Callable
from types import ModuleType

_NUMPY = {
    "cos": "Math.cos", "sin": "Math.sin", "sqrt": "Math.sqrt", "arctan2": "Math.atan2", "int64": "Math.trunc",
    "inf": "Infinity",
}  # fmt: skip
_PLAIN = {"min": "Math.min", "max": "Math.max", "abs": "Math.abs", "float": "Number"}
_BINARY = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
_COMPARED = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "===", ast.NotEq: "!=="}


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


def _function(node: ast.FunctionDef) -> str:
    given = [argument.arg for argument in node.args.args]
    own = {each.id for each in ast.walk(node) if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store)}
    body = [each for each in node.body if not (isinstance(each, ast.Expr) and isinstance(each.value, ast.Constant))]
    declared = sorted(own - {*given})
    head = [f"let {', '.join(declared)};"] if declared else []
    return f"function {node.name}({', '.join(given)}) {{\n" + "\n".join([*head, *map(_statement, body)]) + "\n}"


def _statement(node: ast.stmt) -> str:
    if isinstance(node, ast.Return) and node.value is not None:
        return f"return {_value(node.value)};"
    if isinstance(node, ast.Assign) and len(node.targets) == 1:
        return f"{_value(node.targets[0])} = {_value(node.value)};"
    if isinstance(node, ast.AugAssign):
        return f"{_value(node.target)} {_BINARY[type(node.op)]}= {_value(node.value)};"
    if isinstance(node, ast.If):
        other = f" else {_block(node.orelse)}" if node.orelse else ""
        return f"if ({_value(node.test)}) {_block(node.body)}{other}"
    if isinstance(node, ast.While) and not node.orelse:
        return f"while ({_value(node.test)}) {_block(node.body)}"
    if isinstance(node, ast.For) and isinstance(node.iter, ast.Call) and _value(node.iter.func) == "range":
        bounds = [*map(_value, node.iter.args)]
        first, end = bounds if len(bounds) == 2 else ("0", bounds[0])
        name = _value(node.target)
        return f"for ({name} = {first}; {name} < {end}; {name} += 1) {_block(node.body)}"
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
    return {True: "true", False: "false"}[node.value] if isinstance(node.value, bool) else repr(node.value)


def _attribute(node: ast.Attribute) -> str:
    owner = _value(node.value)
    if owner == "np":
        return _NUMPY[node.attr]
    return f"{owner}.{node.attr}" if owner not in ("play", "table", "bed") else node.attr


def _compare(node: ast.Compare) -> str:
    return f"({_value(node.left)} {_COMPARED[type(node.ops[0])]} {_value(node.comparators[0])})"


def _subscript(node: ast.Subscript) -> str:
    places = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
    if isinstance(node.value, ast.Attribute) and node.value.attr == "shape":
        return f"{_value(node.value.value)}.length"
    return _value(node.value) + "".join(f"[{_value(place)}]" for place in places)


def _unary(node: ast.UnaryOp) -> str:
    return f"({'!' if isinstance(node.op, ast.Not) else '-'}{_value(node.operand)})"


_MADE: dict[type, Callable] = {
    ast.Name: lambda node: _PLAIN.get(node.id, node.id),
    ast.Constant: _constant,
    ast.Attribute: _attribute,
    ast.Compare: _compare,
    ast.Subscript: _subscript,
    ast.UnaryOp: _unary,
    ast.BinOp: lambda node: f"({_value(node.left)} {_BINARY[type(node.op)]} {_value(node.right)})",
    ast.BoolOp: lambda node: (
        "(" + (" && " if isinstance(node.op, ast.And) else " || ").join(map(_value, node.values)) + ")"
    ),
    ast.IfExp: lambda node: f"({_value(node.test)} ? {_value(node.body)} : {_value(node.orelse)})",
    ast.Tuple: lambda node: "[" + ", ".join(map(_value, node.elts)) + "]",
    ast.Call: lambda node: f"{_value(node.func)}({', '.join(map(_value, node.args))})",
}
