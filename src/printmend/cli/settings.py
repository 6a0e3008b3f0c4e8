"""Read a user's default options from TOML; the command line overrides them.

    [mend]
    model = "e3-07"
    jobs = 4

A section is a command, a key one of its long options. The user's file is config.toml in the user's folder of printmend,
a project's is printmend.toml in the current folder. The command line comes first, then the project, then the user.
"""

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from printmend.cli.model import ModelType
from printmend.cli.terminal import value_words
from printmend.errors import ConfigError
from printmend.messages import say

PROJECT = Path("printmend.toml")


def user_file() -> Path:
    """Return where the user's settings are."""
    return Path(click.get_app_dir("printmend")) / "config.toml"


def settings_of(
    names: Callable[[], list[str]], command: Callable[[], click.Command | None], name: str
) -> dict[str, Any]:
    """Return the values that the settings give to the parameters of the command ``name``.

    ``names`` returns all commands. Raises `ConfigError` for a section that is no command, or a key that is no option.
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
    """Return a section of a settings file; nothing where there is no such file."""
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
    """Raise `ConfigError` for what the option would refuse, in the file's words; models are looked up when needed."""
    if isinstance(option.type, ModelType | click.Path):
        return
    try:
        option.type_cast_value(click.Context(click.Command(None)), value)
    except click.BadParameter as error:
        wanted = say("usage-wrong-value", place, value_words(option.type) or error.message)
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
