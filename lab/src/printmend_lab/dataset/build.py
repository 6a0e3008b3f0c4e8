"""Build a data set: bodies are sliced, cut into layers and printed on broken printers, each body once.

dataset.json                        what was asked, so that an interrupted build goes on as it began; checksums of:
corruptions/0003.toml               what is broken on printer 3
bodies/NAME.parquet                 a body (`parquet.py`)
prints/corruption=3/NAME.parquet    its print on printer 3
bodies.jsonl                        a line a body that is whole: source, licence, slicing, points, checksums
failures.jsonl                      a line a body that is not, and why; delete the file to try these again
sliced/                             the G-code of meshes
"""

import hashlib
import json
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

import printmend
from printmend.errors import InputError, MissingToolError, PrintmendError, UnwritableError
from printmend.files import read_text, replacing
from printmend.printer import Printer, check_preset, read_printer
from printmend.twin import Twin
from printmend_lab.body.generated import LICENCE
from printmend_lab.dataset.bodies import digest, known_of
from printmend_lab.dataset.parquet import (
    BODIES,
    FAILURES,
    READ,
    RECIPE,
    SCHEMA,
    body_file,
    corruption_file,
    damaged_bodies,
    digest_of,
    print_file,
    read_lines,
    rewrite_lines,
    write_body,
    write_print,
)
from printmend_lab.executor import Executor, WorkerDied
from printmend_lab.path import Body
from printmend_lab.sampling import Severity, check_family

MAX_CORRUPTIONS = 9999  # their numbers have four digits


@dataclass(frozen=True)
class Recipe:
    """What a data set is made of: everything that decides its bodies' files, but the bodies."""

    corruptions: int
    families: tuple[str, ...]
    severity: Severity
    seed: int
    printer: str = "ender5"
    timeout_s: float = 600.0
    schema: int = SCHEMA


@dataclass(frozen=True)
class Built:
    """The result of a build: bodies that are whole, and (body, reason) for those that are not.

    ``mended`` had been built before and were damaged. ``left`` still are, because nobody named their source files.
    """

    bodies: int
    failures: tuple[tuple[str, str], ...]
    mended: int = 0
    left: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Task:
    root: str
    source: str
    name: str
    identity: str
    licence: str
    recipe: Recipe


def check_recipe(recipe: Recipe) -> None:
    """Raise `InputError` for a printer or a family that is not known, and for too many corruptions or none."""
    check_preset(recipe.printer)
    for family in recipe.families:
        check_family(family)
    if not 1 <= recipe.corruptions <= MAX_CORRUPTIONS:
        raise InputError(
            "--corruptions", wanted=f"1 to {MAX_CORRUPTIONS}", came=f"{recipe.corruptions}", todo="correct it"
        )


def build_dataset(
    root: Path,
    files: Sequence[Path],
    recipe: Recipe,
    executor: Executor,
    *,
    licence: str = "unknown",
    unread: Mapping[Path, str] = MappingProxyType({}),
    tick: Callable[[str], None] = lambda name: None,
) -> Built:
    """Build the missing or damaged parts of a data set in ``root``; files of equal content count once.

    ``licence`` is noted for every body except generated ones and those for which a list beside them states another
    (`dataset.bodies`). A body that cannot be sliced, or whose worker dies, is a failure with its reason, as is each of
    the ``unread`` files, whose reasons are known. Failures are not tried again, unless only a slicer was missing.
    Raises `InputError` if ``root`` holds something else or was begun with another recipe.
    """
    check_recipe(recipe)
    root = Path(root).absolute()  # workers may run elsewhere
    _begin(root, recipe)
    _forget_passing(root / FAILURES)
    damaged = damaged_bodies(root, recipe.corruptions, executor)
    done = {line["identity"] for name in (BODIES, FAILURES) for line in read_lines(root / name)} - damaged.keys()
    tasks: dict[str, _Task] = {}
    for path in files:
        identity, known = digest(path), known_of(path)
        name = f"{re.sub(r'[^A-Za-z0-9._-]', '_', known.name)[:60].lstrip('.')}-{identity[:8]}"
        made = re.match(r"[a-z]+-g\d+-s\d+-\d{5}$", path.stem) is not None
        if identity in done:
            tick(path.stem)
        else:
            said = LICENCE if made else known.licence or licence
            task = _Task(str(root), str(path.absolute()), name, identity, said, recipe)
            tasks.setdefault(identity, task)
    left = tuple(sorted(name for identity, name in damaged.items() if identity not in tasks))
    if again := damaged.keys() & tasks.keys():
        rewrite_lines(root / BODIES, [line for line in read_lines(root / BODIES) if line["identity"] not in again])
    with (root / BODIES).open("a", encoding="utf-8") as good, (root / FAILURES).open("a", encoding="utf-8") as bad:
        for path, why in unread.items():
            if (identity := digest(path) if path.is_file() else path.stem) not in done:
                note = {"identity": identity, "body": path.stem, "source": str(path), "why": why}
                bad.write(json.dumps(note) + "\n")
        for task, outcome in executor.map(_build_body, list(tasks.values())):
            failed = outcome.reason if isinstance(outcome, WorkerDied) else outcome.get("error")
            if failed is None:
                line, file = outcome, good
            else:
                line, file = {"identity": task.identity, "body": task.name, "source": task.source, "why": failed}, bad
                line |= {"passing": True} if isinstance(outcome, dict) and outcome.get("passing") else {}
            file.write(json.dumps(line) + "\n")
            file.flush()
            tick(task.name)
    failures = tuple((line["body"], line["why"]) for line in read_lines(root / FAILURES))
    whole = read_lines(root / BODIES)
    mended = sum(line["identity"] in again for line in whole)
    return Built(len(whole) - len(left), failures, mended, left)


def _forget_passing(path: Path) -> None:
    """Remove failures that say nothing of the body from the list: the slicer was missing."""
    lines = read_lines(path)
    lasting = [line for line in lines if not line.get("passing")]
    if len(lasting) < len(lines):
        rewrite_lines(path, lasting)


def read_recipe(root: Path) -> Recipe:
    """Read what a data set is made of. Raise `InputError` for a folder that holds none, or one of another schema."""
    path = Path(root) / RECIPE
    todo = "build one with `printmend dataset build`"
    text = read_text(path, wanted="the folder of a data set", todo=todo)
    try:
        values = json.loads(text)
        if values["schema"] not in READ:
            raise InputError(path, wanted=f"schema {SCHEMA}", came=f"schema {values['schema']}", todo="build it again")
        return Recipe(**{**values["recipe"], "families": tuple(values["recipe"]["families"])})
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise InputError(path, wanted="the folder of a data set", came=f"{error}", todo=todo) from None


def read_checksums(root: Path) -> dict[str, str]:
    """Return the SHA-256 of each broken printer's description by its name; an older data set has none."""
    recipe, known = read_recipe(root), json.loads((Path(root) / RECIPE).read_text(encoding="utf-8")).get("files", {})
    names = {corruption_file(Path(), number).as_posix() for number in range(recipe.corruptions)}
    if known and (not isinstance(known, dict) or known.keys() != names):
        raise InputError(
            Path(root) / RECIPE, wanted=f"checksums of {len(names)} corruptions", came="others",
            todo="build or fetch the data set again",
        )  # fmt: skip
    return dict(known)


def changed_corruptions(root: Path) -> list[str]:
    """Return the faults of the broken printers' descriptions, in words: missing, or not as written."""
    wrong = []
    for name, known in read_checksums(root).items():
        if not (Path(root) / name).is_file():
            wrong.append(f"{name}: missing")
        elif digest_of(Path(root) / name) != known:
            wrong.append(f"{name}: not the file that was written")
    return wrong


def _begin(root: Path, recipe: Recipe) -> None:
    """Write the recipe and the corruptions, or check that the folder was begun with the same."""
    if (root / RECIPE).exists():
        if (found := read_recipe(root)) != recipe:
            other = next(name for name, value in asdict(recipe).items() if getattr(found, name) != value)
            raise InputError(
                root, wanted=f"{other} {getattr(found, other)}, as the build began", came=f"{getattr(recipe, other)}",
                todo="ask for the same, or name another folder",
            )  # fmt: skip
        if changed_corruptions(root):
            _bring_back(root, recipe)
        if wrong := changed_corruptions(root):
            raise InputError(
                root, wanted="the broken printers it began with", came="; ".join(wrong[:3]),
                todo="bring the file back, or build into another folder",
            )  # fmt: skip
        return
    if root.exists() and (not root.is_dir() or any(root.iterdir())):
        raise InputError(root, wanted="a new or empty folder", came="one that holds something", todo="name another")
    (root / "corruptions").mkdir(parents=True)
    files = {}
    for number in range(recipe.corruptions):
        with replacing(path := corruption_file(root, number)) as file:
            file.write(_drawn(recipe, number))
        files[path.relative_to(root).as_posix()] = digest_of(path)
    with replacing(root / RECIPE) as file:
        about = {"schema": SCHEMA, "recipe": asdict(recipe), "printmend": printmend.__version__, "files": files}
        file.write(json.dumps(about, indent=1) + "\n")


def _drawn(recipe: Recipe, number: int) -> str:
    """Return the description of broken printer ``number``: the seed draws it."""
    from printmend.corruption import corruption_toml
    from printmend_lab.sampling import sample

    family = recipe.families[number % len(recipe.families)]
    return corruption_toml(sample(family, np.random.default_rng([recipe.seed, number]), recipe.severity))


def _bring_back(root: Path, recipe: Recipe) -> None:
    """Write missing or changed descriptions again, if the seed still draws what it drew then."""
    for name, known in read_checksums(root).items():
        path, text = root / name, _drawn(recipe, int(Path(name).stem))
        if hashlib.sha256(text.encode()).hexdigest() == known and (not path.is_file() or digest_of(path) != known):
            path.parent.mkdir(parents=True, exist_ok=True)
            with replacing(path) as file:
                file.write(text)


def _build_body(task: _Task) -> dict[str, Any]:
    """Write one body and its prints; return its line for the list, or ``error``."""
    try:
        return _built(task)
    except (OSError, UnwritableError):
        raise  # a full disk is no fault of the body: the build ends, and goes on when there is room
    except MissingToolError as error:
        return {"error": str(error), "passing": True}
    except PrintmendError as error:
        return {"error": str(error)}
    except Exception as error:  # one body must not end the build
        return {"error": " ".join(f"{type(error).__name__}: {error}".split())}


@lru_cache(maxsize=32)  # the next body is printed on the same machines
def _twin(corruption: str, printer: Printer) -> Twin:
    """Return the machine of a corruption in TOML. The text is the key, because another data set may come into the
    folder."""
    from printmend.corruption import parse_corruption

    return Twin.of(parse_corruption(corruption, subject="a corruption of the data set"), printer)


def _built(task: _Task) -> dict[str, Any]:
    from printmend_lab.body.layers import body_of, is_mesh
    from printmend_lab.body.slicer import slice_to, slicing_of

    recipe, root, source = task.recipe, Path(task.root), Path(task.source)
    if not (root / RECIPE).exists():
        raise InputError(root, wanted="a folder that every worker sees", came="none", todo="put it on a shared disk")
    begun = time.perf_counter()
    printer, sliced = read_printer(recipe.printer), "as given"
    if is_mesh(source):
        from printmend_lab.body.mesh import read_solid

        gcode = slice_to(read_solid(source), printer, root / "sliced", timeout_s=recipe.timeout_s)
        sliced = "PrusaSlicer, profile ender5_abs"
    else:
        gcode = source
    ready = time.perf_counter()
    body = Body(task.name, body_of(str(gcode), printer, name=source.stem).layers)
    about = {
        "body": task.name, "source": source.name, "identity": task.identity, "licence": task.licence,
        "sliced": sliced, "gcode": Path(gcode).name, "slicing": slicing_of(Path(gcode)), "printer": recipe.printer,
    }  # fmt: skip
    files = {f"bodies/{task.name}.parquet": write_body(body_file(root, task.name), body, about)}
    for number in range(recipe.corruptions):
        todo = "build the data set anew"
        broken = read_text(corruption_file(root, number), wanted="a corruption in TOML", todo=todo)
        twin = _twin(broken, printer)
        printed = [twin.run(layer.controls, layer.start_steps) for layer in body.layers]
        what = {**about, "corruption": number, "family": recipe.families[number % len(recipe.families)]}
        place = print_file(root, task.name, number)
        files[place.relative_to(root).as_posix()] = write_print(place, body.layers, printed, what)
    return {
        **about, "layer_count": len(body.layers), "points": body.transitions + len(body.layers), "files": files,
        "slice_s": round(ready - begun, 3), "print_s": round(time.perf_counter() - ready, 3),
    }  # fmt: skip
