#!/usr/bin/env python3
"""Draws the figures of bench.py as SVG: speed and memory against size, error against count.

Runs in the environment of the peers, which has matplotlib. Same figures, same bytes.
"""

import json
import sys
from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt  # noqa: E402 -- after the backend is chosen

matplotlib.rcParams.update({"svg.hashsalt": "meshmill", "svg.fonttype": "none", "font.size": 9,
                            "axes.spines.top": False, "axes.spines.right": False})
MIB = 1 << 20
# Ours stand out; peers are told apart by colour and marker.
OURS = {"meshmill": "#c8102e", "meshmill --metric volume": "#e8743b",
        "meshmill --method hybrid": "#8c1d40", "meshmill --method cluster": "#f2a900"}
PEERS = ("#1f4e79", "#2e86ab", "#7fb7be", "#4b7f52", "#6a4c93", "#7d7d7d", "#b0a990", "#3c3c3c")
MARKERS = "svDP^<>X"


def style(name, names):
    """Returns how a method is drawn."""
    if name in OURS:
        return {"color": OURS[name], "marker": "o", "linewidth": 2, "markersize": 5, "zorder": 3}
    index = [other for other in names if other not in OURS].index(name) % len(PEERS)
    return {"color": PEERS[index], "marker": MARKERS[index], "linewidth": 1, "markersize": 4}


def draw(path, lines, names, labels, scale=("log", "log")):
    """Draws lines of points, one a method."""
    figure, axes = plt.subplots(figsize=(7.2, 4.2))
    for name, points in lines.items():
        if points:
            axes.plot(*zip(*sorted(points)), label=name, **style(name, names))
    axes.set_xscale(scale[0])
    axes.set_yscale(scale[1])
    title, x, y = labels
    axes.set_title(title, loc="left", fontsize=10)
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(True, which="major", color="#dddddd", linewidth=0.6)
    axes.legend(fontsize=7, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.savefig(path, bbox_inches="tight", metadata={"Date": None})
    plt.close(figure)


def points(tables, value):
    """Returns the points of each method, leaving out where it did not finish."""
    lines = {}
    for one in tables:
        for name, method in one["methods"].items():
            if not method["verdict"]:
                lines.setdefault(name, []).append(value(one, method))
    return lines


def main():
    """Draws all three."""
    figures, folder = json.loads(Path(sys.argv[1]).read_text()), Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    first = max(one["ratio"] for one in figures["tables"])
    grown = [one for one in figures["tables"] if one["input"].startswith("iso") and one["ratio"] == first]
    names = list(figures["tables"][0]["methods"])
    share = f"iso-surface to {100 * first:g} %, whole process"
    size = "triangles of the input"
    draw(folder / "speed.svg",
         points(grown, lambda one, m: (one["triangles"], one["triangles"] / m["seconds"] / 1e6)),
         names, (share, size, "million triangles a second"))
    draw(folder / "memory.svg",
         points(grown, lambda one, m: (one["triangles"], m["rss_bytes"] / MIB)),
         names, (share, size, "peak memory, MiB"))
    of = figures["curve"][0]["triangles"] if figures["curve"] else 0
    draw(folder / "error.svg",
         points(figures["curve"], lambda _, m: (m["triangles"], max(m["rms"]))),
         names, (f"iso-surface of {of:,} triangles", "triangles left",
                 "RMS error / diagonal, the worse way"))


if __name__ == "__main__":
    main()
