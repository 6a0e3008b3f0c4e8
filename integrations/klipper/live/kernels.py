# SPDX-License-Identifier: GPL-3.0-or-later
"""The planner of `printmend mend` as plain Python: its kernels without numpy and without a compiler.

A kernel is scalar code on records. Here a record is an object with those fields, an array of it a list, and numpy's
few functions are the standard library's. A division by zero gives an infinity, as in the compiled kernels. What only
adds up the promise of a file is left out.
"""

import ast
import builtins
import importlib.machinery
import math
import os
import types

SOURCES = os.path.join(os.path.dirname(os.path.realpath(__file__)), "../../../src")


def divided(a, b):
    """Return a / b as compiled code has it."""
    try:
        return a / b
    except ZeroDivisionError:
        return math.nan if a == 0.0 or a != a else math.copysign(math.inf, a) * math.copysign(1.0, b)


def rooted(value):
    return math.sqrt(value) if value >= 0.0 else math.nan


NUMBERS = ("f8", "i8", "u4", "i4", "u1")


class Kind:
    """What a record consists of, as `numpy.dtype` is told it."""

    def __init__(self, fields, align=False):
        fields = [(field[0], field[1], field[2] if len(field) > 2 else ()) for field in fields]
        self.numbers = [(name, zeros(kind, ())) for name, kind, shape in fields if shape == () and kind in NUMBERS]
        self.others = [field for field in fields if field[2] != () or field[1] not in NUMBERS]
        self.made = type("Record", (), {"__slots__": [name for name, _, _ in fields]})

    def one(self):
        """Return a record of zeros."""
        made = self.made()
        for name, zero in self.numbers:
            setattr(made, name, zero)
        for name, kind, shape in self.others:
            setattr(made, name, zeros(kind, (shape,) if isinstance(shape, int) else shape))
        return made


def zeros(kind, shape):
    if not shape:
        return kind.one() if isinstance(kind, Kind) else 0 if kind[0] in "iu" else 0.0
    return [zeros(kind, shape[1:]) for _ in range(shape[0])]


def named(**names):
    module = types.ModuleType("plain")
    vars(module).update(names)
    return module


NUMPY = named(
    inf=math.inf, nan=math.nan, pi=math.pi, sqrt=rooted, cos=math.cos, sin=math.sin, tan=math.tan, arctan2=math.atan2,
    isnan=math.isnan, ceil=math.ceil, floor=math.floor, rint=round, int64=int, dtype=Kind, record=None, ndarray=None,
    sign=lambda value: (value > 0.0) - (value < 0.0), empty=lambda size, kind: [], copysign=math.copysign,
)  # fmt: skip


def as_it_is(function=None, **options):
    return as_it_is if function is None else function


PLAIN = (ast.Name, ast.Attribute, ast.Constant)  # what costs nothing to look at twice


class Plain(ast.NodeTransformer):
    """Let each division that could be by zero give an infinity, and find entries of an array as those of lists."""

    names = 0

    def visit_BinOp(self, node):
        self.generic_visit(node)
        if not isinstance(node.op, ast.Div) or isinstance(node.right, ast.Constant):
            return node
        call = ast.Call(ast.Name("divided", ast.Load()), [node.left, node.right], [])
        if isinstance(node.right, PLAIN):
            call = ast.IfExp(node.right, node, call)
        return ast.copy_location(call, node)

    def visit_Call(self, node):
        """Compare values where they are: it takes a third of the time of a call of min or max."""
        self.generic_visit(node)
        name = getattr(node.func, "id", None)
        if name not in ("min", "max") or len(node.args) < 2:
            return node
        first, *others = node.args
        for second in others:
            (a, keep_a), (b, keep_b) = self._kept(first), self._kept(second)
            order = ast.Lt() if name == "min" else ast.Gt()
            first = ast.IfExp(ast.Compare(keep_b, [order], [keep_a]), b, a)
        return ast.copy_location(first, node)

    def _kept(self, node):
        """Return what reads a value, and what finds it first: a name keeps it, unless it costs nothing to look at."""
        if isinstance(node, PLAIN):
            return node, node
        self.names += 1
        name = f"kept{self.names}"
        return ast.Name(name, ast.Load()), ast.NamedExpr(ast.Name(name, ast.Store()), node)

    def visit_Subscript(self, node):
        self.generic_visit(node)
        places = getattr(node.slice, "value", node.slice)  # before Python 3.9 it is wrapped
        if isinstance(places, ast.Tuple):
            *rows, last = map(ast.Index, places.elts)
            for row in rows:
                node.value = ast.Subscript(node.value, row, ast.Load())
            node.slice = last
        return node


class Source(importlib.machinery.SourceFileLoader):
    """Reads a module of kernels; nothing is cached, for its code is not the program's."""

    def get_code(self, fullname):
        path = self.get_filename(fullname)
        tree = Plain().visit(ast.parse(self.get_data(path), path))
        return compile(ast.fix_missing_locations(tree), path, "exec")


class Kernels:
    """Modules of kernels, loaded apart from the program's own."""

    def __init__(self):
        self._modules = {"numpy": NUMPY, "printmend.jit": named(entry=as_it_is, inner=as_it_is)}
        self._builtins = dict(vars(builtins), __import__=self._import)

    def load(self, name, **instead):
        """Return a module; ``instead`` take the place of functions that it has imported."""
        if name not in self._modules:
            path = os.path.join(SOURCES, *name.split("."))
            self._modules[name] = module = types.ModuleType(name)
            if not os.path.isdir(path):
                vars(module).update(__builtins__=self._builtins, divided=divided)
                Source(name, path + ".py").exec_module(module)
        module = self._modules[name]
        vars(module).update(instead)
        return module

    def _import(self, name, scope=None, local=None, names=(), level=0):
        if name != "numpy" and name.partition(".")[0] != "printmend":
            return builtins.__import__(name, scope, local, names, level)
        module = self.load(name)
        for each in names or ():
            if not hasattr(module, each):
                setattr(module, each, self.load(f"{name}.{each}"))
        return module


def planner():
    """Return the module whose `mend` plans, with what it imports; nothing is predicted and nothing is added up."""
    kernels = Kernels()
    nothing = lambda *given: None  # noqa: E731
    kernels.load("printmend.plan.kernels.draw", samples_of=lambda model, length: 0, note=nothing)
    return kernels, kernels.load(
        "printmend.plan.kernels.mend", predict_raw=nothing, note=nothing, note_height=nothing,
        layer_of=lambda state, counts, layers, record: 0, _from_home=lambda model, record, m0, m1: 0.0,
    )  # fmt: skip
