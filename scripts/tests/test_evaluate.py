"""evaluate.py with stand-ins for the binary."""

import subprocess
import sys

import evaluate
import make_inputs
import pytest


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """Return a folder with one small input of a cube and one of a sphere."""
    folder = tmp_path_factory.mktemp("data")
    make_inputs.write_inputs(folder, ["cube", "sphere"], ["mc"], [1000])
    return folder


@pytest.fixture(scope="module")
def run(tmp_path_factory, scripts):
    """Return a function that runs evaluate.py with the tests' own cache."""
    cache = tmp_path_factory.mktemp("cache")

    def run(*arguments):
        command = [sys.executable, scripts / "evaluate.py", "--cache", cache, *arguments]
        return subprocess.run(map(str, command), capture_output=True, text=True, check=False)

    return run


def cells(output, *start):
    """Return the cells of the table line that starts with these."""
    lines = [[c.strip() for c in line.split("|")[1:-1]] for line in output.splitlines()]
    return next(line for line in lines if line[: len(start)] == list(start))


def test_a_copy_changes_nothing_and_is_measured_once(data, run):
    done = run("--data", data, "--binary", "cp", "--variants", "copy=")
    assert done.returncode == 0, done.stderr
    before = cells(done.stdout, "cube__mc_1k", "input")
    after = cells(done.stdout, "cube__mc_1k", "copy")
    assert after[2] == f"{before[2]} (x1.000)"
    assert after[4:] == before[4:]
    assert cells(done.stdout, "mc", "copy")[2:6] == ["1", "1.000", "1.000", "0"]
    assert cells(done.stdout, "no creases", "copy")[2] == "1"
    again = run("--data", data, "--binary", "cp", "--variants", "copy=")
    assert again.stdout == done.stdout


def test_a_perfect_output_is_measured_as_one(data, tmp_path, run):
    perfect = tmp_path / "perfect"
    original = data / "originals" / "cube.obj"
    # Called as the binary is: flags, input, output.
    perfect.write_text(f'#!/bin/sh\ncp "{original}" "$3"\n')
    perfect.chmod(0o755)
    options = ["--binary", perfect, "--only", "cube*", "--variants", "best=--flag"]
    done = run("--data", data, *options)
    assert done.returncode == 0, done.stderr
    best = cells(done.stdout, "cube__mc_1k", "best")
    assert best[2].startswith("0.000 ") and best[8] == "8/8" and best[9] == "100.0"
    assert cells(done.stdout, "all with creases", "best")[9] == "8/8"
    assert "sphere" not in done.stdout
    brief = run("--data", data, *options, "--layout", "brief")
    assert cells(brief.stdout, "cube__mc_1k")[6] == "0/8 → 8/8"


def test_a_failing_binary_is_reported(data, run):
    done = run("--data", data, "--binary", "false")
    assert done.returncode == 1
    assert "2 runs failed" in done.stderr
    assert "failed, exit code 1" in cells(done.stdout, "cube__mc_1k", "default")[2]


def test_published_figures_become_variants(data, tmp_path, run):
    reference = tmp_path / "reference.json"
    reference.write_text('{"cube__mc_1k": {"figures": {"theirs": {"emax": 1.5, "l2": 0.25}}}}')
    options = ["--binary", "cp", "--reference", reference, "--columns", "theirs"]
    done = run("--data", data, *options)
    theirs = cells(done.stdout, "cube__mc_1k", "theirs")
    assert theirs[2].startswith("1.500 (x") and theirs[5] == "-"


def test_without_inputs_it_says_so_and_succeeds(tmp_path, run):
    done = run("--data", tmp_path / "nowhere")
    assert done.returncode == 0 and "no inputs in" in done.stdout


def test_geometric_means_are_of_ratios():
    pairs = [({"l2": 1.0}, {"l2": 0.5}), ({"l2": 4.0}, {"l2": 0.5})]
    assert evaluate.ratio_mean(pairs, "l2") == "0.250"
    # An exact output counts as the least ratio, not as zero.
    assert evaluate.ratio_mean([({"l2": 1.0}, {"l2": 0.0})], "l2") == "0.001"


@pytest.mark.parametrize("name", ["measure", "make_inputs", "figures", "evaluate"])
def test_every_script_explains_itself(scripts, name):
    command = [sys.executable, scripts / f"{name}.py", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stdout.startswith("usage:")
