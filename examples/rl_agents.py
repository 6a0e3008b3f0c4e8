"""Play the paper's decision problem with three agents: random, Naive, and Algorithm 1 with a perfect model.

pip install 'printmend[rl]' && python examples/rl_agents.py
"""

import numpy as np

from printmend.env import PrintVectorEnv, algorithm1_agent, naive_agent, random_agent


def mean_return(env: PrintVectorEnv, agent, ticks: int) -> float:
    """Play one episode in every environment; the return is −RMSE in full steps."""
    observation, _ = env.reset(seed=1)
    for _ in range(ticks):
        observation, reward, _terminated, _truncated, _info = env.step(agent(observation))
    return float(reward.mean())


if __name__ == "__main__":
    ticks = 500
    env = PrintVectorEnv(256, ticks=ticks)
    agents = {
        "random": random_agent(np.random.default_rng(0)),
        "Naive": naive_agent,
        "Algorithm 1 (Oracle)": algorithm1_agent(env),
    }
    for name, agent in agents.items():
        print(f"{name:22} mean return {mean_return(env, agent, ticks):9.3f} steps")
