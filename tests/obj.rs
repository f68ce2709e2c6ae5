//! OBJ files, whole: odd ones, random ones, and `tobj` as an independent oracle.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use proptest::prelude::*;
use sharpen::io::{self, Model};
use sharpen::mesh::Vert;

const POINTS: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.5 0.5 1\n";
const FACES: &str = "f 1 2 3\nf 1 3 4\nf 1 5 2\nf 2 5 3\nf 3 5 4\nf 4 5 1\n";

fn parse(bytes: impl AsRef<[u8]>) -> Result<Model, String> {
    io::parse(bytes.as_ref(), "t.obj").map_err(|error| error.to_string())
}

fn pyramid() -> Model {
    parse(format!("{POINTS}{FACES}")).expect("the pyramid is sound")
}

/// The points of each triangle, as bits.
fn triangles(model: &Model) -> Vec<[[u64; 3]; 3]> {
    let bits = |v: Vert| model.points[v.index()].to_array().map(f64::to_bits);
    model.faces.iter().map(|face| face.map(bits)).collect()
}

fn same_mesh(a: &Model, b: &Model) -> bool {
    let bits = |m: &Model| m.points.iter().map(|p| p.to_array().map(f64::to_bits)).collect::<Vec<_>>();
    bits(a) == bits(b) && a.faces == b.faces
}

/// The triangles that tobj reads, in order, as bits; none if it refuses. It takes a face that names a
/// vertex twice for a point or a line and cuts polygons its own way: neither can be compared.
fn oracle(bytes: &[u8]) -> Option<Vec<[[u64; 3]; 3]>> {
    let options = tobj::LoadOptions {
        triangulate: true,
        ignore_points: true,
        ignore_lines: true,
        ..Default::default()
    };
    let mut reader = bytes;
    let (models, _) =
        tobj::load_obj_buf(&mut reader, &options, |_| Ok((Vec::new(), Default::default()))).ok()?;
    let mut triangles = Vec::new();
    for tobj::Model { mesh, .. } in models {
        let bits = |i: u32| [0, 1, 2].map(|k| mesh.positions[3 * i as usize + k].to_bits());
        triangles.extend(mesh.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]].map(bits)));
    }
    Some(triangles)
}

#[test]
fn harmless_oddities_change_nothing() {
    let plain = format!("{POINTS}{FACES}");
    let cases: Vec<(&str, Vec<u8>)> = vec![
        ("CRLF", plain.replace('\n', "\r\n").into()),
        ("CR", plain.replace('\n', "\r").into()),
        ("no final newline", plain.trim_end().into()),
        ("final blanks", (plain.clone() + " \t ").into()),
        ("blank lines", plain.replace('\n', "\n \n\n").into()),
        ("leading blanks", plain.replace("v ", "  v ").replace("f ", "\tf ").into()),
        ("tabs", plain.replace(' ', "\t").into()),
        ("many blanks", plain.replace(' ', "   ").into()),
        ("trailing blanks", plain.replace('\n', " \t\n").into()),
        ("byte order mark", [b"\xef\xbb\xbf", plain.as_bytes()].concat()),
        ("Latin-1 comment", [b"# caf\xe9\n", plain.as_bytes()].concat()),
        ("NUL in a comment", [b"# a\0b\n", plain.as_bytes()].concat()),
        ("comment behind data", plain.replace('\n', " # why not\n").into()),
        ("comment touching data", plain.replace('\n', "#1\n").into()),
        ("comment ending in a backslash", ("# C:\\models\\\n".to_owned() + &plain).into()),
        ("empty comment", ("#\n".to_owned() + &plain).into()),
        ("continuation", plain.replace("f 1 2 3", "f 1 \\\n2 \\\r\n3").into()),
        ("continuation in a vertex", plain.replace("v 1 1 0", "v 1\\\n1 \\\n0").into()),
        ("backslash at the end", (plain.trim_end().to_owned() + " \\").into()),
        ("capital exponent", plain.replace("0.5 0.5 1", "5.0E-1 +5e-01 1.E0").into()),
        ("exponent of three digits", plain.replace("0.5 0.5 1", ".5 50.0e-002 1.0e+000").into()),
        ("many digits", plain.replace("0.5 0.5 1", "0.50000000000000000000000000000 5e-1 1").into()),
        ("plus signs", plain.replace("f 1 2 3", "f +1 +2 +3").replace("v 1 ", "v +1 ").into()),
        ("leading zeros", plain.replace("f 1 2 3", "f 0001 02 3").into()),
        ("weight", (POINTS.replace('\n', " 1.0\n") + FACES).into()),
        ("slashes", plain.replace("f 1 2 3", "f 1/ 2// 3").into()),
        (
            "texture and normal indices",
            ("vt 0 0\nvn 0 0 1\n".to_owned() + &plain.replace("f 1 2 3", "f 1/1/1 2//1 3/-1/-1")).into(),
        ),
        ("texture index too large", plain.replace("f 1 2 3", "f 1/7 2/8 3/9").into()),
        ("normal that is none", ("vn 1.#IND nan -nan(ind)\nvt x\n".to_owned() + &plain).into()),
        (
            "negative indices",
            (POINTS.to_owned() + &FACES.replace('1', "-5").replace('2', "-4").replace('3', "-3")).into(),
        ),
        ("faces first", (FACES.to_owned() + POINTS).into()),
        ("faces between", format!("{}{FACES}{}", &POINTS[..24], &POINTS[24..]).into()),
        (
            "groups",
            format!(
                "mtllib no.mtl\no a\n{POINTS}g b c\nusemtl\ns off\n{}usemtl x#1\ns 1\n{}",
                &FACES[..16],
                &FACES[16..]
            )
            .into(),
        ),
        ("lines and points", format!("{POINTS}l 1 2 3\np 1 2\n{FACES}l 1/1 2/1\n").into()),
        ("unknown statements", format!("cstype bezier\nvp 1 2\n{POINTS}call x.obj 1\n{FACES}end\n").into()),
        ("control byte at the end", (plain.clone() + "\x1a").into()),
    ];
    for (name, bytes) in cases {
        let model = parse(&bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert!(same_mesh(&model, &pyramid()), "{name}: {model:?}");
    }
}

#[test]
fn every_face_is_kept_whatever_it_is() {
    let cases = [
        ("repeated corner", "f 1 1 2"),
        ("doubled", "f 3 2 1"),
        ("on a third side", "f 1 2 6"),
        ("flat", "f 1 7 2"),
    ];
    for (name, face) in cases {
        let model = parse(format!("{POINTS}v 5 5 5\nv 2 0 0\n{FACES}{face}\n")).expect(name);
        assert_eq!((model.points.len(), model.faces.len()), (7, 7), "{name}");
    }
    let polygons = [("f 1 2 3 4", 2), ("f 1 1 1 1", 2), ("f 1 2 3 4 5", 3), ("f 1 2 1 2 1 2", 4)];
    for (face, n) in polygons {
        assert_eq!(parse(format!("{POINTS}{face}\n")).expect(face).faces.len(), n, "{face}");
    }
}

#[test]
fn faults_are_one_line_with_file_line_and_word() {
    let with = |face: &str| format!("{POINTS}{FACES}{face}\n");
    let cases = [
        (format!("{POINTS}v nan 0 0\n{FACES}"), 6, "\"nan\""),
        (format!("{POINTS}v 0 inf 0\n{FACES}"), 6, "\"inf\""),
        (format!("{POINTS}v 0 0 -1e400\n{FACES}"), 6, "\"-1e400\""),
        (format!("{POINTS}v 0 0 0x10\n{FACES}"), 6, "\"0x10\""),
        (format!("{POINTS}v 0,5 0,5 1\n{FACES}"), 6, "\"0,5\""),
        (format!("{POINTS}v 1 2\n{FACES}"), 6, "\"1 2\""),
        (format!("{POINTS}v 0 0 -\n{FACES}"), 6, "\"-\""),
        (format!("{POINTS}v 0 0 \0\n{FACES}"), 6, "\"\\0\""),
        (with("f 0 1 2"), 12, "\"0\""),
        (with("f 1 2 99"), 12, "\"99\""),
        (with("f 1 2 -6"), 12, "\"-6\""),
        (with("f 1 2 99999999999999999999"), 12, "\"99999999999999999999\""),
        (with("f 1 2 -99999999999999999999"), 12, "\"-99999999999999999999\""),
        (with("f 1.0 2.0 3.0"), 12, "\"1.0\""),
        (with("f 1 two 3"), 12, "\"two\""),
        (with("f 1/1/1/1 2 3"), 12, "\"1/1/1/1\""),
        (with("f /1 2 3"), 12, "\"/1\""),
        (with("f 1"), 12, "\"1\""),
        (with("f 1 2"), 12, "\"1 2\""),
        (with("f"), 12, "none"),
        (String::new(), 1, "no faces"),
        ("# hi\n# there\n".to_owned(), 2, "no faces"),
        (POINTS.to_owned(), 5, "no faces"),
        ("solid x\nfacet normal 0 0 1\n".to_owned(), 1, "STL"),
        ("ply\nformat ascii 1.0\n".to_owned(), 1, "PLY"),
    ];
    for (text, line, word) in cases {
        let fault = parse(&text).expect_err(&text);
        assert!(fault.starts_with(&format!("t.obj:{line}: ")) && fault.contains(word), "{text:?}: {fault}");
        assert_eq!(fault.lines().count(), 1, "{fault}");
    }
}

#[test]
fn a_polygon_of_ten_thousand_corners_is_quick() {
    let mut text = String::new();
    for i in 0..10_000u32 {
        writeln!(text, "v {i} {} 0", i.wrapping_mul(2_654_435_761) >> 20).unwrap();
    }
    text += "f";
    (1..=10_000).for_each(|i| write!(text, " {i}").unwrap());
    let start = std::time::Instant::now();
    let model = parse(&text).unwrap();
    assert_eq!((model.points.len(), model.faces.len()), (10_000, 9_998));
    assert!(start.elapsed().as_secs() < 10, "{:?}", start.elapsed());
}

/// A folder of the reference data, if this machine has it.
fn shared(folder: &str) -> Option<Vec<PathBuf>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(folder);
    let Ok(entries) = std::fs::read_dir(&path) else {
        eprintln!("not tested: there is no {}", path.display());
        return None;
    };
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    files.retain(|file| file.extension().is_some_and(|e| e == "obj"));
    files.sort();
    Some(files)
}

fn assert_round_trip(model: &Model) {
    let again = parse(io::format(model)).unwrap();
    assert!(same_mesh(&again, model), "a round trip changed the mesh");
}

#[test]
fn the_reference_inputs_agree_with_tobj_and_come_back() {
    /// Bytes: larger files say no more and take the oracle seconds without optimisation.
    const LARGEST: usize = 400_000;
    for folder in ["inputs", "originals"] {
        for path in shared(folder).unwrap_or_default() {
            let bytes = std::fs::read(&path).unwrap();
            if bytes.len() > LARGEST {
                continue;
            }
            let model = parse(&bytes).unwrap();
            assert_eq!(Some(triangles(&model)), oracle(&bytes), "{}", path.display());
            assert_round_trip(&model);
        }
    }
}

/// Any finite number, in any of several notations.
fn number() -> impl Strategy<Value = String> {
    let finite = || any::<f64>().prop_filter("finite", |x| x.is_finite());
    prop_oneof![
        finite().prop_map(|x| format!("{x:e}")),
        finite().prop_map(|x| format!("{x:E}")),
        (-1e6..1e6f64).prop_map(|x| format!("{x:.6}")),
        (-1e6..1e6f64).prop_map(|x| format!("{x}")),
        any::<i32>().prop_map(|x| x.to_string()),
    ]
}

/// The text of an OBJ file of triangles, with the statements and blanks that files have.
fn text() -> impl Strategy<Value = String> {
    (3..20usize).prop_flat_map(|n| {
        let vertices = proptest::collection::vec([number(), number(), number()], n);
        let blank = prop_oneof![Just(" "), Just("\t"), Just("  ")];
        let between = prop::sample::select(vec!["", "", "", "", "g a\n", "usemtl b\n", "# x\n", "\n"]);
        let corners = prop::sample::subsequence((0..n as i64).collect::<Vec<_>>(), 3).prop_shuffle();
        let face = (corners, any::<[bool; 3]>(), between);
        (vertices, proptest::collection::vec(face, 1..40), blank, any::<bool>()).prop_map(
            |(vertices, faces, blank, crlf)| {
                let n = vertices.len() as i64;
                let mut text = String::new();
                for vertex in vertices {
                    writeln!(text, "v{blank}{}", vertex.join(blank)).unwrap();
                }
                for (corners, is_negative, between) in faces {
                    text += between;
                    text += "f";
                    for (v, negative) in corners.into_iter().zip(is_negative) {
                        write!(text, "{blank}{}", if negative { v - n } else { v + 1 }).unwrap();
                    }
                    text += "\n";
                }
                if crlf { text.replace('\n', "\r\n") } else { text }
            },
        )
    })
}

proptest! {
    #[test]
    fn random_files_agree_with_tobj(text in text()) {
        let model = parse(&text).unwrap();
        prop_assert_eq!(Some(triangles(&model)), oracle(text.as_bytes()));
        assert_round_trip(&model);
    }

    #[test]
    fn meshes_come_back_bit_for_bit(
        points in proptest::collection::vec(any::<[f64; 3]>().prop_filter("finite", |p| p.iter().all(|x| x.is_finite())), 1..30),
        faces in proptest::collection::vec(any::<[prop::sample::Index; 3]>(), 1..30),
    ) {
        let n = points.len();
        let model = Model {
            points: points.into_iter().map(Into::into).collect(),
            faces: faces.iter().map(|f| f.map(|i| Vert::new(i.index(n)))).collect(),
            ..Model::default()
        };
        assert_round_trip(&model);
    }

    #[test]
    fn no_bytes_make_the_reader_panic(bytes in proptest::collection::vec(
        prop_oneof![4 => prop::sample::select(b"vf 0123456789.-+e/\\#\n\r".to_vec()), 1 => any::<u8>()], 0..200
    )) {
        if let Err(fault) = parse(&bytes) {
            prop_assert_eq!(fault.lines().count(), 1);
        }
    }
}
