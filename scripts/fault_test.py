#!/usr/bin/env python3
"""Makes meshmill fail in every way its storage can, and looks at what it leaves.

Needs a build with debug assertions (cargo build): the faults are made inside, by the environment
variable MESHMILL_FAULT. For each small job and each kind of fault, the n-th call fails, for every n
until a run comes to its end. Then: an error that names a path and a verb, exit code 1, nothing under
the output's name; what is left, if anything, is resumed and gives the bytes of an undisturbed run.
Bits flipped in temporary files must be found, or not matter. Then faults of real file systems: a small
one as the folder for temporary files and for the output, where one can be mounted, and folders that
are removed under way. Prints how many faults of each kind were made.
"""

import argparse
import collections
import filecmp
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time

JOBS = [
    ("sort", "sort in.stl -o out.soup --memory 1MiB"),
    ("weld", "weld in.stl -o out.ply --memory 1MiB"),
    ("soup", "soup big.ply -o out.stl --memory 1MiB"),
    ("cluster", "simplify in.stl -o out.ply --cells 400 --memory 1MiB"),
    ("hybrid", "simplify in.ply -o out.ply --method hybrid -t 3000 --memory 4MiB"),
    ("stream", "simplify in.stl -o out.ply --ratio 20% --method stream --memory 16MiB"),
    ("choice", "simplify big.stl -o out.ply --ratio 20% --selection multiple-choice --memory 2MiB"),
    ("choice, packed", "simplify big.stl -o out.stl.gz --ratio 20% --selection multiple-choice --memory 1MiB"),
    ("pipe", "simplify - --input-format stl -o out.ply --cells 40 --memory 1MiB"),
    ("topology", "info big.stl --topology --memory 2MiB"),
    ("compare", "compare in.stl in.ply --samples 2k --memory 4MiB"),
]
KINDS = ["create", "open", "read", "write", "allocate", "set-length", "sync", "rename"]


class Fault(Exception):
    pass


class Bench:
    def __init__(self, binary, folder, checkpoints):
        self.binary, self.folder, self.checkpoints = binary, folder, checkpoints
        self.counts = collections.Counter()
        self.resumed = 0

    def path(self, name):
        return os.path.join(self.folder, name)

    def run(self, line, fault=None, more="", temp="temp"):
        environment = {**os.environ, "RUST_BACKTRACE": "0"}
        if fault:
            environment["MESHMILL_FAULT"] = fault
        keeps = line.split()[0] not in ("info", "compare", "render", "generate")
        dense = f" --checkpoint-seconds {self.checkpoints}" if keeps else ""
        command = [self.binary, *f"{line}{dense} --temp-dir {temp} {more}".split()]
        stdin = open(self.path("in.stl"), "rb") if " - " in line else subprocess.DEVNULL
        return subprocess.run(command, cwd=self.folder, stdin=stdin, capture_output=True, text=True, env=environment, timeout=120, check=False)

    def output(self, line):
        found = re.search(r"-o (\S+)", line)
        return found and self.path(found.group(1))

    def clean(self, output, temp="temp"):
        if output and os.path.exists(output):
            os.remove(output)
        for name in os.listdir(self.path(temp)):
            shutil.rmtree(self.path(os.path.join(temp, name)))

    def check(self, line, ran, what, expected, temp="temp"):
        """What must hold after a fault. Returns whether the run failed."""
        output = self.output(line)
        if ran.returncode == 0:
            if output and not filecmp.cmp(output, expected, shallow=False):
                raise Fault(f"{what}: said to be done, with other bytes")
            self.clean(output, temp)
            return False
        said = ran.stderr
        if ran.returncode != 1 or "panicked" in said:
            raise Fault(f"{what}: exit {ran.returncode}: {said[:600]}")
        if not re.search(r"meshmill: (cannot [a-z ]+ \S+|\S+: |.* needs \d+ bytes)", said):
            raise Fault(f"{what}: no path and verb: {said[:600]}")
        if output and os.path.exists(output):
            raise Fault(f"{what}: failed, and the output is there")
        partials = [name for name in os.listdir(self.folder) if name.endswith(".partial")]
        if partials:
            raise Fault(f"{what}: {partials} is left")
        left = os.listdir(self.path(temp)) if os.path.isdir(self.path(temp)) else []
        if left and "--resume" not in said:
            raise Fault(f"{what}: {left} is left and nobody said so: {said[:300]}")
        if left:
            again = self.run(line, more="--resume", temp=temp)
            if again.returncode != 0 or "going on from" not in again.stderr:
                raise Fault(f"{what}: not resumed: exit {again.returncode}: {again.stderr[:600]}")
            if not filecmp.cmp(output, expected, shallow=False):
                raise Fault(f"{what}: resumed to other bytes")
            self.resumed += 1
            self.clean(output, temp)
        return True

    def every(self, name, line, kind, step, expected):
        n, faults = 0, 0
        while True:
            ran = self.run(line, fault=f"{kind}:{n}")
            if not self.check(line, ran, f"{name}, {kind}:{n}", expected):
                break
            faults += 1
            n += step
        self.counts[kind] += faults
        return faults

    def flips(self, name, line, step, expected):
        """A flipped bit may lie where nobody looks again: then the result must be right."""
        writes, found, n, quiet = 0, 0, 0, 0
        while quiet < 40 and n < 4000:
            ran = self.run(line, fault=f"flip:{n}")
            failed = self.check(line, ran, f"{name}, flip:{n}", expected)
            if failed and "checksum" not in ran.stderr and "as it was written" not in ran.stderr and "not a record file" not in ran.stderr and "holds records" not in ran.stderr and "record count" not in ran.stderr:
                raise Fault(f"{name}, flip:{n}: found otherwise: {ran.stderr[:300]}")
            found += failed
            quiet = 0 if failed else quiet + 1
            writes, n = writes + 1, n + step
        self.counts["flip, found"] += found
        self.counts["flip, without effect"] += writes - found
        return found


def shuffled(folder):
    with open(os.path.join(folder, "in.stl"), "rb") as file:
        header, body = file.read(84), file.read()
    records = [body[i : i + 50] for i in range(0, len(body), 50)]
    random.Random(1).shuffle(records)
    with open(os.path.join(folder, "in.stl"), "wb") as file:
        file.write(header + b"".join(records))


def prepare(bench, triangles):
    os.mkdir(bench.path("temp"))
    for line in (
        f"generate height-field --triangles {triangles} -o in.soup",
        "soup in.soup -o in.stl",
        "generate height-field --triangles 170k -o big.soup",
        "soup big.soup -o big.stl",
    ):
        ran = subprocess.run([bench.binary, *line.split()], cwd=bench.folder, capture_output=True, text=True, check=False)
        assert ran.returncode == 0, ran.stderr
    shuffled(bench.folder)
    os.replace(bench.path("in.stl"), bench.path("small.stl"))
    os.replace(bench.path("big.stl"), bench.path("in.stl"))
    shuffled(bench.folder)
    os.replace(bench.path("in.stl"), bench.path("big.stl"))
    os.replace(bench.path("small.stl"), bench.path("in.stl"))
    for line in ("weld in.stl -o in.ply", "weld big.stl -o big.ply"):
        ran = subprocess.run([bench.binary, *line.split()], cwd=bench.folder, capture_output=True, text=True, check=False)
        assert ran.returncode == 0, ran.stderr


def mounted(path, size):
    os.makedirs(path, exist_ok=True)
    return subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", path], capture_output=True, check=False).returncode == 0


def real_faults(bench, expected_of):
    """Small file systems, and folders that go."""
    for size in ("300k", "1m", "2m", "3m", "4m"):
        for where in ("temporary files", "the output"):
            small = bench.path("small")
            if not mounted(small, size):
                print("SKIPPED: no small file system can be mounted here", flush=True)
                return
            try:
                for name, line in JOBS:
                    expected, output = expected_of[name], bench.output(line)
                    if output is None:
                        continue
                    if where == "temporary files":
                        ran = bench.run(line, temp="small")
                        if ran.returncode == 1:
                            bench.counts[f"real: {where} full"] += 1
                        # What is kept cannot go on there: with more room it can.
                        if os.listdir(small):
                            subprocess.run(["mount", "-o", "remount,size=64m", small], check=True)
                        bench.check(line, ran, f"{name}, {size} for {where}", expected, temp="small")
                        bench.clean(output, "small")
                        subprocess.run(["mount", "-o", f"remount,size={size}", small], check=True)
                    else:
                        moved = line.replace("-o out", "-o small/out")
                        ran = bench.run(moved)
                        if ran.returncode == 1:
                            bench.counts[f"real: {where} full"] += 1
                            if os.listdir(small):
                                raise Fault(f"{name}: {os.listdir(small)} on a full disk")
                            bench.clean(None)
                        else:
                            bench.check(moved, ran, f"{name}, {size} for {where}", expected)
            finally:
                subprocess.run(["umount", "-l", small], check=True)


def removed_under_way(bench, expected_of, rounds, dice):
    for name, line in JOBS:
        output = bench.output(line)
        for _ in range(rounds):
            process = subprocess.Popen(
                [bench.binary, *f"{line} --temp-dir temp".split()], cwd=bench.folder, text=True,
                stdin=open(bench.path("in.stl"), "rb") if " - " in line else subprocess.DEVNULL,
                stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env={**os.environ, "RUST_BACKTRACE": "0"},
            )
            time.sleep(dice.random() * 0.3)
            for left in os.listdir(bench.path("temp")):
                shutil.rmtree(bench.path(f"temp/{left}"), ignore_errors=True)
            _, said = process.communicate()
            if process.returncode not in (0, 1) or "panicked" in said:
                raise Fault(f"{name}, temporary files removed: exit {process.returncode}: {said[:400]}")
            if process.returncode == 0:
                if output and not filecmp.cmp(output, expected_of[name], shallow=False):
                    raise Fault(f"{name}, temporary files removed: other bytes")
            else:
                bench.counts["real: temporary files removed"] += 1
                if output and os.path.exists(output):
                    raise Fault(f"{name}, temporary files removed: the output is there")
            bench.clean(output)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--binary", default="target/debug/meshmill")
    parser.add_argument("--triangles", default="20k", help="size of the inputs (default 20k)")
    parser.add_argument("--step", type=int, default=1, help="every so many-th call only (default 1: all)")
    parser.add_argument("--checkpoints", type=int, default=0, help="seconds between two (default 0)")
    parser.add_argument("--only", default="", help="jobs whose name contains this")
    parser.add_argument("--seconds", type=int, default=10**9, help="stop beginning new jobs after so long")
    arguments = parser.parse_args()
    dice, faults, started = random.Random(1), 0, time.monotonic()
    with tempfile.TemporaryDirectory(prefix="meshmill-fault-") as folder:
        bench = Bench(os.path.abspath(arguments.binary), folder, arguments.checkpoints)
        prepare(bench, arguments.triangles)
        expected_of = {}
        for name, line in JOBS:
            if arguments.only not in name:
                continue
            if time.monotonic() - started > arguments.seconds:
                print(f"{name}: SKIPPED for want of time", flush=True)
                continue
            ran = bench.run(line)
            if ran.returncode != 0:
                print(f"{name}: exit {ran.returncode}: {ran.stderr[:300]}")
                faults += 1
                continue
            output, expected = bench.output(line), bench.path(f"expected-{name}")
            if output:
                os.replace(output, expected)
            bench.clean(None)
            expected_of[name] = expected
            told = []
            try:
                # The larger ones make many more calls of the same kinds.
                step = arguments.step * (7 if "big" in line else 1)
                for kind in KINDS:
                    told.append(f"{kind} {bench.every(name, line, kind, step, expected)}")
                size, n = 0, 0
                while True:
                    ran = bench.run(line, fault=f"full:{size}")
                    if not bench.check(line, ran, f"{name}, full:{size}", expected):
                        break
                    # The last byte that is missing is tried by the way.
                    size, n = size + 40_961 * step, n + 1
                bench.counts["full"] += n
                told.append(f"full {n}")
                for n in range(0, 12, arguments.step):
                    ran = bench.run(line, fault=f"short:{n}")
                    if bench.check(line, ran, f"{name}, short:{n}", expected):
                        raise Fault(f"{name}, short:{n}: a short write is no fault: {ran.stderr[:300]}")
                    bench.counts["short"] += 1
                told.append(f"flips found {bench.flips(name, line, step, expected)}")
                print(f"{name}: {', '.join(told)}", flush=True)
            except Fault as fault:
                faults += 1
                print(f"FAULT: {fault}", flush=True)
                bench.clean(output)
        for test in (lambda: real_faults(bench, expected_of), lambda: removed_under_way(bench, expected_of, 4, dice)):
            if len(expected_of) < len(JOBS):
                break
            try:
                test()
            except Fault as fault:
                faults += 1
                print(f"FAULT: {fault}", flush=True)
        print(", ".join(f"{kind} {count}" for kind, count in sorted(bench.counts.items())))
        print(f"{sum(bench.counts.values())} in all, {bench.resumed} resumed afterwards, {faults} wrong")
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
