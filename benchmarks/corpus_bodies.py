"""How many real files become bodies, and why the others do not.

    .venv/bin/python benchmarks/corpus_bodies.py ../shared/corpus/stl ../shared/corpus/gcode --out FOLDER

Each mesh is sliced (PrusaSlicer, at most --timeout seconds), each G-code file is read; all go through layers to
controls on an Ender-5. FOLDER/bodies.jsonl gets one line a file and FOLDER/sliced keeps the G-code: a second run
repeats only the table.
"""

import argparse
import json
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from printmend.errors import PrintmendError
from printmend.gcode.read import read_gcode
from printmend.printer import read_printer
from printmend_lab.body import body_of, load_body
from printmend_lab.body.layers import is_mesh, layers_of, strokes_of
from printmend_lab.body.slicer import slice_to
from printmend_lab.dataset.bodies import body_files, digest


def evaluate(path: Path, sliced: Path, timeout_s: float) -> dict:
    """Return one file's row; ``reason`` is empty for a body, ``layers`` is 0 where not even layers came out."""
    printer, notes, started = read_printer("ender5"), [], time.perf_counter()
    mesh = is_mesh(path)
    row = {"file": f"{path.parent.name}/{path.name}", "digest": digest(path), "kind": "mesh" if mesh else "G-code"}
    row |= {"layers": 0, "points": 0, "reason": ""}
    try:
        if mesh:
            from printmend_lab.body.mesh import read_solid

            solid = read_solid(path)
            notes += solid.notes
            gcode = slice_to(solid, printer, sliced, timeout_s=timeout_s)
            row |= {"triangles": len(solid.faces), "gcode": gcode.name}
            body = body_of(str(gcode), printer, name=path.stem, note=notes.append)
        else:
            row["layers"] = len(layers_of(strokes_of(read_gcode(path, printer=printer)), printer))
            body = load_body(path, printer, note=notes.append)
        row |= {"layers": len(body.layers), "points": body.transitions}
    except PrintmendError as error:
        row["reason"] = f"wanted {error.wanted}, got {error.came}"
    return row | {"notes": notes, "seconds": round(time.perf_counter() - started, 2)}


def rows(files: list[Path], out: Path, workers: int, timeout_s: float) -> Iterator[dict]:
    """Yield every file's row, done before or now."""
    log = out / "bodies.jsonl"
    done = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
    known = {(row["file"], row["digest"]): row for row in done}
    todo = []
    for path in files:
        row = known.get((f"{path.parent.name}/{path.name}", digest(path)))
        if row:
            yield row
        else:
            todo.append(path)
    with log.open("a", encoding="utf-8") as file, ProcessPoolExecutor(workers) as pool:
        for future in as_completed([pool.submit(evaluate, path, out / "sliced", timeout_s) for path in todo]):
            file.write(json.dumps(future.result()) + "\n")
            file.flush()
            yield future.result()


def report(table: list[dict]) -> str:
    """Return the table in Markdown."""
    lines = ["| kind | files | become layers | become bodies (≥ 1000 points) | points | seconds, median and largest |"]
    lines.append("|---|---|---|---|---|---|")
    for kind in ("mesh", "G-code"):
        own = [row for row in table if row["kind"] == kind]
        bodies, seconds = [row for row in own if not row["reason"]], sorted(row["seconds"] for row in own)
        if own:
            lines.append(
                f"| {kind} | {len(own)} | {sum(row['layers'] > 0 for row in own)} | {len(bodies)} "
                f"| {sum(row['points'] for row in bodies):,} | {seconds[len(seconds) // 2]:.2f}, {seconds[-1]:.1f} |"
            )
    table = sorted(table, key=lambda row: row["file"])
    lines += ["", "| not a body | why |", "|---|---|"]
    lines += [f"| {row['file']} | {row['reason']} |" for row in table if row["reason"]]
    lines += ["", "| changed on the way | what |", "|---|---|"]
    lines += [f"| {row['file']} | {'; '.join(row['notes'])} |" for row in table if row["notes"]]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("paths", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--timeout", type=float, default=120.0)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    files = body_files(options.paths)
    print(report(list(rows(files, options.out, options.workers, options.timeout))))


if __name__ == "__main__":
    main()
