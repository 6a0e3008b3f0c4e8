"""Episodes as Minari and LeRobot read them: what is written is what was played."""

import json
from pathlib import Path

import gymnasium
import numpy as np
import pyarrow.parquet
import pytest
from click.testing import CliRunner

import printmend_lab.env  # noqa: F401 - registers the environments
from printmend.cli.main import group
from printmend.errors import ConfigError, InputError
from printmend_lab.env.agents import one_naive_agent
from printmend_lab.offline import Episode, environment, record, write_lerobot, write_minari

TICKS, PROBE = 30, 20


@pytest.fixture(scope="module")
def env() -> gymnasium.Env:
    return gymnasium.make("printmend/OnePrint-pulley-damaged-v1", ticks=TICKS, probe_ticks=PROBE)


@pytest.fixture(scope="module")
def episodes(env: gymnasium.Env) -> list[Episode]:
    return record(env, one_naive_agent, 3, seed=5)


def test_an_episode_can_be_made_again_from_its_seed_and_actions(env: gymnasium.Env, episodes: list[Episode]) -> None:
    one = episodes[2]
    assert len(one) == TICKS + PROBE
    observation, _ = env.reset(seed=one.seed)
    for tick, action in enumerate(one.actions):
        for name, value in observation.items():
            np.testing.assert_array_equal(value, one.observations[name][tick])
        observation, reward, done, _, _ = env.step(action)
        assert reward == one.rewards[tick]
    assert done
    assert one.rewards.sum() == pytest.approx(0.0, abs=1e-6)  # naive scores nothing


def test_minari_has_a_row_more_than_steps_and_the_spaces(
    env: gymnasium.Env, episodes: list[Episode], tmp_path: Path
) -> None:
    root = write_minari(tmp_path, episodes, env, name="printmend/made-v1", algorithm="naive", author="A. Nother")
    said = json.loads((root / "data" / "metadata.json").read_text())
    assert (said["total_episodes"], said["total_steps"]) == (3, 3 * (TICKS + PROBE))
    assert json.loads(said["env_spec"])["id"] == "printmend/OnePrint-pulley-damaged-v1"
    spaces = json.loads(said["observation_space"])["subspaces"]
    for number, one in enumerate(episodes):
        batch = pyarrow.parquet.read_table(root / "data" / str(number) / "part-0.parquet").to_batches()[0]
        assert batch.num_rows == len(one) + 1
        for name, written in spaces.items():
            column = batch["observations"].field(name).to_numpy(zero_copy_only=False)
            shape = written.get("shape", [])
            values = np.stack(column).reshape(-1, *shape) if shape else column
            np.testing.assert_array_equal(values, one.observations[name])
        actions = np.stack(batch["actions"].to_numpy(zero_copy_only=False))[:-1]
        np.testing.assert_array_equal(actions, one.actions)
        np.testing.assert_array_equal(batch["rewards"].to_numpy()[:-1], one.rewards)
        ended = batch["terminations"].to_numpy(zero_copy_only=False)[:-1]
        assert ended.tolist() == [False] * (len(one) - 1) + [True]
    with pytest.raises(InputError, match="an empty folder"):
        write_minari(tmp_path, episodes, env, name="printmend/made-v1", algorithm="naive", author="A. Nother")


def test_lerobot_counts_frames_from_the_first_and_says_where_episodes_begin(
    episodes: list[Episode], tmp_path: Path
) -> None:
    root = write_lerobot(tmp_path / "set", episodes, task="print", robot="twin")
    info = json.loads((root / "meta" / "info.json").read_text())
    data = pyarrow.parquet.read_table(root / info["data_path"].format(chunk_index=0, file_index=0))
    listed = pyarrow.parquet.read_table(root / "meta" / "episodes" / "chunk-000" / "file-000.parquet").to_pydict()
    assert info["total_frames"] == data.num_rows == 3 * (TICKS + PROBE)
    assert list(info["features"]) == data.column_names
    np.testing.assert_array_equal(data["index"].to_numpy(), np.arange(data.num_rows))
    for number, one in enumerate(episodes):
        start, end = listed["dataset_from_index"][number], listed["dataset_to_index"][number]
        part = data.slice(start, end - start)
        assert set(part["episode_index"].to_pylist()) == {number}
        np.testing.assert_array_equal(np.stack(part["action"].to_numpy()), one.actions.astype(np.float32))
        np.testing.assert_array_equal(np.stack(part["observation.state"].to_numpy()), one.observations["now"][:-1])
        assert part["next.done"].to_pylist() == [False] * (len(one) - 1) + [True]
    stats = json.loads((root / "meta" / "stats.json").read_text())
    assert stats["next.reward"]["mean"][0] == pytest.approx(data["next.reward"].to_numpy().mean(), abs=1e-6)
    tasks = pyarrow.parquet.read_table(root / "meta" / "tasks.parquet")
    index = json.loads(tasks.schema.metadata[b"pandas"])["index_columns"][0]
    assert tasks[index].to_pylist() == ["print"]


def test_the_command_writes_either_form_and_leaves_a_full_folder_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = gymnasium.make
    monkeypatch.setattr(gymnasium, "make", lambda name, **more: real(name, ticks=20, probe_ticks=10, **more))
    asked = [
        "dataset",
        "episodes",
        "--family",
        "pulley",
        "--agent",
        "naive",
        "--episodes",
        "2",
        "-o",
        str(tmp_path / "a"),
    ]
    assert "one-print-pulley-damaged-naive-v1: 2 episodes, 60 steps" in CliRunner().invoke(group, asked).output
    asked[-1] = str(tmp_path / "b")
    assert CliRunner().invoke(group, [*asked, "--form", "lerobot"]).exit_code == 0
    again = CliRunner().invoke(group, [*asked, "--form", "lerobot"])
    assert isinstance(again.exception, InputError)
    with pytest.raises(ConfigError, match="pulley-loose"):
        environment("no", "damaged")
