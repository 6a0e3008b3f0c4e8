"""`printmend warm`: compile now, not while a print waits."""

import click


@click.command(epilog="Example: printmend warm")
def command() -> None:
    """Compile now what learn, check and mend would compile when they are first used on this machine."""
    from printmend.cli.progress import progress
    from printmend.mend.warm import STEPS, warm

    with progress("compiling", len(STEPS)) as done:
        entries, seconds = warm(done)
    if entries:
        click.echo(f"Compiled {entries} kernels in {seconds:.0f} s: learn, check and mend start at once from now on.")
    else:
        click.echo("Nothing to do: all is compiled for this machine.")
