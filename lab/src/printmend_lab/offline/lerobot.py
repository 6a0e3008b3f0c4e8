"""LeRobot's data set format, version 3.0 (github.com/huggingface/lerobot), without LeRobot.

`data/chunk-000/file-000.parquet` has a row for each step, `meta/` says what the columns are and where an episode
begins. What the agent sees of motors and targets is `observation.state`, all else `observation.NAME`, flat.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from printmend.files import replacing
from printmend_lab.offline.episodes import Episode, fresh

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
    _json(root / "meta" / "stats.json", {name: _stats(values) for name, values in columns.items()})
    _json(root / "meta" / "info.json", {
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


def _json(path: Path, value: dict[str, Any]) -> None:
    with replacing(path) as file:
        file.write(json.dumps(value, indent=1))
