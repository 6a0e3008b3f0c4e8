"""`printmend completion`: print the script that lets a shell complete commands, options and model names."""

import click
from click.shell_completion import get_completion_class

from printmend.messages import say


@click.command(epilog="Example: printmend completion bash >> ~/.bashrc")
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@click.pass_context
def command(ctx: click.Context, shell: str) -> None:
    """Print the script that completes printmend's commands, options and models in SHELL."""
    kind = get_completion_class(shell)
    if kind is None:
        raise click.UsageError(say("terminal-usage-shell", shell))
    click.echo(kind(ctx.find_root().command, {}, "printmend", "_PRINTMEND_COMPLETE").source())
