#!/usr/bin/env bash
# Tests the viewer: its decoder and controller in node, all of it in a headless Chromium, and the
# pages that `meshmill document` writes. Says aloud what it has to skip, and fails only where
# something is wrong.
set -euo pipefail
cd "$(dirname "$0")/.."

skip() {
    printf 'SKIPPED: %s\n' "$*" >&2
}

if ! node --version >/dev/null 2>&1; then
    skip "tests of the viewer: there is no node"
    exit 0
fi
# The decoder unpacks with DecompressionStream('deflate-raw').
if ! node -e "new DecompressionStream('deflate-raw')" 2>/dev/null; then
    skip "tests of the viewer: node $(node --version) is too old, 20.12 is needed"
    exit 0
fi

cargo build --locked
MESHMILL=$(cargo metadata --format-version 1 --no-deps | node -p \
    'JSON.parse(require("fs").readFileSync(0, "utf8")).target_directory')/debug/meshmill
export MESHMILL

cd tests/browser
files=(decoder.test.js controller.test.js refine.test.js)
if ! command -v chromium >/dev/null 2>&1; then
    skip "tests in a browser: there is no chromium"
elif ! [ -d node_modules/playwright-core ]; then
    skip "tests in a browser: run 'npm ci' in tests/browser"
else
    files+=(viewer.test.js document.test.js)
fi
exec timeout 600 node --test --test-concurrency=2 "${files[@]}"
