"""What a model is worth: what it does not know, what it promises of a print, what of it may act.

`budget` is what a fit leaves unknown, as a section of the saved model; `unexplained` what its residuals hold beyond
noise; `predict` turns both into the expected error of a file with a 90 % range. What the tests of misfit found goes
into the section ``misfit``; `effects` is what it may do to a new print.
"""
