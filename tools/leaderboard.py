"""Make docs/leaderboard.md of the results in docs/leaderboard; `make docs` runs it.

.venv/bin/python tools/leaderboard.py
"""

from pathlib import Path

from printmend.files import replacing
from printmend_lab.bench.suites import leaderboard

DOCS = Path(__file__).parents[1] / "docs"


def main() -> None:
    with replacing(DOCS / "leaderboard.md") as file:
        file.write(leaderboard(DOCS / "leaderboard"))


if __name__ == "__main__":
    main()
