#!/usr/bin/env bash
# Builds every fuzz target and runs each for some seconds, beginning with the awkward files.
set -euo pipefail
cd "$(dirname "$0")/.."

usage() {
    cat <<'END'
usage: scripts/fuzz.sh [SECONDS] [TARGET...]

  SECONDS  how long each target runs (default 10; 0: only build); below 30 the targets are built
           in less time and run slower
  TARGET   stl, ply, obj, off, soup, progressive, manifest, any (default: all)

Needs a nightly toolchain and cargo-fuzz (cargo install cargo-fuzz --locked); says so and does
nothing where one is missing, or fails there when FUZZ_REQUIRED is set. Seeds are the files of
meshes/torture and the small ones of meshes/real below MESHMILL_SHARED; without them it starts
from nothing. What it finds is left in fuzz/artifacts/TARGET.
END
}

# Larger seeds make every execution slow and say nothing new.
seed_bytes_max=60000
# Far above what any batch takes, far below what a lie about a count asks for. zstd's largest
# window, which a frame may ask for, is 128 MiB.
memory_mib_max=1024
allocation_mib_max=256
# Runs of less than this many seconds are built in less time, and slower.
short_seconds=30
# No target reaches unsafe code of ours, so that the address sanitizer would find nothing, and
# costs two thirds of the executions.
sanitizer=(--sanitizer none)

case "${1:-}" in
    -h | --help)
        usage
        exit 0
        ;;
esac
seconds=${1:-10}
if ! [[ $seconds =~ ^[0-9]+$ ]]; then
    usage >&2
    exit 2
fi
[ $# -eq 0 ] || shift
targets=("$@")
[ $# -gt 0 ] || targets=(stl ply obj off soup progressive manifest any)

how=("${sanitizer[@]}")
[ "$seconds" -ge "$short_seconds" ] || how+=(--dev)

if ! cargo +nightly fuzz --version >/dev/null 2>&1; then
    echo "fuzz: skipped: no nightly toolchain or no cargo-fuzz (cargo install cargo-fuzz --locked)" >&2
    [ -z "${FUZZ_REQUIRED:-}" ] && exit 0 || exit 1
fi

# Copies the seeds of a target: files with its ending, or all, and compressed ones, for "any".
seed() {
    local target=$1 corpus=fuzz/corpus/$1 file
    mkdir -p "$corpus"
    if [ "$target" = manifest ]; then
        # What a sort notes, without the line before it.
        printf '%s' '{"job":{"command":"sort","a.stl: size":"84"},"steps":{"sorted":{"figures":{"held":7,"way":{"ToBuckets":{"bounds":["ff"]}}},"files":[{"name":"00001-bucket","count":7,"record_bytes":40,"checksum":1,"finished":false}]}}}' >"$corpus/sorted"
        return 0
    fi
    if [ "$target" = progressive ]; then
        cp testdata/progressive/*.pm "$corpus"
        return 0
    fi
    [ -n "${MESHMILL_SHARED:-}" ] || return 0
    find "$MESHMILL_SHARED"/meshes/torture "$MESHMILL_SHARED"/meshes/real -type f \
        -size -"$seed_bytes_max"c | sort | while read -r file; do
        local name=${file##*/} ending
        ending=$(printf '%s' "${file##*.}" | tr '[:upper:]' '[:lower:]')
        if [ "$target" = any ]; then
            cp "$file" "$corpus/$name"
            gzip -nc "$file" >"$corpus/$name.gz"
        elif [ "$target" = "$ending" ]; then
            cp "$file" "$corpus/$name"
        elif [ "$target" = soup ] && [ "$ending" = stl ]; then
            # Triangles are triangles: behind a header that the target mends.
            { head -c 128 /dev/zero && head -c 3684 "$file" | tail -c +85; } >"$corpus/$name"
        fi
    done
}

log=$(mktemp)
trap 'rm -f "$log"' EXIT
[ -n "${MESHMILL_SHARED:-}" ] ||
    echo "fuzz: MESHMILL_SHARED is not set: starting without seeds" >&2
echo "fuzz: building ${targets[*]}"
cargo +nightly fuzz build "${how[@]}" >"$log" 2>&1 || {
    cat "$log" >&2
    exit 1
}
[ "$seconds" -gt 0 ] || exit 0

for target in "${targets[@]}"; do
    seed "$target"
    if ! cargo +nightly fuzz run "${how[@]}" "$target" -- -max_total_time="$seconds" -timeout=10 \
        -rss_limit_mb="$memory_mib_max" -malloc_limit_mb="$allocation_mib_max" \
        -print_final_stats=1 >"$log" 2>&1; then
        sed -n '/panicked at/,/^stack backtrace/p; /^==.*ERROR/p; /^SUMMARY:/p; /cargo fuzz run/p; /^error/,$p' "$log" >&2
        echo "fuzz: $target: FOUND SOMETHING, see fuzz/artifacts/$target" >&2
        exit 1
    fi
    executions=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
    memory=$(sed -n 's/^stat::peak_rss_mb: *//p' "$log")
    echo "fuzz: $target: $executions executions in $seconds s, $memory MiB at most, nothing found"
done
