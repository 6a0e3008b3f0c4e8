"""`printmend figures`: what its figures and tables rest on; integrations/tests/test_chains.py draws them all."""

import numpy as np

from printmend_lab.demo.figures import latex_table, similarity_figure


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
