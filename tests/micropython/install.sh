#!/usr/bin/env bash
# What tests/micropython runs on: Node and MicroPython's WebAssembly port, pinned in package-lock.json.
# Does nothing where both are there. Without Node it needs root on a Debian.
set -euo pipefail
cd "$(dirname "$0")"

where=${PS4RIG_MICROPYTHON:-${XDG_CACHE_HOME:-${HOME:-$(echo ~)}/.cache}/ps4rig/micropython}
if command -v node >/dev/null && cmp -s package-lock.json "$where/package-lock.json"; then
    exit 0
fi

if ! command -v node >/dev/null || ! command -v npm >/dev/null; then
    apt-get update -qq
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends nodejs npm >/dev/null
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir "$work/tree"
cp package.json package-lock.json "$work/tree"
npm ci --prefix "$work/tree" --ignore-scripts --no-audit --no-fund --loglevel=error >/dev/null
mkdir -p "$(dirname "$where")"
rm -rf "$where"
# Moved when it is whole, so that a broken-off run leaves no half of it.
mv "$work/tree" "$where"
