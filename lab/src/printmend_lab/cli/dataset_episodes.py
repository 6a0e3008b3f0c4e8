"""`printmend dataset episodes`: an agent's episodes for offline learning, in Minari's format or LeRobot's."""

from pathlib import Path

import click


@click.command(
    "episodes",
    short_help="Record episodes for offline learning: Minari, LeRobot.",
    epilog="Example: printmend dataset episodes --family pulley-loose --agent greybox --episodes 20 -o offline",
)
@click.option("--family", default="pulley-loose", show_default=True, help="What is broken; a wrong one lists them.")
@click.option("--severity", type=click.Choice(["damaged", "realistic"]), default="damaged", show_default=True)
@click.option("--agent", default="greybox", show_default=True, help="naive, or a learner that plans the print.")
@click.option("--episodes", type=click.IntRange(1, 100_000), default=20, show_default=True)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Of the first episode.")
@click.option("--form", type=click.Choice(["minari", "lerobot"]), default="minari", show_default=True)
@click.option("--author", default="unknown", show_default=True, help="Noted in Minari's metadata.")
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="The folder.")
def episodes_command(
    family: str, severity: str, agent: str, episodes: int, seed: int, form: str, author: str, out: Path
) -> None:
    """Let an agent play OnePrint, and keep observations, actions and rewards.

    minari: OUT/printmend/one-print-FAMILY-SEVERITY-AGENT-v1, Parquet. Set MINARI_DATASETS_PATH to OUT to load it by
    that name. lerobot: OUT is a LeRobot data set, version 3.0.
    """
    from printmend.extras import require

    require("printmend dataset episodes", "gymnasium", "pyarrow")
    from printmend_lab.offline.episodes import agent_of, environment, fresh, record
    from printmend_lab.offline.lerobot import write_lerobot
    from printmend_lab.offline.minari import write_minari

    env = environment(family, severity)
    plays = agent_of(agent, env)
    plain = "".join(mark if mark.isalnum() or mark == "-" else "-" for mark in agent)
    name = f"printmend/one-print-{family}-{severity}-{plain}-v1"
    fresh(out / name if form == "minari" else out)  # before hours of play
    found = record(env, plays, episodes, seed=seed)
    if form == "minari":
        root = write_minari(out, found, env, name=name, algorithm=agent, author=author)
    else:
        task = f"print the path on a printer with {family} ({severity}), after one test print"
        root = write_lerobot(out, found, task=task, robot="printmend twin")
    score = sum(float(one.rewards.sum()) for one in found) / len(found)
    click.echo(f"{root}: {len(found)} episodes, {sum(map(len, found))} steps, mean score {score:.3f}")
