"""Writes docs/BENCHMARKS.md from the figures of bench.py."""

import platform
import re
import subprocess
from pathlib import Path

import bench_cluster as bench

OURS = "meshmill"
# Methods that meet a count by edge collapse; the others cluster.
COLLAPSING = ("meshmill", "meshmill --metric volume", "meshmill --method hybrid", "meshoptimizer",
              "meshoptimizer, update", "fast-simplification", "MeshLab (pymeshlab)", "VTK quadric",
              "Open3D")


def slug(name):
    """Returns a name fit for a file."""
    return re.sub(r"\W+", "_", name)


def told(options):
    """Returns the options that the figures hang on."""
    names = ("runs", "samples", "memory", "memory_max", "patience")
    return {name: getattr(options, name) for name in names}


def machine(b):
    """Returns what the figures were measured on and with."""
    cpu = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    memory = re.search(r"^MemTotal:\s*(\d+)", Path("/proc/meminfo").read_text(), re.MULTILINE)
    threads = len(re.findall(r"^processor", Path("/proc/cpuinfo").read_text(), re.MULTILINE))
    commit = subprocess.run(["git", "-C", bench.ROOT, "rev-parse", "--short", "HEAD"],
                            capture_output=True, text=True, check=False).stdout.strip()
    wanted = ("pymeshlab", "vtk", "open3d", "fast_simplification")
    lock = (bench.PEERS / "python" / "requirements.txt").read_text()
    versions = [line.replace("==", " ") for line in lock.splitlines() if line.split("==")[0] in wanted]
    meshopt = re.search(r'name = "meshopt"\nversion = "(.*)"', (bench.PEERS / "Cargo.lock").read_text())
    return {
        "cpu": cpu[1] if cpu else platform.machine(),
        "threads": threads,
        "memory_gib": round(int(memory[1]) / (1 << 20)),
        "system": f"Linux {platform.release().split('-')[0]}",
        "commit": commit,
        "versions": [f"meshopt (crate) {meshopt[1]}", *versions],
    }


def added_to(old, new):
    """Returns old figures to which new ones are added; both must be from one machine, in one way."""
    for part, but in (("machine", "commit"), ("options", "")):
        for name, value in new[part].items():
            if name != but and old[part][name] != value:
                raise SystemExit(f"the figures there have another {name}: {old[part][name]}, not {value}")
    commits = old["machine"]["commit"].split(", ")
    if new["machine"]["commit"] not in commits:
        commits.append(new["machine"]["commit"])
    return old | {"machine": new["machine"] | {"commit": ", ".join(commits)}}


def table(heads, rows):
    """Returns a Markdown table."""
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    lines += ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def percent(ratio):
    """Returns a ratio for people."""
    return f"{100 * ratio:g} %"


def row(name, one, ours, triangles):
    """Returns what one method did with one input, for a table."""
    times = one["seconds"] / ours["seconds"] if not ours["verdict"] else float("nan")
    if one["verdict"]:
        memory = f"{one['rss_bytes'] / bench.MIB:.0f}"
        return (name, one["verdict"], "", "", memory, "", "", "", "", "", "")
    rms = [f"{value:.2e}" for value in one["rms"]]
    return (
        name, f"{one['seconds']:.2f}", f"{triangles / one['seconds'] / 1e6:.2f}",
        f"{times:.2f}", f"{one['rss_bytes'] / bench.MIB:.0f}",
        f"{one['rss_bytes'] / triangles:.0f}", f"{one['triangles']:,}", *rms, f"{one['max']:.2e}",
        f"{one['non_manifold_edges']} · {one['boundary_edges']}",
    )


HEADS = ("method", "s", "M triangles/s", "time / ours", "peak MiB", "bytes/triangle", "triangles left",
         "RMS in→out", "RMS out→in", "max", "non-manifold · boundary edges")


def details(one):
    """Returns the section of one input and ratio."""
    ours = one["methods"][OURS]
    rows = [row(name, method, ours, one["triangles"]) for name, method in one["methods"].items()]
    head = f"### {one['input']}, {one['triangles']:,} triangles, to {percent(one['ratio'])}\n\n"
    return head + table(HEADS, rows)


def summary(tables):
    """Returns the table that says it all: ours beside the best of the peers."""
    rows = []
    for one in tables:
        ours = one["methods"][OURS]
        peers = {name: method for name, method in one["methods"].items()
                 if name in COLLAPSING and not name.startswith(OURS) and not method["verdict"]}
        if ours["verdict"] or not peers:
            continue
        fast = min(peers, key=lambda name: peers[name]["seconds"])
        exact = min(peers, key=lambda name: max(peers[name]["rms"]))
        faithful = max(peers[exact]["rms"])
        small = min(peers, key=lambda name: peers[name]["rss_bytes"])
        rows.append((
            f"{one['input']} ({one['triangles'] / 1e6:.1f} M) to {percent(one['ratio'])}",
            f"{peers[fast]['seconds'] / ours['seconds']:.2f}× ({fast})",
            f"{max(ours['rms']) / max(peers[fast]['rms']):.2f}×",
            f"{max(ours['rms']) / faithful:.2f}× ({exact}, "
            f"{peers[exact]['seconds'] / ours['seconds']:.0f}× our time)",
            f"{ours['rss_bytes'] / peers[small]['rss_bytes']:.2f}× ({small})",
        ))
    return table(("input", "faster than the fastest peer", "error against that one's",
                  "error against the most faithful peer's", "memory against the most frugal's"), rows)


def write(figures, docs):
    """Writes the document."""
    about, options = figures["machine"], figures["options"]
    text = f"""# Benchmarks

Written by `scripts/bench.py`; do not edit. Ratios travel between machines, seconds do not. Losses
stand here like wins. How single parts of meshmill were measured is in
[MEASUREMENTS.md](MEASUREMENTS.md).

**The machine:** {about['cpu']}, {about['threads']} threads, {about['memory_gib']} GiB,
{about['system']}, warm page cache. **Versions:** meshmill {about['commit']};
{', '.join(about['versions'])}.

**How.** Whole processes: read a binary PLY, simplify, write a PLY. All methods in turns; medians of
{options['runs']} runs, of what takes over 10 s one run. meshmill has `--memory {options['memory']}`;
peers may take {options['memory_max']} and {options['patience']:g} s. Errors are relative to the
diagonal of the input's box, by {options['samples']:,} samples each way, measured by a judge that is not
part of meshmill (`scripts/peers`). Peaks of less than 30 MiB show as that. Methods that cluster meet a count only roughly.

## At a glance

Ours is `meshmill simplify` as it is without options. More than 1× is better in the second column, less
than 1× in the others. Peers that cluster are left out here: their errors are larger by far.

{summary(figures['tables'])}
![Triangles a second against size](benchmarks/speed.svg)
![Peak memory against size](benchmarks/memory.svg)
![Error against triangles left](benchmarks/error.svg)

## All figures

"""
    text += "\n".join(details(one) for one in figures["tables"])
    (docs / "BENCHMARKS.md").write_text(text)
