"""The commands that this package adds to `printmend`: who needs it → command → one line of help.

The module `printmend_lab.cli.NAME` holds the command.
"""

COMMANDS = {
    "For researchers": {
        "paper": "See the paper's experiment: break, learn from one layer, plan, print again.",
        "body": "Show what a mesh or G-code file becomes: layers and steps.",
        "bench": "Judge learners and planners: Table I, every fault, real data, test prints.",
        "dataset": "Build, check and fetch data sets of bodies printed on broken printers.",
        "figures": "Draw the paper's figures and its Table I from a data set.",
        "selfrepair": "A broken printer prints its own timing pulley, again and again.",
        "curiosity": "Choose test prints until a promise is met, and compare other ways.",
        "new": "Begin a package with a learner or a planner of your own.",
        "conformance": "Check that a learner, a planner or a fault of your own obeys the laws.",
    }
}
