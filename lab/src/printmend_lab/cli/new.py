"""`printmend new`: begin a learner or a controller of your own."""

from pathlib import Path

import click


@click.group(epilog="Example: printmend new learner my-network")
def command() -> None:
    """Begin a package with a learner or a controller of your own: code that works, entry point, test, README."""


def _begin(kind: str, name: str, out: Path) -> None:
    from printmend_lab.conformance.begin import begin_package

    for path in begin_package(kind, name, out):
        click.echo(path)
    package = name.replace("-", "_")
    click.echo(f"next: cd {out / name} && PYTHONPATH=src printmend conformance {package}.{kind}:MINE")


_where = click.option(
    "--out", "-o", type=click.Path(path_type=Path, file_okay=False), default=Path(), show_default="here",
    help="The folder in which the package's own folder is made.",
)  # fmt: skip


@command.command(epilog="Example: printmend new learner my-network")
@click.argument("name")
@_where
def learner(name: str, out: Path) -> None:
    """Begin a package NAME with a learner: one motor's waves by least squares, to be replaced by yours."""
    _begin("learner", name, out)


@command.command(epilog="Example: printmend new controller my-planner")
@click.argument("name")
@_where
def controller(name: str, out: Path) -> None:
    """Begin a package NAME with a controller: what is missing, tick by tick, to be replaced by yours."""
    _begin("controller", name, out)
