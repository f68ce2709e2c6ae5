#!/usr/bin/env python3
"""Time sharpen against others' loading and saving, and print the table as Markdown.

The mesh is marching cubes of the distance to a block with a hole on a turned
grid. All commands of a round run one after the other, round by round, so that
a machine that slows down slows all of them; figures are medians over rounds.
Ours are whole processes by wall clock; "filter alone" is the sum of the stages
of --report, in runs of their own, without reading, writing and what is made
for the report. The peers are timed inside Python from
before loading to after saving, so that neither their start nor their imports
count. The plain pass is twins, normals and dihedral angles, as the tool does
them for --no-sharpen --sharp-angle.

Needs  .venv/bin/python -m pip install -r scripts/requirements-bench.txt
and    cargo build --release
"""

import argparse
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

import numpy as np
from scipy.spatial.transform import Rotation
from skimage.measure import marching_cubes

ROOT = Path(__file__).resolve().parent.parent
BLOCK = np.array([0.8, 0.6, 0.4])
HOLE = 0.3
# Faces per squared cell on a surface of area one, by this grid's turn; sets the cell size.
FACES_PER_CELL = 2.99
# The stages that are not the filter's; the verdict is made for the report alone.
NOT_FILTER = ("read", "parse", "write", "verdict")
# A small process that starts the one to be measured: Linux counts the peak memory of the process that
# starts another as the other's own.
LAUNCHER = """
import os, sys, time
start = time.perf_counter()
child = os.posix_spawnp(sys.argv[1], sys.argv[1:], os.environ)
_, status, usage = os.wait4(child, 0)
print(time.perf_counter() - start, usage.ru_maxrss)
sys.exit(os.waitstatus_to_exitcode(status))
"""
PEERS = {
    "MeshLib": "from meshlib import mrmeshpy as m; load, save = m.loadMesh, m.saveMesh\n{}\nsave(load({!r}), {!r})",
    "pymeshlab": "import pymeshlab; m = pymeshlab.MeshSet()\n{}\nm.load_new_mesh({!r}); m.save_current_mesh({!r})",
}


def block_with_hole(points):
    """Return the signed distances [n] to the sides of a block with a hole, as CSG combines them."""
    outside = np.abs(points) - BLOCK
    box = np.linalg.norm(np.maximum(outside, 0), axis=1) + np.minimum(outside.max(axis=1), 0)
    return np.maximum(box, HOLE - np.linalg.norm(points[:, :2], axis=1))


def sample(n_faces):
    """Return marching cubes of the block with about so many faces: vertices, faces."""
    area = 8 * (BLOCK * np.roll(BLOCK, 1)).sum() + 4 * np.pi * HOLE * (BLOCK[2] - HOLE / 2)
    cell = np.sqrt(FACES_PER_CELL * area / n_faces)
    turn = Rotation.from_rotvec([0.3, 0.5, 0.7]).as_matrix()
    half = np.abs(turn) @ BLOCK + 2 * cell
    ticks = [np.arange(-h, h + cell, cell) for h in half]
    plane = np.stack(np.meshgrid(*ticks[1:], indexing="ij"), axis=-1).reshape(-1, 2)
    field = np.empty([len(t) for t in ticks], np.float32)
    for i, x in enumerate(ticks[0]):
        points = np.column_stack([np.full(len(plane), x), plane]) @ turn
        field[i] = block_with_hole(points).reshape(field.shape[1:])
    # Zeros, which have no sign, would make degenerate faces.
    field[field == 0] = np.float32(1e-9)
    vertices, faces, _, _ = marching_cubes(field, 0.0, spacing=(cell,) * 3)
    return vertices.astype(float), faces


def shuffled(vertices, faces):
    """Return the mesh with vertices and faces in random order."""
    rng = np.random.default_rng(1)
    order = rng.permutation(len(vertices))
    now = np.empty_like(order)
    now[order] = np.arange(len(order))
    return vertices[order], now[faces[rng.permutation(len(faces))]]


def side_by_side(vertices, faces, n):
    """Return n copies of the mesh side by side."""
    step = np.array([1.1 * np.ptp(vertices[:, 0]), 0, 0])
    return (
        np.concatenate([vertices + i * step for i in range(n)]),
        np.concatenate([faces + i * len(vertices) for i in range(n)]),
    )


def write(path, vertices, faces):
    """Write an OBJ file with six decimals, as large meshes are written; slab by slab."""
    with open(path, "w", encoding="ascii") as out:
        for form, rows in (("v %.6f %.6f %.6f", vertices), ("f %d %d %d", faces + 1)):
            for slab in np.array_split(rows, len(rows) // 100_000 + 1):
                out.write("\n".join([form] * len(slab)) % tuple(slab.ravel().tolist()) + "\n")
    return path


def run(command):
    """Run a command; return its seconds by wall clock, its peak memory in MB and what it printed."""
    launched = [sys.executable, "-S", "-c", LAUNCHER, *map(str, command)]
    done = subprocess.run(launched, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"bench.py: exit status {done.returncode}: {command}")
    *printed, figures = done.stdout.splitlines(keepends=True)
    seconds, kilobytes = figures.split()
    return float(seconds), int(kilobytes) * 1024 / 1e6, "".join(printed)


class Runs:
    """Commands by name, and the figures of each of their runs."""

    def __init__(self, binary, scratch):
        self.binary, self.scratch = binary, Path(scratch)
        self.commands, self.figures = {}, {}

    def ours(self, name, source, *options):
        """Add a run of sharpen: its time and memory."""
        command = [self.binary, "-q", *options, source, self.scratch / "out.obj"]

        def once():
            seconds, memory, _ = run(command)
            return {"seconds": seconds, "memory": memory}

        self.commands[name] = once

    def stages(self, name, source, *options):
        """Add a run of sharpen: the times of its stages."""
        report = self.scratch / f"{len(self.commands)}.json"
        command = [self.binary, "-q", "--report", report, *options, source, self.scratch / "out.obj"]

        def once():
            _, memory, _ = run(command)
            stages = json.loads(report.read_text())["seconds"]
            filtered = sum(s for stage, s in stages.items() if stage not in NOT_FILTER)
            return {"memory": memory, "filter": filtered, "stages": stages}

        self.commands[name] = once

    def peer(self, name, source):
        """Add a run of a peer that loads and saves."""
        code = "import time\n" + PEERS[name].format(
            "start = time.perf_counter()", str(source), str(self.scratch / "peer.obj")
        )

        def once():
            _, memory, printed = run([sys.executable, "-c", code + "\nprint(time.perf_counter() - start)"])
            return {"seconds": float(printed.split()[-1]), "memory": memory}

        self.commands[name] = once

    def measure(self, rounds):
        """Run everything that was not yet run in turn, so many rounds.

        Each run follows one of the same command that does not count: it finds
        memory and page cache as that has left them. Behind another command a run
        may wait for memory that the system has taken back meanwhile.
        """
        new = {name: once for name, once in self.commands.items() if name not in self.figures}
        for round_ in range(rounds):
            for name, once in new.items():
                print(f"\rround {round_ + 1} of {rounds}: {name:40}", end="", file=sys.stderr)
                once()
                self.figures.setdefault(name, []).append(once())
        print(file=sys.stderr)

    def median(self, name, figure):
        """Return the median of a figure."""
        return median(figures[figure] for figures in self.figures[name])

    def ratio(self, name, other, figure="seconds"):
        """Return the median of the rounds' ratios of a figure of two commands."""
        pairs = zip(self.figures[name], self.figures[other])
        return median(a[figure] / b[figure] for a, b in pairs)


def measure_all(binary, scratch, sizes, rounds):
    """Run everything; return the runs and the numbers of faces of the small, middle and large mesh."""
    runs = Runs(binary, scratch)
    made = [sample(size) for size in sizes]
    small, middle, large = (write(runs.scratch / f"{i}.obj", *mesh) for i, mesh in enumerate(made))
    mixed = write(runs.scratch / "shuffled.obj", *shuffled(*made[1]))
    little = write(runs.scratch / "little.obj", *sample(13_000))
    runs.ours("middle", middle, "--threads", "2")
    for peer in PEERS:
        runs.peer(peer, middle)
    runs.stages("plain", middle, "--threads", "1", "--no-sharpen", "--sharp-angle", "30")
    runs.stages("plain shuffled", mixed, "--threads", "1", "--no-sharpen", "--sharp-angle", "30")
    for flag, options in (("", []), (" paper", ["--paper"])):
        runs.stages("one" + flag, middle, "--threads", "1", *options)
        runs.stages("two" + flag, middle, "--threads", "2", *options)
        runs.stages("shuffled" + flag, mixed, "--threads", "1", *options)
    runs.stages("bend", middle, "--threads", "2", "--bend", "1")
    runs.ours("small", small, "--threads", "2")
    runs.ours("little", little, "--threads", "1")
    runs.measure(rounds)
    # By itself: what runs behind it would wait for the system to take its memory back.
    runs.ours("large", large, "--threads", "2")
    runs.measure(rounds)
    return runs, [len(faces) for _, faces in made]


def table(runs, n_faces):
    """Return the table's lines."""
    per_face = [
        [runs.median(name, figure) / n for name, n in zip(("small", "middle", "large"), n_faces)]
        for figure in ("seconds", "memory")
    ]

    def seconds(name, figure="filter"):
        return f"{runs.median(name, figure):.3f} s"

    def times(*pair):
        return f"{runs.ratio(*pair):.2f} ×"

    large, middle = n_faces[2] / 1e6, f"{n_faces[1] / 1e6:.2f} M triangles"
    lines = [(f"{middle}, OBJ to OBJ, 2 threads", seconds("middle", "seconds"), "")]
    for peer, bar in (("MeshLib", 0.5), ("pymeshlab", 0.15)):
        took = seconds(peer, "seconds")
        lines.append((f"against {peer}'s load and save ({took})", times("middle", peer), f"{bar} ×"))
    for flag, name in (("", "filter alone"), (" paper", "`--paper` alone")):
        one, plain = f"{name}, 1 thread", seconds("plain")
        lines += [
            (one, seconds("one" + flag), ""),
            (f"{one}, to the plain pass ({plain})", times("one" + flag, "plain", "filter"), "5.6 ×"),
            (f"{one}, shuffled to ordered", times("shuffled" + flag, "one" + flag, "filter"), "3 ×"),
            (f"{name}, 1 thread to 2", times("one" + flag, "two" + flag, "filter"), "1.6 ×"),
        ]
    lines += [
        (f"plain pass, shuffled to ordered", times("plain shuffled", "plain", "filter"), ""),
        ("filter with `--bend 1`, 2 threads", seconds("bend"), "0.5 s"),
        ("peak memory, OBJ to OBJ", f"{runs.median('middle', 'memory'):.0f} MB", "250 MB"),
        ("peak memory with `--bend 1`", f"{runs.median('bend', 'memory'):.0f} MB", ""),
    ]
    for what, figures in zip(("time", "memory"), per_face):
        growth = f"{figures[1] / figures[0]:.2f} ×, {figures[2] / figures[1]:.2f} ×"
        sizes = f"{n_faces[0] / 1e6:.1f} M to {n_faces[1] / 1e6:.1f} M, to {large:.1f} M"
        lines.append((f"{what} per triangle, from {sizes}", growth, "1.3 ×"))
    lines.append(("13,000 faces, whole process, 1 thread", f"{1e3 * runs.median('little', 'seconds'):.1f} ms", "15 ms"))
    return ["| work | measured | bar |", "| --- | ---: | ---: |"] + [f"| {' | '.join(line)} |" for line in lines]


def machine():
    """Return commit, processor and number of cores."""
    git = ["git", "-C", str(ROOT), "describe", "--always", "--dirty", "--exclude", "*"]
    commit = subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip() or "no commit"
    try:
        processor = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text()).group(1)
    except (OSError, AttributeError):
        processor = platform.processor() or platform.machine()
    return f"commit {commit}, {processor}, {os.cpu_count()} cores"


def huge(binary, scratch, bend):
    """Run once on six parts of 8 million faces side by side; return the lines of the table."""
    vertices, faces = side_by_side(*sample(8_400_000), 6)
    source = write(Path(scratch) / "huge.obj", vertices, faces)
    n_faces = len(faces)
    del vertices, faces
    lines = []
    for level in ([0, 1] if bend else [0]):
        target = Path(scratch) / "out.ply"
        seconds, memory, _ = run([binary, "-q", "--bend", level, "--max-faces", 1_000_000_000, source, target])
        what = f"{n_faces / 1e6:.1f} M triangles, OBJ to PLY, `--bend {level}`"
        lines.append(f"| {what} | {seconds:.1f} s, {memory / 1e3:.1f} GB | 24 GB |")
    return lines


def replaced(text, block):
    """Return the text with what lies between the bench markers replaced."""
    pattern = r"(<!-- bench: begin -->\n).*?(<!-- bench: end -->)"
    new, count = re.subn(pattern, lambda m: m.group(1) + block + m.group(2), text, flags=re.DOTALL)
    if count != 1:
        raise SystemExit("bench.py: the file has no pair of bench markers")
    return new


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--binary", type=Path, default=ROOT / "target/release/sharpen")
    parser.add_argument("--faces", type=int, nargs=3, default=[100_000, 1_000_000, 8_000_000])
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--huge", action="store_true", help="also 50 million faces; needs 24 GB and minutes")
    parser.add_argument("--write", type=Path, metavar="README", help="put the table between the file's markers")
    arguments = parser.parse_args()
    if not arguments.binary.exists():
        raise SystemExit(f"bench.py: {arguments.binary} does not exist: cargo build --release")
    with tempfile.TemporaryDirectory() as scratch:
        runs, n_faces = measure_all(arguments.binary, scratch, arguments.faces, arguments.rounds)
        lines = table(runs, n_faces)
        for name in ("one", "one paper", "two", "bend"):
            stages = runs.figures[name][-1]["stages"]
            print(name, {stage: round(s, 4) for stage, s in stages.items()}, file=sys.stderr)
    if arguments.huge:
        with tempfile.TemporaryDirectory() as scratch:
            lines += huge(arguments.binary, scratch, bend=True)
    heading = f"Medians of {arguments.rounds} rounds by `scripts/bench.py`; {machine()}."
    block = "\n".join([heading, "", *lines]) + "\n"
    print(block)
    if arguments.write:
        arguments.write.write_text(replaced(arguments.write.read_text(), block))


if __name__ == "__main__":
    main()
