"""The commands' common parts in the terminal: language, default options, outputs, progress bars, usage errors.

The language is that of --lang, or of the user's locale. Click's own messages exist in English only.
"""

import contextlib
import json
import math
import os
import re
import sys
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from printmend.cli.model import ModelType
from printmend.errors import ConfigError, InputError
from printmend.files import check_place
from printmend.messages import ENGLISH, GERMAN, Said, as_lines, help_words, say, together, translated

if TYPE_CHECKING:
    from printmend.mend.many import FileOutcome

# Read a user's default options from TOML; the command line overrides them.
#
# [mend] model = "e3-07" jobs = 4
#
# A section is a command, and a key is one of its long options. The user's file is config.toml in the user's printmend
# folder; a project's file is printmend.toml in the current folder. The command line overrides the project's values, and
# these override the user's.

PROJECT = Path("printmend.toml")


def user_file() -> Path:
    """Return the path of the user's settings."""
    return Path(click.get_app_dir("printmend")) / "config.toml"


def settings_of(
    names: Callable[[], list[str]], command: Callable[[], click.Command | None], name: str
) -> dict[str, Any]:
    """Return the settings' values for the parameters of the command ``name``.

    ``names`` returns all commands. Raises `ConfigError` for an unknown command's section, or an unknown option's key.
    """
    values: dict[str, Any] = {}
    for path in (user_file(), PROJECT):
        for key, value in _section(path, names, name).items():
            found = command()
            options = {} if found is None else _options(found)
            if key not in options:
                raise ConfigError(
                    path, wanted=say("options", name, ', '.join(sorted(options))), came=say("in", repr(key), name),
                    todo=say("correct-remove"),
                )  # fmt: skip
            _check(path, f"{key} in [{name}]", options[key], value)
            values[options[key].name or ""] = value
    return values


def _section(path: Path, names: Callable[[], list[str]], name: str) -> dict[str, Any]:
    """Return a section of a settings file, empty if there is no such file."""
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, RecursionError) as error:
        raise ConfigError(path, wanted=say("settings-toml"), came=str(error), todo=say("correct")) from None
    for section, values in table.items():
        if section not in names() or not isinstance(values, dict):
            raise ConfigError(
                path, wanted=say("sections-commands-like-mend"), came=repr(section), todo=say("correct-remove")
            )
    return dict(table.get(name, {}))


def _check(path: Path, place: str, option: click.Option, value: Any) -> None:
    """Raise `ConfigError` for a value that the option would refuse; models are looked up only when needed."""
    if isinstance(option.type, ModelType | click.Path):
        return
    try:
        option.type_cast_value(click.Context(click.Command(None)), value)
    except click.BadParameter as error:
        wanted = together(": ", [place, value_words(option.type) or error.message])
        raise ConfigError(path, wanted=wanted, came=repr(value), todo=say("correct")) from None


def _options(command: click.Command) -> dict[str, click.Option]:
    """Return a command's options by their long names."""
    return {
        word.removeprefix("--"): option
        for option in command.params
        if isinstance(option, click.Option)
        for word in option.opts
        if word.startswith("--")
    }


LANGUAGES = (ENGLISH, GERMAN)


@dataclass
class Terminal:
    """The user's language. Mutable: `main` makes it, --lang sets it, and the last error needs it."""

    language: str = ENGLISH

    def say(self, message: str) -> str:
        """Return a message in the user's language."""
        return translated(message, self.language)


def usual_language(environment: Mapping[str, str] = os.environ) -> str:
    """Return the language of the locale, English if we do not have it."""
    names = (environment.get(name) for name in ("LC_ALL", "LC_MESSAGES", "LANG"))
    return GERMAN if next(filter(None, names), "").lower().startswith("de") else ENGLISH


def language() -> str:
    """Return the language of this command's messages."""
    ctx = click.get_current_context(silent=True)
    terminal = ctx.find_object(Terminal) if ctx is not None else None
    return (terminal or Terminal()).language


def spoken(message: str) -> str:
    """Return a message in the user's language."""
    return translated(message, language())


def echo(message: str, *, err: bool = False) -> None:
    """Print a message in the user's language, its lines with a capital at their beginning.

    If the reader of the output has gone, the words are lost, and the work goes on.
    """
    with contextlib.suppress(BrokenPipeError):
        click.echo(as_lines(message, language()), err=err)


_KIND = re.compile("(INTEGER|FLOAT)( RANGE)?")  # of an option's value, as click names it
_RANGE = re.compile(r"(?:x>=)?([\d.,]+)(?:<=x<=([\d.,]+))?(\]?)")
_UNBROKEN = "\u2011"  # a hyphen at which no line is broken: names of files and options stay whole


class HelpFormatter(click.HelpFormatter):
    """Writes --help in the user's language, paragraph by paragraph."""

    def write_usage(self, prog: str, args: str = "", prefix: str | None = None) -> None:
        super().write_usage(prog, " ".join(map(_helped, args.split())), prefix or _helped("Usage:") + " ")

    def write_heading(self, heading: str) -> None:
        super().write_heading(_helped(heading))

    def write_text(self, text: str) -> None:
        super().write_text("\n\n".join(map(_helped, text.split("\n\n"))).replace("-", _UNBROKEN))

    def write_dl(self, rows: Iterable[tuple[str, str]], col_max: int = 30, col_spacing: int = 2) -> None:
        told = [(_KIND.sub(lambda _: _helped("NUMBER"), term), _described(text)) for term, text in rows]
        super().write_dl([(term, text.replace("-", _UNBROKEN)) for term, text in told], col_max, col_spacing)

    def write(self, string: str) -> None:
        super().write(string.replace(_UNBROKEN, "-"))


def _helped(text: str) -> str:
    """Return a paragraph or a word of --help in the user's language; after click's mark \\b its line breaks stay."""
    if language() != GERMAN:
        return text
    kind, colon, example = text.partition(": ")
    if colon and kind in ("Example", "Examples"):
        return _helped(kind) + colon + example
    return help_words().get(text if "\b" in text else " ".join(text.split()), text)


def _described(text: str) -> str:
    """Return an option's line of help in the user's language, with click's additions in brackets."""
    told, gap, more = text.partition("  [")
    return _helped(told) + gap + "; ".join(map(_added, more.split("; ")))


def _added(text: str) -> str:
    """Return an addition of click's in the user's language: an option's default, its range, or that it is required."""
    text = re.sub(r"(?<![\d.])\d+\.\d+(?![\d.])", lambda number: spoken(f"{float(number[0]):.12g}"), text)
    if (ends := _RANGE.fullmatch(text)) is not None:
        least, most, last = ends.groups()
        return spoken(say("help-from-to", least, most) if most else say("help-from", least)) + last
    return re.sub("default:|required", lambda word: _helped(word[0]), text)


class Finite(click.FloatRange):
    """A range of real numbers, with a decimal point or comma. It excludes nan, which no comparison would."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        value = value.replace(",", ".") if isinstance(value, str) else value
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(say("usage-real"), param, ctx)
        return number


class Percent(Finite):
    """A share as a percentage, with its sign or without: `5%` is 0.05."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        return super().convert(str(value).strip().removesuffix("%"), param, ctx) / 100.0


def usage_words(error: click.ClickException) -> str:
    """Return words for the error in a command line, and where its help is."""
    ctx = getattr(error, "ctx", None)
    command = "printmend" if ctx is None else " ".join(["printmend", *ctx.command_path.split()[1:]])
    return say("terminal-usage-see-help", _wrong(error), command)


def value_words(kind: click.ParamType) -> str:
    """Return words for the values that a type takes; empty for a type whose own error names them."""
    if isinstance(kind, click.Choice):
        return say("usage-one-of", ", ".join(map(str, kind.choices)))
    if isinstance(kind, click.IntRange | click.FloatRange):
        which = "whole" if isinstance(kind, click.IntRange) else "real"
        if kind.min is None or kind.max is None:
            return say(f"usage-{which}") if kind.min is None else say(f"usage-{which}-from", kind.min)
        return say(f"usage-{which}-range", kind.min, kind.max)
    if isinstance(kind, click.Path):
        file = "usage-file" if kind.exists else "usage-file-name"
        return say("usage-folder" if not kind.file_okay else file if not kind.dir_okay else "usage-path")
    if isinstance(kind, click.DateTime):
        return say("usage-day")
    if kind is click.INT or kind is click.FLOAT:
        return say("usage-whole" if kind is click.INT else "usage-real")
    return ""


def _wrong(error: click.ClickException) -> str:
    if isinstance(error, click.NoSuchOption):
        root = None if error.ctx is None else error.ctx.find_root()
        if root is not None and any(error.option_name in option.opts for option in root.command.params):
            return say("usage-before-command", error.option_name)
        return _with_guess(say("usage-no-option", error.option_name), error.possibilities)
    name, ctx = getattr(error, "command_name", None), getattr(error, "ctx", None)
    if name is not None and ctx is not None:
        from difflib import get_close_matches  # which no right command needs

        names = ctx.command.list_commands(ctx)  # click asks a group of loaded commands
        return _with_guess(say("usage-no-command", name), get_close_matches(name, names))
    if isinstance(error, click.BadParameter) and error.param is not None:
        hint = error.param.get_error_hint(error.ctx) if error.param_hint is None else str(error.param_hint)
        hint = hint.replace("'", "")
        if isinstance(error, click.MissingParameter):
            return say("usage-missing", hint)
        told = error.message if isinstance(error.message, Said) else value_words(error.param.type)
        return say("usage-wrong-value", hint, told or error.message)
    if isinstance(error, click.BadOptionUsage):
        return say("usage-needs-value", error.option_name)
    # Among click's other errors, only those of our own commands have a message id.
    return error.message if isinstance(error.message, Said) else " ".join(error.format_message().rstrip(".").split())


def _with_guess(words: str, possibilities: list[str] | None) -> str:
    return say("usage-guess", words, together(", ", possibilities)) if possibilities else words


# Protect inputs from being overwritten, show progress bars, and report the outcome of each file.

_LARGE_BYTES = 20_000_000  # smaller files are done before anybody could read a bar


def spare(outputs: tuple[Path | None, ...], inputs: tuple[Path | None, ...]) -> None:
    """Raise `InputError` if an output is also an input or another output, or if its folder does not exist. None and `-`
    are no files."""
    wanted = [path for path in outputs if path is not None and str(path) != "-"]
    for i, path in enumerate(wanted):
        check_place(path)
        for other in (*wanted[:i], *(item for item in inputs if item is not None and str(item) != "-")):
            if _same(path, other):
                raise InputError(
                    path, wanted=say("file-own-write"), came=say("command-reads-writes-already"),
                    todo=say("choose-another-name"),
                )  # fmt: skip


def _same(one: Path, other: Path) -> bool:
    """Return whether two paths are the same file."""
    try:
        return os.path.samefile(one, other)
    except (OSError, ValueError):
        return os.path.abspath(one) == os.path.abspath(other)


def output_path(source: Path, output: Path | None, *, in_place: bool) -> Path | None:
    """Return the path of the mended file; None is the standard output."""
    if in_place:
        if output is not None or str(source) == "-":
            raise click.UsageError(say("terminal-usage-in-place"))
        return source
    if output is not None:
        if str(output) == "-":
            return None
        return output / source.name if output.is_dir() else output
    if str(source) == "-":
        return None
    from printmend.mend.many import mended_path

    return mended_path(source)


@contextlib.contextmanager
def file_progress(source: Path) -> Iterator[Callable[[int], None] | None]:
    """Yield a function that takes counts of bytes read and draws a bar on a terminal; None for small files and pipes.

    A program that starts this one can set PRINTMEND_PROGRESS=1. It then reads lines such as `37 %` from the standard
    error.
    """
    size = source.stat().st_size if source.is_file() else 0
    if size and os.environ.get("PRINTMEND_PROGRESS") == "1":
        yield _percent_lines(size)
        return
    if size < _LARGE_BYTES or not sys.stderr.isatty() or os.environ.get("TERM") == "dumb":
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(source.name, total=size)
        yield lambda count: bar.update(task, advance=count)


def _percent_lines(size: int) -> Callable[[int], None]:
    """Return a progress function that prints each new percentage on a line."""
    read = said = 0

    def tick(count: int) -> None:
        nonlocal read, said
        read += count
        percent = min(100, 100 * read // size)  # unpacked text is longer than its container
        if percent > said:
            said = percent
            click.echo(f"{percent} %", err=True)

    return tick


@contextlib.contextmanager
def progress(what: str, total: int) -> Iterator[Callable[[str], None]]:
    """Yield a function that advances a bar by one and shows a name; nothing is drawn if the output is piped."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, TextColumn("{task.fields[name]}"), console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(what, total=total, name="")

        def tick(name: str) -> None:
            bar.update(task, advance=1, name=spoken(name)[:40])

        yield tick


def tell(outcome: "FileOutcome", *, as_json: bool, quiet: bool) -> None:
    """Print the outcome for a file, on stderr if it was not mended; ``quiet`` omits successes."""
    if as_json:
        click.echo(json.dumps(outcome.json(), ensure_ascii=False))
    elif outcome.code:
        echo(together("", ["printmend: ", outcome.words]), err=True)
    elif not quiet:
        echo(outcome.words)
