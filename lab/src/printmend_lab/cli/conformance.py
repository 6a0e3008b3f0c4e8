"""`printmend conformance`: does a learner, a controller, a family of faults or an effect keep what it must?"""

import json
from dataclasses import asdict

import click


@click.command(epilog="Example: printmend conformance my_package.my_module:MY_LEARNER")
@click.argument("name", metavar="NAME|MODULE:NAME")
@click.option("--json", "as_json", is_flag=True, help="The outcomes as JSON on stdout.")
@click.pass_context
def command(ctx: click.Context, name: str, as_json: bool) -> None:
    """Run the suite that everything in printmend passes on a learner, a controller, a family of faults or an effect.

    A line for each check, with the reason if it fails; ends with 2 if one does.
    """
    from printmend_lab.conformance import conformance, kind_of

    kind, outcomes = kind_of(name), []
    for outcome in conformance(name):
        outcomes.append(outcome)
        if not as_json:
            click.echo(f"ok      {outcome.check}" if outcome.reason is None else f"FAILED  {outcome.check}")
            if said := outcome.reason or outcome.note:
                click.echo(f"        {said}")
    failed = sum(outcome.reason is not None for outcome in outcomes)
    if as_json:
        click.echo(json.dumps({"name": name, "kind": kind, "checks": [asdict(outcome) for outcome in outcomes]}))
    else:
        click.echo(f"{kind} {name}: {len(outcomes) - failed} of {len(outcomes)} checks kept")
    if failed:
        ctx.exit(2)
