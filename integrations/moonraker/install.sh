#!/bin/sh
# Install printmend for Moonraker, or with --klipper the live transform for Klipper instead; no root is needed.
#
#   integrations/moonraker/install.sh [-m printer.mend.json] [--klipper]
#   integrations/moonraker/install.sh --uninstall
#
# It puts printmend into ~/printmend-env, links the component out of this folder, and writes files of settings that
# moonraker.conf and printer.cfg include. Run again it changes nothing that is as it should be. Only one of the two ways
# can be installed: where the other one is, it says so and changes nothing. --uninstall takes links and settings back; uploaded files, models and ~/printmend-env stay.
# Other places: MOONRAKER, KLIPPER, PRINTER_DATA and PRINTMEND_ENV in the environment.
set -eu

here=$(cd "$(dirname "$(readlink -f "$0")")/../.." && pwd)
moonraker=${MOONRAKER:-$HOME/moonraker}
klipper=${KLIPPER:-$HOME/klipper}
data=${PRINTER_DATA:-$HOME/printer_data}
env=${PRINTMEND_ENV:-$HOME/printmend-env}
config=$data/config
model='' live=no action=install

fail() { echo "install.sh: $1" >&2; exit 2; }

while [ $# -gt 0 ]; do
  case $1 in
    -m) [ $# -ge 2 ] || fail "-m needs a file; name the model that printmend learn wrote"; model=$2; shift ;;
    --klipper) live=yes ;;
    --uninstall) action=uninstall ;;
    *) fail "$1 is not known here; see the first lines of this script" ;;
  esac
  shift
done
[ -f "$config/moonraker.conf" ] || fail "there is no $config/moonraker.conf; set PRINTER_DATA"
[ -d "$moonraker/moonraker/components" ] || fail "there is no $moonraker/moonraker/components; set MOONRAKER"

# link FILE PLACE: what updates would call "dirty" is left out of their sight.
link() {
  ln -sfn "$1" "$2"
  repository=$(git -C "$(dirname "$2")" rev-parse --show-toplevel 2>/dev/null) || return 0
  exclude=$(git -C "$repository" rev-parse --absolute-git-dir)/info/exclude
  name=${2#"$repository"/}
  mkdir -p "$(dirname "$exclude")"
  grep -qxF "$name" "$exclude" 2>/dev/null || echo "$name" >> "$exclude"
}

# include FILE NAME: before what Klipper itself saves at the end of printer.cfg, else as the last line.
include() {
  grep -qxF "[include $2]" "$1" && return 0
  awk -v line="[include $2]" '
    !done && /^#\*# <-+ SAVE_CONFIG -+>/ { print line; done = 1 }
    { print }
    END { if (!done) print line }' "$1" > "$1.printmend"
  replace "$1"
}

# forget FILE NAME: the include again.
forget() {
  [ -f "$1" ] && grep -qxF "[include $2]" "$1" || return 0
  grep -vxF "[include $2]" "$1" > "$1.printmend" || true
  replace "$1"
}

replace() { cat "$1.printmend" > "$1"; rm "$1.printmend"; }

# settings FILE: written once; what its owner changed in it stays.
settings() {
  if [ -e "$1" ]; then cat > /dev/null; echo "kept: $1"; else cat > "$1"; echo "written: $1"; fi
}

restart() {
  if command -v curl > /dev/null && curl -fsS -m 10 -X POST http://127.0.0.1:7125/server/restart > /dev/null 2>&1; then
    echo "Moonraker is restarting."
  else
    echo "Now restart Moonraker."
  fi
  [ ! -f "$config/printer.cfg" ] || echo "Now restart Klipper (RESTART)."
}

if [ "$action" = uninstall ]; then
  rm -f "$moonraker/moonraker/components/printmend.py" "$klipper/klippy/extras/printmend.py"
  forget "$config/moonraker.conf" printmend-moonraker.conf
  forget "$config/printer.cfg" printmend-klipper.cfg
  rm -f "$config/printmend-moonraker.conf" "$config/printmend-klipper.cfg"
  echo "Taken back. Kept: $data/printmend (files as they were uploaded), $config/printer.mend.json, $env."
  restart
  exit 0
fi

# Files are mended, or moves are corrected live: with both, what the one did the other would judge.
other=$moonraker/moonraker/components/printmend.py way=Moonraker
[ "$live" = yes ] || other=$klipper/klippy/extras/printmend.py way=Klipper
if [ -e "$other" ] || [ -L "$other" ]; then
  fail "printmend is installed for $way already ($other); run install.sh --uninstall first"
fi
[ -z "$model" ] || [ -f "$model" ] || fail "there is no $model; name the model that printmend learn wrote"
[ "$live" = no ] || [ -d "$klipper/klippy/extras" ] || fail "there is no $klipper/klippy/extras; set KLIPPER"
[ "$live" = no ] || [ -f "$config/printer.cfg" ] || fail "there is no $config/printer.cfg; set PRINTER_DATA"
if [ "$live" = no ] && [ ! -x "$env/bin/printmend" ]; then
  python=$(command -v python3.13 || command -v python3.12 || command -v python3.11 || command -v python3) ||
    fail "there is no python3; install Python 3.11 or newer"
  "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
    fail "$python is older than 3.11; see docs/hosts.md, Which computer"
  "$python" -m venv "$env"
  "$env/bin/python" -m pip install --quiet --disable-pip-version-check -e "${here}[compile]"
  "$env/bin/printmend" warm || echo "install.sh: the first file will take a minute longer" >&2
fi
[ -z "$model" ] || cp "$model" "$config/printer.mend.json"

origin=$(git -C "$here" config --get remote.origin.url 2> /dev/null || true)
branch=$(git -C "$here" rev-parse --abbrev-ref HEAD 2> /dev/null || true)
{
  if [ "$live" = no ]; then
    printf '[printmend]\ncommand: %s/bin/printmend\nmodel: %s/printer.mend.json\n' "$env" "$config"
  fi
  if [ -n "$origin" ]; then
    printf '\n[update_manager printmend]\ntype: git_repo\npath: %s\norigin: %s\nprimary_branch: %s\n' \
      "$here" "$origin" "$branch"
    [ ! -d "$env" ] || printf 'virtualenv: %s\nrequirements: core.lock\n' "$env"
    printf 'is_system_service: False\nmanaged_services: moonraker klipper\n'
  fi
} | settings "$config/printmend-moonraker.conf"
[ "$live" = yes ] || link "$here/integrations/moonraker/printmend.py" "$moonraker/moonraker/components/printmend.py"
include "$config/moonraker.conf" printmend-moonraker.conf
[ "$live" = no ] || link "$here/integrations/klipper/printmend.py" "$klipper/klippy/extras/printmend.py"
if [ -f "$config/printer.cfg" ]; then # the transform, or a button that mends what is here already
  if [ "$live" = yes ]; then
    printf '[printmend]\nmodel: %s/printer.mend.json\n' "$config"
  else
    printf '[gcode_macro PRINTMEND_MEND_ALL]\ngcode: {action_call_remote_method("printmend_mend")}\n'
  fi | settings "$config/printmend-klipper.cfg"
  include "$config/printer.cfg" printmend-klipper.cfg
fi
[ -e "$config/printer.mend.json" ] || echo "Now put the model of this printer at $config/printer.mend.json."
restart
