"""The server: a FastAPI application over a folder of the user's, its page and its API."""

from collections.abc import AsyncIterator, Callable, Iterable
from concurrent.futures import Executor
from contextlib import asynccontextmanager
from pathlib import Path

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException
from starlette.middleware.gzip import GZipMiddleware
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp

from printmend import __version__
from printmend.errors import PrintmendError, RefusedError
from printmend.studio import api, api_printers
from printmend.studio.guard import LOOPBACK, Guard, TooLargeError
from printmend.studio.jobs import Jobs, Studio
from printmend.studio.store import NotThereError, Store

PAGE = Path(__file__).parent / "page"
MOST_BYTES = 400_000_000  # of an upload: a sliced part of this size takes a day to print
WORKERS = 2  # processes that jobs run in
_ABOUT = (
    "Everything that the page does, for other programs: send files, start jobs, follow them, fetch what they made. "
    "Lengths are mm. Errors are a table with one line, `error`."
)


def create_app(
    folder: Path,
    *,
    hosts: Iterable[str] = LOOPBACK,
    token: str | None = None,
    workers: int = WORKERS,
    cluster: Executor | None = None,
    most_bytes: int = MOST_BYTES,
    stopping: Callable[[], bool] = lambda: False,
) -> ASGIApp:
    """Return the server over ``folder``, where everything is kept: printers, uploads, jobs and their files.

    ``hosts`` are the names that it answers to, ``token`` what everybody must know who is not on this computer. Jobs
    run in ``workers`` processes, or on a ``cluster`` that sees the folder, too. ``stopping`` says when streams of
    events should end.
    """

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        store = Store(folder)
        jobs = Jobs(store, workers=workers, cluster=cluster)
        app.state.studio = Studio(store, jobs)
        yield
        jobs.close()
        store.close()

    app = FastAPI(
        title="printmend studio", version=__version__, description=_ABOUT, lifespan=lifespan, docs_url=None,
        redoc_url=None, openapi_url="/api/openapi.json",
    )  # fmt: skip
    app.state.most_bytes, app.state.stopping = most_bytes, stopping
    app.add_exception_handler(PrintmendError, _refused)
    app.add_exception_handler(RequestValidationError, _misfit)
    app.add_exception_handler(HTTPException, _http)
    app.add_exception_handler(TooLargeError, _too_large)
    app.include_router(api.router)
    app.include_router(api_printers.router)
    app.mount("/", StaticFiles(directory=PAGE, html=True))
    return Guard(
        GZipMiddleware(app, minimum_size=2000, compresslevel=5), hosts=hosts, token=token, most_bytes=most_bytes
    )


def _refused(request: Request, error: Exception) -> JSONResponse:
    status = 404 if isinstance(error, NotThereError) else 409 if isinstance(error, RefusedError) else 400
    return JSONResponse({"error": str(error)}, status)


_SEE = "see /api/openapi.json"
_MISFITS = {
    "json_invalid": f"wanted JSON, got something else; {_SEE}",
    "string_pattern_mismatch": f"wanted a key of this studio, got something else; {_SEE}",
}


def _misfit(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)
    first = error.errors()[0]
    place = ".".join(str(part) for part in first["loc"][1:] if isinstance(part, str)) or "the request"
    return JSONResponse({"error": f"{place}: {_MISFITS.get(first['type'], first['msg'])}"}, 422)


def _http(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    if isinstance(error.__cause__, TooLargeError):  # while it was read
        return _too_large(request, error.__cause__)
    return JSONResponse({"error": str(error.detail)}, error.status_code, headers=error.headers)


def _too_large(request: Request, error: Exception) -> JSONResponse:
    return JSONResponse({"error": f"wanted at most {error.args[0] / 1e6:g} MB, got more; give a smaller file"}, 413)
