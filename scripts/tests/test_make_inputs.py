"""make_inputs.py: what the samplings promise."""

import make_inputs
import measure
import meshes
import numpy as np
import pytest
from make_inputs import Surface, sample
from shapes import SHAPES, original

SMALL = 1500


def creases_of(mesh):
    """Return the crease edges of a mesh."""
    return measure.crease_edges(*mesh, meshes.edges_of(mesh[1]), 30.0)


@pytest.mark.parametrize(
    ("shape", "length", "corners"),
    [
        ("cube", 12, 8),
        # Outline and its copy, and the six edges between them.
        ("lbracket", 2 * 4.4 + 6, 12),
        ("bracket", 2 * 4.4 + 6 + 2 * 2 * np.pi * 0.22, 12),
        ("blockhole", 4 * (1.6 + 1.2 + 0.8) + 2 * 2 * np.pi * 0.3, 8),
        ("countersunk", 8 * 1.2 + 4 * 0.3 + 2 * np.pi * (0.18 + 0.18 + 0.38), 8),
        ("cylinder", 2 * 2 * np.pi * 0.5, 0),
        ("cone", 2 * np.pi * 0.6, 0),
        ("pyramid", 4 * 1.2 + 4 * (2 * 0.6**2 + 0.9**2) ** 0.5, 5),
        ("icosahedron", 30 * 2, 12),
        ("sphere", 0, 0),
        ("torus", 0, 0),
        ("round_small", 0, 0),
        ("round_big", 0, 0),
    ],
)
def test_originals_have_the_creases_that_they_are_known_for(shape, length, corners):
    mesh = original(shape)
    lines = creases_of(mesh)
    assert measure.total_length(mesh[0], lines) == pytest.approx(length, rel=1e-4)
    assert (np.bincount(lines.ravel(), minlength=1) >= 3).sum() == corners


@pytest.mark.parametrize("shape", SHAPES)
def test_originals_are_closed_manifolds(shape):
    mesh = original(shape)
    make_inputs.check(shape, *mesh, Surface(*mesh))


def test_distance_is_exact_and_signed():
    cube = Surface(*original("cube"))
    points = np.array([(0, 0, 0.4), (0, 0, 0.7), (0.6, 0.7, 0.8), (0.6, 0.6, 0.0)])
    expected = [-0.1, 0.2, np.sqrt(0.01 + 0.04 + 0.09), np.sqrt(0.02)]
    assert cube.distance(points) == pytest.approx(expected)


@pytest.mark.parametrize("shape", ["cone", "saddle"])
def test_signs_are_right_next_to_slivers(shape):
    """Fans of slivers are where barycentric coordinates give wrong signs."""
    surface = Surface(*original(shape))
    points = np.random.default_rng(0).uniform(-1, 1, (3000, 3))
    radius = np.hypot(points[:, 0], points[:, 1])
    x, z = points[:, 0], points[:, 2]
    if shape == "cone":
        inside = (np.abs(z) < 0.6) & (radius < (0.6 - z) / 2)
    else:
        inside = (np.abs(z) < 0.8) & (radius < 0.6) & (np.hypot(x, z - 1.2) > 0.9)
    # Nothing is decided within the tessellation's deviation from the circle.
    distance = surface.distance(points)
    clear = np.abs(distance) > 1e-4
    assert ((distance < 0) == inside)[clear].all()


@pytest.mark.parametrize("shape", ["cube", "bracket"])
@pytest.mark.parametrize("method", ["mc", "mcaxis", "mi", "remesh"])
def test_samplings_are_closed_oriented_manifolds_of_the_size_asked_for(shape, method):
    vertices, faces = sample(shape, method, SMALL)
    counts = measure.topology((vertices, faces), meshes.edges_of(faces))
    assert set(counts.values()) == {0}
    volume = make_inputs.volume(vertices, faces)
    assert volume == pytest.approx(make_inputs.volume(*original(shape)), rel=0.1)
    assert abs(len(faces) / SMALL - 1) <= make_inputs.FACES_TOLERANCE


@pytest.mark.parametrize("method", ["mi", "remesh", "scan"])
def test_vertices_are_exactly_on_the_surface(method):
    vertices, _ = sample("bracket", method, SMALL)
    surface = original("bracket")
    assert measure.nearest(vertices, *surface)[0].max() < 1e-9


@pytest.mark.parametrize("method", ["mc", "mcaxis", "nets"])
def test_grids_leave_the_surface_next_to_creases_only(method):
    vertices, faces = sample("cube", method, SMALL)
    mesh = original("cube")
    off = measure.nearest(vertices, *mesh)[0]
    from_crease = measure.nearest(vertices, mesh[0], creases_of(mesh))[0]
    edge = meshes.edge_lengths(vertices, meshes.edges_of(faces)).mean()
    assert off.max() > 0.02 * edge
    # The distance is linear along a grid edge whose ends have the same nearest face.
    assert off[from_crease > 2 * edge].max() < 1e-12


@pytest.mark.parametrize("method", ["mc", "mcaxis", "nets", "decimated", "smoothed", "mi", "remesh"])
def test_samplings_are_blind_to_creases(method, tmp_path):
    meshes.write_obj(tmp_path / "cube.obj", *original("cube"))
    meshes.write_obj(tmp_path / "sampled.obj", *sample("cube", method, SMALL))
    figures = measure.measure(tmp_path / "cube.obj", tmp_path / "sampled.obj")
    assert figures["crease"] < 25 and figures["corners"] == 0


def test_surface_nets_are_closed_and_oriented():
    vertices, faces = sample("bracket", "nets", SMALL)
    counts = measure.topology((vertices, faces), meshes.edges_of(faces))
    assert counts["border_edges"] == counts["misoriented_edges"] == 0
    assert counts["nonmanifold_edges"] < 0.01 * SMALL
    volume = make_inputs.volume(vertices, faces)
    assert volume == pytest.approx(make_inputs.volume(*original("bracket")), rel=0.1)
    assert abs(len(faces) / SMALL - 1) <= make_inputs.FACES_TOLERANCE


def test_decimation_leaves_long_edges_across_flat_sides():
    vertices, faces = sample("cube", "decimated", SMALL)
    assert abs(len(faces) / SMALL - 1) <= make_inputs.FACES_TOLERANCE
    lengths = meshes.edge_lengths(vertices, meshes.edges_of(faces))
    assert lengths.max() > 4 * lengths.mean()
    finer, triangles = sample("cube", "mc", SMALL)
    assert meshes.edge_lengths(finer, meshes.edges_of(triangles)).max() < 3 * lengths.mean()


def test_smoothing_rounds_creases():
    surface = original("cube")
    off = [
        measure.nearest(surface[0], *sample("cube", method, SMALL))[0].mean() for method in ("mc", "smoothed")
    ]
    assert off[1] > 1.3 * off[0]


def test_a_scan_covers_the_surface():
    _, faces = sample("cube", "scan", SMALL)
    borders = (meshes.edges_of(faces).n_faces == 1).sum()
    assert abs(len(faces) / SMALL - 1) < 0.2 and borders < 0.02 * SMALL


def test_noise_has_the_stated_size_and_direction():
    vertices, faces = sample("sphere", "remesh", SMALL)
    moved = make_inputs.add_noise(vertices, faces, 10, np.random.default_rng(3)) - vertices
    edge = meshes.edge_lengths(vertices, meshes.edges_of(faces)).mean()
    along = (moved * meshes.vertex_normals(vertices, faces)).sum(axis=1)
    assert along.std() == pytest.approx(0.1 * edge, rel=0.1)
    assert np.linalg.norm(moved, axis=1) == pytest.approx(np.abs(along), abs=1e-12)


def test_the_same_seed_gives_the_same_bytes(tmp_path):
    for run in ("first", "second"):
        make_inputs.write_inputs(
            tmp_path / run, ["cube"], ["mc", "mi", "remesh", "scan"], [1000], noises=[5]
        )
    names = sorted(p.relative_to(tmp_path / "first") for p in (tmp_path / "first").rglob("*.obj"))
    assert len(names) == 1 + 4 * 2
    for name in names:
        first, second = ((tmp_path / run / name).read_bytes() for run in ("first", "second"))
        assert first == second, name


def test_another_seed_turns_the_grid():
    first, second = (sample("cube", "mc", 1000, seed)[0] for seed in (1, 2))
    assert first.shape != second.shape or np.abs(first - second).max() > 0.01


def test_a_mesh_with_a_hole_fails_the_check():
    vertices, faces = original("cube")
    with pytest.raises(ValueError, match="3 border_edges"):
        make_inputs.check("cube", vertices, faces[1:], Surface(vertices, faces))


def test_a_mesh_inside_out_fails_the_check():
    vertices, faces = original("cube")
    with pytest.raises(ValueError, match="inward"):
        make_inputs.check("cube", vertices, faces[:, ::-1], Surface(vertices, faces))


def test_a_lost_tunnel_fails_the_check():
    with_hole, without = (Surface(*original(name)) for name in ("blockhole", "cube"))
    with pytest.raises(ValueError, match="Euler characteristic 2 instead of 0"):
        make_inputs.check("blockhole", without.vertices, without.faces, with_hole)
