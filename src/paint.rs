//! Paints a mesh with the colours of its classification, as the papers' figures show it.
//!
//! In/out: the *input* mesh + `Labels` -> the bytes of a PLY file with coloured faces and, in its edge
//! element, coloured edges. MeshLab and PyVista show both.
//! Cost: O(F).

use crate::classify::Labels;
use crate::mesh::{Half, Mesh};

type Rgb = [u8; 3];

/// Smooth region.
const RED: Rgb = [222, 92, 84];
/// Corner triangle.
const GREEN: Rgb = [64, 176, 80];
/// Chamfer edge.
const BLUE: Rgb = [36, 72, 224];
/// Smooth edge outside of every region.
const BROWN: Rgb = [150, 98, 52];
/// Border of a smooth region.
const DARK_RED: Rgb = [168, 20, 20];
/// An edge that looks like a chamfer and was left alone.
const ORANGE: Rgb = [240, 150, 20];
/// An edge that nothing can be said of.
const VIOLET: Rgb = [150, 60, 190];
/// Whatever has no colour.
const GRAY: Rgb = [190, 190, 190];

/// `mesh` painted with `labels`, as a binary little-endian PLY file.
#[must_use]
pub fn paint(mesh: &Mesh, labels: &Labels) -> Vec<u8> {
    let edges: Vec<Half> = mesh.edges().collect();
    let mut bytes = header(mesh.n_verts(), mesh.n_faces(), edges.len()).into_bytes();
    for p in mesh.points() {
        p.to_array().iter().for_each(|x| bytes.extend(x.to_le_bytes()));
    }
    let mut corners = labels.corner_faces.iter().copied().peekable();
    for f in mesh.face_ids() {
        let is_corner = corners.next_if_eq(&f).is_some();
        let colour = match (is_corner, labels.red_face[f]) {
            (true, _) => GREEN,
            (false, true) => RED,
            (false, false) => GRAY,
        };
        bytes.push(3);
        mesh.corners(f).iter().for_each(|v| bytes.extend((v.index() as u32).to_le_bytes()));
        bytes.extend(colour);
    }
    for h in edges {
        for v in mesh.ends(h) {
            bytes.extend((v.index() as u32).to_le_bytes());
        }
        bytes.extend(edge_colour(labels, h));
    }
    bytes
}

/// Blue before everything else, as it is what matters; a red edge that is smooth as well lies inside its
/// region and shows brown there, as in the papers' second picture.
fn edge_colour(labels: &Labels, h: Half) -> Rgb {
    if labels.chamfer_edge[h] {
        BLUE
    } else if labels.abstained.binary_search(&h).is_ok() {
        ORANGE
    } else if labels.beyond_reach.binary_search(&h).is_ok() {
        VIOLET
    } else if labels.smooth_edge[h] {
        BROWN
    } else if labels.red_edge[h] {
        DARK_RED
    } else {
        GRAY
    }
}

fn header(n_verts: usize, n_faces: usize, n_edges: usize) -> String {
    format!(
        "ply\nformat binary_little_endian 1.0\n\
         comment sharpen: red smooth regions, green corner triangles; blue chamfer edges, \
         orange edges left alone, violet edges beyond reach, brown smooth edges\n\
         element vertex {n_verts}\nproperty double x\nproperty double y\nproperty double z\n\
         element face {n_faces}\nproperty list uchar uint vertex_indices\n{RGB}\
         element edge {n_edges}\nproperty uint vertex1\nproperty uint vertex2\n{RGB}\
         end_header\n"
    )
}

const RGB: &str = "property uchar red\nproperty uchar green\nproperty uchar blue\n";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Face;
    use crate::mesh::tests::mesh;

    // 3---2    Face 0 is red, face 1 a corner; edge 2-0 between them is blue, edge 0-1 brown.
    // | / |
    // 0---1
    #[test]
    fn faces_and_edges_carry_their_colours() {
        let m = mesh(&[[0.; 3], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]], &[[0, 1, 2], [0, 2, 3]]);
        let only =
            |halves: &[usize]| m.halves().map(|h| halves.contains(&h.index())).collect::<Vec<_>>().into();
        let labels = Labels {
            red_face: vec![true, false].into(),
            corner_faces: vec![Face::new(1)],
            chamfer_edge: only(&[2, 3]),
            smooth_edge: only(&[0]),
            red_edge: only(&[0, 1]),
            abstained: vec![Half::new(4)],
            beyond_reach: vec![Half::new(5)],
            ..Labels::default()
        };
        let bytes = paint(&m, &labels);
        let start = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        let text = String::from_utf8_lossy(&bytes[..start]).into_owned();
        assert!(text.contains("element vertex 4\n") && text.contains("element edge 5\n"), "{text}");
        let faces = &bytes[start + 4 * 24..];
        assert_eq!(faces[..16], [&[3u8, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0][..], &RED].concat());
        assert_eq!(faces[29..32], GREEN);
        let edges: Vec<&[u8]> = faces[32..].chunks(11).collect();
        let colours: Vec<&[u8]> = edges.iter().map(|edge| &edge[8..]).collect();
        assert_eq!(colours, [&BROWN, &DARK_RED, &BLUE, &ORANGE, &VIOLET]);
        assert_eq!(edges[2][..8], [2, 0, 0, 0, 0, 0, 0, 0]);
    }
}
