"""What a model is worth: what it does not know, what it promises of a print, what of it may act.

`budget` is what a fit leaves unknown, as a section of the saved model; `unexplained` what its residuals hold beyond
noise; `predict` turns both into the expected error of a file with a 90 % range.

Seam: where a saved model has a section ``misfit`` with ``unexplained``, a table of cause → {"rms_mm", "sd_mm"} (what
that cause may add to the error of a new print, root mean square over both axes, and the standard deviation of this
figure), `budget.parse_budget` takes them in; each shows under its own name in what a promise is made of.
"""
