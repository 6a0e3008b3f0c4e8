"""Post-processing script for PrusaSlicer, OrcaSlicer, Bambu Studio and SuperSlicer: mends the file that was sliced.

    printmend-post -m printer.mend.json [--any-printer] [--or-print] FILE

The slicer puts FILE last and its settings into SLIC3R_*. What cannot be mended ends with 1 and a reason, and FILE is
replaced by a comment that says so, as some slicers leave it where it can be printed; --or-print leaves it as it was.
A file that is mended already stays as it is.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ALREADY = re.compile(r"(?:got|found) one that was mended with model (\w+)")
NAMES = ("SLIC3R_PRINTER_MODEL", "SLIC3R_PRINTER_SETTINGS_ID")


def other_printer(document: dict, environment: dict) -> str:
    """Return what contradicts: the model's printer and the slicer's, or nothing.

    Names agree where one holds the other, spaces and hyphens aside: "Creality Ender-3" and "ENDER3". A slicer without
    a name, or a model without one, contradicts nothing.
    """
    ours = [name for name in (document.get("name"), document.get("printer", {}).get("name")) if name]
    theirs = [environment[name] for name in NAMES if environment.get(name)]
    plain = [[re.sub(r"[^a-z0-9]", "", name.lower()) for name in names] for names in (ours, theirs)]
    if not ours or not theirs or any(a in b or b in a for a in plain[0] for b in plain[1]):
        return ""
    return f"the model is of {ours[0]!r}, but the file was sliced for {theirs[-1]!r}; use its model, or --any-printer"


def mended(command: str, model: str, source: Path, fresh: Path) -> str:
    """Write the mended file; return the reason where there is none."""
    try:
        done = subprocess.run(  # noqa: S603 — the printmend beside this Python
            [command, "mend", str(source), "-m", model, "-o", str(fresh)],
            capture_output=True, text=True, errors="replace", check=False, stdin=subprocess.DEVNULL,
        )  # fmt: skip
    except OSError as error:
        return f"{command}: {error.strerror or error}"
    print(done.stdout.replace(str(fresh), str(source)), end="")
    if done.returncode == 0:
        return ""
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    return lines[-1].removeprefix("printmend: ") if lines else f"printmend ended with {done.returncode}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-m", "--model", required=True)
    parser.add_argument("--any-printer", action="store_true", help="whatever the slicer calls this printer")
    parser.add_argument("--or-print", action="store_true", help="leave a file that cannot be mended as it was sliced")
    parser.add_argument("file", type=Path)
    options = parser.parse_args()
    command = shutil.which("printmend", path=str(Path(sys.executable).parent)) or shutil.which("printmend")
    # The slicer's name for the file may have no ending that printmend knows: the copy gets the real one.
    suffix = Path(os.environ.get("SLIC3R_PP_OUTPUT_NAME", "") or options.file.name).suffix or ".gcode"
    fresh = options.file.with_name(f".{options.file.name}.mended{suffix}")
    reason = "printmend is not installed beside this script's Python" if command is None else ""
    document = {}
    try:
        document = json.loads(Path(options.model).read_text(encoding="utf-8"))
        if not options.any_printer and isinstance(document, dict):
            reason = reason or other_printer(document, dict(os.environ))
    except (OSError, ValueError):
        pass  # printmend says it better
    try:
        reason = reason or mended(str(command), options.model, options.file, fresh)
        if not reason:
            os.replace(fresh, options.file)
            return 0
    finally:
        fresh.unlink(missing_ok=True)
    already = ALREADY.search(reason)
    if already and isinstance(document, dict) and already[1] == document.get("digest"):
        print(f"{options.file}: mended already")
        return 0
    if not options.or_print and not already:
        fresh.write_text("; not mended by printmend: " + " ".join(reason.split()) + "\n", encoding="utf-8")
        os.replace(fresh, options.file)
    print(f"printmend: {reason}", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
