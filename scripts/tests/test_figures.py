"""figures.py: files of the right size that show something."""

import subprocess
import sys

import figures
import numpy as np
import pytest
from skimage.io import imread

HEADER = """ply
format {layout} 1.0
comment a square of two faces and one edge
element vertex 4
property double x
property double y
property double z
element face 2
property list uchar uint vertex_indices
property uchar red
property uchar green
property uchar blue
element edge 1
property uint vertex1
property uint vertex2
property uchar red
property uchar green
property uchar blue
end_header
"""
VERTICES = [(0, 0, 0), (1, 0, 0), (1, 1, 0.25), (0, 1, 0)]
FACES = [((0, 1, 2), (255, 0, 0)), ((0, 2, 3), (0, 128, 0))]
EDGES = [((0, 2), (0, 0, 255))]


def classes_file(path, layout):
    """Write the square as a file of classes."""
    head = HEADER.format(layout=layout).encode()
    if layout == "ascii":
        rows = [v for v in VERTICES]
        rows += [(3, *corners, *colour) for corners, colour in FACES]
        rows += [(*ends, *colour) for ends, colour in EDGES]
        body = "".join(" ".join(map(str, row)) + "\n" for row in rows).encode()
    else:
        order = "<" if "little" in layout else ">"
        body = np.array(VERTICES, order + "f8").tobytes()
        for corners, colour in FACES:
            body += bytes([3]) + np.array(corners, order + "u4").tobytes() + bytes(colour)
        for ends, colour in EDGES:
            body += np.array(ends, order + "u4").tobytes() + bytes(colour)
    path.write_bytes(head + body)
    return path


@pytest.mark.parametrize("layout", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_classes_are_read_in_every_layout(tmp_path, layout):
    path = classes_file(tmp_path / "classes.ply", layout)
    vertices, faces, colours, edges, edge_colours = figures.read_classes(path)
    assert vertices.tolist() == [list(map(float, v)) for v in VERTICES]
    assert faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert colours.tolist() == [[255, 0, 0], [0, 128, 0]]
    assert edges.tolist() == [[0, 2]]
    assert edge_colours.tolist() == [[0, 0, 255]]


def run(scripts, *arguments):
    """Run figures.py."""
    command = [sys.executable, scripts / "figures.py", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_panels_stand_side_by_side_and_show_the_classes_colours(tmp_path, scripts, save, cube):
    mesh = save("cube", *cube)
    classes = classes_file(tmp_path / "classes.ply", "binary_little_endian")
    out = tmp_path / "out.png"
    options = ["--classes", classes, "--edges", "--size", 200, 150]
    run(scripts, out, mesh, mesh, *options)
    picture = imread(out)[..., :3].astype(int)
    assert picture.shape == (150, 600, 3)
    first, middle, last = (picture[30:, x : x + 200] for x in (0, 200, 400))
    red, green, blue = (middle[..., c] for c in range(3))
    assert (red > green + 50).sum() > 100, "the red face"
    assert (green > red + 30).sum() > 100, "the green face"
    assert (blue > red + 100).sum() > 10, "the blue edge"
    # One camera: the same mesh gives the same picture; it has light and dark faces.
    assert np.abs(first[:, 5:190] - last[:, 5:190]).mean() < 2
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 3


def test_errors_are_coloured_and_the_worst_places_get_a_row_each(tmp_path, scripts, save, cube):
    vertices, faces = cube
    dented = vertices.copy()
    dented[7] -= 0.3
    original, mesh = save("cube", *cube), save("dented", dented, faces)
    out = tmp_path / "out.png"
    options = ["--original", original, "--error", "--worst", 2, "--size", 200, 150]
    run(scripts, out, mesh, *options)
    picture = imread(out)[..., :3].astype(int)
    assert picture.shape == (300, 200, 3)
    assert (np.ptp(picture, axis=2) > 60).sum() > 100, "nothing is coloured"


def test_the_worst_place_is_the_missing_corner(cube):
    vertices, faces = cube
    dented = vertices.copy()
    dented[7] -= 0.3
    places, normals = figures.worst_places((dented, faces), cube, 2)
    # The missing corner, or the dent's bottom, which is as far from the cube.
    distances = np.linalg.norm(places[0] - np.array([[1, 1, 1], [0.7, 0.7, 0.7]]), axis=1)
    assert distances.min() < 1e-9
    assert np.linalg.norm(places[0] - places[1]) > 0.05 * 3**0.5
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1)


def test_face_errors_are_percentages_of_the_diagonal(plane):
    errors = figures.face_errors(plane(0.05), plane(0))
    assert errors == pytest.approx(100 * 0.05 / 2**0.5)
