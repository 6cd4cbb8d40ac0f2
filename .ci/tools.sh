#!/bin/sh
# Are the tools there that FootFall is built with? One sentence for the first that is not.
set -eu

fail() {
    echo "footfall: $1" >&2
    exit 2
}

command -v cargo >/dev/null 2>&1 ||
    fail "cargo is missing: install rustup from https://rustup.rs, open a new shell, and try again."
command -v cc >/dev/null 2>&1 ||
    fail "a C compiler is missing: install it with: apt-get install build-essential"
command -v node >/dev/null 2>&1 ||
    fail "Node.js is missing: install version 20.19 or later of 20, or 22.12 or later, from https://nodejs.org."
command -v npm >/dev/null 2>&1 ||
    fail "npm is missing: it comes with Node.js from https://nodejs.org."

version=$(node -p 'process.versions.node')
major=${version%%.*}
rest=${version#*.}
minor=${rest%%.*}
if ! { [ "$major" -eq 20 ] && [ "$minor" -ge 19 ]; } &&
    ! { [ "$major" -eq 22 ] && [ "$minor" -ge 12 ]; } &&
    ! [ "$major" -gt 22 ]; then
    fail "Node.js $version is too old: version 20.19 or later of 20, or 22.12 or later, is needed, from https://nodejs.org."
fi
cargo --version >/dev/null 2>&1 ||
    fail "cargo cannot run the toolchain of rust-toolchain.toml: install it with: rustup toolchain install $(sed -n 's/^channel = "\(.*\)"/\1/p' rust-toolchain.toml)"
