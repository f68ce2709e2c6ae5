"""Makes the scripts importable, and small meshes for the tests."""

import sys
from pathlib import Path

import numpy as np
import pytest

SCRIPTS = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(SCRIPTS))


@pytest.fixture(scope="session")
def scripts():
    """Return the folder of the scripts."""
    return SCRIPTS


@pytest.fixture
def save(tmp_path):
    """Return a function that writes a mesh and returns its path."""
    import meshes

    def write(name, vertices, faces):
        path = tmp_path / f"{name}.obj"
        meshes.write_obj(path, np.asarray(vertices, float), np.asarray(faces))
        return path

    return write


@pytest.fixture
def cube():
    """Return the unit cube: corner number 4 x + 2 y + z."""
    vertices = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))])
    return vertices, faces


@pytest.fixture
def plane():
    """Return a function making a square [0, 1]^2 at a height, of n x n cells."""

    def square(height, n=4):
        x, y = np.meshgrid(np.arange(n + 1) / n, np.arange(n + 1) / n, indexing="ij")
        vertices = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, float(height))])
        a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
        b, c, d = a + n + 1, a + n + 2, a + 1
        return vertices, np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])

    return square
