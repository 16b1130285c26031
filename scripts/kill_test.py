#!/usr/bin/env python3
"""Kills meshmill at random moments, resumes it, and compares the result byte by byte.

For each method: one run that nobody disturbs; then so many rounds in which a run that keeps all it
has done is killed with SIGKILL at a random moment, perhaps killed again while it goes on, and at last
let go on to its end. After each kill nothing may lie under the output's name, but for the whole
result of a run that was killed after it was done, and the bytes in the end must be those of the
undisturbed run. Prints a line for each method and fails at the first fault.
"""

import argparse
import filecmp
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time

# Name, arguments, input, and what the output is called. {in} and {out} are filled in.
METHODS = [
    ("slabs", "simplify {in} -o {out} --ratio 5% --method stream --memory 64MiB", "shuffled.stl", "out.ply"),
    ("slabs, volume", "simplify {in} -o {out} --ratio 5% --method stream --metric volume --memory 64MiB", "shuffled.stl", "out.ply"),
    ("slabs, colours", "simplify {in} -o {out} --ratio 5% --method stream --memory 80MiB", "colored.soup", "out.ply"),
    ("multiple choice", "simplify {in} -o {out} --ratio 5% --selection multiple-choice --memory 24MiB", "shuffled.stl", "out.ply"),
    ("cluster, spills", "simplify {in} -o {out} --cells 300 --memory 3MiB", "shuffled.stl", "out.ply"),
    ("cluster, count", "simplify {in} -o {out} --method cluster -t 3000 --memory 24MiB", "scattered.ply", "out.ply"),
    ("bounded", "simplify {in} -o {out} --max-error 0.2% --memory 80MiB", "shuffled.stl", "out.ply"),
    ("bounded, colours", "simplify {in} -o {out} --max-error 0.5% --max-color-error 9 --max-normal-deviation 40 --memory 80MiB", "colored.soup", "out.ply"),
    ("hybrid", "simplify {in} -o {out} --method hybrid -t 9000 --memory 24MiB", "scattered.ply", "out.ply"),
    ("sort", "sort {in} -o {out} --memory 3MiB", "shuffled.stl", "out.soup"),
    ("sort, in order", "sort {in} -o {out} --axis x --memory 3MiB", "ordered.soup", "out.stl"),
    ("soup", "soup {in} -o {out} --memory 1MiB", "scattered.ply", "out.stl"),
    ("weld", "weld {in} -o {out} --memory 3MiB", "shuffled.stl", "out.ply"),
    ("obj", "simplify {in} -o {out} --ratio 5% --method stream --memory 80MiB", "scattered.obj", "out.ply"),
    ("pipe", "simplify - --input-format stl -o {out} --ratio 5% --method stream --memory 64MiB", "shuffled.stl", "out.ply"),
    ("pipe, cluster", "simplify - --input-format stl -o {out} --cells 200 --memory 3MiB", "shuffled.stl", "out.ply"),
]


def run(binary, arguments, folder, **more):
    command = [binary, *arguments.split(), "-q"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, **more)


def shuffle(path, header_bytes, record_bytes, into):
    with open(path, "rb") as file:
        header, body = file.read(header_bytes), file.read()
    records = [body[i : i + record_bytes] for i in range(0, len(body), record_bytes)]
    random.Random(1).shuffle(records)
    with open(into, "wb") as file:
        file.write(header)
        file.write(b"".join(records))


def make_inputs(binary, folder, triangles):
    """A gyroid: in order, in no order, with scattered indices, and coloured."""

    def make(arguments):
        done = run(binary, arguments, folder)
        assert done.returncode == 0, done.stderr

    make(f"generate gyroid --triangles {triangles} -o ordered.soup")
    make("soup ordered.soup -o ordered.stl")
    join = lambda name: os.path.join(folder, name)
    shuffle(join("ordered.stl"), 84, 50, join("shuffled.stl"))
    make("weld shuffled.stl -o scattered.ply")
    make("weld shuffled.stl -o scattered.obj")
    # Colours by position, in the layout of docs/FORMATS.md.
    import struct
    import zlib

    with open(join("shuffled.stl"), "rb") as file:
        body = file.read()[84:]
    count = len(body) // 50
    header = b"\x89MMSOUP\n" + struct.pack("<IIQ", 1, 1, count) + bytes(24 + 48 + 28)
    with open(join("colored.soup"), "wb") as file:
        file.write(header + struct.pack("<I", zlib.crc32(header)))
        for i in range(count):
            for corner in range(3):
                at = 50 * i + 12 + 12 * corner
                position = body[at : at + 12]
                file.write(position + zlib.crc32(position).to_bytes(4, "little"))


class Fault(Exception):
    pass


def round_of(binary, method, folder, seconds, dice, expected):
    """One run, killed and resumed until it comes to its end. Returns kills, and how often it went on."""
    _, arguments, source, output = method
    arguments = arguments.replace("{in}", source).replace("{out}", output)
    arguments += " --checkpoint-seconds 0 --temp-dir temp"
    path = os.path.join(folder, output)
    kills, resumed, first = 0, 0, True
    while True:
        stdin = subprocess.DEVNULL
        if " - " in arguments and first:
            stdin = open(os.path.join(folder, source), "rb")
        command = [binary, *arguments.split(), *([] if first else ["--resume"])]
        process = subprocess.Popen(command, cwd=folder, stdin=stdin, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        # Of the runs that go on, half are let alone.
        if first or dice.random() < 0.5:
            try:
                process.wait(timeout=dice.random() * seconds)
            except subprocess.TimeoutExpired:
                process.send_signal(signal.SIGKILL)
        _, said = process.communicate()
        resumed += "going on from" in said
        if process.returncode == -signal.SIGKILL:
            kills += 1
            if os.path.exists(path):
                # Killed after it was done: between giving the output its name and its own end.
                break
            # A stream whose spool was not whole is read again.
            manifests = [f for f in os.listdir(os.path.join(folder, "temp")) if os.path.exists(os.path.join(folder, "temp", f, "manifest"))]
            first = first or False
            if " - " in arguments:
                first = not manifests or not is_spooled(os.path.join(folder, "temp", manifests[0]))
                if first:
                    shutil.rmtree(os.path.join(folder, "temp"))
                    os.mkdir(os.path.join(folder, "temp"))
            else:
                first = False
            continue
        if process.returncode != 0:
            raise Fault(f"exit {process.returncode}: {said[:600]}")
        break
    if not filecmp.cmp(path, expected, shallow=False):
        raise Fault("other bytes, or not all of them")
    os.remove(path)
    left = [f for f in os.listdir(os.path.join(folder, "temp"))]
    for name in left:
        # Runs that were killed before their first checkpoint, or while they removed their folder.
        shutil.rmtree(os.path.join(folder, "temp", name))
    return kills, resumed


def is_spooled(workspace):
    with open(os.path.join(workspace, "manifest"), "rb") as file:
        return b'"import":' in file.read()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--binary", default="target/release/meshmill")
    parser.add_argument("--kills", type=int, default=50, help="kills of each method, at least (default 50)")
    parser.add_argument("--triangles", default="1M", help="size of the inputs (default 1M)")
    parser.add_argument("--seed", type=int, default=None, help="of the moments; said if not given")
    parser.add_argument("--only", default="", help="methods whose name contains this")
    arguments = parser.parse_args()
    binary = os.path.abspath(arguments.binary)
    seed = arguments.seed if arguments.seed is not None else random.randrange(1 << 32)
    print(f"seed {seed}", flush=True)
    dice = random.Random(seed)
    faults = 0
    with tempfile.TemporaryDirectory(prefix="meshmill-kill-") as folder:
        os.mkdir(os.path.join(folder, "temp"))
        make_inputs(binary, folder, arguments.triangles)
        for method in METHODS:
            name, command, source, output = method
            if arguments.only not in name:
                continue
            command = command.replace("{in}", source).replace("{out}", output)
            stdin = open(os.path.join(folder, source), "rb") if " - " in command else subprocess.DEVNULL
            started = time.monotonic()
            done = run(binary, f"{command} --temp-dir temp --checkpoint-seconds 100000", folder, stdin=stdin)
            plain = time.monotonic() - started
            if done.returncode != 0:
                print(f"{name}: exit {done.returncode}: {done.stderr}")
                faults += 1
                continue
            expected = os.path.join(folder, "expected")
            os.replace(os.path.join(folder, output), expected)
            kills = resumed = rounds = 0
            # With a checkpoint at every chance a run takes longer.
            seconds = plain * 1.5
            try:
                while kills < arguments.kills:
                    more = round_of(binary, method, folder, seconds, dice, expected)
                    kills, resumed, rounds = kills + more[0], resumed + more[1], rounds + 1
                print(f"{name}: {kills} kills survived in {rounds} runs, {resumed} went on from what was left, {plain:.2f} s undisturbed", flush=True)
            except Fault as fault:
                faults += 1
                print(f"{name}: FAULT after {kills} kills: {fault}", flush=True)
                shutil.rmtree(os.path.join(folder, "temp"))
                os.mkdir(os.path.join(folder, "temp"))
                if os.path.exists(os.path.join(folder, output)):
                    os.remove(os.path.join(folder, output))
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
