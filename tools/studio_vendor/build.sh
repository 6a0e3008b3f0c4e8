#!/usr/bin/env bash
# Bundles the libraries of the studio's page from the lock file into FOLDER, with their licences: `make studio-vendor`.
set -euo pipefail
folder=$(realpath "$1")
cd "$(dirname "$0")"
npm ci --silent --no-audit --no-fund
node_modules/.bin/esbuild vendor.js --bundle --minify --format=esm --target=es2022 --legal-comments=none --log-level=warning --outfile="$folder/vendor.js"
for name in three preact htm; do
  printf '%s %s\n\n' "$name" "$(node -p "require('./node_modules/$name/package.json').version")"
  cat "node_modules/$name/LICENSE"
  printf '\n----\n\n'
done > "$folder/vendor.LICENSES.txt"
(cd "$folder" && sha256sum vendor.js vendor.LICENSES.txt) > "$folder/vendor.sha256"
