"""The shapes that make_inputs.py samples, as exact meshes.

Creases are edges and corners are vertices of the meshes; curved parts are
tessellated far finer than any sampling of them.
"""

import numpy as np
from manifold3d import CrossSection, Manifold

# Pieces of a full circle: the tessellation is then 2e-5 radii from the circle.
CIRCLE = 512
# The same for doubly curved parts, whose faces grow with its square.
SPHERE = 256


def bracket():
    """Return an L-bracket with a hole through its foot."""
    hole = Manifold.cylinder(2, 0.22, 0.22, CIRCLE, True).translate((0.75, 0.5, 0))
    return lbracket() - hole


def lbracket():
    """Return an L-shaped prism: one concave edge among convex ones."""
    outline = [(0, 0), (1.2, 0), (1.2, 0.35), (0.35, 0.35), (0.35, 1.0), (0, 1.0)]
    return prism(outline, 1.0).rotate((90, 0, 0)).translate((0, 1.0, 0))


def prism(outline, height):
    """Return the prism over a counter-clockwise polygon."""
    return Manifold.extrude(CrossSection([outline]), height)


def blockhole():
    """Return a block with a through hole."""
    return Manifold.cube((1.6, 1.2, 0.8), True) - Manifold.cylinder(2, 0.3, 0.3, CIRCLE, True)


def countersunk():
    """Return a plate with a countersunk hole."""
    cone = Manifold.cylinder(0.2, 0.18, 0.38, CIRCLE).translate((0, 0, 0.1))
    hole = Manifold.cylinder(2, 0.18, 0.18, CIRCLE, True)
    # The cone ends exactly in the plate's top face, where a difference is ambiguous.
    above = Manifold.cylinder(0.1, 0.38, 0.38, CIRCLE).translate((0, 0, 0.3))
    return Manifold.cube((1.2, 1.2, 0.3), True).translate((0, 0, 0.15)) - (cone + hole + above)


def saddle():
    """Return a cylinder whose top is cut by a crossing cylinder: a crease in space."""
    cutter = Manifold.cylinder(4, 0.9, 0.9, CIRCLE, True).rotate((90, 0, 0))
    return Manifold.cylinder(1.6, 0.6, 0.6, CIRCLE, True) - cutter.translate((0, 0, 1.2))


def star():
    """Return an eight-pointed star prism: convex and concave edges in turn."""
    turn = np.arange(16) * np.pi / 8
    radius = np.where(np.arange(16) % 2 == 0, 0.8, 0.5)
    return prism(np.column_stack([radius * np.cos(turn), radius * np.sin(turn)]), 0.5)


def wedge():
    """Return a prism with an acute edge of 35 degrees."""
    return prism([(0, 0), (1.2, 0), (1.2, 1.2 * np.tan(np.radians(35)))], 1.0)


def pyramid():
    """Return a square pyramid: four edges meet in its apex."""
    base = [(-0.6, -0.6, 0), (0.6, -0.6, 0), (0.6, 0.6, 0), (-0.6, 0.6, 0)]
    return Manifold.hull_points(np.array([*base, (0, 0, 0.9)]))


def icosahedron():
    """Return an icosahedron: five edges of 42 degrees meet in each vertex."""
    golden = (1 + 5**0.5) / 2
    points = [(0, a, b * golden) for a in (-1, 1) for b in (-1, 1)]
    return Manifold.hull_points(np.array([np.roll(p, i) for p in points for i in range(3)]))


def flatcone():
    """Return a cylinder with a flat cone on top, whose sides rise at 27 degrees only."""
    cone = Manifold.cylinder(0.35, 0.7, 0, CIRCLE).translate((0, 0, 0.5))
    return Manifold.batch_hull([Manifold.cylinder(0.5, 0.7, 0.7, CIRCLE), cone])


def needle():
    """Return a slim cone: its sides are 11 degrees from its axis."""
    return Manifold.cylinder(1.6, 0.3, 0, CIRCLE, True)


def conepit():
    """Return a block with a conical pit: a concave apex."""
    pit = Manifold.cylinder(0.5, 0, 0.5, CIRCLE).translate((0, 0, 0.1))
    # The cone ends exactly in the block's top face, where a difference is ambiguous.
    above = Manifold.cylinder(0.2, 0.5, 0.5, CIRCLE).translate((0, 0, 0.6))
    return Manifold.cube((1.4, 1.4, 1.2), True) - (pit + above)


def roundcone(radius):
    """Return a cone with a round tip: there is no apex to recover."""
    slope = np.arctan(0.5)
    ball = Manifold.sphere(radius, SPHERE)
    # The ball touches the sides of the cone with half that slope.
    top = 0.6 - radius / np.sin(slope)
    low = top + radius * np.sin(slope)
    base = Manifold.cylinder(low + 0.6, 0.6, radius * np.cos(slope), CIRCLE)
    return Manifold.batch_hull([base.translate((0, 0, -0.6)), ball.translate((0, 0, top))])


def rounded_block(radius):
    """Return a block with round edges."""
    ball = Manifold.sphere(radius, SPHERE)
    corner = np.array([0.7, 0.5, 0.35]) - radius
    signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
    return Manifold.batch_hull([ball.translate(corner * sign) for sign in signs])


SHAPES = {
    "cube": lambda: Manifold.cube((1, 1, 1), True),
    "lbracket": lbracket,
    "bracket": bracket,
    "blockhole": blockhole,
    "countersunk": countersunk,
    "cylinder": lambda: Manifold.cylinder(1.6, 0.5, 0.5, CIRCLE, True),
    "saddle": saddle,
    "cone": lambda: Manifold.cylinder(1.2, 0.6, 0, CIRCLE, True),
    "flatcone": flatcone,
    "needle": needle,
    "conepit": conepit,
    "roundcone_big": lambda: roundcone(0.15),
    "roundcone_small": lambda: roundcone(0.04),
    "pyramid": pyramid,
    "wedge": wedge,
    "star": star,
    "icosahedron": icosahedron,
    "thinplate": lambda: Manifold.cube((1.4, 1.0, 0.12), True),
    "round_small": lambda: rounded_block(0.04),
    "round_big": lambda: rounded_block(0.2),
    "sphere": lambda: Manifold.sphere(0.6, SPHERE),
    "torus": lambda: Manifold.revolve(
        CrossSection.circle(0.25, SPHERE // 2).translate((0.6, 0)), SPHERE
    ),
}


def original(shape):
    """Return the exact mesh of a shape."""
    mesh = SHAPES[shape]().to_mesh64()
    return np.asarray(mesh.vert_properties)[:, :3].copy(), np.asarray(mesh.tri_verts, np.int64)
