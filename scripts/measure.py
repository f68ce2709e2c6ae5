#!/usr/bin/env python3
"""Measure how far meshes are from the surface that they sample.

Distances are exact point-to-surface distances from dense samples, in both
directions, as Metro takes them (Cignoni, Rocchini and Scopigno 1998):
area-uniform points on the faces, points along the edges and all vertices.
Nothing is random, so the same files give the same figures.
"""

import argparse
import json
import sys

import igl
import numpy as np
import pymeshlab
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

import meshes

# Points on the faces of each mesh. Ten times as many change l2 by less than 0.5 %.
SAMPLES = 400_000
# Two sheets lie on each other at an edge folded by more than this, in degrees.
FOLD = 170.0
# A crease or corner counts as recovered within this many mean edges.
NEAR = 0.1
# ... and where an edge runs along the crease, not across it, in degrees.
ALONG = 30.0
# Points along creases, a mean edge.
CREASE_SAMPLES = 10

# Key, heading, decimals, what it is.
FIGURES = [
    ("emax", "Emax %", 4, "symmetric Hausdorff distance, % of the original's diagonal"),
    ("l2", "L2 %", 5, "RMS distance, the larger direction, % of the original's diagonal"),
    ("n20", "n20 %", 2, "% of the area with a normal more than 20 degrees off"),
    ("normal", "normal deg", 2, "mean angle to the original's normal, degrees"),
    ("crease", "crease %", 1, "% of the original's crease length recovered"),
    ("crease_total", "total %", 1, "length of all creases, % of the original's"),
    ("crease_false", "false %", 1, "length of creases where there is none, % of the original's"),
    ("corners", "corners", 0, "corners of the original with a vertex on them"),
    ("corners_true", "of", 0, "corners of the original"),
    ("si", "self-int", 0, "self-intersecting faces"),
    ("flip", "flips", 0, "faces turned more than 90 degrees from the original's normal"),
    ("fold", "folds", 0, f"edges with a dihedral over {FOLD:.0f} degrees"),
    ("border_edges", "border", 0, "edges with one face"),
    ("nonmanifold_edges", "nm edges", 0, "edges with more than two faces"),
    ("misoriented_edges", "misoriented", 0, "edges whose two faces run the same way"),
    ("nonmanifold_vertices", "nm vertices", 0, "vertices whose faces are not one fan"),
    ("vertices", "vertices", 0, "vertices"),
    ("faces", "faces", 0, "faces"),
    ("mean_edge", "mean edge", 5, "mean edge length, in the file's unit"),
]


def measure(original_path, processed_path, crease_angle=30.0, edge=None):
    """Measure a processed mesh against its original.

    crease_angle: dihedral in degrees from which an edge is a crease, in both
    meshes. edge: the length that recovered creases and corners are judged by
    (within NEAR times this); by default the processed mesh's mean edge. Give
    the input's to compare outputs of different resolution.

    Returns a dict with the keys of FIGURES; crease figures are None where the
    original has no crease.
    """
    original = meshes.read_mesh(original_path)
    processed = meshes.read_mesh(processed_path)
    edges = meshes.edges_of(processed[1])
    figures = {
        "vertices": len(processed[0]),
        "faces": len(processed[1]),
        "mean_edge": float(meshes.edge_lengths(processed[0], edges).mean()),
    }
    tolerance = NEAR * (figures["mean_edge"] if edge is None else edge)
    figures |= distances(original, processed)
    figures |= creases(original, processed, edges, crease_angle, tolerance)
    figures |= topology(processed, edges)
    figures["si"] = self_intersecting_faces(*processed)
    figures["flip"] = flipped_faces(original, processed)
    figures["fold"] = int((meshes.dihedrals(*processed, edges) > FOLD).sum())
    return {key: figures[key] for key, *_ in FIGURES}


def sample_faces(vertices, faces, count):
    """Return area-uniform points on the faces [n, 3] and their faces [n].

    Points sit at equal steps of accumulated area; where in the triangle comes
    from the R2 low-discrepancy sequence (Roberts 2018), which is far less
    noisy than random numbers.
    """
    total = np.cumsum(meshes.face_areas(vertices, faces))
    step = np.arange(count)
    face = np.searchsorted(total, (step + 0.5) / count * total[-1], side="right")
    face = np.minimum(face, len(faces) - 1)
    plastic = 1.32471795724474602596
    u, v = (0.5 + step / plastic) % 1, (0.5 + step / plastic**2) % 1
    fold = u + v > 1
    u[fold], v[fold] = 1 - u[fold], 1 - v[fold]
    a, b, c = (vertices[faces[face, i]] for i in range(3))
    return a + u[:, None] * (b - a) + v[:, None] * (c - a), face


def sample_segments(start, end, spacing):
    """Return points in the middles of equal pieces of segments, and each point's segment.

    Every segment gets at least one; pieces are no longer than spacing.
    """
    pieces = np.ceil(np.linalg.norm(end - start, axis=1) / spacing).astype(int)
    pieces = np.maximum(pieces, 1)
    segment = np.repeat(np.arange(len(start)), pieces)
    within = np.arange(len(segment)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    t = ((within + 0.5) / pieces[segment])[:, None]
    return (1 - t) * start[segment] + t * end[segment], segment


def nearest(points, vertices, elements):
    """Return distances to a mesh or set of segments, and the nearest element."""
    squared, element, _ = igl.point_mesh_squared_distance(
        np.ascontiguousarray(points), np.ascontiguousarray(vertices), np.ascontiguousarray(elements)
    )
    return np.sqrt(np.maximum(squared, 0)), element


def one_way(source, target):
    """Return the largest and the RMS distance from source to target, and the face samples.

    The samples: face of the source, nearest face of the target.
    """
    vertices, faces = source
    points, face = sample_faces(vertices, faces, SAMPLES)
    distance, hit = nearest(points, *target)
    spacing = np.sqrt(meshes.face_areas(vertices, faces).sum() / SAMPLES)
    ends = meshes.edges_of(faces).ends
    along, _ = sample_segments(vertices[ends[:, 0]], vertices[ends[:, 1]], spacing)
    # Vertices that no face uses are no part of the surface.
    others = np.concatenate([vertices[np.unique(faces)], along])
    largest = max(distance.max(), nearest(others, *target)[0].max())
    return largest, np.sqrt((distance**2).mean()), face, hit


def distances(original, processed):
    """Return emax, l2, n20 and the mean normal error."""
    percent = 100 / meshes.diagonal(original[0])
    there = one_way(original, processed)
    largest, rms, face, hit = one_way(processed, original)
    off = meshes.angle_between(
        meshes.face_normals(*processed)[face], meshes.face_normals(*original)[hit]
    )
    return {
        "emax": float(max(largest, there[0]) * percent),
        "l2": float(max(rms, there[1]) * percent),
        "n20": float((off > 20).mean() * 100),
        "normal": float(off.mean()),
    }


def crease_edges(vertices, faces, edges, crease_angle):
    """Return the edges with a dihedral over crease_angle degrees [n, 2]."""
    return edges.ends[meshes.dihedrals(vertices, faces, edges) > crease_angle]


def length_along(vertices, lines, other_vertices, other_lines, tolerance, spacing):
    """Return the length of the lines that have one of the others close by.

    Close: within tolerance, the two directions within ALONG degrees.
    """
    if len(other_lines) == 0:
        return 0.0
    start, end = vertices[lines[:, 0]], vertices[lines[:, 1]]
    points, line = sample_segments(start, end, spacing)
    distance, hit = nearest(points, other_vertices, other_lines)
    direction = meshes.normalized(end - start)[line]
    other = meshes.normalized(np.diff(other_vertices[other_lines], axis=1)[:, 0])[hit]
    parallel = np.abs((direction * other).sum(axis=1)) > np.cos(np.radians(ALONG))
    piece = (np.linalg.norm(end - start, axis=1) / np.bincount(line))[line]
    return float(piece[(distance < tolerance) & parallel].sum())


def total_length(vertices, lines):
    """Return the summed length of segments given by vertex indices."""
    return float(np.linalg.norm(vertices[lines[:, 0]] - vertices[lines[:, 1]], axis=1).sum())


def creases(original, processed, edges, crease_angle, tolerance):
    """Return what became of the original's creases and corners."""
    true = crease_edges(*original, meshes.edges_of(original[1]), crease_angle)
    if len(true) == 0:
        figures = dict.fromkeys(["crease", "crease_total", "crease_false"])
        return figures | {"corners": 0, "corners_true": 0}
    found = crease_edges(*processed, edges, crease_angle)
    spacing = tolerance / NEAR / CREASE_SAMPLES
    percent = 100 / total_length(original[0], true)
    total = total_length(processed[0], found)
    recovered = length_along(original[0], true, processed[0], found, tolerance, spacing)
    justified = length_along(processed[0], found, original[0], true, tolerance, spacing)
    corner = np.flatnonzero(np.bincount(true.ravel()) >= 3)
    apart = cKDTree(processed[0]).query(original[0][corner])[0] if len(corner) else np.empty(0)
    return {
        "crease": recovered * percent,
        "crease_total": total * percent,
        "crease_false": (total - justified) * percent,
        "corners": int((apart < tolerance).sum()),
        "corners_true": len(corner),
    }


def topology(mesh, edges):
    """Count the edges and vertices at which the mesh is no closed oriented manifold."""
    faces = mesh[1]
    start = meshes.half_edges(faces)[:, 0]
    _, pairs = edges.two_sided()
    return {
        "border_edges": int((edges.n_faces == 1).sum()),
        "nonmanifold_edges": int((edges.n_faces > 2).sum()),
        "misoriented_edges": int((start[pairs[:, 0]] == start[pairs[:, 1]]).sum()),
        "nonmanifold_vertices": nonmanifold_vertices(faces, edges),
    }


def nonmanifold_vertices(faces, edges):
    """Count vertices whose faces fall apart into several fans.

    Corners of one vertex are joined across every edge that they share; what
    stays apart are different fans.
    """
    halves = meshes.half_edges(faces)
    # The two corners of half-edge 3 f + i are 3 f + i and the face's next one.
    here = np.arange(len(halves))
    after = here - here % 3 + (here + 1) % 3
    corner = np.concatenate([here, after])
    vertex = np.concatenate([halves[:, 0], halves[:, 1]])
    edge = np.tile(edges.of_half, 2)
    # Equal (edge, vertex) pairs follow one another: chain their corners.
    order = np.lexsort([vertex, edge])
    same = (np.diff(edge[order]) == 0) & (np.diff(vertex[order]) == 0)
    a, b = corner[order[:-1][same]], corner[order[1:][same]]
    graph = coo_matrix((np.ones(len(a)), (a, b)), shape=(len(halves), len(halves)))
    n_fans, fan = connected_components(graph, directed=False)
    vertex_of_fan = np.empty(n_fans, dtype=np.int64)
    vertex_of_fan[fan] = halves[:, 0]
    return int((np.bincount(vertex_of_fan) > 1).sum())


def self_intersecting_faces(vertices, faces):
    """Count the faces that cut another face of the mesh.

    MeshLab finds them; what it takes for a cut between faces of one plane that
    lie apart in it does not count. Faces that name a vertex twice have nothing
    to cut with.
    """
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    mesh_set = pymeshlab.MeshSet()
    mesh_set.add_mesh(pymeshlab.Mesh(vertices, faces.astype(np.int32)))
    mesh_set.compute_selection_by_self_intersections_per_face()
    selected = faces[mesh_set.current_mesh().face_selection_array()]
    return int(cut_by_others(vertices, selected).sum())


def cut_by_others(vertices, faces):
    """Return which of the faces [F] cut another one of them."""
    if not len(faces):
        return np.zeros(0, bool)
    corners = vertices[faces]
    center = corners.mean(axis=1)
    radius = np.linalg.norm(corners - center[:, None], axis=2).max(axis=1)
    near = cKDTree(center).query_ball_point(center, radius + radius.max())
    return np.array(
        [any(cut(vertices, faces[i], faces[j]) for j in js if j != i) for i, js in enumerate(near)]
    )


def cut(vertices, f, g):
    """Whether faces f and g [3] cut each other beyond the vertices that they share.

    Two with a common edge never do, as MeshLab has it; two with a common vertex
    do where the side opposite to it of one meets the other.
    """
    common = np.intersect1d(f, g)
    if len(common) == 2:
        return False
    if len(common) == 1:
        sides = [vertices[t[t != common[0]]] for t in (f, g)]
        return not (are_apart(sides[0], vertices[g]) and are_apart(sides[1], vertices[f]))
    return len(common) == 3 or not are_apart(vertices[f], vertices[g])


def are_apart(a, b):
    """Whether an axis separates two triangles or segments [2 or 3, 3] by more than rounding.

    It is the normal of one, a side turned by 90 degrees in the plane of one, or
    the cross product of two sides.
    """
    sides = [np.roll(t, -1, axis=0) - t for t in (a, b)]
    normals = np.array([np.cross(side[0], side[1]) for side in sides])
    turned = np.cross(normals[:, None], np.concatenate(sides)[None]).reshape(-1, 3)
    both = np.cross(sides[0][:, None], sides[1][None]).reshape(-1, 3)
    axes = meshes.normalized(np.concatenate([normals, turned, both]))
    on_a, on_b = a @ axes.T, b @ axes.T
    gap = np.maximum(on_a.min(axis=0) - on_b.max(axis=0), on_b.min(axis=0) - on_a.max(axis=0))
    return bool(gap.max() > 1e-9 * np.ptp(np.concatenate([a, b]), axis=0).max())


def flipped_faces(original, processed):
    """Count faces turned more than 90 degrees from the normal nearest to their centroid."""
    vertices, faces = processed
    _, hit = nearest(vertices[faces].mean(axis=1), *original)
    cosine = (meshes.face_normals(*processed) * meshes.face_normals(*original)[hit]).sum(axis=1)
    return int((cosine < 0).sum())


def table(rows):
    """Lay out (name, figures) rows as text, a column for each figure."""
    cells = [["mesh", *(heading for _, heading, *_ in FIGURES)]]
    for name, figures in rows:
        cells.append([name, *(_number(figures[key], decimals) for key, _, decimals, _ in FIGURES)])
    widths = [max(map(len, column)) for column in zip(*cells)]
    return "\n".join(
        "  ".join(c.rjust(w) if i else c.ljust(w) for i, (c, w) in enumerate(zip(line, widths)))
        for line in cells
    )


def _number(value, decimals):
    return "-" if value is None else f"{value:.{decimals}f}"


def main():
    legend = "\n".join(f"  {key:22}{text}" for key, _, _, text in FIGURES)
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog=f"figures:\n{legend}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("original", metavar="ORIGINAL", help="mesh of the true surface")
    parser.add_argument("processed", metavar="PROCESSED", nargs="+", help="meshes to measure")
    parser.add_argument("--json", action="store_true", help="print JSON: one object by file name")
    parser.add_argument(
        "--crease-angle",
        type=float,
        default=30.0,
        metavar="DEG",
        help="an edge is a crease from this dihedral, in degrees (default: %(default)g)",
    )
    parser.add_argument(
        "--edge",
        type=float,
        metavar="LENGTH",
        help=f"creases and corners count as recovered within {NEAR:g} of this length "
        "(default: the processed mesh's mean edge)",
    )
    options = parser.parse_args()
    try:
        rows = [
            (path, measure(options.original, path, options.crease_angle, options.edge))
            for path in options.processed
        ]
    except (OSError, ValueError) as error:
        sys.exit(f"measure.py: {error}")
    print(json.dumps(dict(rows), indent=1) if options.json else table(rows))


if __name__ == "__main__":
    main()
