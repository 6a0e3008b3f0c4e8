"""The language that a command speaks in the terminal: --lang, or that of the user's locale."""

import os
from collections.abc import Mapping
from dataclasses import dataclass

import click

from printmend.messages import ENGLISH, GERMAN, translated

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
