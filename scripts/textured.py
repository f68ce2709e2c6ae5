#!/usr/bin/env python3
"""Send a cube with textures, colours, groups and materials through sharpen, and see what becomes of them.

The cube is cut by marching cubes on a turned grid. Each side has a group, a material and a chart of the
texture of its own, so that every crease is a seam; colours are the place within the cube. All are closed
forms of the place, and what comes out is held against them: a texture coordinate against the projection on
its material's side, a colour against its vertex. New vertices take theirs from where they were inserted and
then move onto the crease, so both may be off by what they moved: two edge lengths at most, one for all but
one in a hundred. Faces keep their parent's material, so a chamfer stays as jagged in colour as it came. Draws texture (above) and colours (below), before and after.

  textured.py OUT_FOLDER
"""

import argparse
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyvista
from scipy.spatial.transform import Rotation
from skimage.measure import marching_cubes
from vtkmodules.vtkCommonCore import vtkLogger

import meshes

ROOT = Path(__file__).resolve().parent.parent
SIDES = ["left", "right", "front", "back", "bottom", "top"]
SIDE_COLOURS = np.array(
    [(230, 90, 80), (90, 170, 90), (80, 120, 220), (235, 190, 70), (150, 100, 190), (80, 190, 200)]
)
# The cube's corners are at plus and minus this.
HALF = 0.5
VARIANTS = {"sharpened": [], "bent": ["--bend", "1"]}

# Without a display VTK says so, and then draws without one.
vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)


@dataclass
class Model:
    """What an OBJ file says: rows of v, colours and vt, and for each face its corners and names."""

    points: np.ndarray
    colours: np.ndarray
    charts: np.ndarray
    faces: np.ndarray
    face_charts: np.ndarray
    materials: np.ndarray
    groups: np.ndarray
    mtllib: str


def side_of(points):
    """Return the number of the cube's side that each point is on or nearest to [n]."""
    axis = np.abs(points).argmax(axis=1)
    return 2 * axis + (points[np.arange(len(points)), axis] > 0)


def chart(points, sides):
    """Return the texture coordinates [n, 2] of points on these sides: three columns, two rows."""
    axis = sides // 2
    rows = np.arange(len(points))
    u, v = points[rows, (axis + 1) % 3], points[rows, (axis + 2) % 3]
    within = np.column_stack([u, v]) / (2.2 * HALF) + 0.5
    return (within + np.column_stack([axis, sides % 2])) / [3, 2]


def colour(points):
    """Return the colour of points, 0 to 1 [n, 3]."""
    return np.clip(points / (2 * HALF) + 0.5, 0, 1)


def sample(n_cells):
    """Return marching cubes of the distance to the cube on a turned grid."""
    turn = Rotation.from_rotvec([0.3, 0.5, 0.7]).as_matrix()
    ticks = np.linspace(-1, 1, n_cells)
    points = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1) @ turn
    outside = np.abs(points) - HALF
    field = np.linalg.norm(np.maximum(outside, 0), axis=-1) + np.minimum(outside.max(axis=-1), 0)
    vertices, faces, _, _ = marching_cubes(field, 0.0, spacing=(ticks[1] - ticks[0],) * 3)
    return (vertices - 1) @ turn, faces


def write(path, vertices, faces):
    """Write the cube with all that a file can say about it, its material library and its texture."""
    sides = side_of(vertices[faces].mean(axis=1))
    lines = ["# A cube with six materials", f"mtllib {path.stem}.mtl", "o cube"]
    for p, c in zip(vertices, colour(vertices)):
        lines.append("v " + " ".join(f"{x:.9g}" for x in (*p, *c)))
    corner_sides = np.repeat(sides, 3)
    keys, index = np.unique(
        np.column_stack([faces.ravel(), corner_sides]), axis=0, return_inverse=True
    )
    lines += [f"vt {u:.9g} {v:.9g}" for u, v in chart(vertices[keys[:, 0]], keys[:, 1])]
    index = index.reshape(-1, 3)
    for side, name in enumerate(SIDES):
        lines += [f"g {name}", f"usemtl {name}_paint"]
        for f in np.flatnonzero(sides == side):
            lines.append("f " + " ".join(f"{v + 1}/{t + 1}" for v, t in zip(faces[f], index[f])))
    path.write_text("\n".join(lines) + "\n")
    library = [
        f"newmtl {name}_paint\nKd {' '.join(f'{x / 255:.3f}' for x in rgb)}\nmap_Kd checker.png\n"
        for name, rgb in zip(SIDES, SIDE_COLOURS)
    ]
    path.with_suffix(".mtl").write_text("\n".join(library))
    pyvista.Texture(checker()).to_image().save(path.parent / "checker.png")


def checker(size=768):
    """Return the texture: a checker in each side's colour, row 0 at the top [n, m, 3]."""
    v, u = np.mgrid[0:size, 0:size] / size
    v = 1 - v
    side = 2 * np.minimum((3 * u).astype(int), 2) + np.minimum((2 * v).astype(int), 1)
    dark = ((np.floor(24 * u) + np.floor(16 * v)) % 2).astype(bool)
    return np.where(dark[..., None], SIDE_COLOURS[side] // 2, SIDE_COLOURS[side]).astype(np.uint8)


def read(path):
    """Read an OBJ file of triangles with texture coordinates and colours."""
    rows, texture, faces, charts, materials, groups = [], [], [], [], [], []
    material = group = mtllib = ""
    for line in path.read_text().splitlines():
        word, _, rest = line.partition(" ")
        if word == "v":
            rows.append([float(x) for x in rest.split()])
        elif word == "vt":
            texture.append([float(x) for x in rest.split()[:2]])
        elif word == "usemtl":
            material = rest
        elif word == "g":
            group = rest
        elif word == "mtllib":
            mtllib = rest
        elif word == "f":
            corners = [corner.split("/") for corner in rest.split()]
            faces.append([int(c[0]) - 1 for c in corners])
            charts.append([int(c[1]) - 1 for c in corners])
            materials.append(material)
            groups.append(group)
    rows = np.array(rows)
    return Model(
        rows[:, :3], rows[:, 3:], np.array(texture), np.array(faces), np.array(charts),
        np.array(materials), np.array(groups), mtllib,
    )


def check(before, after):
    """Hold a model against the closed forms; return figures. Raises ValueError where something is lost."""
    def demand(holds, what):
        if not holds:
            raise ValueError(what)

    edge = meshes.edge_lengths(before.points, meshes.edges_of(before.faces)).mean()
    names = [f"{name}_paint" for name in SIDES]
    demand(after.mtllib == before.mtllib, "the material library is another")
    demand(set(after.materials) == set(names), "a material is lost")
    demand((after.materials == np.char.add(after.groups, "_paint")).all(), "group and material disagree")
    demand(after.colours.shape == after.points.shape, "a vertex has no colour")
    sides = np.searchsorted(names, after.materials, sorter=np.argsort(names))
    sides = np.argsort(names)[sides]
    corner_sides = np.repeat(sides, 3)
    expected = chart(after.points[after.faces.ravel()], corner_sides)
    found = after.charts[after.face_charts.ravel()]
    # In lengths on the cube: a chart is 2.2 half sides wide, a third and a half of the texture.
    off_chart = np.linalg.norm((found - expected) * [3, 2] * 2.2 * HALF, axis=1)
    off_colour = np.abs(after.colours - colour(after.points)).max(axis=1) * 2 * HALF
    for what, off in (("texture coordinate", off_chart / edge), ("colour", off_colour / edge)):
        demand(off.max() < 2, f"a {what} is {off.max():.2f} edges off")
        demand((off > 1).mean() < 0.01, f"more than one {what} in a hundred is an edge off")
    seams = np.unique(np.column_stack([after.faces.ravel(), corner_sides]), axis=0)
    per_vertex = np.bincount(seams[:, 0])
    ids = np.unique(np.column_stack([after.faces.ravel(), after.face_charts.ravel()]), axis=0)
    demand((np.bincount(ids[:, 0]) >= per_vertex).all(), "two sides share a texture coordinate at a seam")
    areas = meshes.face_areas(after.points, after.faces)
    strange = side_of(after.points[after.faces].mean(axis=1)) != sides
    return {
        "faces": len(after.faces),
        "texture_off_edges": float(off_chart.max() / edge),
        "colour_off_edges": float(off_colour.max() / edge),
        "texture_off_mean": float(off_chart.mean() / edge),
        "area_on_another_side": float(areas[strange].sum() / areas.sum()),
    }


def draw(path, models, texture):
    """Draw texture and colours of each model, flat shaded."""
    plotter = pyvista.Plotter(off_screen=True, shape=(2, len(models)), window_size=(520 * len(models), 1000))
    plotter.set_background("white")
    for column, (title, model) in enumerate(models.items()):
        # One vertex per corner, so that each has one texture coordinate.
        points = model.points[model.faces.ravel()]
        data = pyvista.PolyData.from_regular_faces(points, np.arange(len(points)).reshape(-1, 3))
        data.active_texture_coordinates = model.charts[model.face_charts.ravel()]
        data["colour"] = np.round(255 * model.colours[model.faces.ravel()]).astype(np.uint8)
        for row, style in enumerate([{"texture": texture}, {"scalars": "colour", "rgb": True}]):
            plotter.subplot(row, column)
            plotter.add_mesh(data, smooth_shading=False, copy_mesh=True, ambient=0.2, **style)
            plotter.add_text(title, font_size=9, color="black")
            plotter.camera_position = [(2.2, -2.6, 1.7), (0, 0, 0), (0, 0, 1)]
    plotter.screenshot(path)
    plotter.close()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--binary", type=Path, default=ROOT / "target/release/sharpen")
    parser.add_argument("--cells", type=int, default=34, help="of the grid along an axis")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    source = arguments.out / "cube.obj"
    write(source, *sample(arguments.cells))
    models = {"as it came": read(source)}
    print("as it came:", check(models["as it came"], models["as it came"]))
    for name, options in VARIANTS.items():
        target = arguments.out / f"cube_{name}.obj"
        subprocess.run([arguments.binary, "-q", *options, source, target], check=True)
        models[name] = read(target)
        try:
            print(f"{name}:", check(models["as it came"], models[name]))
        except ValueError as error:
            sys.exit(f"textured.py: {name}: {error}")
    draw(arguments.out / "cube.png", models, pyvista.Texture(checker()))


if __name__ == "__main__":
    main()
