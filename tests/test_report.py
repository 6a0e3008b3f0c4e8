"""The technical report: no figure stands in its text, and what its words claim is in the results."""

import importlib.util
import re
import shutil
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

from printmend.errors import InputError
from tests.test_prose import faults, sentences

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "report"
TEXT = (FOLDER / "report.typ").read_text(encoding="utf-8")
NUMBERS = r"\b(?:eleven|twelve|thir|four|fif|six|seven|eigh|nine)(?:teen|ty)?(?:th)?\b|\b\w+teen\b|\bhundred|\bthousand"


@pytest.fixture(scope="module")
def report() -> ModuleType:
    spec = importlib.util.spec_from_file_location("report", ROOT / "tools" / "report.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def found(report: ModuleType) -> dict:
    return report.figures()


def prose() -> str:
    """The text as it is read: figures, code, formulas and references taken out."""
    text = re.sub(r"//[^\n]*", "", TEXT)
    text = text[text.index("*Abstract.*") :]
    text = text[: text.index("#for one in data.sources")]
    text = re.sub(r'#n\("[^"]+"\)', "FIGURE", text)
    text = re.sub(r'image\("[^"]+", width: \d+%\)', "", text)
    text = re.sub(r"\b(?:TableI|Families|Measured)-v1\b", "SUITE", text)
    return re.sub(r"\$[^$]*\$|`[^`]*`|@\w+|<\w+>", "X", text)


def test_no_figure_stands_in_the_text() -> None:
    assert re.findall(r"[^\n]*\d[^\n]*", prose()) == []
    allowed = {"six damaged printers": "", "nine prints of ten": ""}  # what was tried, and what a range is
    plain = " ".join(prose().split())
    for words in allowed:
        assert words in plain
        plain = plain.replace(words, "")
    assert re.findall(NUMBERS, plain) == []
    for formula in re.findall(r"\$([^$]*)\$", TEXT):
        assert not re.search(r"[.\d]\d", formula)


def test_every_figure_has_a_name_and_every_name_a_figure(found: dict) -> None:
    spec = tomllib.loads((FOLDER / "figures.toml").read_text(encoding="utf-8"))
    assert set(re.findall(r'#n\("([^"]+)"\)', TEXT)) == set(spec["figure"]) == set(found["figures"])
    assert set(re.findall(r'\brows\(\s*"(\w+)"', TEXT)) == set(spec["table"]) == set(found["tables"])
    cited = set(re.findall(r"@(\w+)", TEXT)) - set(re.findall(r"<(\w+)>", TEXT))
    assert cited == set(re.findall(r"^(\w+):", (FOLDER / "sources.yml").read_text(encoding="utf-8"), re.MULTILINE))


def test_a_result_that_changes_changes_the_report(report: ModuleType, found: dict, tmp_path: Path) -> None:
    for source in found["sources"]:
        (tmp_path / source["file"]).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / source["file"], tmp_path / source["file"])
    (tmp_path / "docs" / "report").mkdir(parents=True)
    shutil.copy(FOLDER / "figures.toml", tmp_path / "docs" / "report")
    assert report.figures(tmp_path) == found
    file = tmp_path / "benchmarks" / "results" / "outside.csv"
    file.write_text(file.read_text().replace("healthy,0.05,0.0036,0.0036", "healthy,0.05,0.0036,0.0777"))
    assert report.figures(tmp_path)["figures"]["outside.most"] == "0.0777"
    file.write_text(file.read_text().replace("healthy,0.05", "well,0.05"))
    with pytest.raises(InputError, match="a row for outside"):
        report.figures(tmp_path)


def test_the_words_are_those_of_the_figures(report: ModuleType, found: dict) -> None:
    """Where a sentence compares, the results say the same; else the sentence must be written again."""
    figure = {name: float(value) for name, value in found["figures"].items()}
    tables = {
        name: {row[0]: [float(cell) for cell in row[1:]] for row in rows} for name, rows in found["tables"].items()
    }
    # "level with a Gaussian process", "where a traverse is cut matters about as much"
    assert abs(figure["measured.greybox"] / figure["measured.process"] - 1) < 0.03
    # "comes closest. Where the fewest points were measured it is ahead of the grey box, and the search … of both"
    peers = {name: row for name, row in tables["peers"].items() if "ours" not in name}
    near, ours = peers["Gaussian process"], tables["peers"]["grey box (ours)"]
    assert all(min(row[k] for row in peers.values()) == near[k] for k in range(3))
    assert tables["peers"]["printmend (ours)"][0] < near[0] < ours[0]
    assert all(mine <= other for mine, other in zip(ours[1:], near[1:], strict=True))
    # "on two shapes of three a plain least-squares fit comes closer"
    for raw, _copy, plain, mine, floor in tables["captures"].values():
        assert floor < min(plain, mine) < max(plain, mine) < raw
    assert sum(plain < mine for _raw, _copy, plain, mine, _floor in tables["captures"].values()) == 2
    # "pulleys with play are stated too narrowly"
    assert tables["calibration"]["pulley with play"][0] * 100 < figure["calibration.normal"]
    # "ahead of the grey box where a fault belongs to no family and few points were measured"
    few = [row for row in report.read(ROOT / "benchmarks" / "results" / "meta.csv") if row["points"] in ("30", "60")]
    free = [row for row in few if row["kind"] == "taught, no family" and row["print"] == "zigzag"]
    assert all(float(row["meta_mm"]) < float(row["grey_box_mm"]) for row in free)
    # "deadlocks": worse than no model; "the grey box notices it"
    assert figure["loose.oracle"] > figure["loose.naive"] > figure["loose.greybox"]
    assert figure["gain.hybrid"] < figure["gain.greybox"]
    assert figure["promise.unmodelled"] > 1.2 > figure["promise.modelled"]


def test_its_sentences_are_short_and_plain() -> None:
    text = re.sub(r"#figure\((?:[^()]|\((?:[^()]|\([^()]*\))*\))*\)|#n\([^)]*\)", "FIGURE", prose())
    text = re.sub(r"^(=+|-) ?", "\n", text, flags=re.MULTILINE)
    bad = [f"{', '.join(told)}: {one}" for one in sentences(text) if (told := faults(one))]
    assert not bad, "\n".join(bad)


def test_it_becomes_a_pdf(tmp_path: Path, report: ModuleType, found: dict) -> None:
    typst = pytest.importorskip("typst", reason="typst makes the report; `make report` needs it")
    shutil.copytree(ROOT / "docs" / "figures", tmp_path / "figures")
    shutil.copytree(FOLDER, tmp_path / "report")
    (tmp_path / "report" / "figures.json").write_text(report.json.dumps(found))
    pdf = typst.compile(tmp_path / "report" / "report.typ", root=tmp_path)
    assert pdf.startswith(b"%PDF")
