"""PrusaSlicer as a function: a solid in, G-code out, the same bytes every time.

The profile ships with the package (`profiles/ender5_abs.ini`); bed and centre come from the printer.
"""

import contextlib
import hashlib
import os
import re
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator
from importlib import resources
from pathlib import Path

from printmend.errors import MeshError, MissingToolError
from printmend.files import replacing
from printmend.printer import Printer
from printmend_lab.body.solid import Solid, refuse_oversize, stl_bytes

TIMEOUT_S = 600.0  # for one part

_PROGRAM = "prusa-slicer"
_SKIRT_ROOM_MM = 8.0  # the profile's skirt, on both sides
# Of the settings that a slicer writes into its G-code, those that shape the layers.
_SHAPING = (
    "layer_height", "first_layer_height", "initial_layer_print_height", "nozzle_diameter", "extrusion_width",
    "line_width", "perimeters", "wall_loops", "top_solid_layers", "top_shell_layers", "bottom_solid_layers",
    "bottom_shell_layers", "fill_density", "sparse_infill_density", "fill_pattern", "sparse_infill_pattern",
    "support_material", "enable_support", "skirts", "skirt_loops", "brim_width", "spiral_vase", "spiral_mode",
)  # fmt: skip
_END_BYTES = 1 << 16  # of a file's head and of its tail, where slicers write them
_DATE = re.compile(rb" on \d{4}-\d\d-\d\d at \d\d:\d\d:\d\d UTC", re.ASCII)


def profile_text() -> str:
    """Return the slicer profile: Ender-5, 0.4 mm nozzle, ABS, 0.2 mm layers."""
    return (resources.files("printmend_lab.body") / "profiles" / "ender5_abs.ini").read_text(encoding="utf-8")


def slice_solid(solid: Solid, printer: Printer, *, timeout_s: float = TIMEOUT_S) -> bytes:
    """Slice in the middle of the printer's bed and return the G-code.

    Raises MissingToolError without PrusaSlicer, MeshError where the body does not fit, where the slicer finds
    nothing to print, and where it needs more than ``timeout_s`` seconds.
    """
    program = shutil.which(_PROGRAM)
    if program is None:
        raise MissingToolError(
            _PROGRAM, wanted="PrusaSlicer on PATH, to slice a mesh", came="none",
            todo="apt-get install prusa-slicer, or give G-code from any slicer",
        )  # fmt: skip
    refuse_oversize(solid, printer)
    with tempfile.TemporaryDirectory(prefix="printmend-slice-") as name:
        folder = Path(name)
        (folder / "profile.ini").write_text(profile_text(), encoding="utf-8")
        (folder / "body.stl").write_bytes(stl_bytes(solid))
        try:
            with _steady() as prefix:
                code, said = _run([*prefix, program, *_arguments(solid, printer, folder)], folder, timeout_s)
        except subprocess.TimeoutExpired:
            raise MeshError(
                solid.name, wanted=f"a body that slices within {timeout_s:g} s",
                came=f"{len(solid.faces)} triangles that take longer", todo="decimate the mesh, or slice it yourself",
            ) from None  # fmt: skip
        output = folder / "body.gcode"
        if code != 0 or not output.is_file():
            raise MeshError(
                solid.name, wanted="a body that PrusaSlicer can slice", came=_complaint(said, code),
                todo="turn it onto a flat side, or check its size and unit",
            )  # fmt: skip
        head, newline, rest = output.read_bytes().partition(b"\n")
        return _DATE.sub(b"", head) + newline + rest


def slice_to(solid: Solid, printer: Printer, folder: Path, *, timeout_s: float = TIMEOUT_S) -> Path:
    """Slice into ``folder`` once and return the G-code's path; the name holds a hash of body, profile and bed.

    A second call with the same body returns the file that is there, so that benchmarks resume.
    """
    path = Path(folder) / f"{re.sub(r'[^A-Za-z0-9._-]', '_', solid.name)[:80]}-{_key(solid, printer)}.gcode"
    if not path.exists():
        gcode = slice_solid(solid, printer, timeout_s=timeout_s)
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path, "wb") as file:
            file.write(gcode)
    return path


def slicing_of(gcode: Path) -> dict[str, str]:
    """Return how a G-code file says it was sliced: the ``program``, and the settings that shape its layers.

    Slic3r and its descendants write their settings as comments. Settings that the file lacks are left out.
    """
    with Path(gcode).open("rb") as file:
        head = file.read(_END_BYTES)
        file.seek(max(file.seek(0, os.SEEK_END) - _END_BYTES, 0))
        ends = (head + b"\n" + file.read()).decode("utf-8", "replace")
    found = {}
    if program := re.search(r"^; ?generated (?:by|with) (.+?)(?: on \d.*)?\r?$", ends, re.IGNORECASE | re.MULTILINE):
        found["program"] = program[1][:80]
    said = dict(re.findall(r"^; (\w+) = (.*?)\r?$", ends, re.MULTILINE))
    return {**found, **{name: said[name][:80] for name in _SHAPING if name in said}}


def _key(solid: Solid, printer: Printer) -> str:
    digest = hashlib.sha256(stl_bytes(solid))
    digest.update(profile_text().encode())
    digest.update(repr(_arguments(solid, printer, Path())).encode())
    return digest.hexdigest()[:16]


def _arguments(solid: Solid, printer: Printer, folder: Path) -> list[str]:
    x, y, z = printer.axes
    corners = [(x.min_mm, y.min_mm), (x.max_mm, y.min_mm), (x.max_mm, y.max_mm), (x.min_mm, y.max_mm)]
    skirt_fits = (solid.size_mm[:2] + _SKIRT_ROOM_MM <= [x.length_mm, y.length_mm]).all()
    return [
        "--export-gcode",
        *("--loglevel", "1"),
        *("--load", str(folder / "profile.ini")),
        *("--bed-shape", ",".join(f"{cx:g}x{cy:g}" for cx, cy in corners)),
        *("--max-print-height", f"{z.max_mm:g}"),
        *("--center", f"{(x.min_mm + x.max_mm) / 2:g},{(y.min_mm + y.max_mm) / 2:g}"),
        *(() if skirt_fits else ("--skirts", "0")),
        *("--output", str(folder / "body.gcode")),
        str(folder / "body.stl"),
    ]


def _run(arguments: list[str], folder: Path, timeout_s: float) -> tuple[int, bytes]:
    """Run the slicer; return its exit code and its stderr. Nothing that it started outlives this call."""
    with subprocess.Popen(  # noqa: S603 (a fixed program, a list of arguments, no shell)
        arguments, cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        # HOME inside the folder: the user's own slicer settings must not leak in.
        env={**os.environ, "HOME": str(folder), "LC_ALL": "C"}, start_new_session=True,
    ) as process:  # fmt: skip
        try:
            _, said = process.communicate(timeout=timeout_s)
        except BaseException:
            # What is on PATH may be a wrapper, which leaves the slicer running when it alone is ended.
            if hasattr(os, "killpg"):
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
            process.kill()
            raise
    return process.returncode, said


@contextlib.contextmanager
def _steady() -> Iterator[list[str]]:
    """Return the prefix that makes PrusaSlicer repeat itself: fixed addresses and one processor.

    Its paths depend on the order of pointers and of threads. If the system refuses either, slicing still works, but two
    runs may differ in the order of equal islands.
    """
    prefix = []
    if (setarch := shutil.which("setarch")) and _works([setarch, "-R", "true"]):
        prefix += [setarch, "-R"]
    taskset = shutil.which("taskset")
    if taskset is None or not hasattr(os, "sched_getaffinity"):
        yield prefix
        return
    with _processor() as number:
        yield [*prefix, taskset, "-c", str(number)]


@contextlib.contextmanager
def _processor() -> Iterator[int]:
    """Return the number of a processor on which no other slicing of this user runs, or any if none is free."""
    import fcntl  # systems without affinities have no fcntl

    numbers = sorted(os.sched_getaffinity(0))
    with contextlib.ExitStack() as held:
        for number in numbers:
            path = Path(tempfile.gettempdir()) / f"printmend-{os.getuid()}-slices-on-{number}"
            try:
                file = held.enter_context(os.fdopen(os.open(path, os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW, 0o600)))
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:  # held by another, or nowhere to say so
                continue
            break
        else:
            number = numbers[os.getpid() % len(numbers)]
        yield number


def _works(command: list[str]) -> bool:
    return subprocess.run(command, capture_output=True, check=False).returncode == 0  # noqa: S603 (fixed words)


def _complaint(stderr: bytes, code: int) -> str:
    """Return the slicer's own reason, in one line."""
    lines = [line.strip() for line in stderr.decode("utf-8", "replace").splitlines()]
    lines = [line for line in lines if line and not line.startswith(("[", "Object name"))]
    if lines:
        return f"“{' '.join(lines)[:160]}”"
    return f"exit code {code} without a reason" if code >= 0 else f"a crash ({signal.strsignal(-code)})"
