#!/usr/bin/env python3
"""Kills folder runs and checks that nothing is lost.

Makes a tree of small meshes, every hundredth of them broken, and sharpens it once without disturbance.
Then does the same with kills (SIGKILL) at random moments, each followed by a resumed run, and compares:

* at every moment each output is whole: the same bytes as without disturbance;
* a resumed run repeats no more than the files that were being worked on;
* in the end all outputs are there and no temporary files, and the report has one line for each file, the
  same as without disturbance but for the seconds.

Needs nothing but Python 3.11 and the binary. Prints its figures; exit status 0 if all holds.
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
STATE = ".sharpen-state.jsonl"


class Lost(Exception):
    """Something does not hold."""


def check(holds: bool, what: str) -> None:
    if not holds:
        raise Lost(what)


def chamfered_cube(n: int, scale: float) -> str:
    """A cube with cut-off edges as OBJ: n x n samples on each side, strips along its edges, no corners."""
    lines, faces = [], []
    for side in range(6):
        axis = side // 2
        for i in range(n):
            for j in range(n):
                point = [0.0] * 3
                point[axis] = -1.0 if side % 2 == 0 else 1.0
                point[(axis + 1) % 3] = 0.9 * (2 * i / (n - 1) - 1)
                point[(axis + 2) % 3] = 0.9 * (2 * j / (n - 1) - 1)
                lines.append("v " + " ".join(repr(scale * x) for x in point))

    def add(a: int, b: int, c: int, side: int) -> None:
        faces.append(f"f {a} {c} {b}" if side % 2 == 0 else f"f {a} {b} {c}")

    def at(side: int, i: int, j: int) -> int:
        return (side * n + i) * n + j + 1

    for side in range(6):
        for i in range(n - 1):
            for j in range(n - 1):
                add(at(side, i, j), at(side, i + 1, j), at(side, i + 1, j + 1), side)
                add(at(side, i, j), at(side, i + 1, j + 1), at(side, i, j + 1), side)
    for axis in range(3):
        for s, t in ((0, 0), (0, 1), (1, 0), (1, 1)):
            for k in range(n - 1):
                a, b = (at(2 * axis + s, t * (n - 1), k + d) for d in (0, 1))
                c, d = (at(2 * ((axis + 1) % 3) + t, k + d, s * (n - 1)) for d in (0, 1))
                add(a, c, b, 1 + s + t)
                add(b, c, d, 1 + s + t)
    return "\n".join(lines + faces) + "\n"


BROKEN = ["", "v 0 0 0\nf 1 2 3\n", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "\x89PNG\r\n\x1a\n\0\0"]


def make_inputs(folder: Path, n_files: int, broken_every: int) -> tuple[set[str], set[str]]:
    """Names of all files and of the broken ones."""
    names, broken = set(), set()
    for index in range(n_files):
        name = f"{index // 100:03}/{index:05}.obj"
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        names.add(name)
        if index % broken_every == broken_every - 1:
            broken.add(name)
            path.write_text(BROKEN[index // broken_every % len(BROKEN)])
        else:
            path.write_text(chamfered_cube(3 + index % 4, 1 + index / n_files))
    return names, broken


def outputs(folder: Path) -> dict[str, Path]:
    """The files of an output folder, without the program's own."""
    files = (path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(".sharpen-"))
    return {str(path.relative_to(folder)): path for path in files}


def temporaries(folder: Path) -> list[Path]:
    return list(folder.rglob(".sharpen-*.tmp"))


def report_lines(path: Path) -> dict[str, dict]:
    """The lines of a report by name, without the times; all whole, none twice."""
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    for line in lines:
        line.pop("seconds")
        line.get("report", {}).pop("seconds", None)
    by_name = {line["name"]: line for line in lines}
    check(len(by_name) == len(lines), "a file has two lines in the report")
    return by_name


def children_of(place: Path) -> list[str]:
    """Processes that work on a file of this place."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            words = (process / "cmdline").read_bytes().split(b"\0")
            if b"--only-file" in words and os.readlink(process / "cwd") == str(place):
                found.append(process.name)
        except OSError:
            continue
    return found


class Torture:
    def __init__(self, arguments: argparse.Namespace, place: Path) -> None:
        self.arguments = arguments
        self.place = place
        self.random = random.Random(arguments.seed)
        self.expected: dict[str, bytes] = {}

    def start(self, output: str, *flags: str) -> subprocess.Popen:
        report = f"{output}.jsonl"
        command = [self.arguments.binary, "-q", "--report", report, *flags, *self.arguments.flags, "in", output]
        with open(self.place / "said", "wb") as said:
            return subprocess.Popen(command, cwd=self.place, stderr=said)

    def said(self) -> str:
        """What the last run said on standard error."""
        return (self.place / "said").read_text(errors="replace")

    def check_whole(self) -> dict[str, int]:
        """All outputs that are there are whole; when they were written comes back."""
        found = outputs(self.place / "out")
        for name, path in found.items():
            check(name in self.expected, f"{name}: should not be there")
            check(path.read_bytes() == self.expected[name], f"{name}: is not whole")
        return {name: path.stat().st_mtime_ns for name, path in found.items()}

    def kill(self, run: subprocess.Popen) -> bool:
        """Kills a run; whether it was still going on."""
        run.send_signal(signal.SIGKILL)
        was_killed = run.wait() == -signal.SIGKILL
        deadline = time.monotonic() + 10
        while children_of(self.place):
            check(time.monotonic() < deadline, "a process outlives the run that has started it")
            time.sleep(0.01)
        return was_killed

    def run(self) -> None:
        arguments, place = self.arguments, self.place
        names, broken = make_inputs(place / "in", arguments.files, arguments.broken_every)
        size = sum(path.stat().st_size for path in (place / "in").rglob("*.obj"))
        print(f"{len(names)} files, {len(broken)} of them broken, {size / 1e6:.1f} MB")

        begin = time.monotonic()
        status = self.start("calm").wait()
        seconds = time.monotonic() - begin
        check(status == (1 if broken else 0), f"exit status {status}")
        self.expected = {name: path.read_bytes() for name, path in outputs(place / "calm").items()}
        check(set(self.expected) == names - broken, "without a kill: other outputs than expected")
        calm = report_lines(place / "calm.jsonl")
        print(f"without a kill: {seconds:.1f} s, {len(names) / seconds:.0f} files a second")

        full = (place / "calm.jsonl").stat().st_size
        shares = sorted(self.random.uniform(0.02, 0.98) for _ in range(arguments.kills))
        before: dict[str, int] = {}
        total = n_killed = n_temporaries = n_repeated = 0
        for share in shares:
            run = self.start("out", "--resume")
            time.sleep(self.random.uniform(0, 0.2))  # While it finds out what is done.
            n_killed += self.kill(run)
            self.check_whole()

            run = self.start("out", "--resume")
            report = place / "out.jsonl"
            while run.poll() is None and not (report.exists() and report.stat().st_size >= share * full):
                time.sleep(0.0005)
            time.sleep(self.random.uniform(0, 0.005))
            was_killed = self.kill(run)
            check(was_killed, f"a run ended before it could be killed; {self.said()}")
            n_killed += 1
            after = self.check_whole()
            check(before.keys() <= after.keys(), "an output has gone")
            repeated = sum(after[name] != when for name, when in before.items())
            left = temporaries(place / "out")
            print(f"killed at {share:.0%}: {len(after)} outputs, all whole; {repeated} made again; {len(left)} temporary")
            n_temporaries += len(left)
            n_repeated += repeated
            total += 1
            before = after

        begin = time.monotonic()
        status = self.start("out", "--resume").wait()
        seconds = time.monotonic() - begin
        check(status == (1 if broken else 0), f"exit status {status} in the end")
        check("another run" not in self.said(), "in the end: a dead run keeps the folder locked")
        after = self.check_whole()
        n_repeated += sum(after[name] != when for name, when in before.items())
        check(set(after) == set(self.expected), f"in the end: outputs are missing; {self.said()}")
        check(not temporaries(place), "in the end: temporary files are left")
        check(report_lines(place / "out.jsonl") == calm, "in the end: the report is another one")
        # Each kill catches at most the files that are being worked on.
        limit = n_killed * arguments.jobs
        check(n_repeated <= limit, f"{n_repeated} files were made again, more than {limit}")
        status = self.start("out", "--resume").wait()
        check(self.check_whole() == after, "a run with nothing to do does something")
        state = (place / "out" / STATE).read_text().splitlines()
        check(len(state) == len(self.expected), "the state has other files")
        print(f"the last run: {seconds:.1f} s")
        print(
            f"{n_killed} kills ({total} of them at work): {len(after)} outputs, all whole; {n_repeated} made "
            f"again; {n_temporaries} temporary files found, none left; {len(calm)} lines of report, all right"
        )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--files", type=int, default=10_000)
    parser.add_argument("--broken-every", type=int, default=100, metavar="N")
    parser.add_argument("--kills", type=int, default=3, help="while at work; as many more at the start of a run")
    parser.add_argument("--seed", type=int, default=None, help="of the moments [default: another one each time]")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--binary", default=str(ROOT / "target" / "release" / "sharpen"))
    parser.add_argument("--isolate", action="store_true", help="each file in a process of its own")
    parser.add_argument("--place", type=Path, help="folder to work in [default: a temporary one]")
    arguments = parser.parse_args()
    arguments.binary = str(Path(arguments.binary).resolve())
    arguments.flags = ["--jobs", str(arguments.jobs)] + (["--timeout", "300"] if arguments.isolate else [])
    if arguments.seed is None:
        arguments.seed = random.randrange(10**6)
    print(f"seed {arguments.seed}, {arguments.jobs} jobs" + (", isolated" if arguments.isolate else ""))
    place = Path(tempfile.mkdtemp(prefix="torture-", dir=arguments.place)).resolve()
    try:
        Torture(arguments, place).run()
    except Lost as lost:
        print(f"batch_torture: {lost} (see {place})", file=sys.stderr)
        return 1
    shutil.rmtree(place)
    return 0


if __name__ == "__main__":
    sys.exit(main())
