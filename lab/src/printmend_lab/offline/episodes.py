"""Let an agent play a one-print environment, and keep what it saw, did and got."""

from dataclasses import dataclass
from pathlib import Path

import gymnasium
import numpy as np

from printmend.errors import ConfigError, InputError
from printmend.printer import read_printer
from printmend_lab.env import SCENES
from printmend_lab.env.agents import OneAgent, learning_agent, one_naive_agent

NAIVE = "naive"


@dataclass(frozen=True, eq=False)
class Episode:
    """An episode of T steps: ``observations`` {name: [T + 1, …]}, ``actions`` [T, 2], ``rewards`` [T], and the ends of
    its score {name: number} that no agent sees. It ends by itself; none is cut short."""

    seed: int
    observations: dict[str, np.ndarray]
    actions: np.ndarray
    rewards: np.ndarray
    ends: dict[str, float]

    def __len__(self) -> int:
        return len(self.actions)


def environment(family: str, severity: str) -> gymnasium.Env:
    """Make the one-print environment of a family. Raise `ConfigError` where none is registered."""
    known = SCENES.get(severity, ())  # type: ignore[call-overload]
    if family not in known:
        todo = "correct the name" if known else "damaged or realistic"
        raise ConfigError("family", wanted=f"one of {', '.join(known)}", came=repr(family), todo=todo)
    return gymnasium.make(f"printmend/OnePrint-{family}-{severity}-v1", disable_env_checker=True)


def agent_of(name: str, env: gymnasium.Env) -> OneAgent:
    """Return the agent that commands paths as they are (``naive``), or the one that plans by a learner of that name."""
    printer = read_printer(env.spec.kwargs.get("printer", "ender5"))  # type: ignore[union-attr]
    return one_naive_agent if name == NAIVE else learning_agent(name, printer)


def record(env: gymnasium.Env, agent: OneAgent, episodes: int, *, seed: int) -> list[Episode]:
    """Play ``episodes`` episodes; the k-th begins with the seed ``seed`` + k, so that any can be made again."""
    found = []
    for number in range(episodes):
        observation, info = env.reset(seed=seed + number)
        seen, actions, rewards, done = [observation], [], [], False
        while not done:
            action = agent({name: np.asarray(value)[None] for name, value in observation.items()})[0]
            observation, reward, ended, cut, _ = env.step(action)
            done = ended or cut
            seen.append(observation)
            actions.append(action)
            rewards.append(float(reward))
        together = {name: np.stack([np.asarray(one[name]) for one in seen]) for name in seen[0]}
        ends = {name: float(value) for name, value in info.items()}
        found.append(Episode(seed + number, together, np.array(actions), np.array(rewards), ends))
    return found


def fresh(folder: Path) -> Path:
    """Make a folder for a data set. Raise `InputError` where something lies in it already."""
    folder = Path(folder)
    if folder.exists() and any(folder.iterdir()):
        raise InputError(folder, wanted="an empty folder, or none", came="files", todo="name another -o")
    folder.mkdir(parents=True, exist_ok=True)
    return folder
