#!/usr/bin/env python3
"""Runs every command in a control group with little more memory than its budget, on inputs far larger.

The kernel ends what takes more than --memory and --margin together, and what a command reads and
writes passes through the same memory: the inputs are taken out of the page cache before each run, and
are twenty times the budget where a job names no other. Sorted and in random order, as triangle soup
and indexed, from files and from a pipe. Prints a Markdown table: seconds, the peak of resident memory,
and how it ended: done, refused (the budget cannot do; exit 1, with a reason), or killed, which is a fault
and makes this script fail, as any other end does.

Needs a built meshmill, a memory controller that may be written to (usually root), and disk for some
eight times --triangles times 50 bytes, with --large 12 GB. Builds scripts/peers, which puts the inputs out of order.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import bench_cluster as bench

JOBS = [
    # What slabs need grows with the square root of the input: not less for twenty times as much.
    "simplify sorted.stl -o out.ply --ratio 1% --memory 192MiB",
    "simplify sorted.ply -o out.ply --ratio 1% --memory 192MiB",
    "simplify shuffled.stl -o out.ply --ratio 1% --memory 192MiB",
    "simplify shuffled.ply -o out.ply --ratio 1% --memory 192MiB",
    "cat shuffled.stl | simplify - --input-format stl -o out.ply --ratio 1% --memory 192MiB",
    "simplify sorted.ply -o out.ply --ratio 0.5% --metric volume --memory 192MiB",
    "simplify sorted.ply -o out.ply --ratio 1%",
    "simplify sorted.ply -o out.ply --ratio 20% --method cluster",
    "simplify shuffled.stl -o out.ply --ratio 20% --method cluster",
    "simplify shuffled.ply -o out.ply --ratio 20% --method cluster",
    "simplify sorted.stl -o out.ply -t 50k --method hybrid",
    "simplify sorted.stl -o out.ply --ratio 1% --selection multiple-choice",
    "simplify sorted.ply -o out.ply --max-error 0.5% --memory 192MiB",
    "sort sorted.ply -o out.soup",
    "sort shuffled.stl -o out.soup",
    "sort shuffled.ply -o out.soup --axis x",
    "soup sorted.ply -o out.stl",
    "soup shuffled.ply -o out.stl",
    "weld sorted.stl -o out.ply",
    "weld shuffled.stl -o out.ply",
    "info shuffled.stl --topology",
    "info shuffled.ply --topology",
    "compare sorted.stl small.ply --samples 100k",
    "compare shuffled.ply small.ply --samples 100k",
    "render shuffled.stl -o out.png --size 800x600",
    "document sorted.ply -o out.html -t 100k",
]

# Only with --large.
LARGE_JOBS = [
    "generate gyroid --triangles 200M -o - --output-format soup -q | "
    "simplify - --input-format soup --assume-sorted z --ratio 0.5% -o out.ply --memory 512MiB",
    "generate gyroid --triangles 200M -o - --output-format soup -q | "
    "simplify - --input-format soup --ratio 0.2% -o out.ply --memory 512MiB",
]


class Group:
    """A control group with limited memory, of either version."""

    def __init__(self):
        first = Path("/sys/fs/cgroup/memory")
        parent = first if first.is_dir() else Path("/sys/fs/cgroup")
        self.path = parent / f"meshmill-memory-test-{os.getpid()}"
        self.path.mkdir()
        self.limit = self.path / ("memory.limit_in_bytes" if parent == first else "memory.max")
        self.events = self.path / ("memory.oom_control" if parent == first else "memory.events")

    def enter(self):
        (self.path / "cgroup.procs").write_text(str(os.getpid()))

    def killed(self):
        """Processes that the kernel has ended for want of memory."""
        lines = (line.split() for line in self.events.read_text().splitlines())
        return sum(int(count) for name, count in lines if name == "oom_kill")

    def remove(self):
        self.path.rmdir()


def forget(path):
    """Takes a file out of the page cache, which is memory of the group that has read it."""
    with open(path, "rb") as file:
        os.fsync(file.fileno())
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def inputs(options, folder):
    """Makes the inputs that are missing."""
    def make(name, *command):
        if not (folder / name).exists():
            print(f"  making {name}", file=sys.stderr)
            subprocess.run([*command], check=True, stdout=subprocess.DEVNULL)

    surface = [options.meshmill, "generate", "gyroid", "--triangles", options.triangles, "-o"]
    for name in ["sorted.stl", "sorted.ply"]:
        make(name, *surface, folder / name, "-q")
    make("shuffled.stl", bench.PEERS / "target/release/shuffle", folder / "sorted.stl", folder / "shuffled.stl")
    make("shuffled.ply", bench.PEERS / "target/release/shuffle", folder / "sorted.ply", folder / "shuffled.ply",
         "--indexed")
    make("small.ply", options.meshmill, "simplify", folder / "sorted.ply", "-o", folder / "small.ply", "--ratio",
         "1%", "--memory", "1GiB", "-q")


def run(options, folder, group, job):
    """Runs a job; returns its row and whether it ended as it should."""
    pipe, _, line = job.rpartition(" | ")
    for name in ["sorted.stl", "sorted.ply", "shuffled.stl", "shuffled.ply", "small.ply"]:
        forget(folder / name)
    source = subprocess.DEVNULL
    feeder = None
    if pipe:
        program = [options.meshmill] if pipe.startswith("generate") else []
        words = program + pipe.split()
        feeder = subprocess.Popen(words, cwd=folder, stdout=subprocess.PIPE)
        source = feeder.stdout
    line, _, memory = line.partition(" --memory ")
    memory = memory or options.memory
    flags = ["--memory", memory, "-q"]
    flags += [] if line.startswith(("info", "compare")) else ["--force"]
    group.limit.write_text(str(bench.parse_bytes(memory) + bench.parse_bytes(options.margin)))
    before, started = group.killed(), time.monotonic()
    child = subprocess.Popen([options.meshmill, *line.split(), *flags], cwd=folder, stdin=source,
                             stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, preexec_fn=group.enter)
    if feeder:
        feeder.stdout.close()
    said = child.stderr.read().decode()
    _, status, usage = os.wait4(child.pid, 0)
    seconds = time.monotonic() - started
    child.returncode = os.waitstatus_to_exitcode(status)
    if feeder:
        feeder.wait()
    is_killed = group.killed() > before
    end = {0: "done", 1: "refused"}.get(child.returncode, f"exit {child.returncode}")
    end = "**killed**" if is_killed else end
    reason = said.strip().splitlines()[-1] if child.returncode and said.strip() else ""
    shown = " \\| ".join(part for part in [pipe, line] if part)
    row = [f"`{shown}`", memory, f"{seconds:.1f}", f"{usage.ru_maxrss / 1024:.0f}", f"{end} {reason}".strip()]
    return row, end in ("done", "refused")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--meshmill", type=Path, default=bench.ROOT / "target/release/meshmill", help="the built program")
    add("--triangles", default="26M", help="of the inputs (default: %(default)s)")
    add("--memory", default="64MiB", help="budget of each run (default: %(default)s)")
    add("--margin", default="64MiB", help="what the group has beside it (default: %(default)s)")
    add("--scratch", type=Path, help="a folder to work in, whose inputs are used again")
    add("--large", action="store_true", help="200 M triangles from a pipe, too")
    add("--only", default="", help="jobs with this text")
    options = parser.parse_args()
    options.meshmill = options.meshmill.resolve()
    subprocess.run(["cargo", "build", "--release", "--quiet", "--manifest-path", bench.PEERS / "Cargo.toml"], check=True)
    scratch = tempfile.TemporaryDirectory(prefix="meshmill-memory-") if options.scratch is None else None
    folder = Path(scratch.name) if scratch else options.scratch.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    inputs(options, folder)
    group = Group()
    jobs = JOBS + (LARGE_JOBS if options.large else [])
    rows, are_good = [], True
    try:
        for job in (job for job in jobs if options.only in job):
            row, is_good = run(options, folder, group, job)
            print(f"  {' · '.join(row)}", file=sys.stderr)
            rows.append(row)
            are_good &= is_good
    finally:
        group.remove()
    sizes = ", ".join(f"{name} {(folder / name).stat().st_size / 1e6:.0f} MB" for name in ["sorted.stl", "sorted.ply"])
    print(f"{options.triangles} triangles ({sizes}), the budget and {options.margin} beside it:\n")
    bench.table(["command", "budget", "s", "peak RSS MiB", "ended"], rows)
    sys.exit(0 if are_good else 1)


if __name__ == "__main__":
    main()
