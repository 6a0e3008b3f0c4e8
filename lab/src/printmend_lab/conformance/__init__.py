"""What every learner, controller and family of faults must keep, those of other packages too.

The tests run it on all that come with printmend, `printmend conformance my_module:MINE` on one's own. A check is a
function of a candidate that raises `AssertionError` with the reason where it is not kept.
"""

from printmend_lab.conformance.run import KINDS, CheckOutcome, conformance, kind_of

__all__ = ["KINDS", "CheckOutcome", "conformance", "kind_of"]
