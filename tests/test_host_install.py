"""The script that installs printmend beside Moonraker and Klipper: what it writes, twice, and what it takes back."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SCRIPT = ROOT / "integrations/moonraker/install.sh"
MOONRAKER = "[server]\nhost: 0.0.0.0\n"
PRINTER = (
    "[printer]\nkinematics: cartesian\n\n#*# <---------------------- SAVE_CONFIG ---------------------->\n"
    "#*# DO NOT EDIT THIS BLOCK OR BELOW.\n#*#\n#*# [bed_mesh default]\n"
)

pytestmark = pytest.mark.skipif(os.name != "posix", reason="Moonraker runs on Linux")


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """A computer with Moonraker and Klipper, as their own installers leave it, and printmend's environment."""
    for folder in (
        "moonraker/moonraker/components",
        "klipper/klippy/extras",
        "printer_data/config",
        "printmend-env/bin",
    ):
        (tmp_path / folder).mkdir(parents=True)
    for name in ("moonraker", "klipper"):
        git(tmp_path / name, "init", "-q")
    (tmp_path / "printer_data/config/moonraker.conf").write_text(MOONRAKER)
    (tmp_path / "printer_data/config/printer.cfg").write_text(PRINTER)
    (tmp_path / "printmend-env/bin/printmend").write_text("#!/bin/sh\n")
    (tmp_path / "printmend-env/bin/printmend").chmod(0o755)
    (tmp_path / "bin").mkdir()
    for tool in ("sh", "awk", "grep", "cat", "rm", "ln", "cp", "git", "readlink", "dirname", "mkdir"):
        (tmp_path / "bin" / tool).symlink_to(str(shutil.which(tool)))  # no curl: nothing real is restarted
    return tmp_path


def git(folder: Path, *arguments: str) -> str:
    done = subprocess.run(  # noqa: S603 — in folders of this test
        ["git", "-C", str(folder), *arguments],  # noqa: S607
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return done.stdout


def install(home: Path, *arguments: str) -> subprocess.CompletedProcess:
    environment = {"HOME": str(home), "PATH": str(home / "bin")}
    return subprocess.run(  # noqa: S603 — our own script
        [SCRIPT, *arguments], capture_output=True, text=True, check=False, env=environment
    )


def texts(home: Path) -> dict[str, str]:
    """Return all that the script may have changed."""
    places = [home / "printer_data/config", home / "moonraker/moonraker", home / "klipper/klippy"]
    found = [path for place in places for path in sorted(place.rglob("*")) if path.is_file() or path.is_symlink()]
    return {str(path.relative_to(home)): path.read_text() for path in found}


@pytest.mark.parametrize("live", [False, True], ids=["files", "live"])
def test_it_installs_once_and_takes_all_back(live: bool, home: Path) -> None:
    before = texts(home)
    (model := home / "new.mend.json").write_text("{}")
    arguments = ["-m", str(model), *(["--klipper"] if live else [])]
    done = install(home, *arguments)
    assert (done.returncode, done.stderr) == (0, "")
    once = texts(home)
    component, extra = home / "moonraker/moonraker/components/printmend.py", home / "klipper/klippy/extras/printmend.py"
    assert (component.is_symlink(), extra.is_symlink()) == (not live, live)
    link = extra if live else component
    assert link.resolve() == ROOT / f"integrations/{'klipper' if live else 'moonraker'}/printmend.py"
    where = home / ("klipper" if live else "moonraker")
    assert git(where, "status", "--porcelain") == "", "an update would call it dirty"
    config = home / "printer_data/config"
    assert (config / "moonraker.conf").read_text() == MOONRAKER + "[include printmend-moonraker.conf]\n"
    assert ("[printmend]" in (config / "printmend-moonraker.conf").read_text()) is not live
    assert ("[printmend]" in (config / "printmend-klipper.cfg").read_text()) is live  # else the button
    included = PRINTER.replace("#*# <-", "[include printmend-klipper.cfg]\n#*# <-", 1)
    assert (config / "printer.cfg").read_text() == included
    assert (config / "printer.mend.json").read_text() == "{}"
    # What the owner changed stays, and a second time nothing is added.
    settings = config / ("printmend-klipper.cfg" if live else "printmend-moonraker.conf")
    settings.write_text(settings.read_text() + "# mine\n")
    assert install(home, *arguments).returncode == 0
    assert texts(home) == {**once, str(settings.relative_to(home)): once[str(settings.relative_to(home))] + "# mine\n"}
    assert install(home, "--uninstall").returncode == 0
    assert texts(home) == {**before, "printer_data/config/printer.mend.json": "{}"}


@pytest.mark.parametrize("live", [False, True], ids=["files first", "live first"])
def test_only_one_of_the_two_ways_is_installed(live: bool, home: Path) -> None:
    ways: tuple[list[str], list[str]] = (["--klipper"], []) if live else ([], ["--klipper"])
    first, second = ways
    assert install(home, *first).returncode == 0
    once = texts(home)
    refused = install(home, *second)
    assert refused.returncode == 2
    assert refused.stderr.count("\n") == 1
    assert f"installed for {'Klipper' if live else 'Moonraker'} already" in refused.stderr
    assert texts(home) == once
    assert install(home, "--uninstall").returncode == 0
    assert install(home, *second).returncode == 0
    links = [home / "klipper/klippy/extras/printmend.py", home / "moonraker/moonraker/components/printmend.py"]
    assert [link.is_symlink() for link in links] == [not live, live]
    moonraker = (home / "printer_data/config/printmend-moonraker.conf").read_text()
    assert ("[printmend]" in moonraker) is live


PYTHON = """#!/bin/sh
echo "$@" >> "$HOME/asked"
[ "$2" != venv ] || { mkdir -p "$3/bin"; cp "$0" "$3/bin/python"; cp "$0" "$3/bin/printmend"; }
"""


def test_a_new_environment_has_what_compiles(home: Path) -> None:
    """The folder of a repository has no compiled kernels."""
    shutil.rmtree(home / "printmend-env")
    (home / "bin/python3").write_text(PYTHON)
    (home / "bin/python3").chmod(0o755)
    for name in ("python3.11", "python3.12", "python3.13"):
        (home / "bin" / name).symlink_to(home / "bin/python3")
    assert install(home).returncode == 0
    asked = (home / "asked").read_text().splitlines()
    assert asked[1] == f"-m venv {home}/printmend-env"
    assert asked[2].endswith(f"-e {ROOT}[compile]")
    assert asked[3] == "warm"


def test_updates_come_from_where_the_folder_came_from(home: Path, tmp_path: Path) -> None:
    clone = tmp_path / "printmend"
    (clone / "integrations").mkdir(parents=True)
    shutil.copytree(SCRIPT.parent, clone / "integrations/moonraker")
    for command in (["init", "-q", "-b", "main"], ["remote", "add", "origin", "ssh://away/printmend.git"]):
        git(clone, *command)
    subprocess.run(  # noqa: S603
        [clone / "integrations/moonraker/install.sh"], check=True, capture_output=True,
        env={"HOME": str(home), "PATH": str(home / "bin")},
    )  # fmt: skip
    lines = (home / "printer_data/config/printmend-moonraker.conf").read_text().splitlines()
    assert {"[update_manager printmend]", "type: git_repo", f"path: {clone}", "origin: ssh://away/printmend.git",
            f"virtualenv: {home}/printmend-env", "requirements: core.lock"} <= {*lines}  # fmt: skip
    assert (ROOT / "core.lock").is_file()


@pytest.mark.parametrize(
    ("missing", "arguments", "words"),
    [
        ("printer_data/config/moonraker.conf", [], "set PRINTER_DATA"),
        ("moonraker/moonraker/components", [], "set MOONRAKER"),
        ("klipper/klippy/extras", ["--klipper"], "set KLIPPER"),
        (None, ["-m", "absent.json"], "name the model"),
        (None, ["--nonsense"], "not known here"),
    ],
)
def test_it_says_what_is_missing_and_changes_nothing(missing, arguments, words: str, home: Path) -> None:
    if missing is not None:
        (home / missing).rename(home / "away")
    before = texts(home)
    done = install(home, *arguments)
    assert (done.returncode, words in done.stderr) == (2, True), done.stderr
    assert texts(home) == before
