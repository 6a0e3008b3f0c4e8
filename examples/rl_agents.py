"""Play the paper's decision problem with four agents: random, Naive, and two that know the true machine.

pip install 'printmend-lab[rl]' && python examples/rl_agents.py

The belts are loose. Algorithm 1, the paper's planner, then does far worse than Naive, though its model is perfect: it
takes the control whose imagined result is nearest to the next target, and inside the play no control changes the
result, so that the motor never gets through. An agent that takes up the play for the move after that does not wait.
"""

import numpy as np

from printmend_lab.env import PrintVectorEnv, algorithm1_agent, naive_agent, planning_agent, random_agent


def mean_return(env: PrintVectorEnv, agent, ticks: int) -> float:
    """Play one episode in every environment; the return is −RMSE in full steps."""
    observation, _ = env.reset(seed=1)
    for _ in range(ticks):
        observation, reward, _terminated, _truncated, _info = env.step(agent(observation))
    return float(reward.mean())


def returns(envs: int = 256, ticks: int = 500) -> dict[str, float]:
    """Return the mean return of each agent."""
    env = PrintVectorEnv(envs, ticks=ticks)
    agents = {
        "random": random_agent(np.random.default_rng(0)),
        "Naive": naive_agent,
        "Algorithm 1, true machine": algorithm1_agent(env),
        "look-ahead, true machine": planning_agent(env),
    }
    return {name: mean_return(env, agent, ticks) for name, agent in agents.items()}


if __name__ == "__main__":
    for name, value in returns().items():
        print(f"{name:28} mean return {value:9.3f} steps")
