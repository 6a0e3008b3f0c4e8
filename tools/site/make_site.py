"""Make the play screen as a folder that any static host serves: python tools/site/make_site.py [FOLDER]

The page is the studio's own. Its law is translated from the program's kernels (`translate.py`). What *Mend it* shows is
made here by the program, once for each preset: measured, learned and mended as in the studio. For other faults the
page mends by itself, with the planner's kernels in JavaScript, for a printer that is known exactly.
"""

import gzip
import hashlib
import json
import shutil
import sys
import tempfile
from pathlib import Path

import page_parts

from printmend.messages import messages_of, page_messages
from printmend.studio import work
from printmend.studio.app import PAGE

HERE = Path(__file__).parent
MOST_BYTES = 15_000_000
_SHOWN = (work.WANTED, work.MENDED)  # files of a play that the page fetches


def presets() -> dict[str, dict]:
    """Return the faults of the page's buttons."""
    text = (PAGE / "presets.js").read_text(encoding="utf-8")
    return dict(json.loads(text[text.index("{") :].rstrip().rstrip(";")))


def make(folder: Path, names: list[str]) -> int:
    """Write the page with the plays ``names`` to ``folder``; return how many bytes it has."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(PAGE, folder, ignore=shutil.ignore_patterns("stream.js", "*.sha256"))
    for name in ("api.js", "faults.js", "planner.js", "planner-worker.js"):
        shutil.copy(HERE / name, folder / name)
    (folder / "law.js").write_text(page_parts.law(), encoding="utf-8")
    (folder / "kernels").mkdir()
    for name, text in page_parts.planner().items():
        (folder / "kernels" / name).write_text(text, encoding="utf-8")
    (folder / "part.packed").write_bytes(gzip.compress(json.dumps(page_parts.part()).encode(), mtime=0))
    (folder / "printer.json").write_text(json.dumps(page_parts.printer() | {"base": names[0]}), encoding="utf-8")
    (folder / "messages.json").write_text(json.dumps(page_messages(), ensure_ascii=False), encoding="utf-8")
    for name in names:
        _play(folder / "plays" / name, name, presets()[name])
    files = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    digest = hashlib.sha256(b"".join((folder / name).read_bytes() for name in files)).hexdigest()[:12]
    worker = (HERE / "sw.js").read_text(encoding="utf-8")
    worker = worker.replace("VERSION", digest, 2).replace('["FILES"]', json.dumps(["./", *files]))
    (folder / "sw.js").write_text(worker, encoding="utf-8")
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def _play(folder: Path, name: str, faults: dict) -> None:
    """Run a play as the studio does, and keep what its page shows."""
    folder.mkdir(parents=True)
    with tempfile.TemporaryDirectory(prefix="printmend-") as data:
        result = work.run("play", str(Path(data) / "job"), data, {"faults": faults})
        if "error" in result:
            raise SystemExit(f"{name}: {result['error']}")
        made = [file for file in result["files"] if file in _SHOWN]
        for file in made:
            (folder / f"{file}.packed").write_bytes(gzip.compress((Path(data) / "job" / file).read_bytes(), mtime=0))
    job = {"id": name, "kind": "play", "state": "done", "share": 1, "step": "", "files": made, "error": None,
           "result": {**result, "messages": messages_of(result)}}  # fmt: skip
    (folder / "job.json").write_text(json.dumps(job), encoding="utf-8")


if __name__ == "__main__":
    where = Path(sys.argv[1] if len(sys.argv) > 1 else "build/site/demo")
    size = make(where, list(presets()))
    print(f"{where}: {size / 1e6:.1f} MB")
    if size > MOST_BYTES:
        raise SystemExit(f"wanted at most {MOST_BYTES / 1e6:g} MB, got {size / 1e6:.1f}")
