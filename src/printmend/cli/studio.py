"""`printmend studio`: everything in the browser."""

import sys
from datetime import UTC, datetime
from pathlib import Path

import click
from click.core import ParameterSource

from printmend.cli.terminal import echo
from printmend.messages import say


# Its many parameters are its options.
@click.group(invoke_without_command=True, epilog="Example: printmend studio")
@click.option("--host", default="127.0.0.1", show_default=True, help="Where it listens. From other computers "
              "it lets in known devices only; the address for the first one is printed once.")  # fmt: skip
@click.option("--port", type=click.IntRange(0, 65535), default=8765, show_default=True, help="0 takes a free one.")
@click.option("--name", "names", multiple=True, metavar="NAME", help="A further name by which browsers reach it.")
@click.option("--no-browser", is_flag=True, help="Do not open a browser.")
@click.option("--folder", type=click.Path(path_type=Path, file_okay=False), help="Keep everything below this folder "
              "[default: the system's folders for a user's programs]")  # fmt: skip
@click.option("--device", metavar="NAME", help="Let in another device, print its address, and end.")
@click.option("--user", default="", metavar="USER", help="With --device: whose printers it sees; all without one.")
@click.option("--revoke", metavar="NAME", help="Revoke a device, and end.")
@click.option("--devices", is_flag=True, help="List the devices that are let in, and end.")
@click.option("--workers", type=click.IntRange(1, 64), default=2, show_default=True, help="Jobs at a time.")
@click.option(
    "--most-gb", type=click.FloatRange(0.1), default=20.0, show_default=True, help="Largest size of its folder."
)
@click.option("--cluster", help="Run jobs on Dask workers that share the folder: tcp://HOST:PORT of a scheduler, or "
              "local:N.")  # fmt: skip
@click.pass_context
def command(
    ctx: click.Context, host: str, port: int, names: tuple[str, ...], no_browser: bool, folder: Path | None,
    device: str | None, user: str, revoke: str | None, devices: bool, workers: int, most_gb: float, cluster: str | None,
) -> None:  # fmt: skip
    """Open printmend in the browser: your printers, measuring, mending, and a printer to break.

    The server listens on this computer only. It sends nothing anywhere but the files that you send to your printer.
    """
    if ctx.invoked_subcommand is not None:
        return
    from printmend.extras import require

    require(
        "printmend studio", "cv2", "fastapi", "httpx2", "matplotlib", "pebble", "PIL", "platformdirs", "reportlab",
        "scipy", "sqlalchemy", "uvicorn", *(["distributed"] if cluster else []),
    )  # fmt: skip
    from printmend.studio.devices import Devices
    from printmend.studio.places import Places
    from printmend.studio.serve import let_in, serve

    places = Places.usual() if folder is None else Places.below(folder)
    if open_still := places.make():
        echo(say("terminal-studio-open-to-others", ", ".join(open_still)))
    if device is not None:
        require("printmend studio --device", "segno")
        given = any(ctx.get_parameter_source(each) == ParameterSource.COMMANDLINE for each in ("host", "port"))
        address = let_in(places.state, device, user, host=host, port=port, given=given)
        click.echo(f"{device}: {address}")
        if sys.stdout.isatty():
            _draw_code(address)
    if revoke is not None:
        Devices(places.state).revoke(revoke)
        echo(say("terminal-studio-revoked", revoke))
    if devices:
        for one in Devices(places.state).known():
            since = datetime.fromtimestamp(one.created_s, UTC).date().isoformat()
            of = say("terminal-device-of", one.name, one.user) if one.user else one.name
            echo(say("terminal-device-since", of, since))
    if device is None and revoke is None and not devices:
        serve(places, host=host, port=port, names=names, browser=not no_browser, workers=workers, cluster=cluster,
              most_gb=most_gb, told=echo)  # fmt: skip


@command.command("install-service", short_help="Start the studio with the computer.")
@click.option("--print", "only", is_flag=True, help="Show the file, and write nothing.")
@click.pass_context
def install_service(ctx: click.Context, only: bool) -> None:
    """Start the studio with the computer, as a user service of systemd, launchd or Windows.

    It gets the options that stand before `install-service`. Nothing is started: the commands for that are shown.
    """
    from printmend.studio.serve import service, write_service

    assert ctx.parent is not None
    made = service(_options(ctx.parent))
    if only:
        click.echo(f"# {made.path}\n{made.text}", nl=False)
    else:
        write_service(made)
        echo(say("written", made.path))
    click.echo("# To begin:\n" + "\n".join(made.begin) + "\n# To undo:\n" + "\n".join(made.undo))


def _options(ctx: click.Context) -> list[str]:
    """Return the options with which a command was called, as words."""
    given = []
    for option in ctx.command.params:
        value = ctx.params.get(str(option.name))
        if ctx.get_parameter_source(str(option.name)) != ParameterSource.COMMANDLINE:
            continue
        if option.name not in ("host", "port", "names", "folder", "workers", "most_gb", "cluster"):
            raise click.UsageError(say("terminal-usage-service", option.opts[0]))
        for one in value if isinstance(value, tuple) else [value]:
            given += [option.opts[0], str(one.resolve() if isinstance(one, Path) else one)]
    return given


def _draw_code(address: str) -> None:
    """Draw an address as a QR code that a phone reads from the terminal."""
    import segno

    segno.make(address).terminal(compact=True)
