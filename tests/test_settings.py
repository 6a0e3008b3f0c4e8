"""Settings in TOML, of the user and of a project; and the one line that a slip of the finger gets."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from printmend.cli.main import group
from printmend.errors import ConfigError
from tests.mending import BENT, SQUARE, text_of
from tests.mortal import heed_ctrl_c

PROGRAM = str(Path(sys.executable).parent / "printmend")
NAMES = group.list_commands(click.Context(group))


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    (tmp_path / "config" / "printmend").mkdir(parents=True)
    (tmp_path / "part.gcode").write_bytes(SQUARE)
    (tmp_path / "bent.mend.json").write_text(text_of(BENT))
    return tmp_path


def test_the_command_line_comes_before_the_project_and_the_project_before_the_user(place: Path) -> None:
    user = place / "config" / "printmend" / "config.toml"
    user.write_text('[mend]\nmodel = "nobody"\nquiet = true\n')
    assert "nobody" in str(CliRunner().invoke(group, ["mend", "part.gcode"]).exception)
    (place / "printmend.toml").write_text('[mend]\nmodel = "bent"\n')
    done = CliRunner().invoke(group, ["mend", "part.gcode"])
    assert (done.exit_code, done.output) == (0, "")
    assert (place / "part.mended.gcode").exists()
    assert "other" in str(CliRunner().invoke(group, ["mend", "part.gcode", "-m", "other"]).exception)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[mended]\n", "sections that are commands, like .mend.*'mended'"),
        ("[mend]\nspeed = 3\n", "options of mend: crossing, filament, firmware, .*'speed' in .mend"),
        ("[mend\n", "settings in TOML"),
        (
            '[mend]\njobs = "four"\n',
            "printmend.toml: expected jobs in .mend.: a whole number from 1 to 64, found 'four';",
        ),
    ],
)
def test_settings_that_are_none_are_refused(place: Path, text: str, said: str) -> None:
    (place / "printmend.toml").write_text(text)
    done = CliRunner().invoke(group, ["mend", "part.gcode", "-m", "bent"])
    assert isinstance(done.exception, ConfigError)
    with pytest.raises(ConfigError, match=said):
        raise done.exception


def test_a_slip_gets_one_line(place: Path) -> None:
    for arguments, said in (
        (["mend", "part.gcode", "--modle", "bent"], "there is no option --modle (did you mean --model?);"),
        (["mend", "part.gcode", "--lang", "de"], "--lang stands before the command; see printmend mend --help"),
        (["mned"], "there is no command mned (did you mean mend?); see printmend --help"),
        (["completion"], "is missing"),
        (["check", str(place), "-m", "bent"], "the name of a file, not of a folder"),
        (["learn", "trace.csv", "--printer", "ender3", "-o", str(place)], "the name of a file, not of a folder"),
    ):
        done = subprocess.run([PROGRAM, *arguments], capture_output=True, text=True, check=False)  # noqa: S603
        assert done.returncode == 2
        assert done.stderr.count("\n") == 1
        assert done.stderr.startswith("printmend: ")
        assert said in done.stderr
        assert "--help" in done.stderr


def test_ctrl_c_says_how_to_go_on(place: Path) -> None:
    (place / "jobs").mkdir()
    command = [PROGRAM, "watch", "jobs", "mended", "-m", "bent", "--every", "0.2"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, preexec_fn=heed_ctrl_c) as running:  # noqa: S603
        while running.poll() is None and not (place / "mended").exists():
            time.sleep(0.02)
        running.send_signal(signal.SIGINT)
        assert running.stderr is not None
        said = running.stderr.read()
    assert running.returncode == 130
    assert "continues where it left off" in said
    assert len(said.splitlines()) == 1


def test_shells_complete_commands_and_models(place: Path) -> None:
    for shell in ("bash", "zsh", "fish"):
        assert "_PRINTMEND_COMPLETE" in CliRunner().invoke(group, ["completion", shell]).output
    for typed, said in (("printmend pri", "plain,printers"), ("printmend mend -m be", "plain,bent")):
        words = {"_PRINTMEND_COMPLETE": "bash_complete", "COMP_WORDS": typed, "COMP_CWORD": str(typed.count(" "))}
        done = subprocess.run([PROGRAM], env={**os.environ, **words}, capture_output=True, text=True, check=False)  # noqa: S603
        assert said in done.stdout.splitlines()


def test_every_command_has_a_manual_page_of_its_help(place: Path) -> None:
    assert CliRunner().invoke(group, ["man", "-o", "pages"]).exit_code == 0
    assert {path.stem for path in (place / "pages").iterdir()} == {
        "printmend",
        *(f"printmend-{n}" for n in NAMES),
    }
    requests = {"TH", "SH", "PP", "TP", "nf", "fi", "B"}
    for path in (place / "pages").iterdir():
        text = path.read_text()
        assert {line[1:].split(" ")[0] for line in text.splitlines() if line.startswith((".", "'"))} <= requests
        assert "\b" not in text
        if path.stem != "printmend":
            command = group.get_command(click.Context(group), path.stem.removeprefix("printmend-"))
            for option in (one for one in command.params if isinstance(one, click.Option)):
                assert max(option.opts, key=len).replace("-", "\\-") in text
    assert all(f"\\fB{name}\\fP\n" in (place / "pages/printmend.1").read_text() for name in NAMES)
