"""`printmend man`: make a manual page for each command from its --help."""

import re
from pathlib import Path

import click

from printmend import __version__
from printmend.cli.terminal import echo
from printmend.messages import say_count

EXIT_CODES = (
    ("0", "Done."),
    ("1", "A bug in printmend."),
    ("2", "A file, model, printer or option is not as it should be; standard error says how. Nothing is written."),
    ("3", "Mending is not sure to help, and nothing is written; or `verify` found a promise broken."),
    ("130", "Stopped by Ctrl-C. What was written is whole."),
)
_FILES = (
    ("printmend.toml", "Settings of the current folder: a section for each command."),
    ("~/.config/printmend/config.toml", "The user's own, on Linux; those of the folder come before it."),
)


@click.command(epilog="Example: printmend man -o ~/.local/share/man/man1 && man printmend-mend")
@click.option("-o", "--output", metavar="FOLDER", required=True, type=click.Path(path_type=Path, file_okay=False),
              help="Where `man` looks: on Linux ~/.local/share/man/man1.")  # fmt: skip
@click.pass_context
def command(ctx: click.Context, output: Path) -> None:
    """Write manual pages into FOLDER: printmend.1 and one for each command."""
    from printmend.files import replacing

    folder = output.expanduser()
    folder.mkdir(parents=True, exist_ok=True)
    written = pages(ctx.find_root().command)
    for name, text in written.items():
        with replacing(folder / f"{name}.1") as page:
            page.write(text)
    echo(say_count("terminal-man-pages", len(written), folder))


def pages(group: click.Command) -> dict[str, str]:
    """Return the text of each page in roff by its name: the program's own, then those of its commands."""
    assert isinstance(group, click.Group)  # for mypy: the root is a group
    top = click.Context(group, info_name="printmend")
    names = group.list_commands(top)
    found = {"printmend": _page(top, [f"printmend-{name}" for name in names])}
    for name in names:
        below = group.get_command(top, name)
        if below is not None:
            found[f"printmend-{name}"] = _page(click.Context(below, info_name=name, parent=top), ["printmend"])
    return found


def _page(ctx: click.Context, others: list[str]) -> str:
    """Return a command's page for `man`."""
    command, name = ctx.command, ctx.command_path.replace(" ", "-")
    lines = [
        f'.TH "{_plain(name.upper())}" 1 "" "printmend {__version__}" "printmend"', ".SH NAME",
        f"{_plain(name)} \\- {_plain(command.get_short_help_str(200).rstrip('.'))}", ".SH SYNOPSIS",
        f".B {_plain(ctx.command_path)}", _plain(" ".join(command.collect_usage_pieces(ctx))), ".SH DESCRIPTION",
    ]  # fmt: skip
    for i, paragraph in enumerate(re.split(r"\n[ \t]*\n", command.help or "")):
        lines += [".PP"] * (i > 0) + _paragraph(paragraph)
    if isinstance(command, click.Group):
        listed = [(one, command.get_command(ctx, one)) for one in command.list_commands(ctx)]
        lines += _table("COMMANDS", [(one, below.get_short_help_str(200)) for one, below in listed if below])
    records = [option.get_help_record(ctx) for option in command.get_params(ctx)]
    lines += _table("OPTIONS", [record for record in records if record])
    lines += _table("EXIT STATUS", list(EXIT_CODES)) + _table("FILES", list(_FILES))
    if command.epilog:
        kind, _, examples = command.epilog.partition(": ")
        lines += [f".SH {kind.upper()}", ".nf", *(_text(one.strip()) for one in examples.split("; ")), ".fi"]
    lines += [".SH SEE ALSO", ", ".join(f"\\fB{_plain(one)}\\fP(1)" for one in others)]
    return "\n".join(lines) + "\n"


def _table(title: str, rows: list[tuple[str, str]]) -> list[str]:
    """Return a section of terms and their texts."""
    return [f".SH {title}"] + [line for term, text in rows for line in (".TP", f"\\fB{_plain(term)}\\fP", _text(text))]


def _paragraph(text: str) -> list[str]:
    """Return a paragraph of a help text; after click's mark \\b its line breaks stay."""
    if text.lstrip().startswith("\b"):
        rows = text.strip().removeprefix("\b").strip("\n").splitlines()
        return [".nf", *(_text(row) for row in rows), ".fi"]
    return [_text(" ".join(text.split()))]


def _text(text: str) -> str:
    """Return a line that roff takes as text, even if it begins like a request."""
    return "\\&" + _plain(text) if text.startswith((".", "'")) else _plain(text)


def _plain(text: str) -> str:
    """Escape a text so that `man` shows its backslashes and hyphens unchanged."""
    return text.replace("\\", "\\e").replace("-", "\\-")
