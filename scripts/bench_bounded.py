#!/usr/bin/env python3
"""Decimation under an error bound: does it hold, how few triangles are left, how fast.

    scripts/bench_bounded.py FOLDER [--meshes N] [--tables-only | --meshes-only] [--scratch DIR]

FOLDER has `real/` and `big/`. Prints markdown for docs/MEASUREMENTS.md:

 - Tables 1 and 2 of [CKS98] at the same shares of the diagonal, all three fairings;
 - the largest N meshes of `real/` at four bounds, and meshoptimizer beside it with `ErrorAbsolute`,
   its tolerance searched for until the same maximum is measured: over the vertices of the input, and
   over its surface.

Distances are measured by `meshmill compare`. The guarantee is about vertices; the surface is a million
points for the tables and a hundred thousand else. Builds both packages first.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
SHARES = [0.01, 0.05, 0.25, 1.0]
ISO_SHARES = [0.011, 0.11, 1.1]
SCAN_SHARES = [0.0044, 0.044, 0.44]
ORACLES = [
    ("order 1", ["--fairing", "shape"]),
    ("order 2", ["--fairing", "smooth", "--fairing-update", "all"]),
    ("order 2, fast update", ["--fairing", "smooth"]),
    ("error", ["--fairing", "error"]),
]
SEARCH_STEPS = 12


def target(package):
    folder = json.loads(
        subprocess.check_output(
            ["cargo", "metadata", "--format-version", "1", "--no-deps"], cwd=package
        )
    )["target_directory"]
    return pathlib.Path(folder) / "release"


class Bench:
    def __init__(self, scratch):
        for package in (ROOT, ROOT / "scripts/peers"):
            subprocess.run(["cargo", "build", "--release", "--locked", "-q"], cwd=package, check=True)
        self.meshmill = target(ROOT) / "meshmill"
        self.peer = target(ROOT / "scripts/peers") / "peer-meshopt"
        self.scratch = pathlib.Path(scratch)

    def run(self, *words):
        done = subprocess.run([str(word) for word in words], capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"{' '.join(map(str, words))}: {done.stderr}")
        return done.stdout

    def bounded(self, mesh, share, flags=(), memory="1GiB"):
        out, report = self.scratch / "ours.ply", self.scratch / "report.json"
        self.run(self.meshmill, "simplify", mesh, "-o", out, "--force", "-q", "--max-error",
                 f"{share}%", "--report", report, "--memory", memory, *flags)
        report = json.loads(report.read_text())
        stages = {stage["name"]: stage["seconds"] for stage in report["stages"]}
        return {
            "out": out,
            "triangles_in": report["input"]["triangles"],
            "triangles": report["output"]["triangles"],
            "seconds": stages["decimate"] + stages["finish"],
            "memory": report["peak_memory_bytes"],
            "bound": report["bounded"]["max_error"],
        }

    def compare(self, mesh, result, samples, seed=0):
        text = self.run(self.meshmill, "compare", mesh, result, "--samples", samples, "--seed", seed,
                        "--json", "-q")
        return json.loads(text)["a_to_b"]

    def vertices_max(self, mesh, result):
        """Over the vertices: a sample is among the points, another one where it is the farthest."""
        least = float("inf")
        for seed in range(20):
            found = self.compare(mesh, result, 1, seed)
            least = min(least, found["max"])
            if found["max"] != found["p50"]:
                break
        return least

    def surface_max(self, mesh, result, samples="100k"):
        return self.compare(mesh, result, samples)["max"]

    def peer_within(self, mesh, limit, measure, first):
        """The peer's fewest triangles whose measured maximum is within a limit."""
        out = self.scratch / "peer.ply"
        low, high, best = 0.0, None, None
        error = first
        for _ in range(SEARCH_STEPS):
            text = self.run(self.peer, mesh, out, "--method", "simplify", "--target-error", error)
            found = json.loads(text)
            if measure(mesh, out) <= limit:
                low = error
                if best is None or found["out_triangles"] < best["out_triangles"]:
                    best = found
            else:
                high = error
            error = 2 * error if high is None else (low + high) / 2
            if high is not None and high - low < 0.02 * high:
                break
        return best


def kilo(rate):
    return f"{rate / 1e3:,.0f}"


def table(bench, name, mesh, shares):
    print(f"\n{name}:\n")
    print("| oracle | ε, % of the diagonal | triangles left | removed/s, thousands | peak memory, MiB |"
          " maximum at vertices / ε | RMS / ε |")
    print("|---|---:|---:|---:|---:|---:|---:|")
    for oracle, flags in ORACLES:
        for share in shares:
            done = bench.bounded(mesh, share, flags)
            removed = (done["triangles_in"] - done["triangles"]) / done["seconds"]
            left = 100 * done["triangles"] / done["triangles_in"]
            rms = bench.compare(mesh, done["out"], "1M")["rms"]
            print(f"| {oracle} | {share} | {done['triangles']:,} ({left:.3g} %) | {kilo(removed)} |"
                  f" {done['memory'] >> 20} |"
                  f" {bench.vertices_max(mesh, done['out']) / done['bound']:.4f} |"
                  f" {rms / done['bound']:.3f} |", flush=True)


def tables(bench, folder):
    iso = bench.scratch / "gyroid.ply"
    bench.run(bench.meshmill, "generate", "gyroid", "--triangles", "81k", "-o", iso, "-q")
    table(bench, "Iso-surface, a gyroid of 81 K triangles", iso, ISO_SHARES)
    big = folder / "big/bunnyct_6m.ply"
    table(bench, "Iso-surface, a CT scan of 6.1 M triangles", big, ISO_SHARES)
    scan = folder / "real/igea_268k.ply"
    table(bench, "Scan, igea with 269 K triangles", scan, SCAN_SHARES)


def beside_the_peer(bench, meshes):
    print("\n| mesh | ε, % | left | thousand triangles/s | meshoptimizer, same maximum at vertices |"
          " same maximum on the surface | its thousand triangles/s |")
    print("|---|---:|---:|---:|---:|---:|---:|")
    violations = runs = 0
    for mesh in meshes:
        # What the peer reads, with equal positions as one vertex.
        plain = bench.scratch / "plain.stl"
        bench.run(bench.meshmill, "soup", mesh, "-o", plain, "--force", "-q")
        for share in SHARES:
            done = bench.bounded(plain, share)
            at_vertices = bench.vertices_max(plain, done["out"])
            on_surface = bench.surface_max(plain, done["out"])
            runs += 1
            violations += at_vertices > done["bound"]
            by_vertices = bench.peer_within(plain, at_vertices, bench.vertices_max, done["bound"])
            by_surface = bench.peer_within(plain, on_surface, bench.surface_max, done["bound"])
            name = f"{mesh.stem} ({done['triangles_in']:,})" if share == SHARES[0] else ""
            left = [found["out_triangles"] if found else None for found in (by_vertices, by_surface)]
            times = [f"{count / done['triangles']:.2f} ×" if count else "never" for count in left]
            speed = kilo(done["triangles_in"] / by_vertices["simplify_s"]) if by_vertices else ""
            print(f"| {name} | {share} | {done['triangles']:,} |"
                  f" {kilo(done['triangles_in'] / done['seconds'])} | {times[0]} | {times[1]} |"
                  f" {speed} |", flush=True)
    print(f"\n{runs} results, {violations} with a vertex beyond the bound.")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--meshes", type=int, default=20)
    parts = parser.add_mutually_exclusive_group()
    parts.add_argument("--tables-only", action="store_true")
    parts.add_argument("--meshes-only", action="store_true")
    parser.add_argument("--scratch")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=given.scratch) as scratch:
        bench = Bench(scratch)
        if not given.meshes_only:
            tables(bench, given.folder)
        if not given.tables_only:
            files = sorted((given.folder / "real").iterdir(), key=lambda file: -file.stat().st_size)
            same = {"igea_268k_normals_colour", "bun_zipper_conf"}
            files = [file for file in files if file.stem not in same]
            beside_the_peer(bench, files[: given.meshes])


if __name__ == "__main__":
    main()
