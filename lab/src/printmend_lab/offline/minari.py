"""Minari's format (minari.farama.org), its Parquet form, without Minari.

`data/metadata.json` describes the set, `data/K/part-0.parquet` is episode K: T + 1 rows, the last without an action.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from printmend.files import replacing
from printmend_lab.executor import program_version
from printmend_lab.offline.episodes import Episode, fresh

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
