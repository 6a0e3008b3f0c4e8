"""Which extra brings a library that is not installed."""

from printmend.errors import MissingToolError

# pyproject.toml says what each extra installs.
_EXTRAS = {
    "cv2": "scan",
    "PIL": "scan",
    "scipy": "scan",
    "lightgbm": "trees",
    "matplotlib": "report",
    "mpl_toolkits": "report",
    "reportlab": "report",
    "lxml": "paper",
    "networkx": "paper",
    "sklearn": "paper",
    "trimesh": "paper",
    "gymnasium": "rl",
    "distributed": "cluster",
    "manifold3d": "dataset",
    "pyarrow": "dataset",
    "thingi10k": "thingi10k",
    "fastapi": "studio",
    "httpx2": "studio",
    "pebble": "studio",
    "sqlalchemy": "studio",
    "uvicorn": "studio",
}


def missing_extra(error: ImportError) -> MissingToolError | None:
    """Return in words which extra is missing, None where the module that cannot be imported is of none."""
    module = (error.name or "").partition(".")[0]
    if module not in _EXTRAS or not isinstance(error, ModuleNotFoundError):
        return None
    extra = _EXTRAS[module]
    return MissingToolError(
        module, wanted=f"the extra {extra!r} of printmend", came="an installation without it",
        todo=f"pip install 'printmend[{extra}]'",
    )  # fmt: skip
