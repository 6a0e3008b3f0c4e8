"""compose.yaml and the Dockerfile, as far as no daemon is needed: read as Docker does, and what each names is there."""

import re
import shlex
from pathlib import Path

import click
import pytest
import yaml
from compose_spec import PyCompose

from printmend.cli.main import group

ROOT = Path(__file__).parents[1]
COMPOSE = (ROOT / "compose.yaml").read_text(encoding="utf-8")
DOCKERFILE = (ROOT / "Dockerfile").read_text(encoding="utf-8")
STAGES = re.split(r"^(?=FROM )", DOCKERFILE, flags=re.MULTILINE)[1:]
SERVICES = yaml.safe_load(COMPOSE)["services"]


def stage(name: str) -> str:
    """Return the stage of the Dockerfile that has a name."""
    return next(text for text in STAGES if re.match(rf"FROM \S+ AS {name}$", text.partition("\n")[0]))


def words(text: str, instruction: str) -> list[str]:
    """Return the last words in JSON that an instruction has in a stage."""
    return list(yaml.safe_load(re.findall(rf"^{instruction} (\[.*\])$", text, re.MULTILINE)[-1]))


def test_compose_reads_the_file_and_each_service_has_what_it_names() -> None:
    told = PyCompose.from_yaml(COMPOSE)
    told.validate()
    assert told.service_names() == ["studio", "scheduler", "worker", "lab"]
    volumes, built = set(yaml.safe_load(COMPOSE)["volumes"]), set()
    for name, service in SERVICES.items():
        assert set(service.get("depends_on", ())) <= set(SERVICES), name
        assert {volume.partition(":")[0] for volume in service["volumes"]} <= volumes, name
        assert service["cap_drop"] == ["ALL"], name
        if "build" in service:
            built.add(service["image"])
            assert "USER 10001:10001" in stage(service["build"]["target"]), name
        place = service["volumes"][0].partition(":")[2]
        assert f"VOLUME {place}" in stage(service["image"].removeprefix("printmend/")), name
    assert {service["image"] for service in SERVICES.values()} == built  # a worker runs what another one builds
    with pytest.raises(ValueError, match="cap_dorp"):
        PyCompose.from_yaml(COMPOSE.replace("cap_drop", "cap_dorp"))


def test_each_stage_copies_from_one_before_it_and_files_that_are_there() -> None:
    names: list[str] = []
    for text in STAGES:
        image, name = re.findall(r"^FROM (\S+) AS (\S+)$", text, re.MULTILINE)[0]
        assert ":" in image or image in names, name
        assert set(re.findall(r"from=(\w+)", text)) <= set(names), name
        names.append(name)
    for file in re.findall(r"cp ([\w. ]+) /dist", DOCKERFILE)[0].split():
        assert (ROOT / file).is_file(), file


def test_the_studio_in_the_container_starts_with_options_that_it_has_and_listens_where_it_is_asked() -> None:
    text, service = stage("studio"), SERVICES["studio"]
    assert words(text, "ENTRYPOINT") == ["printmend"]
    name, *options = words(text, "CMD")
    command = group.get_command(click.Context(group), name)
    assert isinstance(command, click.Group)
    given = command.make_context(name, options, resilient_parsing=True).params
    assert given["no_browser"]
    assert f"VOLUME {given['folder']}" in text
    assert f"EXPOSE {given['port']}" in text
    assert f"('127.0.0.1', {given['port']})" in text  # the health check
    assert service["ports"] == [f"127.0.0.1:{given['port']}:{given['port']}"]
    assert given["host"] == "0.0.0.0"  # noqa: S104 — within the container
    # read_only: all that is written lies in the volume or in memory
    written = {str(given["folder"]), *service["tmpfs"], "/tmp"}  # noqa: S108
    home = re.findall(r"NUMBA_CACHE_DIR=(\S+)", DOCKERFILE)[0]
    assert service["read_only"]
    assert any(home.startswith(place) for place in written)


def test_the_labs_commands_are_ones_that_the_image_has() -> None:
    for name in ("scheduler", "worker"):
        assert SERVICES[name]["command"][:2] == ["dask", name]
    asked = next(line for line in COMPOSE.splitlines() if "run --rm lab printmend" in line)
    program, *rest = shlex.split(asked.partition("run --rm lab ")[2])
    assert program == "printmend"
    context, command = click.Context(group), group
    while rest and isinstance(command, click.Group) and (found := command.get_command(context, rest[0])) is not None:
        command, rest = found, rest[1:]  # type: ignore[assignment]
    known = {option for each in command.params for option in each.opts}
    assert {word for word in rest if word.startswith("--")} <= known
    assert re.search(r"tcp://scheduler:(\d+)", asked)[1] in SERVICES["scheduler"]["command"]  # type: ignore[index]
