# Two images: `studio`, everything in the browser as a service, and `lab`, every command with Dask and PrusaSlicer.
#
#   docker build --target studio -t printmend/studio .
#   docker build --target lab -t printmend/lab .
#
# compose.yaml starts both.

FROM python:3.11-slim-bookworm AS build
# The newest of Debian's stable release is wanted here and below.
# hadolint ignore=DL3008
RUN apt-get update && apt-get install -y --no-install-recommends gcc libc6-dev libgomp1 make \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /src
COPY . .
# The locked environment compiles the kernels and builds the wheels; versions without hashes bind what `lab` installs.
RUN make kernels \
    && .venv/bin/python -m hatchling build -t wheel -d /dist \
    && cp owner.lock pip.lock /dist \
    && sed -n 's/^\([A-Za-z0-9._-]*==[^\\]*\)\\$/\1/p' requirements.lock >/dist/constraints.txt
WORKDIR /src/lab
RUN ../.venv/bin/python -m hatchling build -t wheel -d /dist

FROM python:3.11-slim-bookworm AS base
# LightGBM needs OpenMP.
# hadolint ignore=DL3008
RUN apt-get update && apt-get install -y --no-install-recommends libgomp1 && rm -rf /var/lib/apt/lists/* \
    && groupadd --gid 10001 printmend && useradd --uid 10001 --gid 10001 --create-home printmend \
    && install -d -m 700 -o printmend -g printmend /data
ENV PYTHONUNBUFFERED=1 PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1 NUMBA_CACHE_DIR=/home/printmend/kernels

FROM base AS studio
RUN --mount=type=bind,from=build,source=/dist,target=/dist \
    pip install --require-hashes --no-deps -r /dist/owner.lock && pip install --no-deps /dist/printmend-*.whl
USER 10001:10001
VOLUME /data
EXPOSE 8765
# The address that it prints bears a token: `docker logs` shows it. Open it as http://127.0.0.1:8765/?token=…
HEALTHCHECK --interval=30s --timeout=5s --start-period=30s \
    CMD ["python", "-c", "import socket; socket.create_connection(('127.0.0.1', 8765), 3).close()"]
ENTRYPOINT ["printmend"]
CMD ["studio", "--host", "0.0.0.0", "--port", "8765", "--no-browser", "--folder", "/data"]

FROM base AS lab
# hadolint ignore=DL3008
RUN apt-get update && apt-get install -y --no-install-recommends prusa-slicer && rm -rf /var/lib/apt/lists/*
RUN --mount=type=bind,from=build,source=/dist,target=/dist \
    set -- /dist/printmend-*.whl /dist/printmend_lab-*.whl \
    && pip install -c /dist/constraints.txt "printmend[all] @ file://$1" "printmend-lab[all] @ file://$2"
USER 10001:10001
WORKDIR /data
VOLUME /data
CMD ["printmend", "--help"]
