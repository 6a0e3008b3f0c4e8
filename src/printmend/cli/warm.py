"""`printmend warm`: compile now, not while a print waits."""

import click

from printmend.cli.terminal import echo
from printmend.messages import say, say_count


@click.command(epilog="Example: printmend warm")
def command() -> None:
    """Compile now what learn, check and mend would compile at their first use on this machine."""
    from printmend.cli.terminal import progress
    from printmend.mend.warm import STEPS, warm

    with progress("compiling", len(STEPS)) as done:
        entries, seconds = warm(done)
    if entries:
        echo(say_count("terminal-warm-done", entries, f"{seconds:.0f}"))
    else:
        echo(say("terminal-warm-already"))
