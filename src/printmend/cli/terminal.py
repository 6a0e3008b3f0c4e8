"""What a command says and understands in the terminal: the language, numbers as typed, and mistakes as messages.

The language is that of --lang, or of the user's locale. Click has its own messages in English only.
"""

import math
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import click

from printmend.messages import ENGLISH, GERMAN, Said, help_words, say, together, translated

LANGUAGES = (ENGLISH, GERMAN)


@dataclass
class Terminal:
    """The user's language. Mutable: `main` makes it, --lang sets it, and the last error needs it."""

    language: str = ENGLISH

    def say(self, message: str) -> str:
        """Return a message in the user's language."""
        return translated(message, self.language)


def usual_language(environment: Mapping[str, str] = os.environ) -> str:
    """Return the language of a locale, English where we do not speak it."""
    names = (environment.get(name) for name in ("LC_ALL", "LC_MESSAGES", "LANG"))
    return GERMAN if next(filter(None, names), "").lower().startswith("de") else ENGLISH


def language() -> str:
    """Return the language that this command speaks."""
    ctx = click.get_current_context(silent=True)
    terminal = ctx.find_object(Terminal) if ctx is not None else None
    return (terminal or Terminal()).language


def spoken(message: str) -> str:
    """Return a message in the user's language."""
    return translated(message, language())


def echo(message: str, *, err: bool = False) -> None:
    """Print a message in the user's language."""
    click.echo(spoken(message), err=err)


class HelpFormatter(click.HelpFormatter):
    """Writes --help in the user's language, paragraph by paragraph."""

    def write_usage(self, prog: str, args: str = "", prefix: str | None = None) -> None:
        super().write_usage(prog, " ".join(map(_helped, args.split())), prefix or _helped("Usage:") + " ")

    def write_heading(self, heading: str) -> None:
        super().write_heading(_helped(heading))

    def write_text(self, text: str) -> None:
        super().write_text("\n\n".join(map(_helped, text.split("\n\n"))))

    def write_dl(self, rows: Iterable[tuple[str, str]], col_max: int = 30, col_spacing: int = 2) -> None:
        super().write_dl([(term, _described(text)) for term, text in rows], col_max, col_spacing)


def _helped(text: str) -> str:
    """Return a paragraph or a word of --help in the user's language; after click's mark \\b its lines stay lines."""
    if language() != GERMAN:
        return text
    kind, colon, example = text.partition(": ")
    if colon and kind in ("Example", "Examples"):
        return _helped(kind) + colon + example
    return help_words().get(text if "\b" in text else " ".join(text.split()), text)


def _described(text: str) -> str:
    """Return an option's line of help in the user's language, and what click adds in brackets."""
    told, gap, more = text.partition("  [")
    return _helped(told) + gap + re.sub("default:|required", lambda word: _helped(word[0]), more)


class Finite(click.FloatRange):
    """A range of real numbers; nan, which no comparison excludes, is none of them."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(say("usage-real"), param, ctx)
        return number


class Percent(Finite):
    """A share as a percentage, with its sign or without: `5%` is 0.05."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        return super().convert(str(value).strip().removesuffix("%"), param, ctx) / 100.0


def usage_words(error: click.ClickException) -> str:
    """Return what is wrong with a command line, and where its help is."""
    ctx = getattr(error, "ctx", None)
    command = "printmend" if ctx is None else " ".join(["printmend", *ctx.command_path.split()[1:]])
    return say("terminal-usage-see-help", _wrong(error), command)


def value_words(kind: click.ParamType) -> str:
    """Return which values a type takes; empty for a type that says so itself."""
    if isinstance(kind, click.Choice):
        return say("usage-one-of", ", ".join(map(str, kind.choices)))
    if isinstance(kind, click.IntRange | click.FloatRange):
        which = "whole" if isinstance(kind, click.IntRange) else "real"
        if kind.min is None or kind.max is None:
            return say(f"usage-{which}") if kind.min is None else say(f"usage-{which}-from", kind.min)
        return say(f"usage-{which}-range", kind.min, kind.max)
    if isinstance(kind, click.Path):
        return say("usage-folder" if not kind.file_okay else "usage-file" if not kind.dir_okay else "usage-path")
    if kind is click.INT or kind is click.FLOAT:
        return say("usage-whole" if kind is click.INT else "usage-real")
    return ""


def _wrong(error: click.ClickException) -> str:
    if isinstance(error, click.NoSuchOption):
        root = None if error.ctx is None else error.ctx.find_root()
        if root is not None and any(error.option_name in option.opts for option in root.command.params):
            return say("usage-before-command", error.option_name)
        return _with_guess(say("usage-no-option", error.option_name), error.possibilities)
    if (name := getattr(error, "command_name", None)) is not None:
        return _with_guess(say("usage-no-command", name), getattr(error, "possibilities", None))
    if isinstance(error, click.BadParameter) and error.param is not None:
        hint = error.param.get_error_hint(error.ctx) if error.param_hint is None else str(error.param_hint)
        hint = hint.replace("'", "")
        if isinstance(error, click.MissingParameter):
            return say("usage-missing", hint)
        told = error.message if isinstance(error.message, Said) else value_words(error.param.type)
        return say("usage-wrong-value", hint, told or error.message)
    if isinstance(error, click.BadOptionUsage):
        return say("usage-needs-value", error.option_name)
    # Of click's other errors only those of our own commands have an id.
    return error.message if isinstance(error.message, Said) else " ".join(error.format_message().rstrip(".").split())


def _with_guess(words: str, possibilities: object) -> str:
    if not isinstance(possibilities, list | tuple) or not possibilities:
        return words
    return say("usage-guess", words, together(", ", possibilities))
