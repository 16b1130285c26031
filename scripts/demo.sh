#!/usr/bin/env bash
# The main job on a fresh machine with Rust: makes a large mesh and simplifies it in little memory.
# usage: scripts/demo.sh [TRIANGLES]    (default 10M)
set -euo pipefail
repository=$(cd "$(dirname "$0")/.." && pwd)
triangles=${1:-10M}

cargo build --release --locked --manifest-path "$repository/Cargo.toml"
target=${CARGO_TARGET_DIR:-$repository/target}
meshmill=$(cd "$target" && pwd)/release/meshmill
folder=$(mktemp -d -t meshmill-demo-XXXXXX)
cd "$folder"

run() {
    printf '\n$ meshmill %s\n' "$*"
    "$meshmill" "$@"
}

run generate gyroid --triangles "$triangles" -o gyroid.ply
run simplify gyroid.ply -o small.ply --ratio 1% --memory 256MiB --report report.json
run info small.ply

printf '\nThe results are in %s; remove the folder when you have seen them:\n' "$folder"
ls -l "$folder"
