#!/usr/bin/env bash
# Micro-benchmarks of the kernels (benches/kernels.rs), and one commit against another.
set -euo pipefail
cd "$(dirname "$0")/.."

usage() {
    cat <<'END'
usage: scripts/bench.sh [run [FILTER]]
       scripts/bench.sh compare OLD NEW [FILTER]

  run      measures the kernels of what is checked out; FILTER is a part of their names
  compare  measures OLD, OLD against itself, which shows the noise, and NEW against OLD

A shared machine makes small changes meaningless: look at the intervals.
END
}

run() {
    cargo bench --locked --bench kernels -- --noplot "$@"
}

# Measures a commit in a folder of its own: bench_commit COMMIT NAME FLAG...
bench_commit() {
    local commit=$1 name=$2
    shift 2
    if [ ! -d "$folder/$name" ]; then
        git worktree add --quiet --detach "$folder/$name" "$commit"
    fi
    # Both look for what the other measured in one place; each is built in its own.
    (cd "$folder/$name" && CRITERION_HOME="$folder/measured" CARGO_TARGET_DIR="$folder/$name/target" \
        cargo bench --locked --bench kernels -- --noplot "$@")
}

clean_up() {
    git worktree remove --force "$folder/old" 2>/dev/null || true
    git worktree remove --force "$folder/new" 2>/dev/null || true
    rm -rf "$folder"
}

compare() {
    local old=$1 new=$2
    shift 2
    folder=$(mktemp -d)
    trap clean_up EXIT
    printf '== %s, to warm up\n' "$old"
    bench_commit "$old" old --save-baseline first "$@" >/dev/null
    printf '== %s against itself: the noise\n' "$old"
    bench_commit "$old" old --baseline first "$@"
    bench_commit "$old" old --save-baseline old "$@" >/dev/null
    printf '== %s against %s\n' "$new" "$old"
    bench_commit "$new" new --baseline old "$@"
}

case "${1:-run}" in
    run)
        shift || true
        run "$@"
        ;;
    compare)
        if [ $# -lt 3 ]; then
            usage >&2
            exit 2
        fi
        shift
        compare "$@"
        ;;
    -h | --help) usage ;;
    *)
        usage >&2
        exit 2
        ;;
esac
