"""An installation without extras does its job, and says which extra is missing where one is."""

import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

from printmend.extras import _EXTRAS

BASE = """
import sys
sys.modules.update(dict.fromkeys({names}))  # what is None cannot be imported
import printmend
for name in set(printmend.__all__) - {{"measure_scans"}}:
    getattr(printmend, name)
import printmend.export.firmware, printmend.learn.callipers, printmend.learn.prior.prior, printmend.repair.update
import printmend.learn.hybrid.residual, printmend.learn.meta, printmend.probe.part_layer, printmend.promise.misfit_rows
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
    wanted = [item for extra in ("scan", "report", "trees", "studio") for item in extras[extra]]
    for items, lock in (project["dependencies"], core), ([*project["dependencies"], *wanted], owner):
        names = {re.split(r"[>\[]", item)[0] for item in items} - {"printmend"}
        pinned = {one.split("==")[0] for one in lock}
        assert {name.replace("_", "-") for name in names} | {"editables", "hatchling"} <= pinned


def test_every_module_is_in_the_extra_that_is_named() -> None:
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
    extras = {
        extra: {re.split(r"[>\[]", item)[0] for item in items}
        for extra, items in project["optional-dependencies"].items()
    }
    homes = packages_distributions()
    for module, extra in _EXTRAS.items():
        # a distribution that is one compiled file does not say which module it brings
        assert {home.lower() for home in homes.get(module, [module])} & extras[extra], module
    assert "printmend" in extras["all"]
    base = {re.split(r"[>\[]", item)[0] for item in project["dependencies"]}
    assert not base & set().union(*(extras[extra] for extra in _EXTRAS.values()))


def test_without_extras_all_but_scans_is_there_and_those_name_theirs(tmp_path: Path) -> None:
    done = subprocess.run(  # noqa: S603 - our own
        [sys.executable, "-c", BASE.format(names=sorted(_EXTRAS))], capture_output=True, text=True, cwd=tmp_path
    )
    said = "wanted the extra 'scan' of printmend, got an installation without it; pip install 'printmend[scan]'"
    assert done.stdout.splitlines() == [f"cv2: {said}"], done.stderr
    assert done.stderr.splitlines() == [f"printmend: cv2: {said}"]
    assert done.returncode == 2
