"""The paper's partially observed decision problem for reinforcement learning; needs the extra ``[rl]``.

``gymnasium.make("printmend/Print-v0")`` after ``import printmend_lab.env``: a new fault every episode, nothing
measured is ever observed. ``"printmend/OnePrint-pulley-loose-damaged-v1"`` and its kin,
`OnePrint-{family}-{severity}-v1` for the families of `SCENES`: first a test print and its scan, then the print.
"""

import gymnasium

from printmend_lab.env.agents import (
    algorithm1_agent,
    learning_agent,
    naive_agent,
    one_naive_agent,
    open_loop_agent,
    planning_agent,
    probing_controls,
    random_agent,
    score_agent,
)
from printmend_lab.env.fleet import SCENES, random_layer
from printmend_lab.env.one_print_env import KEPT_SEED, OnePrintEnv, OnePrintVectorEnv
from printmend_lab.env.print_env import PrintEnv, PrintVectorEnv, draw_damaged

__all__ = [
    "KEPT_SEED",
    "SCENES",
    "OnePrintEnv",
    "OnePrintVectorEnv",
    "PrintEnv",
    "PrintVectorEnv",
    "algorithm1_agent",
    "draw_damaged",
    "learning_agent",
    "naive_agent",
    "one_naive_agent",
    "open_loop_agent",
    "planning_agent",
    "probing_controls",
    "random_agent",
    "random_layer",
    "score_agent",
]

if "printmend/Print-v0" not in gymnasium.registry:
    gymnasium.register(
        "printmend/Print-v0",
        entry_point="printmend_lab.env.print_env:PrintEnv",
        vector_entry_point="printmend_lab.env.print_env:PrintVectorEnv",
    )
    for _severity, _families in SCENES.items():
        for _family in _families:
            gymnasium.register(
                f"printmend/OnePrint-{_family}-{_severity}-v1",
                entry_point="printmend_lab.env.one_print_env:OnePrintEnv",
                vector_entry_point="printmend_lab.env.one_print_env:OnePrintVectorEnv",
                kwargs={"family": _family, "severity": _severity},
            )
