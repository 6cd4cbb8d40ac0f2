#!/bin/sh
# The browser tests: against a ground server of their own, on a free port, with logs of its own.
set -eu

scratch=$(mktemp -d)
server=""
finish() {
    status=$?
    if [ -n "$server" ]; then
        kill "$server" 2>/dev/null || true
        wait "$server" 2>/dev/null || true
    fi
    if [ "$status" -ne 0 ] && [ -s "$scratch/server.log" ]; then
        echo "The last words of the ground server:" >&2
        tail -n 20 "$scratch/server.log" >&2
    fi
    rm -rf "$scratch"
    exit "$status"
}
trap finish EXIT INT TERM

target/debug/footfall serve --demo --port 0 --logs "$scratch/logs" --terrains "$scratch/terrain" \
    2>"$scratch/server.log" &
server=$!
url=""
tries=0
while [ -z "$url" ]; do
    url=$(sed -n 's|^FootFall is at \(http://[^/]*\)/.*|\1|p' "$scratch/server.log")
    tries=$((tries + 1))
    if ! kill -0 "$server" 2>/dev/null || [ "$tries" -gt 300 ]; then
        echo "footfall: the ground server for the browser tests did not start." >&2
        exit 3
    fi
    [ -n "$url" ] || sleep 0.2
done
cd web
FOOTFALL_URL="$url" CHROMIUM="${CHROMIUM:-$(command -v chromium)}" npx --no-install playwright test
