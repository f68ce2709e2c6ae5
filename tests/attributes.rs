//! What a file says about a mesh, carried through rebuilds: whole files in, whole files out.

use glam::DVec3;
use sharpen::Mesh;
use sharpen::io::{self, Model, View};
use sharpen::mesh::{Face, Half, Vert};
use sharpen::refine::{Inserts, Lineage, Place, refine};
use sharpen::weld::{Weld, weld};

fn read(text: &str) -> Model {
    let model = io::parse(text.as_bytes(), "t.obj").unwrap();
    assert_eq!(model.notices, [""; 0]);
    model
}

fn v(i: usize) -> Vert {
    Vert::new(i)
}

/// The file `text` with the edges between the vertices `split` (counted from 1) split in the middle, and
/// a vertex in each of `centres` (triangles from 0); the edges `sharp` are sharp afterwards. Vertices in one
/// place are one for all this.
fn refined(text: &str, split: &[[usize; 2]], centres: &[usize], sharp: &[[usize; 2]]) -> String {
    let Model { points, mut faces, mut attributes, .. } = read(text);
    if let Some(firsts) = weld(&points, (0..points.len()).map(Vert::new), Weld::Exact) {
        attributes.join(&mut faces, &firsts);
    }
    let mesh = Mesh::new(points.clone(), faces).unwrap();
    let is_split = |h: Half| {
        let ends = [mesh.from(h).index() + 1, mesh.to(h).index() + 1];
        split.iter().any(|&[a, b]| ends == [a, b] || ends == [b, a])
    };
    let centres: Vec<Face> = centres.iter().map(|&f| Face::new(f)).collect();
    let inserts = Inserts::in_the_middle(&mesh, is_split, &centres);
    let refined = refine(&mesh, &inserts).unwrap();
    let sharp: Vec<_> = sharp.iter().map(|edge| edge.map(|i| v(i - 1))).collect();
    let (attributes, notices) = attributes.carry(&refined.lineage, &mesh, &refined.mesh, &sharp);
    assert_eq!(notices, [""; 0]);
    match attributes.part(&points, &refined.mesh) {
        Some((points, faces)) => written(&points, &faces, &attributes),
        None => written(refined.mesh.points(), refined.mesh.faces(), &attributes),
    }
}

fn written(points: &[DVec3], faces: &[[Vert; 3]], attributes: &sharpen::attributes::Attributes) -> String {
    String::from_utf8(io::format(View { points, faces, attributes })).unwrap()
}

// 4---3
// | / |    The edge 1-3 is split; vertex 5 lies on it.
// 1---2
const SQUARE: &str = "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 0 2 0\n";

#[test]
fn texture_coordinates_mix_on_each_side_of_a_seam() {
    let table = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt 0.5 0\nvt 0.5 0.5\n";
    let seam = format!("{SQUARE}{table}f 1/1 2/2 3/3\nf 1/5 3/6 4/4\n");
    assert_eq!(
        refined(&seam, &[[1, 3]], &[], &[]),
        format!(
            "{SQUARE}v 1 1 0\n{table}vt 0.5 0.5\nvt 0.5 0.25\n\
             f 3/3 5/7 2/2\nf 5/7 1/1 2/2\nf 1/5 5/8 4/4\nf 5/8 3/6 4/4\n"
        )
    );
    let no_seam = format!("{SQUARE}{table}f 1/1 2/2 3/3\nf 1/1 3/3 4\n");
    assert_eq!(
        refined(&no_seam, &[[1, 3]], &[], &[]),
        format!(
            "{SQUARE}v 1 1 0\n{table}vt 0.5 0.5\n\
             f 3/3 5/7 2/2\nf 5/7 1/1 2/2\nf 1/1 5/7 4\nf 5/7 3/3 4\n"
        ),
        "one entry for both sides; a corner without stays without"
    );
}

#[test]
fn a_face_with_a_centre_mixes_all_three_corners() {
    let text = "v 0 0 0\nv 3 0 0 1 0 0.5\nv 0 3 0 0 1 0.5\nv 9 9 9\nvt 0 0\nvt 3 0\nvt 0 3\nf 1/1 2/2 3/3\n";
    assert_eq!(
        refined(text, &[[1, 2], [2, 3], [3, 1]], &[0], &[]),
        "v 0 0 0\nv 3 0 0 1 0 0.5\nv 0 3 0 0 1 0.5\nv 9 9 9\n\
         v 1.5 0 0\nv 1.5 1.5 0 0.5 0.5 0.5\nv 0 1.5 0\nv 1 1 0\n\
         vt 0 0\nvt 3 0\nvt 0 3\nvt 1.5 0\nvt 1 1\nvt 1.5 1.5\nvt 0 1.5\n\
         f 1/1 5/4 8/5\nf 5/4 2/2 8/5\nf 2/2 6/6 8/5\nf 6/6 3/3 8/5\nf 3/3 7/7 8/5\nf 7/7 1/1 8/5\n"
    );
}

#[test]
fn groups_and_materials_stay_with_the_children() {
    let text = format!(
        "# head\nmtllib a.mtl\n{SQUARE}v 4 0 0\ng a\nusemtl red\nf 1 2 3\ng b\nusemtl blue\ns 1\nf 1 3 4\nl 1 2 3\ng c\nf 2 5 3\ng end\n"
    );
    assert_eq!(
        refined(&text, &[[1, 3]], &[], &[]),
        format!(
            "# head\nmtllib a.mtl\n{SQUARE}v 4 0 0\nv 1 1 0\ng a\nusemtl red\nf 3 6 2\nf 6 1 2\n\
             g b\nusemtl blue\ns 1\nf 1 6 4\nf 6 3 4\nl 1 2 3\ng c\nf 2 5 3\ng end\n"
        )
    );
}

#[test]
fn polygons_that_were_not_touched_stay_polygons() {
    let text = format!("{SQUARE}v 4 0 0\nv 4 2 0\nv 0 9 0\nf 1 2 3 4\nf 2 5 6 3\nf 4 3 7\n");
    assert_eq!(refined(&text, &[], &[], &[]), text);
    assert_eq!(
        refined(&text, &[[5, 6]], &[], &[]),
        format!(
            "{SQUARE}v 4 0 0\nv 4 2 0\nv 0 9 0\nv 4 1 0\nf 1 2 3 4\nf 5 8 2\nf 8 6 2\nf 2 6 3\nf 4 3 7\n"
        )
    );
}

// A roof: two squares that meet in the ridge 4-3. Vertex 7 splits the right eaves 6-5, so 4, 5, 6 and 7
// are touched; 1 has no normal and gets none, 2 and 3 keep theirs.
const ROOF: &str = "v 0 0 0\nv 0 4 0\nv 1 4 1\nv 1 0 1\nv 2 4 0\nv 2 0 0\n";

/// `text` with zeros for numbers that are nothing but rounding errors.
fn without_dust(text: &str) -> String {
    let is_dust = |word: &str| word.parse::<f64>().is_ok_and(|number| number != 0.0 && number.abs() < 1e-15);
    let line = |line: &str| {
        line.split(' ').map(|word| if is_dust(word) { "0" } else { word }).collect::<Vec<_>>().join(" ")
    };
    text.lines().map(|text| line(text) + "\n").collect()
}

#[test]
fn normals_at_touched_vertices_are_made_anew_and_others_kept() {
    let text = format!(
        "{ROOF}vn 0 1 0\nvn -1 0 0\nf 4//1 3//1 2//2\nf 4//1 2//2 1\nf 4//1 6//1 5//1\nf 4//1 5//1 3//1\n"
    );
    let right = "vn 0.7071067811865476 0 0.7071067811865476\n";
    // Where a sector has one face only, its normal comes without a mean; equal ones of a face are one.
    let alone = "vn 0.7071067811865475 0 0.7071067811865475\n";
    let left = "vn -0.7071067811865476 0 0.7071067811865476\n";
    assert_eq!(
        without_dust(&refined(&text, &[[6, 5]], &[], &[])),
        format!(
            "{ROOF}v 2 2 0\nvn 0 1 0\nvn -1 0 0\nvn 0 0 1\n{right}{alone}{right}\
             f 4//3 3//1 2//2\nf 4//3 2//2 1\nf 6//5 7//6 4//3\nf 7//6 5//4 4//3\nf 4//3 5//4 3//1\n"
        ),
        "one normal over the smooth ridge"
    );
    let sharp = format!(
        "{ROOF}v 2 2 0\nvn 0 1 0\nvn -1 0 0\n{left}{right}{alone}\
         f 4//3 3//1 2//2\nf 4//3 2//2 1\nf 6//5 7//4 4//4\nf 7//4 5//4 4//4\nf 4//4 5//4 3//1\n"
    );
    assert_eq!(refined(&text, &[[6, 5]], &[], &[[3, 4]]), sharp, "one on each side of the sharp ridge");
    // The file has two normals along the ridge: no need to say that it is sharp.
    let split = text
        .replace("vn -1 0 0\n", "vn -1 0 0\nvn 1 0 0\n")
        .replace("f 4//1 6//1 5//1\nf 4//1 5//1 3//1", "f 4//3 6//1 5//1\nf 4//3 5//1 3//3");
    let expected = format!(
        "{ROOF}v 2 2 0\nvn 0 1 0\nvn -1 0 0\nvn 1 0 0\n{left}{right}{alone}\
         f 4//4 3//1 2//2\nf 4//4 2//2 1\nf 6//6 7//5 4//5\nf 7//5 5//5 4//5\nf 4//5 5//5 3//3\n"
    );
    assert_eq!(refined(&split, &[[6, 5]], &[], &[]), expected);
}

#[test]
fn normals_that_still_hold_stay_as_the_file_has_them() {
    // Four decimals, and one normal twice, as exporters write them.
    let table = "vn 0.7071 0 0.7071\nvn 0.7071 0 0.7071\n";
    let text = format!("{ROOF}{table}f 4//1 6//2 5//1\nf 4//2 5//2 3//1\n");
    assert_eq!(
        refined(&text, &[[6, 5], [4, 5]], &[], &[]),
        format!(
            "{ROOF}v 2 2 0\nv 1.5 2 0.5\n{table}f 5//1 8//1 7//1\nf 8//1 4//1 6//2\nf 8//1 6//2 7//1\n\
             f 4//1 8//1 3//1\nf 8//1 5//1 3//1\n"
        )
    );
}

/// One rebuild by hand: of three triangles round vertex 1 the middle one is gone, and vertex 2 has gone
/// to where vertex 5 is.
#[test]
fn what_a_collapse_moves_is_mixed_from_its_parent_and_what_it_removes_moves_on() {
    let text = "v 0 0 0 1 0 0\nv 2 0 0 0 1 0\nv 0 2 0 0 0 1\nv -2 0 0 1 1 1\nv 0 -2 0 0 0 0\n\
        vt 0 0\nvt 1 0\nvt 0 1\nvt 0.5 0.5\n\
        g a\nf 1/1 2/2 3/3\ng b\nf 1/1 3/3 4/4\ng c\nf 1/1 4/4 5/2\nl 1 2 3\np 5\n";
    let model = read(text);
    let mesh = Mesh::new(model.points.clone(), model.faces).unwrap();
    let new = Mesh::new(model.points, vec![[v(0), v(3), v(2)], [v(0), v(3), v(4)]]).unwrap();
    let corner = Place::Corner;
    let lineage = Lineage {
        parents: vec![Face::new(0), Face::new(2)].into(),
        corners: vec![corner(0), Place::Foreign, corner(2), corner(0), corner(1), corner(2)].into(),
        foreign: vec![(Half::new(1), [0.25, 0.25, 0.5])],
    };
    let (attributes, notices) = model.attributes.carry(&lineage, &mesh, &new, &[]);
    assert_eq!(notices, [""; 0]);
    assert_eq!(
        written(new.points(), new.faces(), &attributes),
        "v 0 0 0 1 0 0\nv 2 0 0 0 1 0\nv 0 2 0 0 0 1\nv -2 0 0 1 1 1\nv 0 -2 0 0 0 0\n\
         vt 0 0\nvt 1 0\nvt 0 1\nvt 0.5 0.5\nvt 0.25 0.5\n\
         g a\nf 1/1 4/5 3/3\ng b\ng c\nf 1/1 4/4 5/2\nl 1 2 3\np 5\n"
    );
}

/// A mesh with one vertex less: lines and points that name it are left out, and that is said.
#[test]
fn lines_to_vertices_that_are_gone_are_named() {
    let model = read("v 0 0 0\nv 2 0 0\nv 0 2 0\nv 0 0 0\nl 1 4\np 4\nl 1 2\nf 1 2 3\n");
    let mesh = Mesh::new(model.points.clone(), model.faces).unwrap();
    let new = Mesh::new(model.points[..3].to_vec(), mesh.faces().to_vec()).unwrap();
    let lineage = Lineage {
        parents: vec![Face::new(0)].into(),
        corners: [0, 1, 2].map(Place::Corner).to_vec().into(),
        foreign: Vec::new(),
    };
    let (attributes, notices) = model.attributes.carry(&lineage, &mesh, &new, &[]);
    assert_eq!(notices, ["left out: 2 lines or points whose vertices are gone"]);
    assert_eq!(
        written(new.points(), new.faces(), &attributes),
        "v 0 0 0\nv 2 0 0\nv 0 2 0\nl 1 2\nf 1 2 3\n"
    );
}

#[test]
fn a_new_vertex_without_a_face_has_no_colour() {
    // Found by random changes to files: faces that name a vertex twice can leave one behind.
    let model = read("v 0 0 0 1 0 0\nv 2 0 0 0 1 0\nv 0 2 0 0 0 1\nf 1 2 3\n");
    let mut points = model.points.clone();
    let mesh = Mesh::new(model.points, model.faces).unwrap();
    points.push(DVec3::ONE);
    let new = Mesh::new(points, mesh.faces().to_vec()).unwrap();
    let lineage = Lineage {
        parents: vec![Face::new(0)].into(),
        corners: [0, 1, 2].map(Place::Corner).to_vec().into(),
        foreign: Vec::new(),
    };
    let (attributes, _) = model.attributes.carry(&lineage, &mesh, &new, &[]);
    assert_eq!(
        written(new.points(), new.faces(), &attributes),
        "v 0 0 0 1 0 0\nv 2 0 0 0 1 0\nv 0 2 0 0 0 1\nv 1 1 1\nf 1 2 3\n"
    );
}

// 4---3 6    The square with vertices of its own on each side of its diagonal.
// | / / |
// 1 5---2
const SEAM: &str =
    "v 0 0 0 1 0 0\nv 2 0 0 1 0 0\nv 2 2 0 1 0 0\nv 0 2 0 0 1 0\nv -0 0 0 0 0 1\nv 2 2 0 0 1 1\n";

#[test]
fn a_new_vertex_on_a_seam_of_vertices_is_one_on_each_side() {
    // The mesh has the edge 1-3; the file has 1-3 above it and 5-6 below.
    assert_eq!(
        refined(&format!("{SEAM}f 1 3 4\nf 5 2 6\n"), &[[1, 3], [3, 4], [2, 3]], &[], &[]),
        format!(
            "{SEAM}v 1 1 0 1 0 0\nv 1 2 0 0.5 0.5 0\nv 2 1 0 0.5 0.5 0.5\nv 1 1 0 0 0.5 1\n\
             f 3 8 7\nf 8 4 7\nf 4 1 7\nf 6 10 9\nf 10 5 2\nf 10 2 9\n"
        )
    );
}

#[test]
fn a_new_vertex_between_shared_vertices_is_shared() {
    // As before, but only one end of the diagonal is split in the file; and nowhere but there.
    let half = SEAM.replace("v 2 2 0 0 1 1\n", "v 9 9 9\n");
    assert_eq!(
        refined(&format!("{half}f 1 3 4\nf 5 2 3\n"), &[[1, 3], [2, 3]], &[], &[]),
        format!(
            "{half}v 1 1 0 1 0 0\nv 2 1 0 1 0 0\nv 1 1 0 0.5 0 0.5\n\
             f 1 7 4\nf 7 3 4\nf 3 9 8\nf 9 5 2\nf 9 2 8\n"
        )
    );
    assert_eq!(
        refined(&format!("{half}f 1 3 4\nf 1 2 3\nf 5 4 2\n"), &[[1, 3]], &[], &[]),
        format!("{half}v 1 1 0 1 0 0\nf 1 7 4\nf 7 3 4\nf 3 7 2\nf 7 1 2\nf 5 4 2\n")
    );
}

#[test]
fn a_file_with_split_vertices_comes_back_when_nothing_is_inserted() {
    let text = format!("{SEAM}vt 0 0\nvt 1 1\ng a\nf 1/1 3/2 4/1\nl 5 6\nf 5 2 6/2\n");
    assert_eq!(refined(&text, &[], &[], &[]), text);
}
