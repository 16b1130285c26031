#!/usr/bin/env python3
"""Measures decimation side by side with meshoptimizer's edge collapse, and both errors by one judge.

Everything is run interleaved (A B A B ...) on warm input. Prints Markdown. Sections, all of which
run unless some are named:
  a  an indexed PLY to 10 % and to 1 %
  b  the same surface as a sorted STL, to 10 %: the peer welds first
  c  one thread against two
  d  real meshes named with --mesh, to 10 % and to 1 %
  e  throughput at ten times the size (only with --large)
  f  the methods side by side at one count, as in [WK03 Fig. 4], on meshes named with --mesh
  g  a pipe from the generator, of any size: read once, no disk (only with --pipe-triangles)

Needs a built meshmill; builds the peers if they are missing. Only the standard library of
Python 3.11.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import bench_cluster as bench


def decimating(b, source, out, ratio, *more, method="stream"):
    """Returns the command that decimates a file."""
    return [b.meshmill, "simplify", source, "-o", out, "--method", method, "--ratio", ratio,
            "--memory", b.options.memory, "--force", "-q", *more]


DEVIATION_HEAD = ("result", "triangles", "RMS in→out", "RMS out→in", "max",
                  "non-manifold · boundary edges")


def deviation_row(b, name, source, out):
    """Returns what the judge says of a result, for a table."""
    d = b.deviation(source, out)
    surface, after = d["surface"], d["b"]
    ways = [f"{surface[way]['rms_relative']:.2e}" for way in ("a_to_b", "b_to_a")]
    largest = f"{surface['symmetric']['max_relative']:.2e}"
    edges = f"{after['non_manifold_edges']} · {after['boundary_edges']}"
    return name, after["triangles"], *ways, largest, edges


def both(b, source, ratio, runs):
    """Decimates one file with both and prints times and errors."""
    ours, theirs = b.path("ours.ply"), b.path("theirs.ply")
    share = str(float(ratio.rstrip("%")) / 100)
    peer = [b.peer, source, theirs, "--method", "simplify", "--target-ratio", share]
    commands = {"meshmill": (decimating(b, source, ours, ratio), ours), "meshoptimizer": (peer, theirs)}
    if b.options.volume:
        out = b.path("volume.ply")
        command = decimating(b, source, out, ratio, "--metric", "volume")
        commands["meshmill, --metric volume"] = (command, out)
    # To a tenth, what clustering leaves is most of the mesh.
    if b.options.hybrid and ratio == "1%":
        out = b.path("hybrid.ply")
        command = decimating(b, source, out, ratio, method="hybrid")
        commands["meshmill, --method hybrid"] = (command, out)
    measured = bench.interleave(commands, runs)
    count = bench.stl_count(source) if source.suffix == ".stl" else bench.ply_counts(source)[1]
    print(f"**{source.name} to {ratio}**\n")
    bench.report(measured, count, [(name, "meshoptimizer") for name in commands if name != "meshoptimizer"])
    bench.table(DEVIATION_HEAD,
                [deviation_row(b, name, source, out) for name, (_, out) in commands.items()])


def section_a(b):
    """An indexed PLY."""
    for ratio in ("10%", "1%"):
        both(b, b.surface("ply"), ratio, b.options.runs)


def section_b(b):
    """A sorted STL."""
    path = b.path("sorted.stl")
    if not path.exists():
        bench.run([b.meshmill, "sort", b.surface("ply"), "-o", path])
    bench.warm(path)
    both(b, path, "10%", b.options.runs)


def section_c(b):
    """One thread against two."""
    source = b.surface("ply")
    outs = {threads: b.path(f"threads{threads}.ply") for threads in ("1", "2")}
    commands = {f"-j {threads}": (decimating(b, source, out, "10%", "-j", threads), out)
                for threads, out in outs.items()}
    measured = bench.interleave(commands, b.options.runs)
    bench.report(measured, bench.ply_counts(source)[1], [("-j 2", "-j 1")])
    same = bench.digest(outs["1"]) == bench.digest(outs["2"])
    print(f"Same bytes: {'yes' if same else 'NO'}.\n")


def section_d(b):
    """Real meshes."""
    for mesh in b.options.mesh:
        for ratio in ("10%", "1%"):
            both(b, Path(mesh), ratio, 1)


def section_e(b):
    """Ten times the size."""
    if not b.options.large:
        print("Skipped: it generates a large file and runs only with --large.\n")
        return
    rows = []
    for triangles in (b.options.triangles, b.options.large_triangles):
        source, out = b.surface("ply", triangles), b.path("ours.ply")
        measured = bench.run([b.meshmill, "simplify", source, "-o", out, "--ratio", "1%",
                              "--memory", b.options.large_memory, "--force", "-q"])
        count = bench.ply_counts(source)[1]
        rows.append((count, f"{measured.seconds:.1f}", f"{count / measured.seconds / 1e6:.2f}",
                     bench.mib(measured.rss_bytes)))
    bench.table(("triangles", "s", "M triangles/s", "peak RSS MiB"), rows)


def section_f(b):
    """All methods at one count."""
    methods = {
        "slabs, quadrics": ["--method", "stream"],
        "slabs, volumes": ["--method", "stream", "--metric", "volume"],
        "window, multiple choice": ["--method", "stream", "--selection", "multiple-choice"],
        "hybrid": ["--method", "hybrid"],
        "clustering": ["--method", "cluster"],
    }
    for mesh in map(Path, b.options.mesh):
        rows = []
        target = str(max(bench.ply_counts(mesh)[1] // 50, 1))
        for name, flags in methods.items():
            out = b.path(f"{mesh.stem} {name}.ply")
            bench.run([b.meshmill, "simplify", mesh, "-o", out, "-t", target, "--memory",
                       b.options.memory, "--force", "-q", *flags])
            rows.append(deviation_row(b, name, mesh, out))
        out = b.path(f"{mesh.stem} meshoptimizer.ply")
        share = str(int(target) / bench.ply_counts(mesh)[1])
        bench.run([b.peer, mesh, out, "--method", "simplify", "--target-ratio", share])
        rows.append(deviation_row(b, "meshoptimizer simplify", mesh, out))
        print(f"**{mesh.name} to {target}**\n")
        bench.table(DEVIATION_HEAD, rows)


def section_g(b):
    """A pipe."""
    rows = []
    for triangles in b.options.pipe_triangles:
        out, report = b.path("piped.ply"), b.path("piped.json")
        generate = [b.meshmill, "generate", "gyroid", "--triangles", triangles, "-q",
                    "-o", "-", "--output-format", "soup"]
        simplify = [b.meshmill, "simplify", "-", "--input-format", "soup", "--assume-sorted", "z",
                    "--selection", "threshold", "--ratio", "1%", "--memory", b.options.large_memory,
                    "-o", out, "--force", "-q", "--report", report]
        with subprocess.Popen(list(map(str, generate)), stdout=subprocess.PIPE) as source:
            subprocess.run(list(map(str, simplify)), stdin=source.stdout, check=True)
        told = json.loads(report.read_text())
        before, after = (told[side]["triangles"] for side in ("input", "output"))
        rows.append((before, after, f"{told['seconds']:.0f}", f"{before / told['seconds'] / 1e6:.2f}",
                     bench.mib(told["peak_memory_bytes"]), bench.mib(told["temporary_bytes_peak"])))
    bench.table(("triangles", "result", "s, with the generator", "M triangles/s", "peak RSS MiB",
                 "disk MiB"), rows)


SECTIONS = {"a": section_a, "b": section_b, "c": section_c, "d": section_d, "e": section_e,
            "f": section_f, "g": section_g}


def arguments():
    """Returns what was typed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("sections", nargs="*", metavar="SECTION", help="which to run: " + " ".join(SECTIONS))
    add("--meshmill", default=bench.ROOT / "target" / "release" / "meshmill", help="the built program")
    add("--triangles", default="10M", help="of the input (default: %(default)s)")
    add("--runs", type=int, default=3, help="of each command (default: %(default)s)")
    add("--samples", type=int, default=1_000_000, help="of the judge (default: %(default)s)")
    add("--memory", default="256MiB", help="budget (default: %(default)s)")
    add("--volume", action="store_true", help="measure --metric volume, too")
    add("--hybrid", action="store_true", help="measure --method hybrid to 1 %%, too")
    add("--mesh", action="append", default=[], help="a PLY for section d")
    add("--large", action="store_true", help="run section e")
    add("--large-triangles", default="100M", help="of its input (default: %(default)s)")
    add("--large-memory", default="1GiB", help="its budget (default: %(default)s)")
    add("--pipe-triangles", action="append", default=[], help="of an input of section g")
    add("--scratch", help="a folder to work in, whose inputs are used again")
    options = parser.parse_args()
    unknown = set(options.sections) - set(SECTIONS)
    if unknown:
        parser.error(f"no such section: {' '.join(sorted(unknown))}")
    return options


def main():
    """Runs the sections."""
    options = arguments()
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(options.scratch or folder)
        scratch.mkdir(parents=True, exist_ok=True)
        b = bench.Bench(options, scratch)
        facts = bench.machine(b)
        load = " ".join(f"{value:.1f}" for value in os.getloadavg())
        print(f"{facts['cpu']}, {facts['cores']} cores; load {load}; meshopt {facts['meshopt']}.\n")
        for name in options.sections or SECTIONS:
            print(f"## {name}: {SECTIONS[name].__doc__}\n")
            try:
                SECTIONS[name](b)
            except bench.Failed as failure:
                print(f"FAILED: {failure}\n")
                sys.exit(1)


if __name__ == "__main__":
    main()
