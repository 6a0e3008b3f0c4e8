"""Environment steps a second for 1024 prints side by side, with the mean return of each agent; then of the paper's
problem with its test print and scan, stepped at random.

python benchmarks/bench_env.py [--envs 1024] [--ticks 500] [--json]
"""

import argparse
import json
import time

import numpy as np

from printmend_lab.env import (
    OnePrintVectorEnv,
    PrintVectorEnv,
    algorithm1_agent,
    naive_agent,
    planning_agent,
    random_agent,
)


def measured(envs: int, ticks: int) -> list[dict]:
    env = PrintVectorEnv(envs, ticks=ticks)
    started = time.perf_counter()
    env.reset(seed=1)
    reset_s = time.perf_counter() - started
    actions = np.random.default_rng(0).integers(0, 7, (64, envs, 2))
    fixed = iter(np.tile(actions, (1 + 2 * ticks // 64, 1, 1, 1)).reshape(-1, envs, 2))
    agents = {
        "environment alone": lambda _: next(fixed),
        "random": random_agent(np.random.default_rng(0)),
        "naive": naive_agent,
        "algorithm 1": algorithm1_agent(env),
        "look-ahead": planning_agent(env),
    }
    rows = []
    for name, agent in agents.items():
        observation, _ = env.reset(seed=1)
        observation, *_ = env.step(agent(observation))  # compile
        observation, _ = env.reset(seed=1)
        started = time.perf_counter()
        for _ in range(ticks):
            observation, reward, _terminated, _truncated, _info = env.step(agent(observation))
        seconds = time.perf_counter() - started
        rows.append(
            {
                "agent": name,
                "envs": envs,
                "steps_per_s": round(envs * ticks / seconds),
                "mean_return_steps": round(float(reward.mean()), 3),
                "median_return_steps": round(float(np.median(reward)), 3),
                "reset_with_pools_s": round(reset_s, 2),
            }
        )
    return rows


def one_print(envs: int) -> dict:
    """Return the steps a second of the paper's problem, over one episode and the beginning of the next."""
    env = OnePrintVectorEnv(envs)
    env.reset(seed=1)
    actions = np.random.default_rng(0).integers(0, 7, (64, envs, 2))
    env.step(actions[0])  # compile
    env.reset()
    started, steps = time.perf_counter(), 0
    done = np.zeros(envs, bool)
    while not done.all():
        _, _, done, _, _ = env.step(actions[steps % 64])
        steps += 1
    env.step(actions[0])
    return {
        "agent": "one print, random",
        "envs": envs,
        "steps_per_s": round(envs * steps / (time.perf_counter() - started)),
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--envs", type=int, default=1024)
    parser.add_argument("--ticks", type=int, default=500)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    one = one_print(given.envs)
    print(json.dumps(one) if given.json else "{agent:18} {steps_per_s:>12,} steps/s".format(**one))
    for row in measured(given.envs, given.ticks):
        print(
            json.dumps(row)
            if given.json
            else "{agent:18} {steps_per_s:>12,} steps/s   return {mean_return_steps:9.3f}".format(**row)
        )
