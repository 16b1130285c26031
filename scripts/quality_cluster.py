#!/usr/bin/env python3
"""Fidelity of clustering, by one judge: what edge quadrics and constrained placement are worth,
and how far from meshoptimizer's clustering we are at the same count.

    scripts/quality_cluster.py MESHES_FOLDER [--meshmill PATH] [--samples N]

MESHES_FOLDER holds the meshes named in the tables below. Prints Markdown. Needs release builds of
meshmill and of scripts/peers; python3 with nothing else.
"""

import argparse
import json
import pathlib
import subprocess
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
PEERS = ROOT / "scripts/peers/target/release"

BOUNDARY_MESH = "real/bunny70k_meshlab.ply"
PLACEMENT_MESHES = ["real/horse_97k.ply", "real/bunny70k_meshlab.ply", "real/armadillo_igl.obj", "real/igea_268k_normals_colour.ply"]
PEER_MESHES = ["real/bunny70k_meshlab.ply", "big/bunnyct_6m.ply"]
COUNT_MESHES = PLACEMENT_MESHES + ["real/ogre.obj", "real/os_mountain.obj", "real/dragon_vrip_res2.ply", "real/grey_nurse_shark.stl", "real/cube_40k.obj", "big/bunnyct_6m.ply"]


class Bench:
    def __init__(self, args, folder):
        self.args, self.folder = args, pathlib.Path(folder)

    def mesh(self, name):
        return str(pathlib.Path(self.args.meshes) / name)

    def simplify(self, mesh, *options):
        out, report = str(self.folder / "out.ply"), self.folder / "report.json"
        command = [self.args.meshmill, "simplify", mesh, "-o", out, "--method", "cluster", "--force", "-q", "--report", str(report)]
        subprocess.run(command + list(options), check=True)
        return out, json.loads(report.read_text())

    def judge(self, a, b, *options):
        command = [str(PEERS / "judge"), a, b, "--json", "--samples", str(self.args.samples)]
        done = subprocess.run(command + list(options), check=True, capture_output=True, text=True)
        return json.loads(done.stdout)


def table(title, head, rows):
    print(f"\n### {title}\n\n| " + " | ".join(head) + " |\n|" + "---|" * len(head))
    for row in rows:
        print("| " + " | ".join(str(cell) for cell in row) + " |", flush=True)


def e(value):
    return f"{value:.2e}"


def boundary(bench):
    mesh = bench.mesh(BOUNDARY_MESH)
    for cells in [16, 32, 64, 96]:
        for weight in ["0", "0.5"]:
            out, report = bench.simplify(mesh, "--cells", str(cells), "--boundary-weight", weight)
            d = bench.judge(mesh, out, "--boundary")
            rim, surface = d["boundary"]["symmetric"], d["surface"]["symmetric"]
            yield cells, report["output"]["triangles"], "with" if weight != "0" else "without", e(rim["rms_relative"]), e(rim["max_relative"]), e(surface["rms_relative"]), e(surface["max_relative"])


def placement(bench):
    for name in PLACEMENT_MESHES:
        mesh = bench.mesh(name)
        for cells in [32, 96]:
            for way in ["constrained", "clamped", "free"]:
                out, report = bench.simplify(mesh, "--cells", str(cells), "--placement", way)
                surface = bench.judge(mesh, out)["surface"]["symmetric"]
                yield name, cells, report["output"]["triangles"], way, e(surface["rms_relative"]), e(surface["max_relative"])


def peers(bench):
    for name in PEER_MESHES:
        mesh = bench.mesh(name)
        for ratio in ["10%", "1%"]:
            out, report = bench.simplify(mesh, "--ratio", ratio)
            ours = bench.judge(mesh, out)
            other = str(bench.folder / "peer.ply")
            command = [str(PEERS / "peer-meshopt"), mesh, other, "--method", "sloppy", "--target-faces", str(report["output"]["triangles"])]
            done = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
            theirs = bench.judge(mesh, other)
            for who, count, d in [("meshmill", report["output"]["triangles"], ours), ("meshoptimizer sloppy", done["out_triangles"], theirs)]:
                s = d["surface"]
                yield name, ratio, who, count, e(s["a_to_b"]["rms_relative"]), e(s["b_to_a"]["rms_relative"]), e(s["symmetric"]["max_relative"])


def counts(bench):
    for name in COUNT_MESHES:
        for ratio in ["50%", "10%", "1%"]:
            _, report = bench.simplify(bench.mesh(name), "--ratio", ratio)
            cluster, wanted = report["cluster"], report["input"]["triangles"] * float(ratio[:-1]) / 100
            out = report["output"]["triangles"]
            yield name, ratio, round(wanted), cluster["triangles_estimated"], out, f"{out / wanted:.2f}", cluster["attempts"], f"{out / cluster['cells_occupied']:.2f}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("meshes")
    parser.add_argument("--meshmill", default=str(ROOT / "target/release/meshmill"))
    parser.add_argument("--samples", type=int, default=300_000)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(args, folder)
        table(f"Edge quadrics: {BOUNDARY_MESH}", ["cells", "triangles", "edge quadrics", "boundary RMS", "boundary max", "surface RMS", "surface max"], boundary(bench))
        table("Placement", ["mesh", "cells", "triangles", "placement", "RMS", "max"], placement(bench))
        table("Beside meshoptimizer's clustering", ["mesh", "ratio", "by", "triangles", "RMS A→B", "RMS B→A", "max"], peers(bench))
        table("Wanted counts", ["mesh", "ratio", "wanted", "estimated", "result", "of wanted", "attempts", "triangles a cell"], counts(bench))


if __name__ == "__main__":
    main()
