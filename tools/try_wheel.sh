#!/usr/bin/env bash
# Build the wheels, let pip choose, install printmend's without the lock and without extras into a new environment, and do
# its job there: probe, twin, learn, mend, check, export, demo. Then add the lab's, and see that its commands are there.
# Usage: tools/try_wheel.sh PYTHON, where PYTHON has hatchling.
set -euo pipefail
cd "$(dirname "$0")/.."
build=$(cd "$(dirname "$1")" && pwd)/$(basename "$1") # not resolved: a link into its environment
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT

"$build" -m hatchling build -t wheel -d "$place/dist" >/dev/null
PRINTMEND_PURE=1 "$build" -m hatchling build -t wheel -d "$place/dist" >/dev/null
(cd lab && "$build" -m hatchling build -t wheel -d "$place/dist" >/dev/null)
"$build" -m venv "$place/venv"
"$place/venv/bin/python" -m pip download --quiet --disable-pip-version-check --no-deps --no-index \
  --find-links "$place/dist" -d "$place/chosen" printmend
ls "$place/dist" | sed 's/^/built: /'
ls "$place/chosen" | sed 's/^/pip chooses: /'
"$place/venv/bin/python" -m pip install --quiet --disable-pip-version-check "$place"/chosen/*.whl
site=$("$place/venv/bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
echo "installed: $(du -sm --exclude=pip --exclude='pip-*' --exclude=setuptools --exclude='setuptools-*' "$site" | cut -f1) MB"

cd "$place"
export PATH="$place/venv/bin:$PATH" NUMBA_CACHE_DIR="$place/kernels" PYTHONPATH=
TIMEFORMAT="  %U s of processor time"
say() { echo "+ $*"; time "$@"; }
cat >broken.toml <<'TOML'
[x.pulley]
kind = "radius"
radius_mm = 6.3
[x.belt]
kind = "play"
play_mm = 0.4
[y.pulley]
kind = "eccentric"
eccentricity_mm = 0.3
TOML
cat >part.gcode <<'GCODE'
G21
G90
M83
G28
G1 Z0.2 F600
G0 X60 Y60 F6000
G1 X120 Y60 E2 F1800
G1 X120 Y120 E2
G1 X60 Y120 E2
G1 X60 Y60 E2
GCODE
say printmend probe --printer ender3 --dots 150 -o probe.gcode
say printmend twin probe.gcode --printer ender3 --corruption broken.toml -o trace.csv
say printmend learn trace.csv --printer ender3 -o printer.mend.json
say printmend mend part.gcode -m printer.mend.json -o mended.gcode
say printmend check part.gcode -m printer.mend.json --against mended.gcode
say printmend export -m printer.mend.json --to klipper
say printmend demo -o demo
printmend studio --help >/dev/null
# what an extra or the lab would bring is named in one line; the wheel is asked for again, where it came from
lacks() { # PACKAGE COMMAND...
  local package=$1 said code=0
  shift
  said=$("$@" 2>&1) || code=$?
  echo "+ $*: $said"
  [ "$code" = 2 ] && [ "$(wc -l <<<"$said")" = 1 ] && grep -qF -- "-m pip install $package" <<<"$said"
}
lacks "'$(ls "$place"/chosen/*.whl)[scan]'" printmend measure scan.png --probe probe.json
lacks printmend-lab printmend bench families --help
python -m pip install --quiet --disable-pip-version-check "$place"/dist/printmend_lab-*.whl # numba comes with it
say printmend bench families --help >/dev/null
say printmend paper -o paper
