#!/usr/bin/env python3
"""Draw meshes side by side: flat shaded, by class or by distance to the original.

All panels share one camera. No window is opened.

  before and after       figures.py OUT.png BEFORE AFTER --edges
  with the classes       figures.py OUT.png BEFORE AFTER --classes CLASSES.ply
  coloured by distance   figures.py OUT.png BEFORE AFTER --original ORIGINAL --error
  the 4 worst places     figures.py OUT.png BEFORE AFTER --original ORIGINAL --worst 4
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import pyvista
from vtkmodules.vtkCommonCore import vtkLogger

import measure
import meshes

# Without a display VTK says so, and then draws without one.
vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)

PLAIN = "#d8d4c8"
# Places of large error nearer to each other than this are one place, % of the diagonal.
APART = 5.0
PLY_TYPES = {
    "char": "i1",
    "int8": "i1",
    "uchar": "u1",
    "uint8": "u1",
    "short": "i2",
    "int16": "i2",
    "ushort": "u2",
    "uint16": "u2",
    "int": "i4",
    "int32": "i4",
    "uint": "u4",
    "uint32": "u4",
    "float": "f4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
}


def read_ply(path):
    """Read a PLY file whose only lists are triangles.

    Returns a structured array by element name; a list property has shape [n, 3].
    """
    data = Path(path).read_bytes()
    header, _, body = data.partition(b"end_header\n")
    lines = [line.split() for line in header.decode("ascii").splitlines()]
    if not body or lines[0] != ["ply"]:
        raise ValueError(f"{path}: not a PLY file")
    layout = next(words[1] for words in lines if words[0] == "format")
    order = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}[layout]
    elements = []
    for words in lines:
        if words[0] == "element":
            elements.append((words[1], int(words[2]), []))
        elif words[0] == "property" and words[1] == "list":
            count, item, name = words[2:]
            elements[-1][2].append((f"{name} count", order + PLY_TYPES[count]))
            elements[-1][2].append((name, order + PLY_TYPES[item], 3))
        elif words[0] == "property":
            elements[-1][2].append((words[2], order + PLY_TYPES[words[1]]))
    text = body.split() if layout == "ascii" else None
    result = {}
    for name, count, fields in elements:
        dtype = np.dtype(fields)
        if text is None:
            rows = np.frombuffer(body, dtype, count)
            body = body[rows.nbytes :]
        else:
            rows, text = _ascii_rows(text, count, dtype)
        for field in dtype.names:
            if field.endswith(" count") and (rows[field] != 3).any():
                raise ValueError(f"{path}: a list in element {name} is not three long")
        result[name] = rows
    return result


def _ascii_rows(words, count, dtype):
    """Return count rows of dtype from words, and the words that follow them."""
    widths = [int(np.prod(dtype[name].shape, dtype=int)) for name in dtype.names]
    table = np.array(words[: count * sum(widths)], dtype=np.float64).reshape(count, -1)
    rows = np.empty(count, dtype)
    starts = np.cumsum([0, *widths[:-1]])
    for name, start, width in zip(dtype.names, starts, widths):
        values = table[:, start : start + width]
        rows[name] = values if dtype[name].shape else values[:, 0]
    return rows, words[count * sum(widths) :]


def read_classes(path):
    """Read a file of classes: vertices, faces, face colours, coloured edges, their colours."""
    ply = read_ply(path)
    vertex, face = ply["vertex"], ply["face"]
    lists = [name for name in ("vertex_indices", "vertex_index") if name in face.dtype.names]
    if not lists:
        raise ValueError(f"{path}: its faces have no vertex_indices")
    edge = ply.get("edge")
    return (
        columns(vertex, "x", "y", "z").astype(np.float64),
        face[lists[0]].astype(np.int64),
        columns(face, "red", "green", "blue").astype(np.uint8),
        columns(edge, "vertex1", "vertex2").astype(np.int64) if edge is not None else None,
        columns(edge, "red", "green", "blue").astype(np.uint8) if edge is not None else None,
    )


def columns(rows, *names):
    """Return fields of a structured array side by side."""
    return np.column_stack([rows[name] for name in names])


def poly_data(vertices, elements):
    """Return a PyVista mesh of triangles [n, 3] or lines [n, 2]."""
    cells = np.column_stack([np.full(len(elements), elements.shape[1]), elements])
    kind = {"faces": cells} if elements.shape[1] == 3 else {"lines": cells}
    return pyvista.PolyData(vertices, **kind)


def face_errors(mesh, original):
    """Return the largest distance of each face to the original, % of its diagonal [F].

    Of the corners, the middles of the edges and the centroid.
    """
    vertices, faces = mesh
    corners = vertices[faces]
    middles = (corners + np.roll(corners, 1, axis=1)) / 2
    centroid = corners.mean(axis=1, keepdims=True)
    points = np.concatenate([corners, middles, centroid], axis=1)
    distance, _ = measure.nearest(points.reshape(-1, 3), *original)
    return distance.reshape(len(faces), -1).max(axis=1) * 100 / meshes.diagonal(original[0])


def worst_places(mesh, original, count):
    """Return the count places on the original farthest from the mesh, or the other way.

    Returns points [n, 3] and the original's normals there; a place hides what
    lies within APART of it.
    """
    points, distances, normals = [], [], []
    original_normals = meshes.face_normals(*original)
    for source, target in ((original, mesh), (mesh, original)):
        sample, face = measure.sample_faces(*source, measure.SAMPLES // 4)
        # Corners and spikes are the worst places, and no sample hits them.
        corner = source[1].ravel()
        sample = np.concatenate([sample, source[0][corner]])
        face = np.concatenate([face, np.repeat(np.arange(len(source[1])), 3)])
        distance, hit = measure.nearest(sample, *target)
        points.append(sample)
        distances.append(distance)
        normals.append(original_normals[face if source is original else hit])
    points, distances, normals = map(np.concatenate, (points, distances, normals))
    order = np.argsort(-distances, kind="stable")
    reach = APART / 100 * meshes.diagonal(original[0])
    chosen = []
    while len(chosen) < count and len(order):
        chosen.append(order[0])
        order = order[np.linalg.norm(points[order] - points[order[0]], axis=1) > reach]
    return points[chosen], normals[chosen]


def view_direction(azimuth, elevation):
    """Return the unit vector towards the camera; degrees, z is up."""
    a, e = np.radians([azimuth, elevation])
    return np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])


def aim(plotter, centre, direction, width, distance):
    """Look at centre from direction, in parallel projection, at a view width wide."""
    camera = plotter.camera
    camera.focal_point = centre
    camera.position = centre + distance * direction
    camera.up = (0, 0, 1) if abs(direction[2]) < 0.95 else (0, 1, 0)
    camera.enable_parallel_projection()
    pixels = plotter.renderer.GetSize()
    camera.parallel_scale = width / 2 * pixels[1] / pixels[0]
    plotter.renderer.ResetCameraClippingRange()


class Panel:
    """One column of the figure: what is drawn in it."""

    def __init__(self, title, mesh, face_colours=None, lines=None, errors=None):
        self.title, self.mesh, self.face_colours = title, mesh, face_colours
        self.lines, self.errors = lines, errors

    def draw(self, plotter, edges, limit):
        """Add the panel's mesh to the plotter's current view."""
        data = poly_data(*self.mesh)
        style = {"show_edges": edges, "edge_color": "#404040", "line_width": 1, "ambient": 0.3}
        if self.errors is not None:
            data.cell_data["distance, % of the diagonal"] = self.errors
            style |= {"cmap": "viridis", "clim": (0, limit)}
            style["scalar_bar_args"] = {"color": "black", "fmt": "%.2g"}
        elif self.face_colours is not None:
            data.cell_data["colour"] = self.face_colours
            style |= {"scalars": "colour", "rgb": True}
        else:
            style["color"] = PLAIN
        plotter.add_mesh(data, smooth_shading=False, copy_mesh=True, **style)
        if self.lines is not None and len(self.lines[0]):
            lines = poly_data(self.mesh[0], self.lines[0])
            lines.cell_data["colour"] = self.lines[1]
            plotter.add_mesh(lines, scalars="colour", rgb=True, line_width=2, lighting=False)


def draw(out, panels, views, size, edges=False, limit=None):
    """Write a PNG with a column for each panel and a row for each view.

    views: (title, centre, direction, width) each; size: of a panel, in pixels;
    limit: upper end of the error scale, by default the largest error shown.
    """
    shape = (len(views), len(panels))
    if limit is None:
        limit = max((p.errors.max() for p in panels if p.errors is not None), default=1.0)
    extent = max(meshes.diagonal(panel.mesh[0]) for panel in panels)
    plotter = pyvista.Plotter(
        off_screen=True, shape=shape, window_size=(size[0] * shape[1], size[1] * shape[0])
    )
    plotter.set_background("white")
    for row, (view_title, centre, direction, width) in enumerate(views):
        for column, panel in enumerate(panels):
            plotter.subplot(row, column)
            panel.draw(plotter, edges, limit)
            title = "  ".join(filter(None, (panel.title, view_title)))
            plotter.add_text(title, font_size=9, color="black")
            aim(plotter, centre, direction, width, 2 * extent)
    plotter.screenshot(out)
    plotter.close()


def make_panels(options, original):
    """Return the figure's panels, the classes after the first mesh."""
    loaded = [meshes.read_mesh(path) for path in options.meshes]
    titles = options.titles or [path.stem for path in options.meshes]
    errors = [face_errors(mesh, original) if options.error else None for mesh in loaded]
    panels = [Panel(t, m, errors=e) for t, m, e in zip(titles, loaded, errors, strict=True)]
    if options.classes:
        vertices, faces, colours, edges, edge_colours = read_classes(options.classes)
        lines = (edges, edge_colours) if edges is not None else None
        panels.insert(1, Panel("classes", (vertices, faces), colours, lines))
    return panels


def make_views(options, panels, original):
    """Return the figure's views: the whole, the zoomed place or the worst places."""
    frame = original if original is not None else panels[0].mesh
    diagonal = meshes.diagonal(frame[0])
    direction = view_direction(*options.view)
    if options.worst:
        places, normals = worst_places(panels[-1].mesh, original, options.worst)
        # Seen straight on, steps in depth would not show.
        tilted = meshes.normalized(normals + 0.7 * direction)
        width = options.width / 100 * diagonal
        return [
            (f"({x:.4g} {y:.4g} {z:.4g})", np.array([x, y, z]), towards, width)
            for (x, y, z), towards in zip(places, tilted)
        ]
    if options.zoom:
        return [("", np.array(options.zoom), direction, options.width / 100 * diagonal)]
    centre = (frame[0].min(axis=0) + frame[0].max(axis=0)) / 2
    return [("", centre, direction, 1.05 * diagonal)]


def parse_arguments():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", metavar="OUT.png", type=Path)
    parser.add_argument("meshes", metavar="MESH", nargs="+", type=Path, help="a column each")
    parser.add_argument("--titles", nargs="+", help="of the meshes (default: their file names)")
    parser.add_argument(
        "--classes", metavar="FILE.ply", help="mesh with face and edge colours, after the first"
    )
    parser.add_argument("--original", metavar="MESH", help="for --error and --worst")
    parser.add_argument(
        "--error", action="store_true", help="colour faces by distance to the original"
    )
    parser.add_argument(
        "--limit", type=float, metavar="PERCENT", help="end of the scale, %% of the diagonal"
    )
    parser.add_argument(
        "--worst", type=int, metavar="N", help="a row for each of the last mesh's N worst places"
    )
    parser.add_argument("--zoom", type=float, nargs=3, metavar=("X", "Y", "Z"), help="look here")
    parser.add_argument(
        "--width",
        type=float,
        default=15.0,
        metavar="PERCENT",
        help="width of zoomed views, %% of the diagonal (default: %(default)g)",
    )
    parser.add_argument(
        "--view",
        type=float,
        nargs=2,
        default=(-50.0, 30.0),
        metavar=("AZIMUTH", "ELEVATION"),
        help="of the camera, in degrees, z is up (default: -50 30)",
    )
    parser.add_argument("--edges", action="store_true", help="draw the meshes' edges")
    parser.add_argument(
        "--size",
        type=int,
        nargs=2,
        default=(700, 600),
        metavar=("W", "H"),
        help="of a panel, in pixels (default: 700 600)",
    )
    options = parser.parse_args()
    if (options.error or options.worst) and not options.original:
        parser.error("--error and --worst need --original")
    if options.titles and len(options.titles) != len(options.meshes):
        parser.error("--titles needs as many titles as meshes")
    return options


def main():
    options = parse_arguments()
    try:
        original = meshes.read_mesh(options.original) if options.original else None
        panels = make_panels(options, original)
        views = make_views(options, panels, original)
    except (OSError, ValueError) as error:
        sys.exit(f"figures.py: {error}")
    draw(options.out, panels, views, options.size, options.edges, options.limit)


if __name__ == "__main__":
    main()
