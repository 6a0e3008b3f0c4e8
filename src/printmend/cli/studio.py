"""`printmend studio`: everything in the browser."""

from pathlib import Path

import click


@click.command(epilog="Example: printmend studio")
@click.option("--host", default="127.0.0.1", show_default=True, help="Where it listens. Any other than this computer "
              "needs a token, which is printed once.")  # fmt: skip
@click.option("--port", type=click.IntRange(0, 65535), default=8765, show_default=True, help="0 takes a free one.")
@click.option("--name", "names", multiple=True, metavar="NAME", help="A further name by which browsers reach it.")
@click.option("--no-browser", is_flag=True, help="Do not open a browser.")
@click.option("--folder", type=click.Path(path_type=Path, file_okay=False), help="Where everything is kept [default: a "
              "folder of the user's]")  # fmt: skip
@click.option("--workers", type=click.IntRange(1, 64), default=2, show_default=True, help="Jobs at a time.")
@click.option("--cluster", help="Run jobs on Dask workers instead, which see the folder, too: tcp://HOST:PORT of a "
              "scheduler, or local:N.")  # fmt: skip
def command(
    host: str, port: int, names: tuple[str, ...], no_browser: bool, folder: Path | None, workers: int,
    cluster: str | None,
) -> None:  # fmt: skip
    """Open printmend in the browser: your printers, measuring, mending, and a printer to break.

    The server listens on this computer only. It sends nothing anywhere but the files that you send to your printer.
    """
    from printmend.extras import require

    require(
        "printmend studio", "cv2", "fastapi", "httpx2", "matplotlib", "pebble", "PIL", "reportlab", "scipy",
        "sqlalchemy", "uvicorn", *(["distributed"] if cluster else []),
    )  # fmt: skip
    from printmend.studio.serve import serve

    folder = folder or Path(click.get_app_dir("printmend")) / "studio"
    folder.mkdir(parents=True, exist_ok=True)
    serve(folder, host=host, port=port, names=names, browser=not no_browser, workers=workers, cluster=cluster,
          told=lambda words: click.echo(words))  # fmt: skip
