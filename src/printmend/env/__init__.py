"""The paper's partially observed decision problem for reinforcement learning; needs the extra ``[rl]``.

``gymnasium.make("printmend/Print-v0")`` after ``import printmend.env``.
"""

import gymnasium

from printmend.env.agents import algorithm1_agent, naive_agent, planning_agent, random_agent
from printmend.env.fleet import random_layer
from printmend.env.print_env import PrintEnv, draw_damaged
from printmend.env.vector_env import PrintVectorEnv

__all__ = [
    "PrintEnv",
    "PrintVectorEnv",
    "algorithm1_agent",
    "draw_damaged",
    "naive_agent",
    "planning_agent",
    "random_agent",
    "random_layer",
]

if "printmend/Print-v0" not in gymnasium.registry:
    gymnasium.register(
        "printmend/Print-v0",
        entry_point="printmend.env.print_env:PrintEnv",
        vector_entry_point="printmend.env.vector_env:PrintVectorEnv",
    )
