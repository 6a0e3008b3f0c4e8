"""Every command and code block in README and docs runs, on a twin where a printer is needed.

Commands of an owner's or farm's way run in one shared folder, which holds what a printer and a scanner would have made:
a small probe, its scans, a part, a tower's table. Commands that take minutes (bench, demo, the benchmarks) are not run:
their subcommands, options, choices and files are looked up.
"""

import csv
import itertools
import re
import shlex
import shutil
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner

from printmend.cli.main import group
from printmend.corruption import Corruption, Drive
from printmend.corruption.frame import CrookedFrame
from printmend.corruption.toml import corruption_toml, parse_corruption
from printmend.demo.contour import demo_body_gcode
from printmend.infer.distances import choose_distances
from printmend.measure.image import write_image
from printmend.measure.measurement import measure_scans
from printmend.measure.table import write_trace
from printmend.printer import read_printer
from printmend.printer.printer import SWITCHES
from printmend.probe import PHASE_MARKS, design_probe, phase_size_mm, write_probe
from printmend.twin import Twin
from printmend.twin.scanner import CLEAN, render_scan
from tests.test_docs import PAGES, ROOT
from tests.test_learn_space import DRIVES, SCREW, measured, tower
from tests.test_printer_convert import KLIPPER

RUN = {"probe", "twin", "measure", "learn", "check", "mend", "verify", "export", "diagnose", "printer", "body"}
LANGUAGES = {"sh", "python", "toml", "text"}
TRUSTED = {"docker", "pip", "pipx", "pre-commit", "source"}  # programs of others, and the shell


@dataclass(frozen=True)
class Block:
    """Lines of a page in ``language``; what stands indented is a command, if it begins like one, or text."""

    page: Path
    line: int
    language: str
    text: str

    def __str__(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def blocks(page: Path) -> Iterator[Block]:
    """Yield a page's fenced blocks, and its indented lines one by one."""
    lines = page.read_text(encoding="utf-8").splitlines()
    fence: int | None = None
    for number, line in enumerate(lines):
        if line.lstrip().startswith("```"):
            if fence is not None:
                yield Block(page, fence + 1, lines[fence].strip(" `"), "\n".join(lines[fence + 1 : number]))
            fence = number if fence is None else None
        elif fence is None and line.startswith("    "):
            yield Block(page, number + 1, "sh" if words(line) and is_command(words(line)) else "text", line.strip())
    assert fence is None, f"{page}: a block is left open"


def words(line: str) -> list[str]:
    """Return a command line's words, without its comment; none where it is not one."""
    try:
        return shlex.split(line, comments=True)
    except ValueError:
        return []


def is_command(line: list[str]) -> bool:
    return Path(line[0]).name in {"printmend", "make", "python", "python3", *TRUSTED}


def commands(block: Block) -> list[list[str]]:
    return [found for line in block.text.replace("\\\n", " ").splitlines() if (found := words(line))]


def inline(page: Path) -> Iterator[list[str]]:
    """Yield the commands within a page's sentences; they may leave out what the sentence says."""
    prose = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    for text in re.findall(r"`([^`]+)`", prose):
        found = words(" ".join(text.split()))
        if len(found) > 1 and Path(found[0]).name == "printmend" and found[1] in group.list_commands(None):  # type: ignore[attr-defined]
            yield found


ALL = [block for page in PAGES for block in blocks(page)]


@pytest.fixture(scope="module")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the documents' commands read."""
    here = tmp_path_factory.mktemp("workshop")
    drives = (DRIVES[0], Drive())
    printer, fault = read_printer("ender3"), Corruption(drives, CrookedFrame(skew_deg=0.5))  # a firmware can hold skew
    plan = design_probe(printer, size_mm=50, marks=100)
    for name in ("probe", "e3-07.probe"):
        write_probe(here / f"{name}.gcode", plan)
    printed = Twin.of(fault, printer).follow(plan.waypoints_mm)[plan.rows]
    for name, turns in (("scan", 0), ("scan-turned", 1), ("scan-1", 0), ("scan-2", 1)):  # two sheets: two turns serve
        drawn = render_scan(
            printed, plan, dpi=200, degradations=CLEAN, rng=np.random.default_rng(turns), quarter_turns=turns
        )
        write_image(here / f"{name}.png", drawn.image, dpi=200)
    phase = design_probe(printer, size_mm=phase_size_mm(printer), marks=PHASE_MARKS)
    write_probe(here / "phase.gcode", phase)
    moved = Twin.of(fault, printer).follow(phase.waypoints_mm)[phase.rows]
    seen = render_scan(moved, phase, dpi=200, degradations=CLEAN, rng=np.random.default_rng(3))
    write_image(here / "phase.png", seen.image, dpi=200)
    across_mm = choose_distances(plan).across_mm
    (here / "distances.txt").write_text("".join(f"{at};{mm:.2f}\n" for at, mm in enumerate(across_mm, start=1)))
    write_trace(here / "part.csv", measure_scans([here / "scan.png"], plan).trace)
    write_trace(here / "trace2.csv", measure_scans([here / "scan-turned.png"], plan).trace)
    write_trace(here / "tower.csv", measured(SCREW, tower(), frame=fault.frame, drives=drives))
    (here / "broken.toml").write_text(corruption_toml(fault))
    (here / "printer.cfg").write_text(KLIPPER)
    square = [f"G1 X{x} Y{y} E1 F1800" for x, y in ((130, 100), (130, 130), (100, 130), (100, 100))]
    (here / "part.gcode").write_text("\n".join(["G21", "G90", "M83", "G28", "G1 Z0.2 F600", "G0 X100 Y100", *square]))
    return here


def test_blocks_say_their_language() -> None:
    for block in ALL:
        assert block.language in LANGUAGES, f"{block}: one of {sorted(LANGUAGES)}, not {block.language!r}"
    assert sum(block.language == "sh" for block in ALL) > 40


def test_an_owners_commands_run(workshop: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the order of the pages. A probe would replace the small one that was scanned: elsewhere.

    Of commands with the same options that name other files to read, the first runs.
    """
    aside = workshop / "aside"
    aside.mkdir()
    done: list[list[str]] = []
    kinds: set[tuple[str, ...]] = set()
    for page in (page for page in PAGES if page.name not in {"CHANGELOG.md", "results.md"}):
        written = [line for block in blocks(page) if block.language == "sh" for line in commands(block)]
        for line in [*written, *(found for found in inline(page) if complete(found))]:
            if Path(line[0]).name != "printmend" or line[1] not in RUN or line in done:
                continue
            if (kind := kind_of(line)) in kinds:
                continue
            kinds.add(kind)
            if "--gcode" in line:  # a part of its own, which test_measure_part.py prints and scans
                continue
            done.append(line)
            if line[1] == "probe":
                for plan in aside.glob("*.json"):  # each owner has a folder of their own: no plan is in the way
                    plan.unlink()
                for path in [*workshop.glob("*.toml"), *workshop.glob("part.gcode"), *workshop.glob("*.csv")]:
                    shutil.copy(path, aside)
            if line[1] == "mend" and "-o" not in line:  # nor what the page before has mended
                (workshop / "part.mended.gcode").unlink(missing_ok=True)
            monkeypatch.chdir(aside if line[1] == "probe" else workshop)
            line, target = (line[: line.index(">")], line[-1]) if ">" in line else (line, None)
            ran = CliRunner().invoke(group, line[1:], catch_exceptions=True)
            told = f"{page.name}: {shlex.join(line)}\n{ran.output}\n{ran.exception!r}"
            assert ran.exit_code == 0, told
            if target is not None:
                Path(target).write_text(ran.stdout)
    assert {line[1] for line in done} >= RUN - {"body"}
    assert (workshop / "part.mended.gcode").stat().st_size > 100


def kind_of(line: list[str]) -> tuple[str, ...]:
    """Return what a command does: its words, but of the files that it reads only which kinds they are."""
    written = line[line.index("-o") + 1] if "-o" in line else ""
    kinds = (word if word == written else re.sub(r"^[^-].*(\.\w+)$", r"\1", word) for word in line)
    if line[1] == "verify":  # as long with two scans as with one: the scans of `measure` are one and two
        return tuple(word for word, _ in itertools.groupby(kinds))
    return tuple(kinds)


@pytest.mark.usefixtures("all_rounds")
def test_the_owners_example_prints_what_its_page_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every command of one printer's way, from probe to verify; each line of the page is among what they print."""
    page = (ROOT / "docs/owners.md").read_text(encoding="utf-8")
    way = page.split("## One printer, from probe to verify")[1].split("\n## ")[0]
    monkeypatch.chdir(tmp_path)
    Path("broken.toml").write_text(re.findall("```toml\n(.*?)```", way, re.DOTALL)[0])
    Path("part.gcode").write_bytes(demo_body_gcode())
    said = ""
    for line in re.findall("```sh\n(.*?)```", way, re.DOTALL)[0].splitlines():
        ran = CliRunner().invoke(group, shlex.split(line)[1:])
        assert ran.exit_code == 0, f"{line}\n{ran.output}"
        said += ran.output
    number = re.compile(r"\d+(?:\.\d+)?")
    printed = " ".join(said.split())
    quotes = [" ".join(quote.split()) for quote in re.findall(r"(?:^    .*\n)+", way, re.MULTILINE)]
    assert len(quotes) == 3
    for quote in quotes:  # the same words, and numbers that another processor's rounding may have moved a little
        found = re.search(number.pattern.join(map(re.escape, number.split(quote))), printed)
        assert found is not None, f"{quote}\nis not in\n{said}"
        wanted, came = ([float(one) for one in number.findall(text)] for text in (quote, found[0]))
        assert came == pytest.approx(wanted, rel=0.1, abs=0.002), f"{found[0]}\nis not\n{quote}"


def options(command: click.Command, rest: list[str]) -> dict[str, object]:
    """Return what the words after a command set; an option that ends a sentence's command may lack its value."""
    parser = command.make_parser(click.Context(command))
    lacks_value = [one for one in command.params if rest and rest[-1] in one.opts and not getattr(one, "is_flag", True)]
    return parser.parse_args([*rest, "…"] if lacks_value else rest)[0]


def complete(line: list[str]) -> bool:
    """Whether a command within a sentence has every argument that it needs, and is more than a name."""
    if line[1] == "learn" and not any(word.endswith(".csv") or word == "--travel" for word in line):
        return False  # its table may be left out, but then a rule says something
    command = group.get_command(None, line[1])  # type: ignore[attr-defined]
    values = options(command, line[2:])
    missing = [one for one in command.params if one.required and not isinstance(values.get(one.name), str | list)]
    return len(line) > 2 and not missing and "…" not in values.values()


def test_every_other_command_can_be_parsed() -> None:
    for page in PAGES:
        for block in blocks(page):
            for line in commands(block) if block.language == "sh" else ():
                look_up(line, str(block))
        for line in inline(page):
            look_up(line, page.name)


def test_kept_results_name_commands_that_are_there() -> None:
    """Each file of figures says how it was made; the outside judges' own printers cannot be had here."""
    files = sorted((ROOT / "benchmarks" / "results").glob("*.csv"))
    assert len(files) > 30
    for path in files:
        head, columns, *rows = re.split(r"\n(?!#)", path.read_text(encoding="utf-8").strip())
        made = re.findall(r"^# command: (.*)$", head, re.MULTILINE)
        assert made or path.stem == "outside_judges", f"{path.name} does not say which command made it"
        assert re.search(r"^# commit: [0-9a-f]{7}", head, re.MULTILINE), path.name
        assert rows, path.name
        assert all(len(row) == len(columns.split(",")) for row in csv.reader(rows)), path.name
        for line in made:
            look_up(words(line), path.name)


def look_up(line: list[str], where: str) -> None:
    """Check that a command, its options and the files that are its program are there."""
    program, rest = Path(line[0]).name, line[1:]
    told = f"{where}: {shlex.join(line)}"
    if program == "make":
        assert all(f"\n{target}:" in (ROOT / "Makefile").read_text() for target in rest if "=" not in target), told
    elif program.startswith("python") and rest[0] == "-m":
        assert all((ROOT / word).is_file() for word in rest if word.startswith("tests/")), told
    elif program.startswith("python"):
        script = (ROOT / rest[0]).read_text(encoding="utf-8")
        beside = {path.stem: path for path in (ROOT / rest[0]).parent.glob("*.py")}  # options may be shared
        shared = re.findall(r"^from (\w+) import", script, re.MULTILINE)
        script += "".join(beside[name].read_text(encoding="utf-8") for name in shared if name in beside)
        for option in (word.split("=")[0] for word in rest if word.startswith("--")):  # or a keyword of the runner's
            assert f'"{option}"' in script or f"{option[2:].replace('-', '_')}=" in script, told
    elif program == "printmend":
        command: click.Command = group
        while isinstance(command, click.Group):
            if not rest or rest[0].startswith("-"):
                break
            names, rest, group_ = rest[0].split("|"), rest[1:], command  # "dataset build|info"
            for name in names:
                found = group_.get_command(click.Context(group_), name)
                assert found is not None, f"{told}: no command {name!r}"
                command = found
        values = options(command, rest[: rest.index(">")] if ">" in rest else rest)
        for parameter in command.params:
            given = values.get(parameter.name)
            if isinstance(parameter.type, click.Choice) and isinstance(given, str):
                for one in given.split("|"):  # "--design layer|optimal"
                    parameter.type.convert(one, parameter, None)
    else:
        assert program in TRUSTED, told


def test_a_wrong_command_is_seen() -> None:
    for wrong in (
        "printmend mend --upside-down",
        "printmend bench table2",
        "python benchmarks/bench_mend.py --nonsense",
    ):
        with pytest.raises((click.ClickException, AssertionError)):
            look_up(wrong.split(), "here")


OWN_RUN = {"adding_an_effect.md"}  # run by tests/test_own_effect.py


@pytest.mark.parametrize(
    "page",
    [page for page in PAGES if "```python" in page.read_text() and page.name not in OWN_RUN],
    ids=lambda page: page.name,
)
def test_python_in_documents_runs(page: Path, workshop: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The blocks of a page are one program, run in the folder of an owner."""
    monkeypatch.chdir(workshop)
    names: dict[str, object] = {"__name__": page.stem}
    for block in blocks(page):
        if block.language == "python":
            exec(compile("\n" * block.line + block.text, str(page), "exec"), names)  # noqa: S102 — our own documents
    assert len(names) > 2


def test_corruptions_in_documents_are_read() -> None:
    found = [block for block in ALL if block.language == "toml"]
    for block in found:
        if "[homing]" in block.text:  # a section of a printer's file
            switch = tomllib.loads(block.text)["homing"]["switch"]
            assert switch in SWITCHES, block
            continue
        assert parse_corruption(block.text, subject=str(block)) != Corruption()
    assert found
