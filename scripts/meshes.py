"""Triangle meshes as two arrays: reading, writing, edges and normals.

A mesh is a pair (vertices, faces): float64 [V, 3] and int64 [F, 3].
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh


def read_mesh(path):
    """Read a triangle mesh; polygons are cut into fans.

    OBJ files are read here, because vertices must come back in the file's own
    order and number; other formats go through trimesh, STL with its equal
    vertices joined.
    """
    path = Path(path)
    if path.suffix.lower() == ".obj":
        vertices, faces = _read_obj(path)
    else:
        loaded = trimesh.load(path, process=False, force="mesh")
        if path.suffix.lower() == ".stl":
            loaded.merge_vertices()
        vertices = np.asarray(loaded.vertices, dtype=np.float64)
        faces = np.asarray(loaded.faces, dtype=np.int64)
    if len(faces) == 0:
        raise ValueError(f"{path}: no faces")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError(f"{path}: a face names a vertex that does not exist")
    if not np.isfinite(vertices).all():
        raise ValueError(f"{path}: a coordinate is not finite")
    return vertices, faces


def _read_obj(path):
    """Read the `v` and `f` lines of a Wavefront OBJ file."""
    vertices, faces = [], []
    with open(path, encoding="utf-8", errors="replace") as lines:
        for line in lines:
            if line.startswith("v "):
                vertices.append([float(word) for word in line.split()[1:4]])
            elif line.startswith("f "):
                corners = [int(word.partition("/")[0]) for word in line.split()[1:]]
                # Indices start at 1; negative ones count back from the last vertex.
                corners = [c - 1 if c > 0 else len(vertices) + c for c in corners]
                for second, third in zip(corners[1:], corners[2:]):
                    faces.append([corners[0], second, third])
    return (
        np.array(vertices, dtype=np.float64).reshape(-1, 3),
        np.array(faces, dtype=np.int64).reshape(-1, 3),
    )


def write_obj(path, vertices, faces):
    """Write an OBJ file; nine decimals, so that equal meshes give equal bytes."""
    # Adding zero turns -0.0 into 0.0.
    rows = np.round(vertices, 9) + 0.0
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in rows]
    lines += [f"f {a} {b} {c}" for a, b, c in faces + 1]
    Path(path).write_text("\n".join(lines) + "\n")


def face_vectors(vertices, faces):
    """Return the cross products of the faces' edges [F, 3]: twice area times normal."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return np.cross(b - a, c - a)


def face_areas(vertices, faces):
    """Return the faces' areas [F]."""
    return np.linalg.norm(face_vectors(vertices, faces), axis=1) / 2


def face_normals(vertices, faces):
    """Return the unit normals [F, 3]; zero for a face without area."""
    return normalized(face_vectors(vertices, faces))


def vertex_normals(vertices, faces):
    """Return unit vertex normals [V, 3], the faces weighted by their angles."""
    normals = face_normals(vertices, faces)
    sums = np.zeros_like(vertices)
    for i in range(3):
        here, after, before = (vertices[faces[:, (i + k) % 3]] for k in range(3))
        cosine = (normalized(after - here) * normalized(before - here)).sum(axis=1)
        angle = np.arccos(np.clip(cosine, -1, 1))
        np.add.at(sums, faces[:, i], normals * angle[:, None])
    return normalized(sums)


def normalized(vectors):
    """Return the vectors at unit length; zero vectors stay zero."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


@dataclass
class Edges:
    """The undirected edges of a mesh.

    ends: vertex indices [E, 2], the smaller first. of_half: the edge of each
    half-edge 3 f + i, which runs from corner i of face f to the next [3F].
    n_faces: faces at each edge [E].
    """

    ends: np.ndarray
    of_half: np.ndarray
    n_faces: np.ndarray

    def two_sided(self):
        """Return the edges with exactly two faces, and those half-edges' indices [n, 2]."""
        order = np.argsort(self.of_half, kind="stable")
        first = np.cumsum(self.n_faces) - self.n_faces
        edges = np.flatnonzero(self.n_faces == 2)
        return edges, np.column_stack([order[first[edges]], order[first[edges] + 1]])


def half_edges(faces):
    """Return start and end vertex of half-edge 3 f + i [3F, 2]."""
    return np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)


def edges_of(faces):
    """Return the mesh's edges."""
    ends, of_half, n_faces = np.unique(
        np.sort(half_edges(faces), axis=1), axis=0, return_inverse=True, return_counts=True
    )
    return Edges(ends, of_half.reshape(-1), n_faces)


def dihedrals(vertices, faces, edges):
    """Return the angle between the normals at each edge in degrees [E].

    It is zero where it has no meaning: at an edge without exactly two faces,
    and next to a face without area.
    """
    normals = face_normals(vertices, faces)
    angles = np.zeros(len(edges.ends))
    which, halves = edges.two_sided()
    n, m = normals[halves[:, 0] // 3], normals[halves[:, 1] // 3]
    sized = (np.abs(n).sum(axis=1) > 0) & (np.abs(m).sum(axis=1) > 0)
    angles[which] = np.where(sized, angle_between(n, m), 0.0)
    return angles


def angle_between(n, m):
    """Return the angle in degrees between unit vectors, row by row.

    The arc tangent keeps angles near 0 and 180 degrees exact.
    """
    cross = np.linalg.norm(np.cross(n, m), axis=1)
    return np.degrees(np.arctan2(cross, (n * m).sum(axis=1)))


def edge_lengths(vertices, edges):
    """Return the lengths of the edges [E]."""
    return np.linalg.norm(vertices[edges.ends[:, 0]] - vertices[edges.ends[:, 1]], axis=1)


def diagonal(vertices):
    """Return the length of the bounding box's diagonal."""
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))
