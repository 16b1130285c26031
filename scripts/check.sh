#!/usr/bin/env bash
# Checks everything: format, lints, documentation, tests. Run it before every commit; CI runs it too.
set -euo pipefail
cd "$(dirname "$0")/.."

usage() {
    cat <<'END'
usage: scripts/check.sh [--peers] [--fuzz SECONDS]

  --peers         also lint and test scripts/peers, the peers meshmill is measured against
  --fuzz SECONDS  also build every fuzz target and run each for SECONDS; says so and goes on
                  where there is no nightly toolchain or cargo-fuzz

The viewer is tested in node and, with `npm ci` done in tests/browser, in chromium; what is missing
is skipped aloud. Tests that need the large meshes find them through MESHMILL_SHARED (the folder that contains
meshes/) and say so when they skip.
END
}

peers=no
fuzz_seconds=
while [ $# -gt 0 ]; do
    case "$1" in
        --peers) peers=yes ;;
        --fuzz)
            fuzz_seconds=${2:-}
            if ! [[ $fuzz_seconds =~ ^[0-9]+$ ]]; then
                usage >&2
                exit 2
            fi
            shift
            ;;
        -h | --help)
            usage
            exit 0
            ;;
        *)
            usage >&2
            exit 2
            ;;
    esac
    shift
done

step() {
    printf '\n== %s\n' "$*"
}

check_peers() {
    step "peers: format, lints, tests"
    (
        cd scripts/peers
        cargo fmt --check
        cargo clippy --locked --all-targets -- -D warnings
        cargo test --locked
    )
}

check_fuzz_targets() {
    step "fuzz targets, $fuzz_seconds s each"
    scripts/fuzz.sh "$fuzz_seconds"
}

step "format"
cargo fmt --check
step "lints"
cargo clippy --locked --all-targets -- -D warnings
step "documentation"
RUSTDOCFLAGS="-D warnings" cargo doc --locked --no-deps
[ "$peers" = no ] || check_peers
[ -z "$fuzz_seconds" ] || check_fuzz_targets
step "viewer"
scripts/browser_test.sh
# Last, so that what the tests say of themselves closes the log.
step "tests"
cargo test --locked
