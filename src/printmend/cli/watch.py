"""`printmend watch`: mend every file that is put into a folder."""

from functools import partial
from pathlib import Path

import click

from printmend.cli.model import ModelType
from printmend.cli.terminal import Finite, echo, tell
from printmend.messages import say, together


@click.command(epilog="Example: printmend watch jobs/ mended/ -m printer.mend.json")
@click.argument("source", metavar="IN", type=click.Path(path_type=Path, file_okay=False))
@click.argument("target", metavar="OUT", type=click.Path(path_type=Path, file_okay=False))
@click.option(
    "-m", "--model", "model_path", required=True, metavar="NAME|printer.mend.json", type=ModelType(),
    help="What `printmend learn` wrote about this printer; read again when it changes.",
)  # fmt: skip
@click.option("--every", "every_s", type=Finite(min=0.1, max=3600), default=2.0, show_default=True,
              help="Seconds between checks; a file that changes between two is still being copied.")  # fmt: skip
@click.option("--once", is_flag=True, help="Mend what is there, and end.")
@click.option("--force", is_flag=True, help="Write even if the prediction is not better.")
@click.option("--json", "as_json", is_flag=True, help="A line of JSON for each file.")
@click.option("--quiet", is_flag=True, help="Print only errors.")
@click.pass_context
def command(
    ctx: click.Context, source: Path, target: Path, model_path: Path, every_s: float, once: bool, force: bool,
    as_json: bool, quiet: bool,
) -> None:  # fmt: skip
    """Mend all G-code that is in the folder IN or comes into it, to OUT under the same name, until it is stopped.

    If a file cannot be mended, OUT/NAME.error.txt says why. A test print that `printmend probe` wrote is copied: it
    must show the printer as it is. A file that this model mended is copied, too. A restart continues where it left off:
    a file is mended once, and again when it has changed.
    """
    from printmend.mend.many import Watch, watch

    try:
        job = Watch(
            source,
            target,
            model_path,
            force=force,
            told=lambda words: echo(together("", ["printmend: ", words]), err=True),
        )
        worst = watch(job, every_s=every_s, once=once, tell=partial(tell, as_json=as_json, quiet=quiet))
    except KeyboardInterrupt:
        echo(say("terminal-watch-stopped"), err=True)
        ctx.exit(130)
    if worst:
        ctx.exit(worst)
