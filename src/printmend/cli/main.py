"""The command line: names, help and errors. Each command is a few lines over a library function."""

import atexit
import contextlib
import gc
import importlib
import os
import signal
import sys
import warnings
from functools import cache
from typing import NoReturn

import click

from printmend import __version__
from printmend.cli.terminal import LANGUAGES, HelpFormatter, Terminal, spoken, usage_words, usual_language
from printmend.errors import MissingToolError, PrintmendError, own_fault, reason
from printmend.extras import lab_command, missing_extra
from printmend.messages import say

# Heading for its users → command → one line of help. The module printmend.cli.NAME has a click command named `command`.
# It is imported only when that command runs, so that `printmend --help` stays instant.
GROUPS: dict[str, dict[str, str]] = {
    "For owners": {
        "demo": "See a broken printer learn, and print right again.",
        "studio": "Open printmend in the browser: see, measure, mend, play.",
        "printer": "List the printer presets, or print one as TOML.",
        "probe": "Write a test print that shows every fault, and its plan.",
        "measure": "Read the scan of a test print: write the trace for `learn`.",
        "learn": "Learn what is wrong with a printer from one measured print.",
        "diagnose": "Write a report: what is wrong with a printer, and what to do.",
        "check": "Predict how far a print will be off, as it is and mended.",
        "mend": "Rewrite G-code so that a broken printer prints it right.",
        "fit": "Say whether a printed part fits, and which slicer settings help.",
        "verify": "Measure a mended check print: was the promise kept?",
        "history": "Show all measurements of a printer, and predict its wear.",
        "export": "Write firmware settings that correct a part of the faults.",
        "pair": "Get a printer's model from a studio, and keep it up to date.",
        "donate": "Pack what you measured into one file to give away; nothing is sent.",
    },
    "For farms": {
        "printers": "List your printers' models by the names that -m takes.",
        "watch": "Mend every file that is put into a folder.",
        "warm": "Compile all kernels now, not at their first use.",
    },
    "For researchers": {
        "twin": "Print G-code on a simulated broken printer.",
    },
    "For your shell": {
        "completion": "Complete commands, options and models in your shell.",
        "man": "Write a manual page for each command.",
    },
}
PLUGINS = "printmend.commands"  # entry points: `NAME = "package.commands:COMMANDS"`, in the form of GROUPS
LAB = ("paper", "body", "bench", "dataset", "figures", "selfrepair", "curiosity", "new", "conformance")


click.Context.formatter_class = HelpFormatter
_GARBAGE = 100_000  # new objects after which Python looks for garbage: imports make many, and none of it is garbage
PIPE_CLOSED = 141  # a shell's exit code for a program that SIGPIPE ended


class LazyGroup(click.Group):
    """A group whose commands are imported when they are called."""

    def invoke(self, ctx: click.Context) -> object:
        """Run a command. If the reader of its output has gone, end it here; click would report an error."""
        try:
            return super().invoke(ctx)
        except BrokenPipeError:
            _silence()
            sys.exit(PIPE_CLOSED)

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(homes())

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if (home := home_of(cmd_name)) is None:
            if cmd_name in LAB:
                raise MissingToolError(
                    f"printmend {cmd_name}", wanted=say("package-printmend-lab"), came=say("installation-without"),
                    todo=lab_command(),
                )  # fmt: skip
            return None
        return importlib.import_module(f"{home}.cli.{cmd_name.replace('-', '_')}").command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        width = max(map(len, homes()))
        found: dict[str, list[tuple[str, str]]] = {}
        for _, groups in packages():
            for who, commands in groups.items():
                found.setdefault(who, []).extend((name.ljust(width), words) for name, words in commands.items())
        for who, rows in found.items():
            with formatter.section(who):
                formatter.write_dl(rows)
        if not homes().keys() & set(LAB):
            formatter.write_text(spoken(say("terminal-lab-adds", ", ".join(LAB), lab_command())))


@cache
def packages() -> list[tuple[str, dict[str, dict[str, str]]]]:
    """Return the packages that have commands, this one first, and their commands in the form of `GROUPS`."""
    from importlib.metadata import entry_points

    others = [(point.module.partition(".")[0], point.load()) for point in entry_points(group=PLUGINS)]
    return [("printmend", GROUPS), *others]


@cache
def homes() -> dict[str, str]:
    """Return each command's package; if two packages share a name, the first one has it."""
    return {
        name: package for package, groups in reversed(packages()) for commands in groups.values() for name in commands
    }


def home_of(name: str) -> str | None:
    """Return a command's package, None for an unknown command. For our own commands, no other package is searched."""
    return "printmend" if any(name in commands for commands in GROUPS.values()) else homes().get(name)


def _speak(ctx: click.Context, option: click.Parameter, language: str | None) -> None:
    """Choose the language before anything else is read, so that errors in the command line use it, too."""
    terminal = ctx.ensure_object(Terminal)
    terminal.language = language or terminal.language


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Example: printmend demo",
)
@click.version_option(__version__, prog_name="printmend")
@click.option("--lang", type=click.Choice(LANGUAGES), metavar="en|de", is_eager=True, expose_value=False,
              callback=_speak,
              help="Language of results, errors and help [default: the locale's].")  # fmt: skip
@click.pass_context
def group(ctx: click.Context) -> None:
    """Print straight on a broken 3-D printer: learn its fault from one print, rewrite the G-code."""
    name = ctx.invoked_subcommand
    if name is not None and home_of(name) is not None:
        from printmend.cli.terminal import settings_of

        settings = settings_of(lambda: [*homes(), *LAB], lambda: ctx.command.get_command(ctx, name), name)  # type: ignore[attr-defined]
        ctx.default_map = {name: settings}


def main() -> None:
    """Run the command line; turn an error into one line on stderr and its exit code.

    Bad input and refusals end with 2 or 3 (`errors.py`), a closed pipe quietly with 141, and a bug in the program with
    1. The environment variable PRINTMEND_TRACEBACK=1 shows the traceback of a bug.
    """
    gc.set_threshold(_GARBAGE)
    atexit.register(gc.freeze)  # or Python would look through everything for garbage once more before it ends
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(AttributeError):  # closed, or not a terminal's
            stream.reconfigure(errors="replace")  # type: ignore[union-attr]
    if not sys.warnoptions:
        warnings.simplefilter("ignore")  # warnings are for programmers; users get errors
    signal.signal(signal.SIGTERM, _terminated)
    if sys.stderr is not None and sys.stderr.isatty():
        import logging

        logging.basicConfig(format="printmend: %(message)s")
        logging.getLogger("printmend").setLevel(logging.INFO)
    terminal = Terminal(usual_language())
    try:
        try:
            code = group.main(prog_name="printmend", standalone_mode=False, obj=terminal)
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()  # a full disk raises its error here at the latest
        sys.exit(code if isinstance(code, int) else 0)
    except PrintmendError as error:
        _end(terminal.say(error.message), error.exit_code)
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        sys.exit(error.exit_code)
    except click.ClickException as error:
        _end(terminal.say(usage_words(error)), error.exit_code)
    except (click.Abort, KeyboardInterrupt):
        _end(terminal.say(say("terminal-stopped")), 130)
    except BrokenPipeError:
        _silence()
        sys.exit(PIPE_CLOSED)
    except OSError as error:
        _silence()
        what = error.filename or say("file")
        _end(terminal.say(say("terminal-file-fails", what, reason(error))), 2)
    except MemoryError:
        _end(terminal.say(say("terminal-no-memory")), 2)
    except Exception as error:
        if isinstance(error, ImportError) and (missing := missing_extra(error)) is not None:
            _end(terminal.say(missing.message), missing.exit_code)
        if os.environ.get("PRINTMEND_TRACEBACK") == "1":
            raise
        _end(terminal.say(say("terminal-own-fault", own_fault(error))), 1)


def _end(message: str, code: int) -> NoReturn:
    """End the program with a line on standard error."""
    if sys.stderr is not None:
        print(f"printmend: {message}", file=sys.stderr)
    sys.exit(code)


def _silence() -> None:
    """Discard the buffered output, so that the interpreter does not fail on it at exit."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _terminated(number: int, frame: object) -> NoReturn:
    """Exit by an exception, so that temporary files are removed on the way."""
    sys.exit(128 + number)
