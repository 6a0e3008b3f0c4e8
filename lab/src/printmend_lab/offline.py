"""Episodes of the one-print environments as files that other programs read: Minari's format, and LeRobot's."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from printmend.errors import ConfigError, InputError
from printmend.files import replacing
from printmend.printer import read_printer
from printmend_lab.env import SCENES
from printmend_lab.env.agents import OneAgent, learning_agent, one_naive_agent
from printmend_lab.executor import program_version

__all__ = ["Episode", "record", "write_lerobot", "write_minari"]

# Let an agent play a one-print environment, and keep what it saw, did and got.

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


# LeRobot's data set format, version 3.0 (github.com/huggingface/lerobot), without LeRobot.
#
# `data/chunk-000/file-000.parquet` has a row for each step, `meta/` says what the columns are and where an episode
# begins. What the agent sees of motors and targets is `observation.state`, all else `observation.NAME`, flat.

FPS = 50  # of the environment's picture: ticks have no time of their own
_STATE = "now"
_FILE = "chunk-000/file-000.parquet"
_PATTERN = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}


def write_lerobot(folder: Path, episodes: Sequence[Episode], *, task: str, robot: str) -> Path:
    """Write episodes of one ``task`` as a LeRobot data set into ``folder``, and return it.

    ``LeRobotDataset(repo_id, root=folder)`` reads it. Raises `InputError` where something is there already.
    """
    root = fresh(folder)
    columns = _columns(episodes)
    for name in ("data/chunk-000", "meta/episodes/chunk-000"):
        (root / name).mkdir(parents=True)
    _table(root / "data" / _FILE, columns)
    lengths = np.array([len(one) for one in episodes])
    ends = np.cumsum(lengths)
    count, zeros = len(episodes), np.zeros(len(episodes), np.int64)
    _table(root / "meta" / "episodes" / _FILE, {
        "episode_index": np.arange(count), "tasks": [[task]] * count, "length": lengths,
        "dataset_from_index": ends - lengths, "dataset_to_index": ends,
        "data/chunk_index": zeros, "data/file_index": zeros,
        "meta/episodes/chunk_index": zeros, "meta/episodes/file_index": zeros,
        "seed": np.array([one.seed for one in episodes]),
        **{name: np.array([one.ends[name] for one in episodes]) for name in episodes[0].ends},
    })  # fmt: skip
    _tasks(root / "meta" / "tasks.parquet", task)
    _indented_json(root / "meta" / "stats.json", {name: _stats(values) for name, values in columns.items()})
    _indented_json(root / "meta" / "info.json", {
        "codebase_version": "v3.0", "robot_type": robot, "fps": FPS, "total_episodes": count,
        "total_frames": int(ends[-1]), "total_tasks": 1, "chunks_size": 1000, "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200, "splits": {"train": f"0:{count}"}, "data_path": f"data/{_PATTERN}",
        "video_path": None, "features": {name: _feature(values) for name, values in columns.items()},
    })  # fmt: skip
    return root


def _columns(episodes: Sequence[Episode]) -> dict[str, np.ndarray]:
    """Return a column [frames, …] for each feature, in order."""
    found: dict[str, np.ndarray] = {}
    for name in episodes[0].observations:
        parts = [one.observations[name][:-1].reshape(len(one), -1) for one in episodes]
        found["observation.state" if name == _STATE else f"observation.{name}"] = _plain(np.concatenate(parts))
    found["action"] = np.concatenate([one.actions for one in episodes]).astype(np.float32)
    found["next.reward"] = np.concatenate([one.rewards for one in episodes]).astype(np.float32)
    found["next.done"] = np.concatenate([np.arange(len(one)) == len(one) - 1 for one in episodes])
    frame = np.concatenate([np.arange(len(one)) for one in episodes])
    found["timestamp"] = (frame / FPS).astype(np.float32)
    found["frame_index"] = frame
    found["episode_index"] = np.repeat(np.arange(len(episodes)), [len(one) for one in episodes])
    found["index"] = np.arange(len(frame))
    found["task_index"] = np.zeros(len(frame), np.int64)
    return found


def _plain(values: np.ndarray) -> np.ndarray:
    """Return a column of numbers where its lists have one each."""
    return values[:, 0] if values.shape[1] == 1 else values


def _feature(values: np.ndarray) -> dict[str, Any]:
    return {"dtype": str(values.dtype), "shape": list(values.shape[1:]) or [1], "names": None}


def _stats(values: np.ndarray) -> dict[str, Any]:
    """Return what a policy is normalised by, over all frames."""
    rows = values.reshape(len(values), -1).astype(float)
    found = {"min": rows.min(axis=0), "max": rows.max(axis=0), "mean": rows.mean(axis=0), "std": rows.std(axis=0)}
    found |= {name: np.quantile(rows, share, axis=0) for name, share in _QUANTILES.items()}
    return {name: value.tolist() for name, value in found.items()} | {"count": [len(rows)]}


def _table(path: Path, columns: dict[str, Any]) -> None:
    import pyarrow
    import pyarrow.parquet

    arrays = []
    for values in columns.values():
        if isinstance(values, np.ndarray) and values.ndim == 2:
            kind = pyarrow.list_(pyarrow.from_numpy_dtype(values.dtype), values.shape[1])
            arrays.append(pyarrow.FixedSizeListArray.from_arrays(values.reshape(-1), type=kind))
        else:
            arrays.append(pyarrow.array(values))
    pyarrow.parquet.write_table(pyarrow.Table.from_arrays(arrays, list(columns)), path, compression="zstd")


def _tasks(path: Path, task: str) -> None:
    """Write the table of tasks, whose words are the index of a data frame."""
    import pyarrow
    import pyarrow.parquet

    def column(name: str | None, field: str, kind: str, stored: str) -> dict[str, Any]:
        return {"name": name, "field_name": field, "pandas_type": kind, "numpy_type": stored, "metadata": None}

    index = "__index_level_0__"
    frame = {
        "index_columns": [index], "column_indexes": [], "pandas_version": "2.0.0",
        "columns": [column("task_index", "task_index", "int64", "int64"), column(None, index, "unicode", "object")],
    }  # fmt: skip
    table = pyarrow.table({"task_index": [0], index: [task]}).replace_schema_metadata({"pandas": json.dumps(frame)})
    pyarrow.parquet.write_table(table, path)


def _indented_json(path: Path, value: dict[str, Any]) -> None:
    with replacing(path) as file:
        file.write(json.dumps(value, indent=1))


# Minari's format (minari.farama.org), its Parquet form, without Minari.
#
# `data/metadata.json` describes the set, `data/K/part-0.parquet` is episode K: T + 1 rows, the last without an action.

_FORM_OF = "0.5.4"  # the version of Minari whose form this is; 0.5 and later read it
_BYTES_A_MB = 1e6


def write_minari(
    folder: Path, episodes: Sequence[Episode], env: gymnasium.Env, *, name: str, algorithm: str, author: str
) -> Path:
    """Write episodes of ``env`` as the Minari data set ``name`` below ``folder``, and return its own folder.

    With the folder in MINARI_DATASETS_PATH, ``minari.load_dataset(name)`` reads it. Raises `InputError` where something
    is there already.
    """
    import pyarrow.parquet

    root = fresh(Path(folder) / name)
    data = root / "data"
    for number, episode in enumerate(episodes):
        (data / str(number)).mkdir(parents=True)
        table = pyarrow.Table.from_batches([_batch(episode, env)])
        pyarrow.parquet.write_table(table, data / str(number) / "part-0.parquet", compression="zstd")
        _json(data / str(number) / "metadata.json",
              {"id": number, "total_steps": len(episode), "seed": episode.seed, **episode.ends})  # fmt: skip
    size = sum(path.stat().st_size for path in data.rglob("*.parquet")) / _BYTES_A_MB
    _json(data / "metadata.json", {
        "dataset_id": name, "data_format": "parquet", "jpeg_encoding": False, "minari_version": _FORM_OF,
        "total_episodes": len(episodes), "total_steps": sum(map(len, episodes)), "dataset_size": round(size, 3),
        "observation_space": json.dumps(_space(env.observation_space)),
        "action_space": json.dumps(_space(env.action_space)),
        "env_spec": env.spec.to_json() if env.spec else None,
        "algorithm_name": algorithm, "author": [author], "requirements": ["printmend-lab[rl]"],
        "description": f"Episodes of printmend {program_version()}: a test print, its scan, and a print.",
    })  # fmt: skip
    return root


def _batch(episode: Episode, env: gymnasium.Env) -> Any:
    import pyarrow

    spaces = env.observation_space.spaces  # type: ignore[attr-defined]
    seen = [_column(spaces[name], episode.observations[name]) for name in spaces]
    rows = len(episode) + 1
    ended = np.arange(rows) == len(episode) - 1
    infos = [pyarrow.array(np.full(rows, value)) for value in episode.ends.values()]
    return pyarrow.RecordBatch.from_pydict(
        {
            "observations": pyarrow.StructArray.from_arrays(seen, names=list(spaces)),
            "actions": _column(env.action_space, np.concatenate([episode.actions, episode.actions[:1] * 0])),
            "rewards": np.append(episode.rewards, 0.0),
            "terminations": ended,
            "truncations": np.zeros(rows, bool),
            "infos": pyarrow.StructArray.from_arrays(infos, names=list(episode.ends)),
        }
    )


def _column(space: gymnasium.Space, values: np.ndarray) -> Any:
    """Return a column of lists of the space's length, or of numbers where it is Discrete."""
    import pyarrow

    if isinstance(space, gymnasium.spaces.Discrete):
        return pyarrow.array(values.astype(np.int64).reshape(-1))
    flat = values.reshape(len(values), -1).astype(space.dtype)
    kind = pyarrow.list_(pyarrow.from_numpy_dtype(space.dtype), flat.shape[1])
    return pyarrow.FixedSizeListArray.from_arrays(flat.reshape(-1), type=kind)


def _space(space: gymnasium.Space) -> dict[str, Any]:
    """Return a space as Minari writes it."""
    if isinstance(space, gymnasium.spaces.Dict):
        return {"type": "Dict", "subspaces": {name: _space(one) for name, one in space.spaces.items()}}
    if isinstance(space, gymnasium.spaces.Box):
        ends = {"low": space.low.tolist(), "high": space.high.tolist()}
        return {"type": "Box", "dtype": str(space.dtype), "shape": list(space.shape), **ends}
    if isinstance(space, gymnasium.spaces.MultiDiscrete):
        ends = {"nvec": space.nvec.tolist(), "start": space.start.tolist()}
        return {"type": "MultiDiscrete", "dtype": str(space.dtype), **ends}
    assert isinstance(space, gymnasium.spaces.Discrete)
    return {"type": "Discrete", "dtype": "int64", "start": int(space.start), "n": int(space.n)}


def _json(path: Path, value: dict[str, Any]) -> None:
    with replacing(path) as file:
        file.write(json.dumps(value))
