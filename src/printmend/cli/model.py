"""Models by file or by name: `-m e3-07` is e3-07.mend.json, here or in the folder of the user's models."""

import shlex
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

if TYPE_CHECKING:
    from printmend.model import SavedModel

SUFFIX = ".mend.json"


def models_folder() -> Path:
    """Return the folder of the user's models."""
    return Path(click.get_app_dir("printmend")) / "models"


def models() -> Iterator[tuple[str, Path]]:
    """Yield the names of the models here and in the user's folder, and their files; the first with a name counts."""
    seen = set()
    for folder in (Path(), models_folder()):
        for path in sorted(folder.glob(f"*{SUFFIX}")):
            name = path.name.removesuffix(SUFFIX)
            if name not in seen:
                seen.add(name)
                yield name, path


class ModelType(click.ParamType):
    """A model's file, or its name."""

    name = "model"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        path = Path(value)
        return path if path.exists() else dict(models()).get(str(value), path)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        names = [CompletionItem(name) for name, _ in models() if name.startswith(incomplete)]
        return [*names, CompletionItem(incomplete, type="file")]


def read_model_in(path: Path, filament: str | None) -> "SavedModel":
    """Read a model; if a filament is named, return the model as it prints in that."""
    from printmend.model import read_model

    model = replace(read_model(path), called=shlex.quote(str(path)))
    if filament is None:
        return model
    from printmend.mend.filament import printed_in  # imports everything that learns

    return printed_in(model, filament)
