#!/usr/bin/env python3
"""Run sharpen over a folder of inputs and measure what it does to them.

The folder holds inputs/SHAPE__METHOD_TAG.obj and originals/SHAPE.obj, as
make_inputs.py writes them; --make writes the project's own. Prints a Markdown
table of each input and of what each variant makes of it, then geometric means
of output/input ratios. Measurements of unchanged files are not repeated.

  the README's table     evaluate.py --make --layout brief
  against the paper's    evaluate.py --variants default= 'paper=--paper'
"""

import argparse
import hashlib
import json
import os
import shlex
import subprocess
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path

import numpy as np

import make_inputs
import measure
from shapes import SHAPES

ROOT = Path(__file__).resolve().parent.parent
# What --make samples: all shapes, by the methods of the README's table.
MADE_METHODS = ["mc", "mi", "remesh"]
MADE_FACES = [8000]
# An output that is exact to the last digit would turn a geometric mean into zero.
LEAST_RATIO = 1e-3
# Counts summed over the inputs of a set.
SUMS = ("flip", "fold", "si")
# Emax counts as raised beyond sampling noise.
RAISED = 1.02


@dataclass
class Row:
    """One input: its figures, and each variant's (or why there are none)."""

    name: str
    figures: dict
    variants: dict = field(default_factory=dict)
    failures: dict = field(default_factory=dict)


def cached_measure(cache, original, processed, edge):
    """Measure, or return what the same files gave before."""
    digest = hashlib.sha256(repr(edge).encode())
    # The measuring code is part of the key: a change there makes all figures new.
    for path in (original, processed, measure.__file__, measure.meshes.__file__):
        digest.update(hashlib.sha256(Path(path).read_bytes()).digest())
    entry = cache / f"{digest.hexdigest()}.json"
    if entry.exists():
        return json.loads(entry.read_text())
    figures = measure.measure(original, processed, edge=edge)
    # Written aside and renamed: another process may be writing the same entry.
    with tempfile.NamedTemporaryFile("w", dir=cache, delete=False) as aside:
        json.dump(figures, aside)
    os.replace(aside.name, entry)
    return figures


def run(command, source, target):
    """Run the command on a mesh; return an error message or None."""
    done = subprocess.run([*command, source, target], capture_output=True, text=True, check=False)
    if done.returncode:
        first = (done.stderr.strip().splitlines() or ["no message"])[0]
        return f"exit code {done.returncode}: {first}"
    return None if target.exists() else "wrote no output"


def evaluate_input(source, original, commands, cache, keep):
    """Return the Row of one input: measure it, then run and measure each variant."""
    figures = cached_measure(cache, original, source, None)
    row = Row(source.stem, figures)
    with tempfile.TemporaryDirectory() as scratch:
        for variant, command in commands.items():
            folder = Path(keep or scratch) / variant
            folder.mkdir(parents=True, exist_ok=True)
            target = folder / source.name
            # An output kept from before must not pass for this run's.
            target.unlink(missing_ok=True)
            problem = run(command, source, target)
            if problem is None:
                try:
                    # Judged by the input's edge length, whatever the output's is.
                    row.variants[variant] = cached_measure(
                        cache, original, target, figures["mean_edge"]
                    )
                except ValueError as error:
                    problem = str(error)
            if problem is not None:
                row.failures[variant] = problem
    return row


def evaluate(data, pattern, commands, cache, keep, jobs):
    """Return the rows of all inputs under data whose names match, by name."""
    tasks = []
    for source in sorted((data / "inputs").glob("*.obj")):
        original = data / "originals" / f"{source.stem.partition('__')[0]}.obj"
        if fnmatch(source.stem, pattern):
            tasks.append((source, original, commands, cache, keep))
    # The search for nearest points is threaded; here the inputs share the cores.
    with ProcessPoolExecutor(jobs, initializer=single_threaded) as pool:
        return list(pool.map(evaluate_input, *zip(*tasks))) if tasks else []


def single_threaded():
    """Keep libigl to one thread in this process."""
    os.environ["IGL_NUM_THREADS"] = "1"


def add_reference(rows, path, columns):
    """Add figures published in a reference.json as further variants."""
    reference = json.loads(path.read_text())
    for row in rows:
        known = reference.get(row.name, {}).get("figures", {})
        for column in columns:
            if column in known:
                row.variants[column] = known[column]


def number(figures, key, decimals=0):
    """Return a figure as text; a dash where there is none."""
    value = figures.get(key)
    return "-" if value is None else f"{value:.{decimals}f}"


def with_ratio(figures, before, key, decimals):
    """Return a figure, and in brackets its ratio to the input's."""
    text = number(figures, key, decimals)
    if figures is before or not before[key]:
        return text
    return f"{text} (x{figures[key] / before[key]:.3f})"


def corners(figures):
    """Return corners found of corners there are."""
    if not figures.get("corners_true"):
        return "-"
    return f"{figures['corners']}/{figures['corners_true']}"


def broken(figures):
    """Return the number of non-manifold or misoriented elements; a dash if unknown."""
    keys = ("nonmanifold_edges", "nonmanifold_vertices", "misoriented_edges")
    return str(sum(figures[key] for key in keys)) if keys[0] in figures else "-"


def markdown(heads, lines):
    """Return a Markdown table; the first two columns are text, the others numbers."""
    rule = ["---", "---", *["---:"] * (len(heads) - 2)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (heads, rule, *lines))


def full_table(rows):
    """Return a table with a line for each input and each variant of it."""
    heads = ["input", "variant", "Emax %", "L2 %", "n20 %", "flips", "folds", "self-int"]
    heads += ["corners", "crease %", "false %", "broken", "border", "faces"]
    lines = []
    for row in rows:
        for variant, figures in {"input": row.figures, **row.variants}.items():
            lines.append(
                [
                    row.name,
                    variant,
                    with_ratio(figures, row.figures, "emax", 3),
                    with_ratio(figures, row.figures, "l2", 4),
                    number(figures, "n20", 2),
                    *(number(figures, key) for key in ("flip", "fold", "si")),
                    corners(figures),
                    number(figures, "crease", 1),
                    number(figures, "crease_false", 1),
                    broken(figures),
                    number(figures, "border_edges"),
                    number(figures, "faces"),
                ]
            )
        for variant, problem in row.failures.items():
            lines.append([row.name, variant, f"failed, {problem}"] + [""] * (len(heads) - 3))
    return markdown(heads, lines)


def brief_table(rows):
    """Return a table with a line for each input: the first variant's changes."""
    heads = ["input", "faces", "Emax %", "L2 %", "normals off %", "creases %", "corners"]
    heads += ["folds", "self-int"]
    lines = []
    for row in rows:
        before = row.figures
        faces = f"{before['faces']}"
        if not row.variants:
            problem = next(iter(row.failures.values()))
            lines.append([row.name, faces, f"failed, {problem}"] + [""] * (len(heads) - 3))
            continue
        after = next(iter(row.variants.values()))
        figures = [("emax", 2), ("l2", 3), ("n20", 1), ("crease", 0)]
        counts = [("fold", 0), ("si", 0)]
        cells = [[f"{number(f, *key)}" for f in (before, after)] for key in figures]
        cells.append([corners(before), corners(after)])
        cells += [[number(f, *key) for f in (before, after)] for key in counts]
        pairs = ["-" if pair == ["-", "-"] else " → ".join(pair) for pair in cells]
        lines.append([row.name, faces, *pairs])
    return markdown(heads, lines)


def sets_of(rows, chosen):
    """Return the sets of rows to take means over, by name: chosen globs, or by method.

    An original without creases has nothing to recover and its own set.
    """
    if chosen:
        return {n: [r for r in rows if fnmatch(r.name, glob)] for n, glob in chosen.items()}
    sets = {"all with creases": [], "no creases": []}
    for row in rows:
        if row.figures["crease"] is None:
            sets["no creases"].append(row)
            continue
        sets["all with creases"].append(row)
        method = row.name.partition("__")[2].split("_")[0]
        sets.setdefault(method, []).append(row)
    return sets


def ratio_mean(pairs, key):
    """Return the geometric mean of after/before; dash if there is none."""
    ratios = [max(b[key] / a[key], LEAST_RATIO) for a, b in pairs if a[key] > 0]
    return f"{np.exp(np.mean(np.log(ratios))):.3f}" if ratios else "-"


def summary(rows, chosen):
    """Return a table of ratios and sums for each set and variant."""
    heads = ["set", "variant", "inputs", "L2 out/in", "Emax out/in", "Emax raised"]
    heads += ["flips", "folds", "self-int", "corners"]
    lines = []
    variants = list(dict.fromkeys(v for row in rows for v in row.variants))
    for name, members in sets_of(rows, chosen).items():
        for variant in variants:
            pairs = [(r.figures, r.variants[variant]) for r in members if variant in r.variants]
            if not pairs:
                continue
            raised = sum(b["emax"] > RAISED * a["emax"] for a, b in pairs)
            lines.append(
                [name, variant, str(len(pairs)), ratio_mean(pairs, "l2")]
                + [ratio_mean(pairs, "emax"), str(raised)]
                + [f"{total(pairs, 0, key)} → {total(pairs, 1, key)}" for key in SUMS]
                + [f"{total(pairs, 1, 'corners')}/{total(pairs, 0, 'corners_true')}"]
            )
    return markdown(heads, lines)


def total(pairs, side, key):
    """Return the sum of a count over one side of the pairs; dash where one is unknown."""
    counts = [pair[side].get(key) for pair in pairs]
    return "-" if None in counts else str(sum(counts))


def make_data(data):
    """Write the project's own inputs, unless they are there."""
    shapes = [
        shape
        for shape in SHAPES
        for method in MADE_METHODS
        for faces in MADE_FACES
        if not (data / "inputs" / f"{shape}__{method}_{make_inputs.tag(faces)}.obj").exists()
    ]
    for shape in dict.fromkeys(shapes):
        print(f"making {shape}", file=sys.stderr)
        make_inputs.write_inputs(data, [shape], MADE_METHODS, MADE_FACES)


def name_and_value(text):
    """Split name=value."""
    name, equals, value = text.partition("=")
    if not equals or not name:
        raise argparse.ArgumentTypeError(f"{text!r} is not name=...")
    return name, value


def parse_arguments():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--data",
        type=Path,
        default=ROOT / "out" / "data",
        metavar="DIR",
        help="holds inputs/ and originals/ (default: out/data in the repository)",
    )
    parser.add_argument(
        "--make", action="store_true", help="first write the project's own inputs there"
    )
    parser.add_argument(
        "--binary",
        default=str(ROOT / "target" / "release" / "sharpen"),
        metavar="COMMAND",
        help="called as COMMAND FLAGS INPUT OUTPUT (default: target/release/sharpen)",
    )
    parser.add_argument(
        "--variants",
        nargs="+",
        type=name_and_value,
        default=[("default", "")],
        metavar="NAME=FLAGS",
        help="what to run, as 'paper=--paper' (default: default=)",
    )
    parser.add_argument("--only", default="*", metavar="GLOB", help="inputs' names to take")
    parser.add_argument(
        "--sets",
        nargs="+",
        type=name_and_value,
        metavar="NAME=GLOB",
        help="of inputs to take geometric means over (default: by method)",
    )
    parser.add_argument(
        "--reference", type=Path, metavar="FILE.json", help="published figures to add"
    )
    parser.add_argument(
        "--columns", nargs="+", default=["authors"], help="of it (default: authors)"
    )
    parser.add_argument(
        "--layout",
        choices=["full", "brief", "summary"],
        default="full",
        help="a line for each variant, for each input, or the means alone (default: full)",
    )
    parser.add_argument("--keep", type=Path, metavar="DIR", help="keep outputs as VARIANT/NAME")
    parser.add_argument(
        "--cache",
        type=Path,
        default=Path(tempfile.gettempdir()) / "sharpen-measurements",
        metavar="DIR",
        help="of measurements (default: %(default)s)",
    )
    parser.add_argument(
        "--jobs", type=int, default=2, help="processes at a time (default: %(default)s)"
    )
    return parser.parse_args()


def main():
    options = parse_arguments()
    if options.make:
        make_data(options.data)
    if not (options.data / "inputs").is_dir():
        print(f"evaluate.py: no inputs in {options.data}; --make writes the project's own")
        return
    options.cache.mkdir(parents=True, exist_ok=True)
    binary = shlex.split(options.binary)
    commands = {name: [*binary, *shlex.split(flags)] for name, flags in options.variants}
    try:
        rows = evaluate(
            options.data, options.only, commands, options.cache, options.keep, options.jobs
        )
        if options.reference:
            add_reference(rows, options.reference, options.columns)
    except (OSError, ValueError) as error:
        sys.exit(f"evaluate.py: {error}")
    if options.layout != "summary":
        print({"full": full_table, "brief": brief_table}[options.layout](rows) + "\n")
    print(summary(rows, dict(options.sets) if options.sets else None))
    failed = sum(len(row.failures) for row in rows)
    if failed:
        sys.exit(f"evaluate.py: {failed} runs failed")


if __name__ == "__main__":
    main()
