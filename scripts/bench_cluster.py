#!/usr/bin/env python3
"""Measures clustering and dereferencing side by side with what they must beat.

Everything is run interleaved (A B A B ...) on warm input, and reported as the
ratio of the medians and the ratios of the pairs, because a shared machine makes
seconds meaningless and ratios of neighbours not. Prints Markdown tables.

Sections, all of which run unless some are named:
  a  clustering an indexed PLY to 10 % against meshoptimizer's, and both errors
  b  the same from binary STL
  c  peak memory over the budget on a large file (only with --large)
  d  a budget that spills against one that does not
  e  PLY to triangle soup against copying the result

Needs a built meshmill; builds the peers if they are missing. Only the standard
library of Python 3.11.
"""

import argparse
import dataclasses
import hashlib
import json
import os
import platform
import re
import shlex
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PEERS = ROOT / "scripts" / "peers"
MIB = 1 << 20
# What the product promises to stay within, over --memory.
ALLOWANCE_BYTES = 64 * MIB
# Bytes of a vertex in the table that dereferencing gathers from.
VERTEX_BYTES = 12


class Failed(Exception):
    """A command that did not do what it was measured for."""


@dataclasses.dataclass
class Run:
    """One run of a command."""

    seconds: float
    # Never below some 30 MiB: until its exec, a child has the memory of this script.
    rss_bytes: int
    stdout: str


# ---------------------------------------------------------------- running


def run(command):
    """Runs a command to its end and measures the time and memory it took."""
    command = [str(word) for word in command]
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        started = time.monotonic()
        child = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=out, stderr=err)
        _, status, usage = os.wait4(child.pid, 0)
        seconds = time.monotonic() - started
        child.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        err.seek(0)
        if child.returncode != 0:
            words = shlex.join(command)
            raise Failed(f"`{words}` ended with {child.returncode}: {err.read()[-500:].strip()}")
        return Run(seconds, usage.ru_maxrss * 1024, out.read())


def interleave(commands, runs):
    """Runs commands in turn, each named and with its output, and returns the runs of each.

    The output is removed and everything is synced before each run, so that none pays
    for the writing of the one before it.
    """
    measured = {name: [] for name in commands}
    for _ in range(runs):
        for name, (command, output) in commands.items():
            output.unlink(missing_ok=True)
            os.sync()
            measured[name].append(run(command))
            print(f"  {name}: {measured[name][-1].seconds:.2f} s", file=sys.stderr, flush=True)
    return measured


def warm(path):
    """Reads a file, so that it is in the page cache."""
    with open(path, "rb", buffering=0) as file:
        while file.read(8 * MIB):
            pass


# ---------------------------------------------------------------- reporting


def figures(runs):
    """Sums up the runs of one command."""
    seconds = [r.seconds for r in runs]
    return {
        "median_s": statistics.median(seconds),
        "seconds": seconds,
        "rss_bytes_max": max(r.rss_bytes for r in runs),
        "rss_bytes": [r.rss_bytes for r in runs],
    }


def compare(measured, first, second):
    """Returns how the times of two interleaved commands relate, first to second."""
    pairs = [a.seconds / b.seconds for a, b in zip(measured[first], measured[second])]
    of_medians = figures(measured[first])["median_s"] / figures(measured[second])["median_s"]
    return {
        "first": first,
        "second": second,
        "ratio_of_medians": of_medians,
        "pairwise": pairs,
        "pairwise_median": statistics.median(pairs),
    }


def table(heads, rows):
    """Prints a Markdown table."""
    print("| " + " | ".join(heads) + " |")
    print("|" + " --- |" * len(heads))
    for row in rows:
        print("| " + " | ".join(str(cell) for cell in row) + " |")
    print(flush=True)


def report(measured, triangles, pairs):
    """Prints the times of all commands and the ratios asked for, and returns both."""
    sums = {name: figures(runs) for name, runs in measured.items()}
    rows = []
    for name, f in sums.items():
        spread = f"{min(f['seconds']):.2f}–{max(f['seconds']):.2f}"
        rate = f"{triangles / f['median_s'] / 1e6:.1f}"
        rows.append((name, f"{f['median_s']:.2f}", spread, rate, mib(f["rss_bytes_max"])))
    table(("run", "median s", "all s", "M triangles/s", "peak RSS MiB"), rows)
    ratios = [compare(measured, first, second) for first, second in pairs]
    table(
        ("time of / time of", "of medians", "pairwise median", "pairs"),
        [
            (
                f"{r['first']} / {r['second']}",
                f"{r['ratio_of_medians']:.3f}",
                f"{r['pairwise_median']:.3f}",
                " ".join(f"{p:.2f}" for p in r["pairwise"]),
            )
            for r in ratios
        ],
    )
    return {"runs": sums, "ratios": ratios}


def mib(size_bytes):
    """Returns a size in MiB, for a table."""
    return f"{size_bytes / MIB:.0f}"


# ---------------------------------------------------------------- files


def ply_counts(path):
    """Returns the vertices and the faces that the header of a PLY file announces."""
    with open(path, "rb") as file:
        header = file.read(4096).split(b"end_header")[0].decode("latin-1")
    counts = dict(re.findall(r"^element (\w+)\s+(\d+)", header, re.MULTILINE))
    return int(counts["vertex"]), int(counts["face"])


def stl_count(path):
    """Returns the triangles of a binary STL file."""
    with open(path, "rb") as file:
        return int.from_bytes(file.read(84)[80:], "little")


def digest(path):
    """Returns a hash of the bytes of a file."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def parse_bytes(text):
    """Returns the bytes of a size such as 128MiB, as the product spells it."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([KMGT]?)(i?)B?", text.strip(), re.IGNORECASE)
    if not match:
        raise argparse.ArgumentTypeError(f"{text!r} is not a size")
    number, prefix, binary = match.groups()
    base = 1024 if binary else 1000
    return int(float(number) * base ** " KMGT".index(prefix.upper() or " "))


class Bench:
    """The tools, the scratch folder and the inputs in it."""

    def __init__(self, options, scratch):
        self.options = options
        self.scratch = scratch
        self.meshmill = Path(options.meshmill).resolve()
        self.peer = PEERS / "target" / "release" / "peer-meshopt"
        self.judge = PEERS / "target" / "release" / "judge"
        self.shuffle = PEERS / "target" / "release" / "shuffle"
        # Even where they are there: they may be older than their source.
        manifest = PEERS / "Cargo.toml"
        build = ["cargo", "build", "-q", "--release", "--manifest-path", manifest]
        subprocess.run(build, check=True, stdout=sys.stderr)

    def path(self, name):
        """Returns a place in the scratch folder."""
        return self.scratch / name

    def surface(self, extension, triangles=None):
        """Returns a gyroid, generated unless it is there from before."""
        triangles = triangles or self.options.triangles
        path = self.path(f"iso{triangles.lower()}.{extension}")
        if not path.exists():
            note(f"generating {path.name}")
            run([self.meshmill, "generate", "gyroid", "--triangles", triangles, "-o", path])
        warm(path)
        return path

    def shuffled(self, ply):
        """Returns a PLY file with its vertices and triangles in random order."""
        path = ply.with_name(f"{ply.stem}_shuffled.ply")
        if not path.exists():
            note(f"shuffling {ply.name}")
            run([self.shuffle, ply, path, "--indexed"])
        warm(path)
        return path

    def clustering(self, source, out, *more):
        """Returns the command that clusters a file."""
        return [self.meshmill, "simplify", source, "-o", out, "--method", "cluster",
                "-j", "2", "--force", *more]

    def deviation(self, original, result):
        """Returns what the judge says, with the first as the original."""
        samples = str(self.options.samples)
        return json.loads(run([self.judge, original, result, "--json", "--samples", samples]).stdout)


def note(text):
    """Says what goes on."""
    print(text, file=sys.stderr, flush=True)


# ---------------------------------------------------------------- sections


def against_peer(bench, source):
    """Clusters one file with both, at the count that meshmill arrives at."""
    ours, theirs = bench.path("ours.ply"), bench.path("theirs.ply")
    budget = bench.options.memory
    cluster = bench.clustering(source, ours, "--ratio", "10%", "--memory", budget)
    run(cluster)
    _, target = ply_counts(ours)
    peer = [bench.peer, source, theirs, "--method", "sloppy", "--target-faces", str(target)]
    if bench.options.sync_peers:
        peer.append("--sync")
    commands = {"meshmill": (cluster, ours), "meshoptimizer": (peer, theirs)}
    measured = interleave(commands, bench.options.runs)
    triangles = stl_count(source) if source.suffix == ".stl" else ply_counts(source)[1]
    result = report(measured, triangles, [("meshmill", "meshoptimizer")])
    result["judged"] = judged = {
        "meshmill": bench.deviation(source, ours),
        "meshoptimizer": bench.deviation(source, theirs),
    }
    result["meshoptimizer_steps"] = [json.loads(r.stdout) for r in measured["meshoptimizer"]]
    rows = []
    for name, d in judged.items():
        surface = d["surface"]
        ways = [f"{surface[way]['rms_relative']:.3e}" for way in ("a_to_b", "b_to_a", "symmetric")]
        b = d["b"]
        largest = f"{surface['symmetric']['max_relative']:.3e}"
        edges = f"{b['non_manifold_edges']} · {b['boundary_edges']}"
        rows.append((name, b["triangles"], *ways, largest, edges))
    heads = ("result", "triangles", "RMS in→out", "RMS out→in", "RMS both", "max",
             "non-manifold · boundary edges")
    table(heads, rows)
    return result


def section_a(bench):
    """Clustering an indexed PLY to 10 %, against meshoptimizer's clustering."""
    return against_peer(bench, bench.surface("ply"))


def section_b(bench):
    """Clustering a binary STL to 10 %, against meshoptimizer's clustering."""
    return against_peer(bench, bench.surface("stl"))


def section_c(bench):
    """Peak resident memory over the budget, on a large file."""
    if not bench.options.large:
        print("Skipped: it generates a large file and runs only with --large.\n")
        return {"skipped": "needs --large"}
    source = bench.surface("ply", bench.options.large_triangles)
    out, told = bench.path("ours.ply"), bench.path("report.json")
    budget = bench.options.large_memory
    rows, result = [], {"budget": budget, "allowance_bytes": ALLOWANCE_BYTES, "cells": {}}
    for cells in bench.options.cells:
        measured = run(bench.clustering(
            source, out, "--cells", str(cells), "--memory", budget, "--report", told))
        facts = json.loads(told.read_text())
        over = measured.rss_bytes - parse_bytes(budget)
        result["cells"][cells] = {
            "seconds": measured.seconds,
            "rss_bytes": measured.rss_bytes,
            "over_budget_bytes": over,
            "report": facts,
        }
        rows.append((
            cells, facts["output"]["triangles"], f"{measured.seconds:.1f}",
            mib(measured.rss_bytes), mib(over), mib(facts["temporary_bytes_peak"]),
            "yes" if over <= ALLOWANCE_BYTES else "NO",
        ))
    heads = ("cells", "triangles out", "s", "peak RSS MiB", f"MiB over {budget}",
             "temporary MiB", f"within {mib(ALLOWANCE_BYTES)} MiB")
    table(heads, rows)
    return result


def section_d(bench):
    """A budget with room for a tenth of the cells against one that does not spill."""
    source = bench.surface("ply")
    target = shlex.split(bench.options.spill_target)
    commands, outputs, reports = {}, {}, {}
    for name, budget in (("spilling", bench.options.spill_memory),
                         ("roomy", bench.options.roomy_memory)):
        outputs[name] = bench.path(f"{name}.ply")
        reports[name] = bench.path(f"{name}.json")
        cluster = bench.clustering(
            source, outputs[name], *target, "--memory", budget, "--report", reports[name])
        commands[name] = (cluster, outputs[name])
    measured = interleave(commands, bench.options.runs)
    result = report(measured, ply_counts(source)[1], [("spilling", "roomy")])
    result["budgets"] = {"spilling": bench.options.spill_memory, "roomy": bench.options.roomy_memory}
    result["temporary_bytes_peak"] = {
        name: json.loads(path.read_text())["temporary_bytes_peak"] for name, path in reports.items()
    }
    result["same_bytes"] = digest(outputs["spilling"]) == digest(outputs["roomy"])
    temporary = " · ".join(f"{n} {mib(b)}" for n, b in result["temporary_bytes_peak"].items())
    print(f"Temporary MiB: {temporary}. Same bytes: {'yes' if result['same_bytes'] else 'NO'}.\n")
    return result


def section_e(bench):
    """PLY to triangle soup against copying the soup, with and without being synced."""
    ply = bench.surface("ply")
    vertices, triangles = ply_counts(ply)
    tenth = bench.options.soup_memory or str(vertices * VERTEX_BYTES // 10)
    out, copy, model = bench.path("soup.stl"), bench.path("copy.stl"), bench.path("model.stl")

    def soup(source, *more):
        return [bench.meshmill, "soup", source, "-o", out, "--force", *more], out

    run(soup(ply)[0])
    out.replace(model)
    commands = {
        "soup": soup(ply),
        "cp": (["cp", model, copy], copy),
        "copy, synced": (
            ["dd", f"if={model}", f"of={copy}", "bs=1M", "conv=fsync", "status=none"], copy),
        "soup, a tenth of the table": soup(ply, "--memory", tenth),
    }
    pairs = [("soup", "cp"), ("soup", "copy, synced"),
             ("soup, a tenth of the table", "cp"), ("soup, a tenth of the table", "soup")]
    if not bench.options.no_shuffled:
        shuffled = bench.shuffled(ply)
        commands["shuffled soup"] = soup(shuffled)
        commands["shuffled soup, a tenth of the table"] = soup(shuffled, "--memory", tenth)
        pairs += [("shuffled soup", "cp"), ("shuffled soup, a tenth of the table", "cp")]
    print(f"A tenth of the vertex table: `--memory {tenth}`.\n")
    result = report(interleave(commands, bench.options.runs), triangles, pairs)
    result["tenth_memory"] = tenth
    return result


SECTIONS = {"a": section_a, "b": section_b, "c": section_c, "d": section_d, "e": section_e}


# ---------------------------------------------------------------- the whole


def machine(bench):
    """Returns what the figures depend on."""
    cpu = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text())
    memory = Path("/proc/meminfo").read_text()
    lock = (PEERS / "Cargo.lock").read_text()
    return {
        "cpu": cpu[1] if cpu else platform.machine(),
        "cores": os.cpu_count(),
        "memory_bytes": int(re.search(r"MemTotal:\s*(\d+)", memory)[1]) * 1024,
        "system": platform.platform(),
        "load_before": os.getloadavg(),
        "meshmill": run([bench.meshmill, "--version"]).stdout.strip(),
        "meshopt": re.search(r'name = "meshopt"\nversion = "(.*)"', lock)[1],
        "rustc": run(["rustc", "--version"]).stdout.strip(),
        "python": platform.python_version(),
    }


def arguments():
    """Returns what was typed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("sections", nargs="*", metavar="SECTION", help="which to run: " + " ".join(SECTIONS))
    add("--meshmill", default=ROOT / "target" / "release" / "meshmill", help="the built program")
    add("--triangles", default="10M", help="of the input (default: %(default)s)")
    add("--runs", type=int, default=5, help="of each command (default: %(default)s)")
    add("--samples", type=int, default=1_000_000, help="of the judge (default: %(default)s)")
    add("--memory", default="128MiB", help="budget in a and b (default: %(default)s)")
    add("--sync-peers", action="store_true", help="make the peer sync its output, as meshmill does")
    add("--large", action="store_true", help="run section c")
    add("--large-triangles", default="50M", help="of its input (default: %(default)s)")
    add("--large-memory", default="256MiB", help="its budget (default: %(default)s)")
    add("--cells", type=int, nargs="+", default=[64, 512, 2048], help="its cells along an axis")
    add("--spill-target", default="--ratio 10%",
        help="what both runs of d ask for, as --spill-target='--cells 512'")
    add("--spill-memory", default="16MiB", help="room for a tenth of the cells (default: %(default)s)")
    add("--roomy-memory", default="2GiB", help="room for all (default: %(default)s)")
    add("--soup-memory", help="the small budget of e (default: a tenth of the vertex table)")
    add("--no-shuffled", action="store_true", help="leave out the shuffled PLY of e")
    add("--scratch", type=Path, help="a folder to work in, whose inputs are used again")
    add("--keep", action="store_true", help="keep the scratch folder made for this run")
    add("--json", type=Path, help="write all figures to this file")
    options = parser.parse_args()
    unknown = [name for name in options.sections if name not in SECTIONS]
    if unknown:
        parser.error(f"there is no section {unknown[0]!r}")
    if not Path(options.meshmill).exists():
        parser.error(f"{options.meshmill} does not exist: build it, or name it by --meshmill")
    return options


def measure(options, scratch):
    """Runs the sections, each whatever became of the others, and returns the exit code."""
    bench = Bench(options, scratch)
    results = {"machine": machine(bench), "options": vars(options) | {"scratch": None}}
    facts = results["machine"]
    print(f"{facts['cpu']}, {facts['cores']} cores, {facts['memory_bytes'] / 2**30:.0f} GiB · "
          f"{facts['meshmill']} · meshopt {facts['meshopt']} · {facts['rustc']} · "
          f"{options.triangles} triangles · {options.runs} runs\n")
    failed = False
    for name in sorted(set(options.sections or SECTIONS)):
        section = SECTIONS[name]
        print(f"### {name}. {section.__doc__}\n", flush=True)
        try:
            results[name] = section(bench)
        except Failed as error:
            failed = True
            results[name] = {"failed": str(error)}
            print(f"FAILED: {error}\n", flush=True)
    if options.json:
        options.json.write_text(json.dumps(results, indent=1, default=str) + "\n")
    return 1 if failed else 0


def main():
    """Works in the scratch folder and clears it away."""
    options = arguments()
    if options.scratch:
        # Not removed: its inputs are what it was given for.
        options.scratch.mkdir(parents=True, exist_ok=True)
        return measure(options, options.scratch)
    scratch = Path(tempfile.mkdtemp(prefix="meshmill-bench-"))
    try:
        return measure(options, scratch)
    finally:
        if options.keep:
            note(f"kept: {scratch}")
        else:
            shutil.rmtree(scratch, ignore_errors=True)


if __name__ == "__main__":
    sys.exit(main())
