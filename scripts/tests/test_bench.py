"""The benchmark's mesh, its bookkeeping and its table."""

import sys

import numpy as np
import pytest

import bench
import meshes


@pytest.fixture(scope="module")
def part():
    """Return the benchmark's part in ten thousand faces."""
    return bench.sample(10_000)


def volume(vertices, faces):
    """Return the signed volume that the faces enclose."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return (a * np.cross(b, c)).sum() / 6


def test_the_part_is_closed_has_a_hole_and_faces_outwards(part):
    vertices, faces = part
    edges = meshes.edges_of(faces)
    assert (edges.n_faces == 2).all()
    assert len(vertices) - len(edges.ends) + len(faces) == 0
    exact = 8 * bench.BLOCK.prod() - np.pi * bench.HOLE**2 * 2 * bench.BLOCK[2]
    assert volume(vertices, faces) == pytest.approx(exact, rel=0.01)


def test_it_has_about_as_many_faces_as_asked_for(part):
    assert len(part[1]) == pytest.approx(10_000, rel=0.1)


def test_shuffling_keeps_the_surface(part):
    mixed = bench.shuffled(*part)
    assert not np.array_equal(mixed[0], part[0])
    assert volume(*mixed) == pytest.approx(volume(*part), rel=1e-9)


def test_copies_stand_side_by_side(part):
    vertices, faces = bench.side_by_side(*part, 3)
    assert len(faces) == 3 * len(part[1])
    assert volume(vertices, faces) == pytest.approx(3 * volume(*part), rel=1e-9)
    assert np.ptp(vertices[:, 0]) > 3 * np.ptp(part[0][:, 0])


def test_files_come_back_as_they_were_written(part, tmp_path):
    vertices, faces = meshes.read_mesh(bench.write(tmp_path / "part.obj", *part))
    assert np.array_equal(faces, part[1])
    assert np.allclose(vertices, part[0], atol=5.1e-7)


def test_a_run_tells_seconds_memory_and_output():
    seconds, memory, printed = bench.run([sys.executable, "-c", "import time; time.sleep(.2); print('x')"])
    assert seconds >= 0.2
    assert memory > 1
    assert printed == "x\n"


def test_a_run_that_fails_ends_the_benchmark():
    with pytest.raises(SystemExit, match="exit status 3"):
        bench.run([sys.executable, "-c", "raise SystemExit(3)"])


def test_ratios_are_medians_of_the_rounds_own():
    runs = bench.Runs("sharpen", "/nowhere")
    runs.figures = {"a": [{"seconds": s} for s in (1, 4, 6)], "b": [{"seconds": s} for s in (2, 2, 2)]}
    assert runs.median("a", "seconds") == 4
    assert runs.ratio("a", "b") == 2


def test_only_what_lies_between_the_markers_is_replaced():
    text = "a\n<!-- bench: begin -->\nold\n<!-- bench: end -->\nb\n"
    assert bench.replaced(text, "new\n") == text.replace("old", "new")
    with pytest.raises(SystemExit, match="no pair"):
        bench.replaced("a\n", "new\n")
