#!/usr/bin/env python3
"""Sample shapes with known creases, blind to the creases, as users' tools do.

The shapes are exact meshes (see shapes.py). The sampling methods know them only
by their distance and nearest points:

  mc      marching cubes of the Euclidean distance on a turned grid: vertices
          next to creases are off the surface
  mcaxis  the same on a grid along the axes
  nets    surface nets of the distance on a turned grid, as voxel remeshers make
          them: a vertex in each cell, the mean of where its edges cross
  decimated
          mc with four times the faces, decimated by quadrics: long slivers across
          flat sides, chamfers as fine as they were
  smoothed
          mc after two rounds of Laplacian smoothing, as models from learned or blurred
          fields look: edges are round by about a sample
  mi      marching intersections: the same connectivity, every vertex exactly
          where its grid edge crosses the surface
  remesh  uniform remeshing, vertices on the surface
  scan    Poisson-disk samples joined by ball pivoting; may have small holes

Writes originals/SHAPE.obj and inputs/SHAPE__METHOD_TAG.obj under the output
folder; the tag is the approximate number of faces, then _nXX with noise.
"""

import argparse
import sys
import zlib
from dataclasses import dataclass
from pathlib import Path

import igl
import numpy as np
import pymeshlab
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from skimage.measure import marching_cubes

import measure
import meshes
from shapes import SHAPES, original

# How far the number of faces may be from the one asked for.
FACES_TOLERANCE = 0.1


class Surface:
    """The exact surface as the sampling methods may know it."""

    def __init__(self, vertices, faces):
        self.vertices, self.faces = vertices, faces
        self.area = float(meshes.face_areas(vertices, faces).sum())
        self.face_normals = meshes.face_normals(vertices, faces)
        self.vertex_normals = meshes.vertex_normals(vertices, faces)
        edges = meshes.edges_of(faces)
        self.edge_of_half = edges.of_half
        self.edge_normals = np.zeros((len(edges.ends), 3))
        np.add.at(self.edge_normals, edges.of_half, np.repeat(self.face_normals, 3, axis=0))
        # Nearest points this close to an edge or vertex are on it.
        self.touch = 1e-10 * meshes.diagonal(vertices)

    def nearest(self, points):
        """Return the nearest points on the surface and their faces."""
        _, face, foot = igl.point_mesh_squared_distance(points, self.vertices, self.faces)
        return foot, face

    def project(self, points):
        """Return the nearest points on the surface."""
        return self.nearest(points)[0]

    def distance(self, points):
        """Return signed distances, negative inside."""
        foot, face = self.nearest(points)
        away = points - foot
        inside = (away * self.pseudonormals(foot, face)).sum(axis=1) < 0
        length = np.linalg.norm(away, axis=1)
        return np.where(inside, -length, length)

    def pseudonormals(self, foot, face):
        """Return normals that tell inside from outside (Baerentzen and Aanaes 2005).

        At a vertex the angle-weighted normal, at an edge the sum of its faces'
        normals. Which it is, is judged by lengths: libigl's signed distance
        goes by barycentric coordinates and errs next to slivers.
        """
        normals = self.face_normals[face]
        corners = self.vertices[self.faces[face]]
        for i in range(3):
            start, end = corners[:, i], corners[:, (i + 1) % 3]
            direction = meshes.normalized(end - start)
            apart = np.linalg.norm(np.cross(foot - start, direction), axis=1)
            on = apart < self.touch
            normals[on] = self.edge_normals[self.edge_of_half[3 * face[on] + i]]
        for i in range(3):
            on = np.linalg.norm(foot - corners[:, i], axis=1) < self.touch
            normals[on] = self.vertex_normals[self.faces[face[on], i]]
        return normals


@dataclass
class Grid:
    """A turned grid of cubes round a surface: shape of the grid, cell size, frame."""

    size: tuple
    cell: float
    origin: np.ndarray
    turn: np.ndarray

    @classmethod
    def around(cls, surface, cell, turn, rng):
        """Return a grid along the rows of turn, two cells larger than the surface.

        It is shifted at random: a grid plane in a face of the shape would put
        zeros, which have no sign, into the field.
        """
        turned = surface.vertices @ turn.T
        low = turned.min(axis=0) - cell * (1 + rng.uniform(0.1, 0.9, 3))
        size = np.ceil((turned.max(axis=0) + 2 * cell - low) / cell).astype(int) + 1
        return cls(tuple(size), cell, low, turn)

    def points(self, index):
        """Return grid coordinates [n, 3], whole or not, as points in space."""
        return (self.origin + index * self.cell) @ self.turn

    def field(self, surface):
        """Return the distances at all grid points."""
        index = np.indices(self.size).reshape(3, -1).T
        return surface.distance(self.points(index)).reshape(self.size)


def on_grid(sample_grid, surface, faces, turn, rng):
    """Sample by sample_grid on a grid that gives about so many faces."""
    # A first guess from three triangles a cell; then from what came of it.
    cell = np.sqrt(3 * surface.area / faces)
    shift = rng.integers(2**32)
    for _ in range(8):
        grid = Grid.around(surface, cell, turn, np.random.default_rng(shift))
        mesh = sample_grid(surface, grid)
        if abs(len(mesh[1]) / faces - 1) <= FACES_TOLERANCE:
            return mesh
        cell *= np.sqrt(len(mesh[1]) / faces)
    raise ValueError(f"no grid gives about {faces} faces")


def march_grid(surface, grid, exact=False):
    """Return the largest component of the marching-cubes mesh of a grid.

    exact puts the vertices on the surface.
    """
    field = grid.field(surface)
    # Only the connectivity is taken from the library, which computes in single
    # precision. Values pushed away from zero keep its vertices clearly inside
    # their grid edges, so that the edge can be read off the position.
    least = 0.01 * grid.cell
    pushed = np.where(field < 0, np.minimum(field, -least), np.maximum(field, least))
    position, faces, *_ = marching_cubes(pushed, 0.0)
    position = position.astype(np.float64)
    low, high = np.floor(position).astype(int), np.ceil(position).astype(int)
    on_edge = (low != high).sum(axis=1) == 1
    at_low, at_high = field[tuple(low.T)], field[tuple(high.T)]
    index = position.copy()
    t = (at_low / (at_low - at_high))[on_edge, None]
    index[on_edge] = (1 - t) * low[on_edge] + t * high[on_edge]
    vertices = grid.points(index)
    if exact:
        # A vertex inside a cell (an ambiguous case) has no edge: it is projected.
        vertices[~on_edge] = surface.project(vertices[~on_edge])
        inside = np.where((at_low < 0)[:, None], low, high)[on_edge]
        outside = np.where((at_low < 0)[:, None], high, low)[on_edge]
        vertices[on_edge] = crossings(surface, grid.points(inside), grid.points(outside))
    return outward(*largest_component(vertices, faces.astype(np.int64)))


def exact_grid(surface, grid):
    """Return what marching intersections make of a grid."""
    return march_grid(surface, grid, exact=True)


def net_grid(surface, grid):
    """Return the largest component of the surface nets of a grid (Gibson 1998)."""
    field = grid.field(surface)
    crossed, quads = [], []
    for axis in range(3):
        step = np.eye(3, dtype=int)[axis]
        ends = [np.moveaxis(field, axis, 0)[part] for part in (slice(None, -1), slice(1, None))]
        at_low, at_high = (np.moveaxis(end, 0, axis) for end in ends)
        low = np.argwhere((at_low < 0) != (at_high < 0))
        at_low, at_high = at_low[tuple(low.T)], at_high[tuple(low.T)]
        point = low + (at_low / (at_low - at_high))[:, None] * step
        b, c = np.eye(3, dtype=int)[[(axis + 1) % 3, (axis + 2) % 3]]
        # The four cells round the edge, counter-clockwise as seen from its high end.
        cells = np.stack([low - b - c, low - c, low, low - b], axis=1)
        crossed.append((cells.reshape(-1, 3), np.repeat(point, 4, axis=0)))
        quads.append(np.where((at_low < 0)[:, None, None], cells, cells[:, ::-1]))
    cells, points = (np.concatenate(parts) for parts in zip(*crossed, strict=True))
    numbers = np.ravel_multi_index(cells.T, field.shape)
    used, number = np.unique(numbers, return_inverse=True)
    means = np.column_stack([np.bincount(number, points[:, k]) for k in range(3)])
    means /= np.bincount(number)[:, None]
    corners = np.concatenate(quads)
    corners = np.searchsorted(used, np.ravel_multi_index(np.moveaxis(corners, -1, 0), field.shape))
    faces = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    return outward(*largest_component(grid.points(means), faces))


def in_meshlab(vertices, faces):
    """Return a set with this mesh, for MeshLab's filters."""
    mesh_set = pymeshlab.MeshSet()
    mesh_set.add_mesh(pymeshlab.Mesh(vertices, faces.astype(np.int32)))
    return mesh_set


def out_of_meshlab(mesh_set):
    """Return the mesh that the filters made."""
    mesh = mesh_set.current_mesh()
    return mesh.vertex_matrix(), mesh.face_matrix().astype(np.int64)


def decimate(surface, faces, rng):
    """Return marching cubes with four times the faces, decimated by quadrics (Garland and Heckbert 1997)."""
    mesh_set = in_meshlab(*on_grid(march_grid, surface, 4 * faces, random_turn(rng), rng))
    mesh_set.meshing_decimation_quadric_edge_collapse(targetfacenum=faces, preservetopology=True)
    return out_of_meshlab(mesh_set)


def smooth(surface, faces, rng):
    """Return marching cubes after two rounds of Laplacian smoothing."""
    mesh_set = in_meshlab(*on_grid(march_grid, surface, faces, random_turn(rng), rng))
    mesh_set.apply_coord_laplacian_smoothing(stepsmoothnum=2)
    return out_of_meshlab(mesh_set)


def crossings(surface, inside, outside):
    """Return the points where segments from inside to outside leave the surface."""
    # Halving 60 times uses up the mantissa.
    for _ in range(60):
        middle = (inside + outside) / 2
        is_in = (surface.distance(middle) < 0)[:, None]
        inside, outside = np.where(is_in, middle, inside), np.where(is_in, outside, middle)
    return (inside + outside) / 2


def remesh(surface, faces, rng):
    """Sample by isotropic remeshing that looks for no features."""
    # Starting from the original would start with vertices on its creases.
    vertices, triangles = on_grid(exact_grid, surface, 2 * faces, random_turn(rng), rng)
    # Equilateral triangles of this edge length cover the area.
    length = np.sqrt(surface.area / faces * 4 / np.sqrt(3))
    for _ in range(8):
        remeshed = isotropic(vertices, triangles, length)
        ratio = len(remeshed[1]) / faces
        if abs(ratio - 1) <= FACES_TOLERANCE:
            return surface.project(remeshed[0]), remeshed[1]
        length *= np.sqrt(ratio)
    raise ValueError(f"no edge length gives about {faces} faces")


def isotropic(vertices, faces, length):
    """Return a uniform remesh; no dihedral angle is large enough to be a feature."""
    mesh_set = in_meshlab(vertices, faces)
    mesh_set.meshing_isotropic_explicit_remeshing(
        iterations=10, targetlen=pymeshlab.PureValue(length), featuredeg=180.0
    )
    return out_of_meshlab(mesh_set)


def scan(surface, faces, rng):
    """Sample by Poisson-disk points joined by ball pivoting."""
    # Random throwing packs about 0.52 as many points as the densest packing,
    # in which each has an area of radius^2 sqrt(3) / 2.
    radius = np.sqrt(0.52 * 2 / np.sqrt(3) * surface.area / (faces / 2))
    points, normals = poisson_disk(surface, radius, 10 * faces, rng)
    mesh_set = pymeshlab.MeshSet()
    mesh_set.add_mesh(pymeshlab.Mesh(points, v_normals_matrix=normals))
    # The largest gaps between the points are nearly one radius wide.
    ball = pymeshlab.PureValue(1.2 * radius)
    mesh_set.generate_surface_reconstruction_ball_pivoting(ballradius=ball)
    return out_of_meshlab(mesh_set)


def poisson_disk(surface, radius, throws, rng):
    """Return points at least radius from each other, and their normals."""
    candidates, face = measure.sample_faces(surface.vertices, surface.faces, throws)
    order = rng.permutation(len(candidates))
    tree = cKDTree(candidates)
    free = np.ones(len(candidates), dtype=bool)
    chosen = []
    for i in order:
        if free[i]:
            chosen.append(i)
            free[tree.query_ball_point(candidates[i], radius)] = False
    normals = meshes.face_normals(surface.vertices, surface.faces)
    return candidates[chosen], normals[face[chosen]]


def largest_component(vertices, faces):
    """Return the component with the most faces: thin edges leave islands behind."""
    a, b = faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel()
    graph = coo_matrix((np.ones(len(a)), (a, b)), shape=(len(vertices),) * 2)
    component = connected_components(graph, directed=False)[1][faces[:, 0]]
    kept = faces[component == np.bincount(component).argmax()]
    used, renumbered = np.unique(kept, return_inverse=True)
    return vertices[used], renumbered.reshape(-1, 3)


def volume(vertices, faces):
    """Return the enclosed volume, negative for a mesh turned inside out."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


def outward(vertices, faces):
    """Return the mesh with its faces turned outward."""
    return vertices, faces if volume(vertices, faces) > 0 else faces[:, ::-1].copy()


def euler_characteristic(faces):
    """Return vertices - edges + faces."""
    return len(np.unique(faces)) - len(meshes.edges_of(faces).ends) + len(faces)


def check(name, vertices, faces, surface, allowed=()):
    """Raise ValueError unless the mesh is a closed manifold of the surface's topology.

    Where some faults are allowed, unless it has none but those.
    """
    counts = measure.topology((vertices, faces), meshes.edges_of(faces))
    faults = [f"{count} {what}" for what, count in counts.items() if count and what not in allowed]
    if not np.isfinite(vertices).all():
        faults.append("a coordinate that is not finite")
    if not allowed:
        if not faults and volume(vertices, faces) <= 0:
            faults.append("faces turned inward")
        expected = euler_characteristic(surface.faces)
        found = euler_characteristic(faces)
        if found != expected:
            faults.append(f"Euler characteristic {found} instead of {expected}")
    if faults:
        raise ValueError(f"{name}: {', '.join(faults)}; more faces may help")


def random_turn(rng):
    """Return a random rotation matrix."""
    return Rotation.random(random_state=rng).as_matrix()


METHODS = {
    "mc": lambda surface, n, rng: on_grid(march_grid, surface, n, random_turn(rng), rng),
    "mcaxis": lambda surface, n, rng: on_grid(march_grid, surface, n, np.eye(3), rng),
    "nets": lambda surface, n, rng: on_grid(net_grid, surface, n, random_turn(rng), rng),
    "decimated": decimate,
    "smoothed": smooth,
    "mi": lambda surface, n, rng: on_grid(exact_grid, surface, n, random_turn(rng), rng),
    "remesh": remesh,
    "scan": scan,
}
# What these methods cannot avoid: scans may have small holes, and where two sheets of
# the surface cross one cell, surface nets give both the same vertex.
FAULTS = {
    "nets": ["nonmanifold_edges", "nonmanifold_vertices"],
    "scan": ["border_edges", "nonmanifold_vertices", "misoriented_edges"],
}


def random_source(seed, name):
    """Return the random numbers of one output, independent of which others are made."""
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def sample(shape, method, faces, seed=1):
    """Return shape sampled by method with about so many faces, checked."""
    surface = Surface(*original(shape))
    name = f"{shape}__{method}_{tag(faces)}"
    mesh = METHODS[method](surface, faces, random_source(seed, name))
    check(name, *mesh, surface, FAULTS.get(method, ()))
    return mesh


def add_noise(vertices, faces, percent, rng):
    """Return vertices moved along their normals; sigma in percent of the mean edge."""
    sigma = percent / 100 * meshes.edge_lengths(vertices, meshes.edges_of(faces)).mean()
    offset = rng.normal(0, sigma, (len(vertices), 1))
    return vertices + offset * meshes.vertex_normals(vertices, faces)


def tag(faces):
    """Return 8000 as 8k."""
    return f"{faces // 1000}k" if faces % 1000 == 0 else str(faces)


def face_count(text):
    """Return 8k as 8000."""
    return int(float(text[:-1]) * 1000) if text.endswith("k") else int(text)


def write_inputs(out, shapes, methods, sizes, noises=(), seed=1):
    """Write originals and inputs under the folder out; return the inputs' paths."""
    written = []
    for folder in ("originals", "inputs"):
        (out / folder).mkdir(parents=True, exist_ok=True)
    for shape in shapes:
        vertices, faces = original(shape)
        check(shape, vertices, faces, Surface(vertices, faces))
        meshes.write_obj(out / "originals" / f"{shape}.obj", vertices, faces)
        for method in methods:
            for size in sizes:
                name = f"{shape}__{method}_{tag(size)}"
                vertices, faces = sample(shape, method, size, seed)
                versions = {name: vertices}
                for percent in noises:
                    noisy = f"{name}_n{percent:02d}"
                    rng = random_source(seed, noisy)
                    versions[noisy] = add_noise(vertices, faces, percent, rng)
                for version, points in versions.items():
                    path = out / "inputs" / f"{version}.obj"
                    meshes.write_obj(path, points, faces)
                    written.append(path)
    return written


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="output folder")
    parser.add_argument(
        "--shapes",
        nargs="+",
        choices=SHAPES,
        default=list(SHAPES),
        metavar="SHAPE",
        help=f"of {', '.join(SHAPES)} (default: all)",
    )
    parser.add_argument(
        "--methods",
        nargs="+",
        choices=METHODS,
        default=["mc", "mcaxis", "mi", "remesh"],
        metavar="METHOD",
        help=f"of {', '.join(METHODS)} (default: mc mcaxis mi remesh)",
    )
    parser.add_argument(
        "--faces",
        nargs="+",
        type=face_count,
        default=[8000],
        metavar="N",
        help=f"numbers of faces, within {100 * FACES_TOLERANCE:g} %%, as 8000 or 8k (default: 8k)",
    )
    parser.add_argument(
        "--noise",
        nargs="+",
        type=int,
        default=[],
        metavar="PERCENT",
        help="also copies with Gaussian noise along the normals, sigma in %% of the mean edge",
    )
    parser.add_argument(
        "--seed", type=int, default=1, help="of turns, shifts and noise (default: %(default)s)"
    )
    options = parser.parse_args()
    try:
        paths = write_inputs(
            options.out,
            options.shapes,
            options.methods,
            options.faces,
            options.noise,
            options.seed,
        )
    except ValueError as error:
        sys.exit(f"make_inputs.py: {error}")
    for path in paths:
        print(path)


if __name__ == "__main__":
    main()
