"""The textured cube: what the script writes, what it notices, and what the binary makes of it."""

import subprocess
from dataclasses import replace

import numpy as np
import pytest

import textured

BINARY = textured.ROOT / "target/debug/sharpen"


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """Return the path of a small cube."""
    path = tmp_path_factory.mktemp("textured") / "cube.obj"
    textured.write(path, *textured.sample(20))
    return path


def test_the_cube_is_as_its_closed_forms_say(source):
    cube = textured.read(source)
    figures = textured.check(cube, cube)
    assert figures["texture_off_edges"] < 1e-6
    assert figures["colour_off_edges"] < 1e-6
    assert figures["area_on_another_side"] == 0
    assert (source.parent / "cube.mtl").read_text().count("newmtl") == 6
    assert (source.parent / "checker.png").stat().st_size > 0


def test_charts_do_not_overlap():
    sides = np.repeat(np.arange(6), 4)
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * textured.HALF
    points = np.concatenate([corners[textured_on(corners, side)] for side in range(6)])
    cells = np.floor(textured.chart(points, sides) * [3, 2])
    assert (2 * cells[:, 0] + cells[:, 1] == sides).all()


def textured_on(corners, side):
    """Return which corners lie on a side."""
    return corners[:, side // 2] == (2 * (side % 2) - 1) * textured.HALF


@pytest.mark.parametrize(
    ("field", "change", "reason"),
    [
        ("materials", lambda x: np.where(x == "top_paint", "left_paint", x), "a material is lost"),
        ("groups", lambda x: np.roll(x, 1), "group and material disagree"),
        ("charts", lambda x: x[::-1].copy(), "a texture coordinate is"),
        ("colours", lambda x: 1 - x, "a colour is"),
        ("mtllib", lambda x: "", "the material library is another"),
    ],
)
def test_what_is_lost_is_noticed(source, field, change, reason):
    cube = textured.read(source)
    with pytest.raises(ValueError, match=reason):
        textured.check(cube, replace(cube, **{field: change(getattr(cube, field))}))


@pytest.mark.skipif(not BINARY.exists(), reason="cargo build has not run")
@pytest.mark.parametrize("options", textured.VARIANTS.values(), ids=textured.VARIANTS.keys())
def test_the_binary_keeps_all_of_it(source, options):
    target = source.with_name("out.obj")
    subprocess.run([BINARY, "-q", *options, source, target], check=True)
    cube, sharp = textured.read(source), textured.read(target)
    assert textured.check(cube, sharp)["faces"] > len(cube.faces)
