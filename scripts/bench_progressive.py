#!/usr/bin/env python3
"""Progressive meshes: bytes, rates, and how good a beginning of the file is.

    scripts/bench_progressive.py FOLDER [--rounds N] [--scratch DIR]

FOLDER has `real/` and `big/`. Prints markdown for docs/MEASUREMENTS.md:

 - bytes a triangle at 14 bits beside Draco (DracoPy) and meshoptimizer (its Python package, deflated
   as a server would), which hold the same positions and triangles at full resolution only; left out
   where the packages are missing;
 - where the bytes go: each column of the batches, deflated alone;
 - triangles a second, medians of N runs: of the whole command, and by processor time;
 - what is drawn from 1, 5 and 20 % of the file, its RMS error beside that of `meshmill simplify` to
   the same count, both measured by `meshmill compare`, the greater of both ways.

Needs a release build.
"""

import argparse
import json
import pathlib
import resource
import statistics
import struct
import subprocess
import sys
import tempfile
import zlib

try:
    import numpy
except ImportError:
    numpy = None

ROOT = pathlib.Path(__file__).resolve().parent.parent
BITS = 14
SHARES = [1, 5, 20]
DRACO_LEVEL = 10

# docs/FORMATS.md: the header, and the head of each block.
HEADER_BYTES, HEAD_BYTES = 128, 32
COLUMNS = ["parents", "kinds and sectors", "places of parents", "places of new vertices", "colours"]


def meshmill_path():
    words = ["cargo", "metadata", "--format-version", "1", "--no-deps"]
    folder = json.loads(subprocess.check_output(words, cwd=ROOT))["target_directory"]
    return pathlib.Path(folder) / "release" / "meshmill"


class Bench:
    def __init__(self, scratch):
        self.meshmill, self.scratch = meshmill_path(), pathlib.Path(scratch)

    def run(self, *words):
        words = [str(word) for word in [self.meshmill, *words]]
        done = subprocess.run(words, capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"{' '.join(words)}: {done.stderr}")
        return done.stdout

    def report(self, *words):
        path = self.scratch / "report.json"
        self.run(*words, "--force", "-q", "--report", path)
        return json.loads(path.read_text())

    def progressive(self, mesh, rounds):
        """The file, its report, and medians of wall clock and processor time."""
        out, seconds, processor = self.scratch / f"{mesh.stem}.pm", [], []
        for _ in range(rounds):
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            report = self.report("progressive", mesh, "-o", out, "--bits", BITS)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            seconds.append(report["seconds"])
            processor.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
        return out, report, statistics.median(seconds), statistics.median(processor)

    def rms(self, mesh, result):
        words = ["compare", mesh, result, "--samples", "200k", "--json", "-q"]
        found = json.loads(self.run(*words))
        return max(found["a_to_b"]["rms"], found["b_to_a"]["rms"]) / found["diagonal"]


def read_ply(path):
    """Positions and triangles of a binary PLY as meshmill writes it."""
    data = path.read_bytes()
    head = data[: data.index(b"end_header\n") + 11]
    counts = [int(line.split()[2]) for line in head.decode().splitlines() if "element" in line]
    width = 8 if b"double x" in head else 4
    end = len(head) + counts[0] * 3 * width
    positions = numpy.frombuffer(data[len(head) : end], f"<f{width}").reshape(-1, 3)
    faces = numpy.frombuffer(data[end:], numpy.dtype([("n", "u1"), ("v", "<u4", 3)]))
    return positions, numpy.ascontiguousarray(faces["v"])


def draco_bytes(positions, faces):
    try:
        import DracoPy
    except ImportError:
        return None
    packed = DracoPy.encode(
        positions.astype("f4"), faces, quantization_bits=BITS, compression_level=DRACO_LEVEL
    )
    return len(packed)


def meshopt_bytes(positions, faces):
    try:
        import meshoptimizer as meshopt
    except ImportError:
        return None
    low = positions.min(axis=0)
    step = (positions.max(axis=0) - low).max() / (2**BITS - 1)
    quantized = numpy.zeros((len(positions), 4), "u2")
    quantized[:, :3] = numpy.round((positions - low) / step)
    indices = numpy.ascontiguousarray(faces.reshape(-1).astype("u4"))
    ordered = numpy.zeros_like(indices)
    meshopt.optimize_vertex_cache(ordered, indices, len(indices), len(positions))
    vertices = numpy.zeros_like(quantized)
    meshopt.optimize_vertex_fetch(
        vertices, ordered, quantized, len(ordered), len(positions), quantized.strides[0]
    )
    packed = meshopt.encode_vertex_buffer(vertices, len(vertices), vertices.strides[0])
    packed += meshopt.encode_index_buffer(ordered, len(ordered), len(positions))
    return len(packed), len(zlib.compress(packed, 9))


def sizes(bench, name, mesh, file, report):
    triangles = report["output"]["triangles"]
    row = [f"| {name} | {triangles:,}", f"{report['progressive']['bytes_per_triangle']:.2f}"]
    share = 100 * report["progressive"]["base_bytes"] / report["output"]["bytes"]
    row.append(f"{share:.2f} %")
    draco = meshopt = None
    if numpy is not None:
        whole = bench.scratch / "whole.ply"
        bench.report("refine", file, "-o", whole)
        arrays = read_ply(whole)
        draco, meshopt = draco_bytes(*arrays), meshopt_bytes(*arrays)
    row.append(f"{draco / triangles:.2f}" if draco else "–")
    row.append(" · ".join(f"{b / triangles:.2f}" for b in meshopt) if meshopt else "–")
    return " | ".join(row) + " |"


def skip_numbers(payload, at, count):
    """The end of `count` numbers in groups of seven bits."""
    while count:
        count -= payload[at] < 0x80
        at += 1
    return at


def columns(name, file, triangles):
    """A row: bytes a triangle of each column, deflated alone, of all batches."""
    data, at, sums = file.read_bytes(), HEADER_BYTES, [0] * len(COLUMNS)
    wide = 3 * -(-BITS // 8)
    for block in range(sys.maxsize):
        if at == len(data):
            break
        length, _, splits = struct.unpack_from("<III", data, at)
        payload = zlib.decompress(data[at + HEAD_BYTES :][:length], -zlib.MAX_WBITS)
        at += HEAD_BYTES + length
        if block == 0:
            continue
        parents = skip_numbers(payload, 0, splits)
        sectors = skip_numbers(payload, parents, 2 * splits)
        ends = [0, parents, sectors, sectors + wide * splits, sectors + 2 * wide * splits]
        for column, (begin, end) in enumerate(zip(ends, [*ends[1:], len(payload)])):
            sums[column] += len(zlib.compress(payload[begin:end], 9)) if end > begin else 0
    return " | ".join([f"| {name}", *(f"{count / triangles:.2f}" for count in sums)]) + " |"


def beginnings(bench, name, mesh, file, base_bytes):
    data, rows = file.read_bytes(), []
    for share in SHARES:
        cut = bench.scratch / "cut.pm"
        if len(data) * share // 100 < base_bytes:
            rows.append(f"| {name} | {share} % | – | still in the base | | |")
            continue
        cut.write_bytes(data[: len(data) * share // 100])
        ours, direct = bench.scratch / "ours.ply", bench.scratch / "direct.ply"
        count = bench.report("refine", cut, "-o", ours)["output"]["triangles"]
        bench.report("simplify", mesh, "-o", direct, "-t", count)
        one, two = bench.rms(mesh, ours), bench.rms(mesh, direct)
        rows.append(
            f"| {name} | {share} % | {count:,} | {100 * one:.4f} % | {100 * two:.4f} % "
            f"| {one / two:.2f} |"
        )
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--scratch")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=args.scratch) as scratch:
        bench = Bench(scratch)
        large = bench.scratch / "bunnyct_2m.ply"
        bench.report("simplify", args.folder / "big/bunnyct_6m.ply", "-o", large, "-t", "2M")
        meshes = [
            ("igea_268k", args.folder / "real/igea_268k.ply"),
            ("dragon_vrip_res2", args.folder / "real/dragon_vrip_res2.ply"),
            ("bunnyct to 2 M", large),
        ]
        size_rows, column_rows, rate_rows, beginning_rows = [], [], [], []
        for name, mesh in meshes:
            file, report, seconds, processor = bench.progressive(mesh, args.rounds)
            triangles = report["output"]["triangles"]
            size_rows.append(sizes(bench, name, mesh, file, report))
            column_rows.append(columns(name, file, triangles))
            rate_rows.append(
                f"| {name} | {triangles / seconds / 1e3:.0f} k | {triangles / processor / 1e3:.0f} k "
                f"| {report['peak_memory_bytes'] / triangles:.0f} |"
            )
            base_bytes = report["progressive"]["base_bytes"]
            beginning_rows += beginnings(bench, name, mesh, file, base_bytes)
        print("| mesh | triangles | bytes a triangle | base, of the file | Draco | meshopt · deflated |")
        print("|---|---:|---:|---:|---:|---:|", *size_rows, sep="\n", end="\n\n")
        print("| mesh |", " | ".join(COLUMNS), "|")
        print("|---|" + "---:|" * len(COLUMNS), *column_rows, sep="\n", end="\n\n")
        print("| mesh | triangles a second | by processor time | bytes of memory a triangle |")
        print("|---|---:|---:|---:|", *rate_rows, sep="\n", end="\n\n")
        print("| mesh | of the file | triangles | RMS, of the diagonal | simplified | ratio |")
        print("|---|---:|---:|---:|---:|---:|", *beginning_rows, sep="\n")


if __name__ == "__main__":
    main()
