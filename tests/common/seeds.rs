//! Files for fuzzing to begin with.

use sharpen::attributes::Attributes;
use sharpen::io::{self, View};

use crate::shapes::{chamfered_cube, sphere, zoo};
use crate::targets::FORMATS;

/// An OBJ file with a bit of all that the format has.
const RICH: &str = "# by hand\nmtllib a.mtl\no one\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0.5 0 0 1\nv 0 1 0 1 1 1\n\
    v .5 5e-1 +1 0.5 0.5 0.5\nvt 0 0\nvt 1 0\nvt 1 1 0\nvn 0 0 1\nvn 0 1 0\ng a b\nusemtl red\ns 1\n\
    f 1/1/1 2/2/1 3/3/2\nf 1//1 3//2 4//1\ng c\nusemtl blue\ns off\nf 1/1 5/2 2/3\nf -4 -1 -3\nf 3 5 4\n\
    f 1 2 3 \\\n4\nl 1 2 3\np 4 5\n";

/// The seeds of each target: its name and the files' contents.
pub fn seeds() -> Vec<(&'static str, Vec<u8>)> {
    let mut meshes: Vec<_> = zoo().into_iter().map(|(_, mesh)| mesh).filter(|m| m.n_faces() > 0).collect();
    meshes.extend([chamfered_cube(3, 0.8), chamfered_cube(4, 0.9), sphere(1)]);
    let attributes = Attributes::default();
    let mut seeds: Vec<(&str, Vec<u8>)> = vec![("obj", RICH.into()), ("tobj", RICH.into())];
    seeds.push(("file", [&[0; 4], RICH.as_bytes()].concat()));
    for mesh in &meshes {
        let view = View { points: mesh.points(), faces: mesh.faces(), attributes: &attributes };
        for (i, format) in (0..).zip(FORMATS) {
            let bytes = io::format_as(view, format);
            let target = ["obj", "off", "ply", "ply", "ply", "ply", "stl", "stl", "stl"][usize::from(i)];
            seeds.push(("file", [&[4, 0, i, i], bytes.as_slice()].concat()));
            if target == "obj" {
                seeds.push(("tobj", bytes.clone()));
            }
            seeds.push((target, bytes));
        }
    }
    // For `mesh`: options, format, shape and size, damage.
    for shape in [1, 2, 7] {
        for size in 0..4 {
            for options in [0, 1, 2, 4, 8, 16, 64, 128] {
                let damage = [7, 0, size, 9, 1, 2, 12, 0, 5, 14, 0, 8, 15, 0, 3, 10, 0, 1, 0, 2];
                seeds.push(("mesh", [&[options, 99, size, shape, size + 240], damage.as_slice()].concat()));
                seeds.push(("mesh", vec![options, 99, size, shape, size + 240]));
            }
        }
    }
    seeds
}
