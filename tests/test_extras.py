"""An installation without extras does its job, and says which extra is missing where one is."""

import json
import re
import shlex
import subprocess
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, packages_distributions
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from printmend.cli import main
from printmend.cli.main import group
from printmend.errors import MissingToolError
from printmend.extras import _EXTRAS, _LAB, _source, install_command, lab_command
from printmend.native import NAME
from printmend_lab.commands import COMMANDS

# Three layers of a square: the demonstration's own body takes seconds.
SQUARES = b"G21\nG90\nM83\nG28\n" + b"".join(
    b"G1 Z%.1f F600\nG1 X90 Y90\nG1 X130 Y90 E2 F1800\nG1 X130 Y130 E2\nG1 X90 Y130 E2\nG1 X90 Y90 E2\n" % height
    for height in (0.2, 0.4, 0.6)
)

BASE = """
import sys
sys.modules.update(dict.fromkeys({names}))  # what is None cannot be imported
import printmend
for name in set(printmend.__all__) - {{"measure_scans"}}:
    getattr(printmend, name)
import printmend.export.firmware, printmend.measure.callipers, printmend_lab.prior.prior, printmend.mend.update
import printmend_lab.hybrid.residual, printmend.probe.part_layer, printmend.learn.order
import printmend.cli.main as cli
try:
    printmend.measure_scans
except printmend.PrintmendError as error:
    print(error)
sys.argv = ["printmend", "probe", "--sheet", "sheet.pdf"]
cli.main()
"""


def locked(name: str) -> dict[str, set[str]]:
    """Return the pinned requirements of a lock file, each with its hashes."""
    text = (Path(__file__).parents[1] / name).read_text()
    return {block.split(" \\")[0]: set(re.findall(r"sha256:\w+", block)) for block in re.split(r"\n(?=\w)", text)}


def test_what_make_demo_installs_is_a_part_of_the_lock_and_has_all_that_it_needs() -> None:
    whole, owner, core = locked("requirements.lock"), locked("owner.lock"), locked("core.lock")
    assert all(hashes and hashes == whole[pinned] for pinned, hashes in owner.items())
    assert all(hashes == owner[pinned] for pinned, hashes in core.items())
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    wanted = [item for extra in ("compile", "scan", "report", "trees", "studio") for item in extras[extra]]
    for items, lock in (
        ([*project["dependencies"], *extras["compile"]], core),
        ([*project["dependencies"], *wanted], owner),
    ):
        names = {re.split(r"[>\[]", item)[0] for item in items} - {"printmend"}
        pinned = {one.split("==")[0] for one in lock}
        assert {name.replace("_", "-") for name in names} | {"editables", "hatchling"} <= pinned


def test_every_module_is_in_the_extra_that_is_named() -> None:
    projects = [
        tomllib.loads((Path(__file__).parents[1] / place / "pyproject.toml").read_text())["project"]
        for place in ("", "lab")
    ]
    extras = {
        extra: {re.split(r"[>\[]", item)[0] for item in items}
        for project in projects
        for extra, items in project["optional-dependencies"].items()
    }
    assert projects[1]["optional-dependencies"].keys() & set(_EXTRAS.values()) == _LAB
    homes = packages_distributions()
    for module, extra in _EXTRAS.items():
        # a distribution that is one compiled file does not say which module it brings
        assert {home.lower() for home in homes.get(module, [module])} & extras[extra], module
    assert "printmend" in extras["all"]
    base = {re.split(r"[>\[]", item)[0] for item in projects[0]["dependencies"]}
    assert not base & set().union(*(extras[extra] for extra in _EXTRAS.values())) - {"printmend", "printmend-lab"}


def installs(*wanted: str) -> str:
    """Return the command that installs packages with their extras from the copies that pip got them from."""
    named = [re.sub(r"^[\w-]+", lambda name: _source(name[0]), each) for each in wanted]
    return shlex.join([sys.executable, "-m", "pip", "install", *named])


@pytest.mark.parametrize(
    ("came", "ours", "labs"),
    [
        (None, "printmend", "printmend-lab"),
        ("https://files.example/printmend.whl", "printmend", "printmend-lab"),
        ("file:///nowhere/printmend", "printmend", "printmend-lab"),
        ("file://{copy}", "{copy}", "{copy}/lab"),
        ("file://{copy}/printmend.whl", "{copy}/printmend.whl", "printmend-lab"),
    ],
)
def test_the_command_installs_from_where_printmend_came_from(
    came: str | None, ours: str, labs: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While no package index has it, its name would be of no use."""
    (copy := tmp_path / "a copy" / "lab").mkdir(parents=True)
    copy = copy.parent
    (copy / "printmend.whl").touch()
    url = None if came is None else came.format(copy=str(copy).replace(" ", "%20"))

    def installed(name: str) -> SimpleNamespace:
        if name == "printmend-lab":
            raise PackageNotFoundError(name)
        return SimpleNamespace(read_text=lambda file: None if url is None else json.dumps({"url": url}))

    monkeypatch.setattr("printmend.extras.distribution", installed)
    pip = [sys.executable, "-m", "pip", "install"]
    assert shlex.split(install_command(["cv2"])) == [*pip, f"{ours.format(copy=copy)}[scan]"]
    assert shlex.split(lab_command()) == [*pip, labs.format(copy=copy)]


def test_without_extras_all_but_scans_is_there_and_those_name_theirs(tmp_path: Path) -> None:
    done = subprocess.run(  # noqa: S603 - our own
        [sys.executable, "-c", BASE.format(names=sorted(_EXTRAS))], capture_output=True, text=True, cwd=tmp_path
    )
    said = f"expected the extra 'scan' of printmend, found that it is not installed; {installs('printmend[scan]')}"
    assert done.stdout.splitlines() == [f"cv2: {said}"], done.stderr
    todo = f"cv2, PIL, scipy, found that they are not installed; {installs('printmend[scan]')}"
    assert done.stderr.splitlines() == [f"printmend: printmend probe --sheet: expected {todo}"]
    assert done.returncode == 2


@pytest.mark.parametrize(
    ("line", "extras"),
    [
        ("demo --part", "report,scan"),
        ("demo --scan", "report,scan"),
        ("studio", "report,scan,studio"),
        ("studio --cluster local:1", "cluster,report,scan,studio"),
        ("measure scan.png --probe probe.json", "scan"),
        ("measure scan.png --gcode part.gcode --printer ender3", "scan"),
        ("probe --printer ender3 --sheet sheet.pdf", "scan"),
        ("twin probe.gcode --printer ender3 --corruption broken.toml --scan scan.png", "scan"),
        ("verify scan.png -m here.mend.json --probe probe.json", "scan"),
        ("diagnose trace.csv --printer ender3", "report"),
        ("diagnose trace.csv --printer ender3 --report report.pdf", "report"),
        ("mend part.gcode -m here.mend.json --report report.html", "report"),
        ("history here.mend.json --picture wear.png", "report"),
        ("selfrepair -o out", "report"),
        ("curiosity -o out", "report"),
        ("bench table1 --bodies generated:2", "report,trees+paper"),
        ("bench table1 --bodies generated:2 --models greybox", "report"),
        ("bench families --rows lightgbm+greedy", "trees"),
        ("figures --dataset data -o out", "report,scan,trees+dataset,paper"),
        ("dataset build --bodies models -o out", "report+dataset,paper"),
        ("dataset export-reference out --bodies models", "scan"),
        ("donate --scan scan.png", "scan"),
    ],
)
def test_a_command_says_at_once_and_in_one_command_all_that_it_needs(
    line: str, extras: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "here.mend.json").touch()
    monkeypatch.setattr("printmend.extras.find_spec", lambda module: None)
    with pytest.raises(MissingToolError) as said:
        group.main(line.split(), standalone_mode=False)
    ours, _, labs = extras.partition("+")
    assert said.value.todo == installs(f"printmend[{ours}]", *([f"printmend-lab[{labs}]"] if labs else []))
    assert [path.name for path in tmp_path.iterdir()] == ["here.mend.json"]


def test_the_demonstrations_need_no_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if not (Path(main.__file__).parents[1] / "compiled" / f"{NAME}.json").is_file():
        pytest.skip("no library here, so numba is needed: `make kernels` makes it")
    monkeypatch.setattr("printmend.extras.find_spec", lambda module: None)
    monkeypatch.setattr("printmend_lab.body.demo_body_gcode", lambda: SQUARES)
    done = CliRunner().invoke(group, ["paper", "--json", "-o", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert f"the paper's learner and the pictures; {installs('printmend[report,trees]')}" in done.stderr
    said = json.loads(done.stdout)
    assert [row["row"] for row in said["rows"]] == ["naive", "greybox", "oracle"]
    assert [path.name for path in tmp_path.iterdir()] == ["corruption.toml"]


@pytest.fixture
def without_lab(monkeypatch: pytest.MonkeyPatch):
    """Let no other package add commands."""
    with monkeypatch.context() as patched:
        patched.setattr("importlib.metadata.entry_points", lambda group: [])
        main.packages.cache_clear()
        main.homes.cache_clear()
        yield
    main.packages.cache_clear()
    main.homes.cache_clear()


def test_a_command_of_the_lab_says_where_it_is(without_lab) -> None:
    for name in main.LAB:
        with pytest.raises(MissingToolError) as said:
            group.main([name, "--help"], standalone_mode=False)
        assert said.value.todo == installs("printmend-lab")
    told = CliRunner().invoke(group, ["--help"]).output
    assert "".join(installs("printmend-lab").split()) in "".join(told.split())
    assert "Table I" not in told


def test_the_lab_has_the_commands_that_printmend_names() -> None:
    assert set(main.LAB) == {name for commands in COMMANDS.values() for name in commands}
    told = CliRunner().invoke(group, ["--help"]).output
    assert "Table I" in told
    assert "pip install" not in told
