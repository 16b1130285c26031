#!/usr/bin/env python3
"""Measures every method of meshmill and of its peers on the same inputs, and writes the table.

Whole processes: read, simplify, write. The runs of all methods on one input are interleaved; what is
quick runs several times and its median counts. All results are judged by one judge, which is not part
of meshmill. Writes docs/BENCHMARKS.md, its plots beside it in docs/benchmarks/, and all figures as
JSON in --scratch. What dies, loses data, or takes longer than --patience is shown as that.

Inputs: iso-surfaces that meshmill generates, and real meshes of the folder that MESHMILL_SHARED names,
turned into binary PLY. Peers: meshoptimizer (built from scripts/peers), and from PyPI, by versions in
scripts/peers/python/requirements.txt, pymeshlab, VTK, Open3D and fast-simplification, in a virtual
environment of their own. Needs Python 3.11, Rust, and for Open3D the libraries libusb-1.0 and libGL.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path

import bench_cluster as bench
import bench_report

PYTHON_PEERS = bench.PEERS / "python"
# Runs shorter than this are repeated.
QUICK_S = 10.0
# Children are looked at so often, at least.
LOOK_S = 0.05


def meshmill(b, *more):
    """A method of ours."""
    return lambda source, out, ratio: [
        b.meshmill, "simplify", source, "-o", out, "--ratio", str(ratio), "--memory",
        b.options.memory, "--force", "-q", *more]


def meshoptimizer(b, method):
    """A method of meshoptimizer."""
    return lambda source, out, ratio: [
        b.peer, source, out, "--method", method, "--target-ratio", str(ratio)]


def from_pypi(b, name):
    """A peer with a Python interface."""
    return lambda source, out, ratio: [
        b.python, PYTHON_PEERS / "peer.py", name, source, out, "--target-ratio", str(ratio)]


def vtk_binned(b):
    """VTK's clustering, which takes a number of cells: the one that meets the count is found first."""
    found = {}

    def command(source, out, divisions):
        return [b.python, PYTHON_PEERS / "peer.py", "vtk-binned", source, out,
                "--divisions", str(divisions)]

    def divisions(source, ratio):
        wanted = bench.ply_counts(source)[1] * ratio
        # A surface crosses about as many of n³ cells as n² and leaves two triangles in each.
        guess = max(2, round((wanted / 4) ** 0.5))
        for _ in range(2):
            told = bench.run(command(source, b.path("binned.ply"), guess)).stdout
            guess = max(2, round(guess * (wanted / json.loads(told)["out_triangles"]) ** 0.5))
        return guess

    def with_divisions(source, out, ratio):
        if (source, ratio) not in found:
            try:
                found[source, ratio] = divisions(source, ratio)
            except bench.Failed:
                found[source, ratio] = 2
        return command(source, out, found[source, ratio])

    return with_divisions


def methods(b):
    """Returns all methods by name: ours first. Those that cluster meet a count only about."""
    return {
        "meshmill": meshmill(b),
        "meshmill --metric volume": meshmill(b, "--metric", "volume"),
        "meshmill --method hybrid": meshmill(b, "--method", "hybrid"),
        "meshmill --method cluster": meshmill(b, "--method", "cluster"),
        "meshoptimizer": meshoptimizer(b, "simplify"),
        "meshoptimizer, update": meshoptimizer(b, "update"),
        "meshoptimizer, sloppy": meshoptimizer(b, "sloppy"),
        "fast-simplification": from_pypi(b, "fast-simplification"),
        "MeshLab (pymeshlab)": from_pypi(b, "pymeshlab"),
        "VTK quadric": from_pypi(b, "vtk-quadric"),
        "VTK binned": vtk_binned(b),
        "Open3D": from_pypi(b, "open3d"),
    }


# ---------------------------------------------------------------- running


def run(command, options):
    """Runs a command to its end, or until it has taken too long or too much memory."""
    command = [str(word) for word in command]
    with tempfile.TemporaryFile("w+") as err:
        started = time.monotonic()
        child = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                                 stderr=err)
        verdict = watch(child, started, options)
        seconds = time.monotonic() - started
        err.seek(0)
        said = err.read().strip().splitlines()
    status, usage = child.usage
    if not verdict and status != 0:
        verdict = f"failed: {said[-1][:100]}" if said else f"ended with {status}"
    return {"seconds": seconds, "rss_bytes": usage.ru_maxrss * 1024, "verdict": verdict}


def watch(child, started, options):
    """Waits for a child; returns why it was ended, or None."""
    verdict = None
    while True:
        pid, status, usage = os.wait4(child.pid, os.WNOHANG)
        if pid:
            child.returncode = os.waitstatus_to_exitcode(status)
            child.usage = (child.returncode, usage)
            return verdict
        if not verdict and time.monotonic() - started > options.patience:
            verdict = f"more than {options.patience} s"
        if not verdict and resident_bytes(child.pid) > bench.parse_bytes(options.memory_max):
            verdict = f"more than {options.memory_max}"
        if verdict:
            child.kill()
        # A hundredth of what has passed, so that short runs are measured well.
        time.sleep(min(LOOK_S, 0.001 + (time.monotonic() - started) / 100))


def resident_bytes(pid):
    """Returns what a process holds in memory."""
    try:
        pages = Path(f"/proc/{pid}/statm").read_text().split()[1]
    except (OSError, IndexError):
        return 0
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


def measure_all(b, source, ratio, wanted):
    """Runs all methods on one input in turns, and judges what they made."""
    b.warm(source)
    triangles = bench.ply_counts(source)[1]
    measured = {name: [] for name in wanted}
    for turn in range(b.options.runs):
        for name, command in wanted.items():
            before = measured[name]
            if turn and (before[0]["verdict"] or before[0]["seconds"] > QUICK_S):
                continue
            out = b.path("out_" + bench_report.slug(name) + ".ply")
            out.unlink(missing_ok=True)
            os.sync()
            one = run(command(source, out, ratio), b.options)
            before.append(one)
            bench.note(f"  {name}: {one['seconds']:.2f} s {one['verdict'] or ''}")
    rows = {}
    for name, runs in measured.items():
        out = b.path("out_" + bench_report.slug(name) + ".ply")
        row = {
            "seconds": statistics.median(one["seconds"] for one in runs),
            "runs": len(runs),
            "rss_bytes": max(one["rss_bytes"] for one in runs),
            "verdict": next((one["verdict"] for one in runs if one["verdict"]), None),
        }
        if not row["verdict"]:
            row |= judged(b, source, out)
        out.unlink(missing_ok=True)
        rows[name] = row
    return {"input": source.stem, "triangles": triangles, "ratio": ratio, "methods": rows}


def judged(b, source, out):
    """Returns what the judge says of a result."""
    try:
        d = b.deviation(source, out)
    except bench.Failed as failure:
        return {"verdict": f"its output cannot be read: {str(failure)[-80:]}"}
    ways = d["surface"]
    after = d["b"]
    return {
        "triangles": after["triangles"],
        "rms": [ways[way]["rms_relative"] for way in ("a_to_b", "b_to_a")],
        "max": ways["symmetric"]["max_relative"],
        "non_manifold_edges": after["non_manifold_edges"],
        "boundary_edges": after["boundary_edges"],
    }


# ---------------------------------------------------------------- inputs and tools


class Bench(bench.Bench):
    """The tools, the scratch folder and the inputs in it."""

    def __init__(self, options, scratch):
        super().__init__(options, scratch)
        self.python = environment(options.environment)

    def warm(self, path):
        """Has a file in the page cache."""
        bench.warm(path)

    def real(self, name):
        """Returns a real mesh as a binary PLY, None when it is not there."""
        shared = os.environ.get("MESHMILL_SHARED")
        source = shared and Path(shared) / "meshes" / name
        if not source or not source.exists():
            bench.note(f"skipped, since MESHMILL_SHARED does not lead to it: {name}")
            return None
        made = self.path(f"{source.stem}.ply")
        if not made.exists():
            soup = self.path("soup.soup")
            bench.run([self.meshmill, "soup", source, "-o", soup, "--force"])
            bench.run([self.meshmill, "weld", soup, "-o", made, "--force"])
            soup.unlink()
        return made


def environment(folder):
    """Returns the Python of the peers' virtual environment, made unless it is there."""
    python = folder / "bin" / "python"
    if not python.exists():
        bench.note(f"installing the peers from PyPI into {folder}")
        venv.create(folder, with_pip=True)
        lock = PYTHON_PEERS / "requirements.txt"
        subprocess.run([python, "-m", "pip", "install", "-q", "-r", lock], check=True,
                       stdout=sys.stderr)
    return python


def arguments():
    """Reads the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--meshmill", type=Path, default=bench.ROOT / "target" / "release" / "meshmill")
    add("--environment", type=Path, default=bench.ROOT / "target" / "bench-environment",
        help="where the peers from PyPI are, or are to be installed")
    add("--scratch", type=Path, required=True, help="a folder for inputs, outputs and figures.json")
    add("--generated", default="1M,10M,50M", help="triangles of the iso-surfaces")
    add("--real", default="real/igea_268k.ply,real/dragon_vrip_res2.ply,big/bunnyct_6m.ply")
    add("--ratios", default="0.1,0.01")
    add("--curve", default="0.3,0.1,0.03,0.01,0.003",
        help="ratios at which the error is drawn, of the first generated one")
    add("--only", default="", help="only methods whose names contain one of these words")
    add("--runs", type=int, default=3)
    add("--samples", type=int, default=1_000_000)
    add("--memory", default="1GiB", help="for meshmill")
    add("--memory-max", default="18GiB", help="what takes more is ended")
    add("--patience", type=float, default=300, help="seconds after which a run is ended")
    add("--add", action="store_true", help="measure only what figures.json does not have")
    add("--again", action="store_true", help="with --add: measure --only's methods once more")
    add("--report-only", action="store_true", help="write the documents from figures.json again")
    return parser.parse_args()


def main():
    """Measures, and writes the documents."""
    options = arguments()
    options.scratch.mkdir(parents=True, exist_ok=True)
    figures_file = options.scratch / "figures.json"
    if not options.report_only:
        measure(Bench(options, options.scratch), figures_file)
    figures = json.loads(figures_file.read_text())
    # Of a run that was ended before the curve, what it has of it.
    figures["curve"] = figures["curve"] or [
        one for one in figures["tables"] if one["input"] == f"iso{options.generated.split(',')[0].lower()}"]
    docs = bench.ROOT / "docs"
    bench_report.write(figures, docs)
    figures_file.write_text(json.dumps(figures, indent=1))
    subprocess.run([environment(options.environment), Path(__file__).parent / "bench_plots.py",
                    figures_file, docs / "benchmarks"], check=True)


def measure(b, figures_file):
    """Measures all inputs, and what the curve needs besides; writes the figures after each."""
    options = b.options
    words = [word for word in options.only.split(",") if word]
    order = methods(b)
    wanted = {name: command for name, command in order.items()
              if not words or any(word in name for word in words)}
    figures = {"machine": bench_report.machine(b), "options": bench_report.told(options),
               "tables": [], "curve": []}
    if options.add and figures_file.exists():
        figures = bench_report.added_to(json.loads(figures_file.read_text()), figures)
    done = {(one["input"], one["ratio"]): one for one in figures["curve"] + figures["tables"]}
    seen = set()

    def measured(source, ratio, methods):
        place = (source.stem, ratio)
        one = done.setdefault(place, {"methods": {}})
        again = options.again and place not in seen
        seen.add(place)
        new = {name: command for name, command in methods.items()
               if again or name not in one["methods"]}
        if new:
            bench.note(f"{source.name} to {ratio:.1%}")
            rows = one["methods"]
            one |= measure_all(b, source, ratio, new)
            rows |= one["methods"]
            one["methods"] = {name: rows[name] for name in order if name in rows}
        return one

    for source in inputs(b):
        alive = dict(wanted)
        for ratio in map(float, options.ratios.split(",")):
            one = measured(source, ratio, alive)
            if one not in figures["tables"]:
                figures["tables"].append(one)
            figures_file.write_text(json.dumps(figures, indent=1))
            # What did not finish will not finish at another ratio.
            alive = {name: command for name, command in alive.items()
                     if not one["methods"].get(name, {"verdict": None})["verdict"]}
    figures["tables"].sort(key=lambda one: (one["triangles"], -one["ratio"]))
    first = b.surface("ply", options.generated.split(",")[0])
    figures["curve"] = []
    for ratio in map(float, options.curve.split(",")):
        figures["curve"].append(measured(first, ratio, wanted))
        figures_file.write_text(json.dumps(figures, indent=1))


def inputs(b):
    """Yields the inputs, small ones first."""
    generated = [b.surface("ply", count) for count in b.options.generated.split(",") if count]
    real = [b.real(name) for name in b.options.real.split(",") if name]
    found = [path for path in generated + real if path]
    return sorted(found, key=lambda path: bench.ply_counts(path)[1])


if __name__ == "__main__":
    sys.exit(main())
