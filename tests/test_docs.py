"""What documents and docstrings promise: cited equations and tests exist."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PHYSICS = (ROOT / "docs" / "physics.md").read_text(encoding="utf-8")
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
SOURCES = sorted(
    path for top in ("src", "tests", "benchmarks", "tools", "examples") for path in ROOT.glob(f"{top}/**/*.py")
)
# "physics.md eq. 7", "physics.md §1–4", "physics.md §8 and §8.1"; a line may end anywhere inside.
SECTION = re.compile(r"physics\.md((?:(?:,| and)? §\d+(?:\.\d+)?(?:–\d+)?)+)")
# An equation of somebody else follows its year: "(Solin and Särkkä 2020, eq. 56)".
EQUATION = re.compile(r"(?<!\d\d\d\d, )\beqs?\. (\d+)(?:(?: and |–|, )(\d+)\b)?")


def running_text(path: Path) -> str:
    """Return a file's text without line ends, comment signs and indentation, so that a citation is in one piece."""
    return re.sub(r"\s+(?:#\s+)?", " ", path.read_text(encoding="utf-8"))


def cited(text: str) -> set[str]:
    """Return what a text cites of physics.md: "§3", "§8.1", "eq. 7"; "§?" for a range that runs backwards."""
    found = set()
    for places in SECTION.findall(text):
        for first, last in re.findall(r"§(\d+(?:\.\d+)?)(?:–(\d+))?", places):
            span = range(int(first), int(last) + 1) if last else ()
            found |= {f"§{n}" for n in span} if last else {f"§{first}"}
            found |= {"§?"} if last and not span else set()
    for numbers in EQUATION.findall(text):
        found |= {f"eq. {n}" for n in numbers if n}
    return found


def offered() -> set[str]:
    """Return the sections and equations of physics.md; an equation is a bold number with an anchor of its own."""
    sections = {f"§{n}" for n in re.findall(r"^###? (\d+(?:\.\d+)?)\.? ", PHYSICS, re.MULTILINE)}
    equations = re.findall(r'^<a id="eq-(\d+)"></a>\*\*\((\d+)\)\*\* ', PHYSICS, re.MULTILINE)
    assert [a for a, _ in equations] == [b for _, b in equations] == [str(1 + n) for n in range(len(equations))]
    return sections | {f"eq. {n}" for n, _ in equations}


def test_every_cited_equation_is_in_physics_md() -> None:
    there, count = offered(), 0
    for path in [*SOURCES, *PAGES]:
        if path == Path(__file__):
            continue  # its examples are wrong on purpose
        here = cited(running_text(path))
        count += len(here)
        assert here <= there, f"{path.relative_to(ROOT)} cites {sorted(here - there)}, which docs/physics.md has not"
    assert count > 60, "the citations were not recognised"


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("(physics.md eq. 7)", {"eq. 7"}),
        ("Equations: physics.md §1–3.", {"§1", "§2", "§3"}),
        ("are those of physics.md §8 and §8.1; a", {"§8", "§8.1"}),
        ("(physics.md §3, eq. 13)", {"§3", "eq. 13"}),
        ("physics.md §4–2", {"§?"}),
    ],
)
def test_citations_are_recognised(text: str, found: set[str]) -> None:
    assert cited(text) == found


def test_every_test_that_a_document_names_is_there() -> None:
    named = {
        (path, name)
        for page in PAGES
        for path, name in re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", page.read_text())
    }
    assert len(named) > 5
    for path, name in sorted(named):
        text = (ROOT / path).read_text(encoding="utf-8")
        assert not name or f"def {name}(" in text, f"{path} has no test {name}"


def test_every_equation_has_a_row_with_its_test() -> None:
    rows = re.findall(r"^\| ([\d, ]+)[^|]*\| `tests/", PHYSICS, re.MULTILINE)
    tested = {f"eq. {number}" for row in rows for number in re.findall(r"\d+", row)}
    assert tested == {each for each in offered() if each.startswith("eq.")}


@pytest.mark.parametrize("package", ["src/printmend", "lab/src/printmend_lab"])
def test_the_overview_says_what_every_package_knows(package: str) -> None:
    rows = re.findall(r"^\| (`.*?) \|", (ROOT / "docs/code_overview.md").read_text(encoding="utf-8"), re.MULTILINE)
    named = {name.rstrip("/") for row in rows for name in re.findall(r"`([\w/]+)`", row)}
    own = {path.parent.name if path.stem == "__init__" else path.stem for path in ROOT.glob(f"{package}/*/__init__.py")}
    own |= {path.stem for path in ROOT.glob(f"{package}/*.py")} - {"__init__", "__main__"}
    assert len(own) > 15
    assert own <= named, f"docs/code_overview.md says nothing of {sorted(own - named)}"


def test_every_file_that_a_document_names_is_there() -> None:
    """A path within the project that stands in backticks; a star stands for any name."""
    inside = re.compile(r"`((?:src|tests|docs|benchmarks|tools|examples|integrations)/[\w./*-]*\w/?)`")
    named = {(page, path) for page in PAGES for path in inside.findall(page.read_text(encoding="utf-8"))}
    assert len(named) > 20
    for page, path in sorted(named):
        assert any(ROOT.glob(path.rstrip("/"))), f"{page.relative_to(ROOT)} names {path}, which is not there"


def test_every_figure_of_the_readme_is_in_the_results() -> None:
    """Errors in mm, which have three decimals or more, and how many prints stayed within their ranges."""
    results = (ROOT / "docs/results.md").read_text(encoding="utf-8")
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    how_exact = readme.split("## How exact")[1].split("\n## ")[0]
    rows = re.findall(r"^\|.*", how_exact, re.MULTILINE)
    figures = {figure for row in rows for figure in re.findall(r"\d+\.\d{3,}", row.split("`")[0])}
    figures |= set(re.findall(r"Of (\d+) simulated prints, (\d+) stayed", how_exact)[0])
    assert len(figures) > 7
    assert not {figure for figure in figures if figure not in results}
