"""`printmend bench`: the paper's tables over your own bodies."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from printmend_lab.cli.table import with_executor

if TYPE_CHECKING:
    from printmend_lab.bench.case import Result

# `printmend bench objectives`: plans for the RMSE or for the area.

NAMES = ("rmse", "area")


# Its many parameters are its options.
@click.command(
    short_help="Does planning for the area instead of the RMSE pay?",
    epilog="Example: printmend bench objectives --objective area --families pulley-loose",
)
@click.option("--objective", "chosen", multiple=True, type=click.Choice(NAMES), help="Repeat; all without it.")
@click.option("--body", type=click.Path(path_type=Path), help="A G-code file or mesh; without it, a timing pulley.")
@click.option("--families", default="pulley,pulley-play,pulley-loose", show_default=True, help="With commas.")
@click.option("--severity", type=click.Choice(["damaged", "realistic", "paper"]), default="damaged", show_default=True)
@click.option("--learner", default="greybox", show_default=True, help="Whose model to plan with; oracle is the truth.")
@click.option("--layers", type=click.IntRange(1), default=2, show_default=True, help="How many to hold out and print.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@click.option("--printer", default="ender5", show_default=True, help="A preset or a TOML file.")
@with_executor
@click.option("-o", "--out", type=click.Path(path_type=Path), default="printmend-objectives", show_default=True)
@click.option("--json", "as_json", is_flag=True, help="The table as JSON on stdout.")
def objectives(
    chosen: tuple[str, ...], body: Path | None, families: str, severity: Any, learner: str, layers: int, seed: int,
    printer: str, executor: Any, out: Path, as_json: bool,
) -> None:  # fmt: skip
    """Learn from one layer, plan others for each objective, print them, measure them by every metric.

    Results go to OUT/objectives.jsonl; an interrupted run continues where it left off.
    """
    from printmend.cli.terminal import progress
    from printmend_lab.bench.objectives import HEADER, cells, objective_cases, objectives_table
    from printmend_lab.cli.table import show_failures, show_table

    cases = objective_cases(
        body, families=families.split(","), severity=severity, layers=layers, seed=seed, printer=printer
    )
    with progress("faults", len(cases)) as tick:
        lines, results = objectives_table(cases, chosen or NAMES, out, learner=learner, executor=executor, tick=tick)
    if as_json:
        click.echo(json.dumps([asdict(line) for line in lines]))
    else:
        show_table(f"Planned for, then measured: {cases[0].body}", HEADER, [cells(line) for line in lines])
    show_failures(results)


# `printmend bench families`: every learner and controller on every family of faults.


def numbers(text: str) -> tuple[float, ...]:
    """Read numbers with commas."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise click.BadParameter(f"expected numbers with commas, found {text!r}") from None


# Its many parameters are its options.
@click.command(
    short_help="Every family of faults: learners, controllers, noise, coverage.",
    epilog="Example: printmend bench families --families pulley-loose,smooth --samples 3 --out families",
)
@click.option(
    "--families", help="FAMILY, FAMILY+screw, FAMILY@PRINTER, with commas. Default: all; a wrong one lists them."
)
@click.option("--dataset", type=click.Path(path_type=Path), help="The bodies and faults of `printmend dataset build` "
              "instead: a line for each of its families.")  # fmt: skip
@click.option("--severity", type=click.Choice(["both", "damaged", "realistic"]), default="both", show_default=True)
@click.option("--rows", help="LEARNER+CONTROLLER, with commas; optimum comes with them.")
@click.option("--noise", default="0,0.05,0.1", show_default=True, help="Of the measurement, mm a coordinate.")
@click.option("--coverage", default="0.5,1,2.5", show_default=True, help="Turns of a motor that the body is across.")
@click.option("--samples", type=click.IntRange(1), default=3, show_default=True, help="Faults drawn a family.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@click.option("--test", is_flag=True, help="The seed kept for the published tables, instead of --seed.")
@with_executor
@click.option("-o", "--out", type=click.Path(path_type=Path), default="printmend-families", show_default=True)
@click.option("--json", "as_json", is_flag=True, help="The cells as JSON on stdout.")
def families(
    families: str | None, dataset: Path | None, severity: str, rows: str | None, noise: str, coverage: str,
    samples: int, seed: int, test: bool, executor: Any, out: Path, as_json: bool,
) -> None:  # fmt: skip
    """Print bodies on random faults of every family: learn from the first layer's noisy scan, print the others.

    A cell is the mean RMSE in full steps, with its ratio to the optimum: the optimal controller on the true machine.
    Results go to OUT/families.jsonl, the tables to OUT/families.md and OUT/families.csv; an interrupted run goes on
    where it was.
    """
    from printmend.cli.terminal import progress
    from printmend_lab.bench.families import (
        FAMILIES,
        ROWS,
        SEVERITIES,
        TEST_SEED,
        draw_family_cases,
        families_table,
        family_cells,
        family_tables,
        write_families,
    )
    from printmend_lab.cli.table import show_failures, show_table

    if dataset is not None:
        _over_dataset(
            dataset, rows.split(",") if rows else list(ROWS), TEST_SEED if test else seed, executor, out, as_json
        )
        return
    noises, coverages = numbers(noise), numbers(coverage)
    cases = draw_family_cases(
        families.split(",") if families else FAMILIES, coverages=coverages, samples=samples,
        severities=[name for name in SEVERITIES if severity in ("both", name)], seed=TEST_SEED if test else seed,
    )  # fmt: skip
    with progress("cases", len(cases)) as tick:
        chosen = rows.split(",") if rows else ROWS
        results = families_table(cases, chosen, noises, out, executor=executor, tick=tick)
    cells = family_cells(results, noises)
    write_families(out, cells, coverages, noises)
    if as_json:
        click.echo(json.dumps({"cells": [asdict(cell) for cell in cells]}))
    else:
        for title, header, lines in family_tables(cells, coverages, noises):
            show_table(title, header, lines)
    show_failures(results)


def _over_dataset(root: Path, rows: list[str], seed: int, executor: Any, out: Path, as_json: bool) -> None:
    from printmend.cli.terminal import progress
    from printmend_lab.bench.case import OPTIMUM
    from printmend_lab.bench.report import write_markdown
    from printmend_lab.bench.table1 import by_family, dataset_cases, table1
    from printmend_lab.cli.table import show_failures, show_table

    rows = list(dict.fromkeys([*rows, OPTIMUM]))
    cases = dataset_cases(root, protocol="heldout", seed=seed)
    with progress("bodies", len(cases)) as tick:
        _, results = table1(cases, rows, out, executor=executor, tick=tick)
    header, lines = by_family(results, rows)
    write_markdown(out / "families.md", header, lines)
    if as_json:
        click.echo(json.dumps({"families": [dict(zip(header, line, strict=True)) for line in lines]}))
    else:
        show_table(f"mean RMSE in steps (ratio to the optimum), {len(cases)} bodies", header, lines)
    show_failures(results)


# `printmend bench measured`: every learner on measured data.


@click.command(
    short_help="Every learner on measured data.",
    epilog="Example: printmend bench measured measured/ --models naive,backlash,greybox",
)
@click.argument("folder", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--sets", help="Names of sets, with commas. Default: all; a wrong one lists them.")
@click.option("--models", help="Learners, with commas. Default: ours, the paper's and those of other trades.")
@with_executor
@click.option("-o", "--out", type=click.Path(path_type=Path), default="printmend-measured", show_default=True)
@click.option("--json", "as_json", is_flag=True, help="The results as JSON on stdout.")
def measured(folder: Path, sets: str | None, models: str | None, executor: Any, out: Path, as_json: bool) -> None:
    """Learn from one part of each measured set below FOLDER, predict the other.

    A cell is what a learner misses as a share of what a straight line misses. The splits are fixed. For a set that is
    not there, its place below FOLDER and the command that fetches it are printed. Results go to OUT/measured.jsonl, the
    table to OUT/measured.md; an interrupted run continues where it left off.
    """
    from printmend.cli.terminal import progress
    from printmend.errors import InputError
    from printmend_lab.bench.measured import ROWS, measured_cases, measured_lines, measured_table
    from printmend_lab.bench.report import write_markdown
    from printmend_lab.cli.table import show_failures, show_table

    cases, absent = measured_cases(folder, sets.split(",") if sets else ())
    for item in absent:
        click.echo(f"absent: {item.name}, expected at {folder / item.place} ({item.licence}): {item.fetch}", err=True)
    if not cases:
        raise InputError(folder, wanted="a measured set", came="none", todo="fetch one as said above")
    with progress("sets", len(cases)) as tick:
        rows = models.split(",") if models else ROWS
        results = measured_table(cases, rows, out, executor=executor, tick=tick)
    header, lines = measured_lines(results)
    write_markdown(out / "measured.md", header, lines)
    if as_json:
        click.echo(json.dumps([item.flat() for item in results]))
    else:
        show_table(f"Missed, as a share of what a straight line misses, {len(cases)} sets", header, lines)
    show_failures(results)


# `printmend bench prints`: which test print teaches most.


@click.command(
    short_help="Which test print teaches most: prints, points, noise.",
    epilog="Example: printmend bench prints --prints fixed,layer,optimal --points 250 --samples 2 --out prints",
)
@click.option("--prints", help="Test prints, with commas. Default: the designs of `probe` and eight shapes.")
@click.option("--families", help="Faults to draw from, with commas.")
@click.option("--points", default="60,250,1000", show_default=True, help="Measured points.")
@click.option("--noise", default="0,0.05,0.1", show_default=True, help="Of the measurement, mm a coordinate.")
@click.option("--samples", type=click.IntRange(1), default=2, show_default=True, help="Faults drawn a family.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@with_executor
@click.option("-o", "--out", type=click.Path(path_type=Path), default="printmend-prints", show_default=True)
@click.option("--json", "as_json", is_flag=True, help="Every result as JSON on stdout.")
def prints(
    prints: str | None, families: str | None, points: str, noise: str, samples: int, seed: int, executor: Any,
    out: Path, as_json: bool,
) -> None:  # fmt: skip
    """Make test prints on randomly damaged printers, learn from each, and print a body with what was learned.

    A cell is the bodies' mean RMSE in full steps, with its ratio to the optimum: the best plan on the true machine.
    Results go to OUT/prints.jsonl and the table to OUT/prints.md; an interrupted run continues where it left off.
    """
    from printmend.cli.terminal import progress
    from printmend_lab.bench import prints as bench
    from printmend_lab.bench.report import write_markdown
    from printmend_lab.cli.table import show_failures, show_table

    counts, noises = tuple(int(count) for count in numbers(points)), numbers(noise)
    cases = bench.draw_print_cases(families.split(",") if families else bench.FAMILIES, samples=samples, seed=seed)
    chosen = prints.split(",") if prints else bench.PRINTS
    with progress("cases", len(cases)) as tick:
        results = bench.prints_table(cases, chosen, counts, noises, out, executor=executor, tick=tick)
    if as_json:
        click.echo(json.dumps([item.flat() for item in results]))
    header, lines = bench.print_lines(results, counts, noises)
    write_markdown(out / bench.MARKDOWN, header, lines)
    if not as_json:
        show_table(f"Test prints, {len(cases)} damaged printers", header, lines)
    show_failures(results)


# `printmend bench real`: measured traverses, learned from the first, predicted the later.


@click.command(
    short_help="Learn from real traverses, predict later ones.",
    epilog="Example: printmend bench real position_error_by_travel.csv",
)
@click.argument("data", type=click.Path(path_type=Path))
@with_executor
@click.option("-o", "--out", type=click.Path(path_type=Path), default="printmend-real", show_default=True)
@click.option("--json", "as_json", is_flag=True, help="The table as JSON on stdout.")
def real(data: Path, executor: Any, out: Path, as_json: bool) -> None:
    """Learn from the first measured traverse of each direction, predict the later ones.

    DATA is a CSV of traverses, or a clone of RenzoCab/Non-Circular-Pulleys with motion capture of real pulleys.
    The floor is the scatter of the later traverses about their own mean. Results go to OUT/real.jsonl; an interrupted
    run continues where it left off.
    """
    from printmend.cli.terminal import progress
    from printmend_lab.bench.real import HEADER, cells, real_cases, real_table
    from printmend_lab.bench.traverse import read_runs
    from printmend_lab.cli.table import show_failures, show_table

    cases = real_cases(data, read_runs(data))
    with progress("pulleys and speeds", len(cases)) as tick:
        lines, results = real_table(cases, out, executor=executor, tick=tick)
    if as_json:
        click.echo(json.dumps({"lines": [asdict(line) for line in lines]}))
    else:
        show_table("Measured traverses", HEADER, [cells(line) for line in lines])
    show_failures(results)


# `printmend bench suite` and `submit-check`: rows on suites that do not change.

_ROWS = "naive,greybox+optimal,meta+optimal"
_REASONS = 3  # of failed cases that are printed; the file has all


@click.command(epilog="Example: printmend bench suite printmend/Families-v1 --rows greybox+optimal -o results")
@click.argument("name", metavar="SUITE", required=False)
@click.option("--rows", help=f"With commas. Default: {_ROWS}; where nothing is planned, without +optimal.")
@click.option("--data", type=click.Path(path_type=Path, exists=True, file_okay=False), help="Folder of measured sets.")
@with_executor
@click.option("--out", "-o", type=click.Path(path_type=Path), default="printmend-suite", show_default=True)
@click.option("--json", "as_json", is_flag=True, help="The results as JSON lines on stdout.")
def suite(name: str | None, rows: str | None, data: Path | None, executor: Any, out: Path, as_json: bool) -> None:
    """Run rows on a suite that never changes.

    Its seed, bodies, splits and metrics are frozen. Without a SUITE, all are listed. Measured-v1 wants the --data that
    `printmend bench measured` reads, and says how to fetch what is missing. Its rows are learners without a planner.
    Each row becomes a file OUT/SUITE/ROW.json with its figures, cost, versions and every case. An interrupted run
    continues where it left off.
    """
    from printmend.cli.terminal import progress
    from printmend.errors import InputError
    from printmend_lab.bench.suites import SUITES, run_suite, write_result
    from printmend_lab.bench.suites import suite as suite_of

    if name is None:
        for one in SUITES.values():
            click.echo(f"{one.name}  {one.count} cases  {one.about}")
        return
    chosen = suite_of(name)
    if chosen.measured != (data is not None):
        todo = "add --data FOLDER" if chosen.measured else "leave --data out"
        raise InputError(chosen.name, wanted="--data" if chosen.measured else "no --data",
                         came="none" if chosen.measured else f"{data}", todo=todo)  # fmt: skip
    asked = rows or (_ROWS.replace("+optimal", "") if chosen.measured else _ROWS)
    for row in dict.fromkeys(asked.split(",")):
        with progress("cases", chosen.count) as tick:
            record = run_suite(chosen, row, out / "work", data=data, executor=executor, tick=tick)
        path = write_result(record, out)
        found, first = record["metrics"], chosen.metrics[0]
        figure = "–" if found[first] is None else f"{found[first]:.3f}{'' if chosen.measured else ' steps'}"
        said = f"{chosen.name} {row}: {first} {figure}, {found['failures']} failed; wrote {path}"
        click.echo(json.dumps(record) if as_json else said)
        for reason in list(dict.fromkeys(record.get("failures", {}).values()))[:_REASONS]:
            click.echo(f"failed: {reason}", err=True)


@click.command("submit-check", epilog="Example: printmend bench submit-check results/Families-v1/greybox+optimal.json")
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))
def submit_check(files: tuple[Path, ...]) -> None:
    """Check results of `bench suite`: checksum, cases, figures."""
    from printmend_lab.bench.suites import check_submission

    for path in files:
        record = check_submission(path)
        click.echo(f"{path}: {record['row']} on {record['suite']}, whole")


@click.group(epilog="Example: printmend bench table1 --bodies models/ --limit 20 --workers 2")
def command() -> None:
    """Judge learners and planners: Table I, every fault, measured data, test prints."""


command.add_command(real)
command.add_command(measured)
command.add_command(families)
command.add_command(prints)
command.add_command(objectives)
command.add_command(suite)
command.add_command(submit_check)


# Its many parameters are its options.
@command.command(epilog="Example: printmend bench table1 --bodies models/ --protocol heldout --limit 60 --workers 2")
@click.option(
    "--bodies",
    multiple=True,
    type=click.Path(path_type=Path),
    help="Files, folders, or generated:N for N bodies that are made here; repeat.",
)
@click.option(
    "--reference", type=click.Path(path_type=Path), help="A data set in the published layout, instead of --bodies."
)
@click.option(
    "--dataset", type=click.Path(path_type=Path), help="A data set of `printmend dataset build`, instead of --bodies."
)
@click.option("--every-printer", is_flag=True, help="With --dataset: each body on all of its printers, not on one.")
@click.option("--protocol", type=click.Choice(["paper", "heldout", "covered"]), default="paper", show_default=True)
@click.option("--families", default="pulley", show_default=True, help="Corruptions to draw from, with commas.")
@click.option("--severity", type=click.Choice(["damaged", "realistic", "paper"]), default="damaged", show_default=True)
@click.option(
    "--printer", default="ender5", show_default=True, help="A preset, for --bodies; `printmend printer` lists them."
)
@click.option(
    "--models", help="Rows, with commas: LEARNER or LEARNER+CONTROLLER. Default: the paper's and the grey box."
)
@click.option("--objective", type=click.Choice(NAMES), help="Plan every learned row for this; else as the row says.")
@click.option("--seed", default=0, show_default=True)
@click.option("--limit", type=click.IntRange(1), help="How many bodies to draw; all without it.")
@with_executor
@click.option("-o", "--out", type=click.Path(path_type=Path), default="printmend-bench", show_default=True)
@click.option("--per-body", is_flag=True, help="Also the RMSE of every body; always with --reference.")
@click.option("--json", "as_json", is_flag=True, help="The table as JSON on stdout.")
def table1(
    bodies: tuple[Path, ...], reference: Path | None, dataset: Path | None, every_printer: bool, protocol: Any,
    families: str, severity: Any, printer: str, models: str | None, objective: str | None, seed: int, limit: int | None,
    executor: Any, out: Path, per_body: bool, as_json: bool,
) -> None:  # fmt: skip
    """Print the paper's Table I. Results go to OUT/table1.jsonl, Fig. 6 to OUT/figure6-*.png.

    Each body is printed on a broken printer (on each, with --every-printer), a model learns from its largest layer, and
    up to three random layers are planned and printed: any layers with --protocol paper, never the training layer with
    heldout. With covered, the training layer shows the most of both motors' turns, and is not judged. An interrupted
    run continues where it left off; OUT/sliced keeps the G-code of meshes.
    """
    from printmend.cli.terminal import progress
    from printmend.extras import require
    from printmend_lab.bench.case import PAPER_ROWS, libraries, planned_for
    from printmend_lab.bench.table1 import dataset_cases, draw_cases, parts, reference_cases, table1
    from printmend_lab.cli.table import show_failures
    from printmend_lab.dataset.bodies import body_files

    rows = tuple(models.split(",")) if models else PAPER_ROWS
    if objective is not None:
        rows = tuple(dict.fromkeys(planned_for(name, objective) for name in rows))
    require("printmend bench table1", "matplotlib", *libraries(rows))
    if sum(map(bool, (bodies, reference, dataset))) != 1:
        raise click.UsageError("give --bodies or --reference or --dataset, one of them")
    if every_printer and dataset is None:
        raise click.UsageError("--every-printer needs --dataset, whose printers it means")
    if dataset is not None:
        cases = dataset_cases(dataset, protocol=protocol, seed=seed, limit=limit, every_printer=every_printer)
    elif reference is not None:
        cases = reference_cases(reference, protocol=protocol, seed=seed, limit=limit)
    else:

        def left_out(path: Path, why: str) -> None:
            click.echo(f"left out {path.name}: {why}", err=True)

        files = body_files(bodies, made=out / "generated", seed=seed, left_out=left_out)
        cases = draw_cases(
            files, protocol=protocol, families=tuple(families.split(",")), severity=severity, seed=seed, limit=limit,
            sliced=out / "sliced", printer=printer,
        )  # fmt: skip
    with progress("bodies", len(cases)) as tick:
        lines, results = table1(cases, rows, out, executor=executor, tick=tick)
    if as_json:
        table = [asdict(line) for line in lines]
        by_play = {part.title: [asdict(line) for line in part.lines] for part in parts(results, rows)}
        bodies_ = [item.flat() for item in results]
        click.echo(json.dumps({"table": table, "parts": by_play, "bodies": bodies_}))
    else:
        what = f"{len({case.body for case in cases})} bodies" + every_printer * " on every printer"
        _show(results, rows, f"Table I, protocol {protocol}, {what}", per_body=per_body or reference is not None)
    show_failures(results)


def _show(results: "Sequence[Result]", rows: Sequence[str], title: str, *, per_body: bool) -> None:
    """Print the table, one each for families with play and without it, and what to know of its rows."""
    from printmend_lab.bench.report import body_table, left_texts
    from printmend_lab.bench.table1 import HEADER, cells, parts, stands_still
    from printmend_lab.cli.table import show_table

    found = parts(results, rows)
    for part in found:
        families = f", families {part.title}" if len(found) > 1 else ""
        show_table(title + families, HEADER, [cells(line) for line in part.lines])
    if per_body:
        click.echo("\n" + body_table(results, rows))
    for text in left_texts(results):
        click.echo(text)
    if worse := stands_still(results, rows):
        click.echo(
            f"Worse than naive: {', '.join(worse)}, planned by the paper's Algorithm 1, which stands still where "
            f"play swallows a step; {worse[-1]}+optimal crosses it."
        )
