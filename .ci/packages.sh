#!/bin/sh
# Debian packages that the tests need beside the build tools: installed when they are missing, as
# root or through sudo; else it says what to install.
set -eu

missing=""
command -v "${CHROMIUM:-chromium}" >/dev/null 2>&1 || missing="$missing chromium"
[ -d /usr/share/fonts/truetype/dejavu ] || missing="$missing fonts-dejavu"
python3 -c 'import venv, ensurepip' >/dev/null 2>&1 || missing="$missing python3-venv"
[ -n "$missing" ] || exit 0

if [ "$(id -u)" -eq 0 ]; then
    as_root=""
elif command -v sudo >/dev/null 2>&1; then
    as_root="sudo"
else
    as_root="none"
fi
if [ "$as_root" = "none" ] || ! command -v apt-get >/dev/null 2>&1; then
    echo "footfall: the tests need these Debian packages, and they cannot be installed from here; as root, do: apt-get install$missing" >&2
    exit 2
fi
echo "Installing for the tests:$missing"
export DEBIAN_FRONTEND=noninteractive
# The list of packages may be missing or old; what cannot be had is told by the second command.
$as_root apt-get update -qq || true
# shellcheck disable=SC2086 # a list of packages
if ! $as_root apt-get install -y -qq --no-install-recommends $missing >/dev/null; then
    echo "footfall: apt-get could not install$missing; do it by hand and try again." >&2
    exit 2
fi
