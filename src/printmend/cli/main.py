"""The command line: names, help and errors. Each command is a few lines over a library function."""

import importlib
import sys

import click

from printmend import __version__
from printmend.errors import PrintmendError

# name → (group, one line of help). The module printmend.cli.NAME holds a click command called `command`; it is
# imported only when that command runs, so that `printmend --help` stays instant.
COMMANDS: dict[str, str] = {
    "demo": "See a printer break, learn and print right again.",
    "bench": "Reproduce the paper's tables on real bodies.",
    "body": "Show what a mesh or G-code file becomes: layers and steps.",
    "check": "Predict how far a print will be off, as it is and mended.",
    "dataset": "Exchange bodies and corruptions with the paper's published code.",
    "diagnose": "Say what is wrong with a printer, and what to do, in one report.",
    "export": "Write the part of a fault that a firmware can hold.",
    "learn": "Learn what is wrong with a printer from one measured print.",
    "measure": "Find the marks of a scanned test print: the trace that `learn` needs.",
    "mend": "Rewrite G-code so that a broken printer prints it right.",
    "printer": "Print a printer preset as TOML, to start your own from.",
    "probe": "Write a test print that shows every fault, and its plan.",
    "twin": "Print G-code on a broken printer that exists only here.",
}


class LazyGroup(click.Group):
    """A group whose commands are imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        module = importlib.import_module(f"printmend.cli.{cmd_name.replace('-', '_')}")
        return module.command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Example: printmend demo",
)
@click.version_option(__version__, prog_name="printmend")
def group() -> None:
    """Print straight on a broken 3-D printer: learn its fault from one print, rewrite the G-code."""


def main() -> None:
    """Run the command line; turn an expected error into one line on stderr and its exit code."""
    try:
        group(standalone_mode=True)
    except PrintmendError as error:
        print(f"printmend: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
