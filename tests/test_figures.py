"""`printmend figures`: the paper's figures and table, from a data set of this test's own."""

from pathlib import Path

import numpy as np
from click.testing import CliRunner

from printmend.cli.main import group
from printmend.demo.figures import latex_table, similarity_figure
from tests.bodies import write_vase


def run(*arguments: object) -> str:
    done = CliRunner().invoke(group, [str(one) for one in arguments], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


def test_a_data_set_becomes_the_papers_figures(tmp_path: Path) -> None:
    vase, data, out = write_vase(tmp_path / "vase.gcode", layers=4, radius_mm=9.0), tmp_path / "data", tmp_path / "out"
    run("dataset", "build", "--bodies", vase, "--corruptions", 1, "-o", data)
    text = run("figures", "--dataset", data, "--models", "naive,oracle", "-o", out)
    for number in range(1, 7):
        svg = (out / f"figure{number}.svg").read_text()
        assert svg.startswith("<?xml")
        assert svg.rstrip().endswith("</svg>")
    families = run("bench", "families", "--dataset", data, "--rows", "oracle+greedy", "--out", tmp_path / "families")
    family, bodies, oracle, ratio, best, one = families.splitlines()[-1].split()
    assert (family, bodies, one) == ("pulley", "1", "(1.00)")
    assert float(best) <= float(oracle)
    assert float(ratio.strip("()")) >= 1.0
    naive = next(line for line in text.splitlines() if line.startswith("naive")).split()
    assert float(naive[2]) > 1.0
    assert naive[-1] == "27.6", "the paper's own figure stands beside"
    assert f"naive & 1 & {naive[2]}" in (out / "table1.tex").read_text()
    assert f"| naive | 1 | {naive[2]} |" in " ".join((out / "table1.md").read_text().split())


def test_latex_is_escaped() -> None:
    text = latex_table(("a", "÷ b"), [("x_1", "–")])
    assert text.splitlines()[2] == r"a & $\div$ b \\"
    assert r"x\_1 & -- \\" in text


def test_the_two_measures_of_fig_4_disagree() -> None:
    by_area, by_points = (
        [float(word.split()[0]) for word in axes.get_title().splitlines()[1:]] for axes in similarity_figure().axes
    )
    assert by_area[0] < by_points[0]
    assert by_points[1] < by_area[1]
    assert np.isfinite([by_area, by_points]).all()
