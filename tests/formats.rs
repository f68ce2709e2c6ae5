//! PLY, STL and OFF: odd files, whole outputs, round trips, and `ply-rs-bw` and `stl_io` as oracles.

use std::io::Cursor;

use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{DefaultElement, Property};
use proptest::prelude::*;
use sharpen::attributes::{Column, Encoding, Kind};
use sharpen::io::{self, Format, Model};
use sharpen::mesh::Vert;

const PLY: Format = Format::Ply(None);
const STL: Format = Format::Stl(None);

fn parse(bytes: impl AsRef<[u8]>, format: Format) -> Result<Model, String> {
    io::parse_as(bytes.as_ref(), "t", format).map_err(|error| error.to_string())
}

fn text(model: &Model, format: Format) -> String {
    String::from_utf8(io::format_as(model, format)).expect("a text")
}

fn bits(model: &Model) -> Vec<[u64; 3]> {
    model.points.iter().map(|p| p.to_array().map(f64::to_bits)).collect()
}

fn faces(model: &Model) -> Vec<[usize; 3]> {
    model.faces.iter().map(|face| face.map(Vert::index)).collect()
}

fn le(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
}

const SQUARE: [[f64; 3]; 4] = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]];
const HEAD: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
    element face 2\nproperty list uchar int vertex_indices\nend_header\n";
const BODY: &str = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n";

fn assert_square(model: &Model, name: &str) {
    assert_eq!(bits(model), SQUARE.map(|p| p.map(f64::to_bits)), "{name}");
    assert_eq!(faces(model), [[0, 1, 2], [0, 2, 3]], "{name}");
}

/// The square in bytes: `head` up to the elements, and whether numbers begin with their highest byte.
fn binary_square(is_big: bool) -> Vec<u8> {
    let name = if is_big { "binary_big_endian" } else { "binary_little_endian" };
    let mut bytes = HEAD.replace("ascii", name).into_bytes();
    let mut push = |number: [u8; 4]| bytes.extend(number);
    for number in SQUARE.as_flattened() {
        let number = *number as f32;
        push(if is_big { number.to_be_bytes() } else { number.to_le_bytes() });
    }
    for face in [[0u32, 1, 2], [0, 2, 3]] {
        bytes.push(3);
        face.iter().for_each(|i| bytes.extend(if is_big { i.to_be_bytes() } else { i.to_le_bytes() }));
    }
    bytes
}

#[test]
fn harmless_ply_files_give_the_square() {
    let all = format!("{HEAD}{BODY}");
    let cases: Vec<(&str, Vec<u8>)> = vec![
        ("text", all.clone().into()),
        ("CRLF", all.replace('\n', "\r\n").into()),
        ("CR", all.replace('\n', "\r").into()),
        ("no final newline", all.trim_end().into()),
        ("one line", format!("{HEAD}{}", BODY.replace('\n', " ")).into()),
        ("many lines", format!("{HEAD}{}", BODY.replace(' ', "\n\n\t")).into()),
        ("bytes, lowest first", binary_square(false)),
        ("bytes, highest first", binary_square(true)),
        ("something behind", [binary_square(false), b"more".to_vec()].concat()),
        ("double", all.replace("float", "double").into()),
        (
            "names with widths",
            all.replace("float", "float32").replace("uchar", "uint8").replace("int v", "int32 v").into(),
        ),
        ("vertex_index", all.replace("vertex_indices", "vertex_index").into()),
        ("whole coordinates", all.replace("float", "int").into()),
        ("faces of shorts", all.replace("uchar int", "int ushort").into()),
        ("comments", all.replace("element v", "comment by hand\nobj_info x\nelement v").into()),
        ("double blanks", all.replace("property float", "property  float ").into()),
        (
            "faces first",
            (HEAD[..21].to_owned()
                + "element face 2\nproperty list uchar int vertex_indices\n"
                + &HEAD[21..HEAD.find("element face").unwrap()]
                + "end_header\n3 0 1 2\n3 0 2 3\n"
                + &BODY[..24])
                .into(),
        ),
        (
            "edges",
            all.replace(
                "end_header",
                "element edge 1\nproperty int vertex1\nproperty int vertex2\nend_header",
            )
            .into_bytes()
            .into_iter()
            .chain(*b"0 1\n")
            .collect(),
        ),
        ("an empty element", all.replace("element f", "element empty 99999999999\nelement f").into()),
        (
            "a list of each vertex",
            all.replace("element f", "property list uchar int near\nelement f")
                .replace("\n0 0 0\n", "\n0 0 0 2 7 7\n")
                .replace("\n1 0 0\n", "\n1 0 0 0\n")
                .replace("\n1 1 0\n", "\n1 1 0 0\n")
                .replace("\n0 1 0\n", "\n0 1 0 1 7\n")
                .into(),
        ),
    ];
    for (name, bytes) in cases {
        let model = parse(&bytes, PLY).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_square(&model, name);
    }
}

#[test]
fn faulty_ply_files_are_named_with_line_and_word() {
    let all = format!("{HEAD}{BODY}");
    let with = |old: &str, new: &str| all.replacen(old, new, 1);
    let huge = "18446744073709551615";
    let cases = [
        (String::new(), "t:1: a PLY file begins with \"ply\""),
        ("solid x\n".into(), "t:1: a PLY file begins with \"ply\"; this looks like an STL file"),
        ("ply\n".into(), "t:2: the head has no \"end_header\""),
        (with("format ascii 1.0\n", ""), "t:9: the head has no \"format\""),
        (with("ascii", "ansi"), "t:2: \"ansi 1.0\" is no format of a PLY file"),
        (with("vertex 4", "vertex four"), "t:3: \"vertex four\" is no element of a PLY file"),
        (with("float x", "real x"), "t:4: \"real x\" is no property of a PLY file"),
        (
            with("uchar int", "float int"),
            "t:8: \"list float int vertex_indices\" is no property of a PLY file",
        ),
        (with("element v", "elephant v"), "t:3: \"elephant\" does not belong into a PLY head"),
        (with("element vertex 4\n", ""), "t:3: a property before the first element"),
        (with("float z", "float w"), "t:3: the vertices have no x, y and z"),
        (with("vertex_indices", "corners"), "t:7: the faces have no list vertex_indices"),
        (with("vertex 4", &format!("vertex {huge}")), "t:1: 18446744073709551615 vertices are too many"),
        (
            with("vertex 4", "vertex 4000000"),
            "t:10: the file is too short for 4000000 x \"vertex\" (6 at most)",
        ),
        (
            with("face 2", &format!("face {huge}")),
            "t:13: the file is too short for 18446744073709551615 x \"face\" (9 at most)",
        ),
        (with("\n1 0 0", "\n1 0 nan"), "t:11: vertex 1 has a coordinate that is not finite"),
        (with("\n1 0 0", "\n1 0 0x"), "t:11: \"0x\" is not a number"),
        (with("0 1 2", "0 1 4"), "t:14: face 0 names vertex 4, but there are 4 (from 0)"),
        (with("0 1 2", "0 1 -1"), "t:14: face 0 names vertex -1, but there are 4 (from 0)"),
        (with("3 0 1 2", "2 0 1"), "t:14: face 0 needs three corners and has 2 only"),
        (with("3 0 2 3", "9 0 2 3"), "t:16: the file ends too early"),
        (with("3 0 2 3", "-3 0 2 3"), "t:15: -3 is no length of a list"),
        (with("face 2", "face 0"), "t:13: no faces (and 4 vertices)"),
        (with("element face", "element tristrips"), "t:15: no faces (triangle strips are not read)"),
    ];
    for (bytes, fault) in cases {
        assert_eq!(parse(&bytes, PLY).unwrap_err(), fault, "{bytes}");
    }
    let mut bytes = binary_square(false);
    bytes.truncate(bytes.len() - 1);
    assert_eq!(parse(&bytes, PLY).unwrap_err(), "t:10: the file ends too early");
}

#[test]
fn a_ply_text_comes_back_with_all_its_columns() {
    let all = "ply\nformat ascii 1.0\ncomment TextureFile a.png\ncomment\nobj_info 3 scans\nelement vertex 4\n\
        property float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\n\
        property uchar blue\nproperty uchar alpha\nproperty float quality\nproperty short label\n\
        element face 2\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\n\
        property uchar flags\nend_header\n\
        0.1 0 0 255 128 0 255 0.25 -7\n1 0 0 0 0 0 0 nan 1\n1 1 0 1 2 3 4 1e-30 2\n0 1 0 9 9 9 9 1 3\n\
        4 0 1 2 3 8 0 0 1 0 1 1 0 1 5\n3 0 2 3 0 6\n";
    let model = parse(all, PLY).unwrap();
    assert_eq!(model.notices, [""; 0]);
    assert_eq!(model.faces.len(), 3, "the quadrilateral is two triangles");
    assert_eq!(text(&model, PLY), all.replace("nan", "NaN"));
    assert_eq!(io::losses(&model, PLY), [""; 0]);
    // And by way of bytes of either order.
    for encoding in [Encoding::LittleEndian, Encoding::BigEndian] {
        let bytes = io::format_as(&model, Format::Ply(Some(encoding)));
        let again = parse(&bytes, PLY).unwrap();
        assert_eq!(bits(&again), bits(&model));
        assert_eq!((&again.faces, &again.attributes.polygons), (&model.faces, &model.attributes.polygons));
        assert_eq!(again.attributes.texture, model.attributes.texture);
        assert_eq!(again.attributes.head, model.attributes.head);
        let values = |m: &Model| -> Vec<(String, Kind, Vec<f32>)> {
            let column = |c: &Column| {
                (c.name.clone(), c.kind, c.values.iter().map(|&x| x as f32).filter(|x| !x.is_nan()).collect())
            };
            m.attributes.vertex_columns.iter().chain(&m.attributes.face_columns).map(column).collect()
        };
        assert_eq!(values(&again), values(&model));
    }
}

#[test]
fn colours_and_normals_of_an_obj_reach_a_ply_and_back() {
    let obj = "v 0 0 0 1 0.5 0\nv 1 0 0 0 0 1\nv 0 1 0 0.2 0.4 0.6\nvn 0 0 1\nf 1//1 2//1 3//1\n";
    let model = parse(obj, Format::Obj).unwrap();
    let ascii = Format::Ply(Some(Encoding::Ascii));
    let expected = "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\n\
        property uchar red\nproperty uchar green\nproperty uchar blue\n\
        property double nx\nproperty double ny\nproperty double nz\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0 255 128 0 0 0 1\n1 0 0 0 0 255 0 0 1\n0 1 0 51 102 153 0 0 1\n3 0 1 2\n";
    assert_eq!(text(&model, ascii), expected);
    assert_eq!(io::losses(&model, ascii), [""; 0]);
    let back = text(&parse(expected, PLY).unwrap(), Format::Obj);
    assert_eq!(
        back,
        "v 0 0 0 1 0.5019607843137255 0\nv 1 0 0 0 0 1\nv 0 1 0 0.2 0.4 0.6\nvn 0 0 1\nvn 0 0 1\nvn 0 0 1\nf 1//1 2//2 3//3\n"
    );
}

#[test]
fn what_a_format_cannot_hold_is_named() {
    let obj = "# c\nmtllib a.mtl\nv 0.1 0 0 1 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 9 9 9\nvt 0.1 0 1\nvn 0 0 1\nvn 0 1 0\n\
        usemtl red\nf 1/1/1 2/1/1 3/1/1 4/1/1\nf 1//2 2//1 3//1\nl 1 2\n";
    let model = parse(obj, Format::Obj).unwrap();
    assert_eq!(io::losses(&model, Format::Obj), [""; 0]);
    assert_eq!(
        io::losses(&model, PLY),
        [
            "left out: material libraries",
            "left out: groups, materials and the like",
            "left out: lines and points",
            "left out: normals (they differ between the faces of a vertex)",
            "left out: the third texture coordinate",
            "left out: digits of texture coordinates behind the seventh",
            "left out: that some vertices have no colour (they are white now)",
        ]
    );
    assert_eq!(
        io::losses(&model, STL),
        [
            "left out: property \"red\"",
            "left out: property \"green\"",
            "left out: property \"blue\"",
            "left out: texture coordinates",
            "left out: normals (they follow from the corners)",
            "left out: polygons (they are cut into triangles)",
            "left out: groups, materials, lines and the like",
            "left out: digits of coordinates behind the seventh",
            "left out: vertices without a face",
        ]
    );
    assert_eq!(
        io::losses(&model, Format::Off),
        [
            "left out: texture coordinates",
            "left out: normals (they differ between the faces of a vertex)",
            "left out: material libraries",
            "left out: groups, materials and the like",
            "left out: lines and points",
        ]
    );
}

/// A triangle of a binary STL file.
fn stl_triangle(corners: [[f32; 3]; 3], attribute: u16) -> Vec<u8> {
    [le(&[0.0; 3]), le(corners.as_flattened()), attribute.to_le_bytes().to_vec()].concat()
}

fn binary_stl(head: &[u8], triangles: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = head.to_vec();
    bytes.resize(80, 0);
    bytes.extend((triangles.len() as u32).to_le_bytes());
    bytes.extend(triangles.concat());
    bytes
}

fn square_triangles() -> [Vec<u8>; 2] {
    let p = SQUARE.map(|p| p.map(|x| x as f32));
    [stl_triangle([p[0], p[1], p[2]], 0), stl_triangle([[-0.0, 0.0, -0.0], p[2], p[3]], 0)]
}

const STL_TEXT: &str = "solid \n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 1 0 0\n   vertex 1 1 0\n\
    \x20 endloop\n endfacet\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 1 1 0\n   vertex 0 1 0\n\
    \x20 endloop\n endfacet\nendsolid\n";

#[test]
fn harmless_stl_files_give_the_square() {
    let bytes = binary_stl(b"made by hand", &square_triangles());
    let cases: Vec<(&str, Vec<u8>)> = vec![
        ("bytes", bytes.clone()),
        ("bytes that begin like a text", binary_stl(b"solid but bytes", &square_triangles())),
        ("something behind", [bytes, b"more".to_vec()].concat()),
        ("text", STL_TEXT.into()),
        ("CRLF", STL_TEXT.replace('\n', "\r\n").into()),
        ("CR", STL_TEXT.replace('\n', "\r").into()),
        ("capitals", STL_TEXT.to_uppercase().into()),
        ("one line each facet", STL_TEXT.replace('\n', " ").replacen("solid  ", "solid \n", 1).replace("endfacet ", "endfacet\n").replace("normal 0 0 1", "normal 0 0 1\n").replace("outer loop", "outer loop\n").into()),
        ("named", STL_TEXT.replace("solid \n", "solid a b\n").replace("endsolid\n", "endsolid a b\n").into()),
        ("no end", STL_TEXT.replace("endsolid\n", "").into()),
        ("normal that is none", STL_TEXT.replace("0 0 1", "nan -nan(ind) 1.#QNAN").into()),
        ("a quadrilateral", STL_TEXT.replace("endloop\n endfacet\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 1 1 0\n", "").into()),
        ("blank lines before", (" \n\n".to_owned() + STL_TEXT).into()),
    ];
    for (name, bytes) in cases {
        let model = parse(&bytes, STL).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_square(&model, name);
    }
}

#[test]
fn faulty_stl_files_are_named_with_line_and_word() {
    let with = |old: &str, new: &str| STL_TEXT.replacen(old, new, 1);
    let cases = [
        (String::new(), "t:1: no STL file: too short"),
        ("ply\nformat ascii 1.0\n".into(), "t:1: no STL file: too short; this looks like a PLY file"),
        ("solid\nendsolid\n".into(), "t:1: no faces"),
        (with("vertex 1 0 0", "vertex 1 x 0"), "t:5: \"x\" is not a number"),
        (with("vertex 1 0 0", "vertex 1 inf 0"), "t:5: \"inf\" is not a finite number"),
        (with("vertex 1 0 0", "vertex 1 0"), "t:5: \"\" is not a number"),
        (with("   vertex 1 0 0\n", ""), "t:6: a facet needs three vertices and has 2 only"),
        (with("   vertex 1 0 0\n", "v 1 0 0\n"), "t:5: \"v\" does not belong into an STL text"),
    ];
    for (text, fault) in cases {
        assert_eq!(parse(&text, STL).unwrap_err(), fault, "{text}");
    }
    let mut bytes = binary_stl(b"", &square_triangles());
    bytes.pop();
    assert_eq!(parse(&bytes, STL).unwrap_err(), "t:1: 2 triangles are announced, 1 are there");
    bytes[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    assert_eq!(parse(&bytes, STL).unwrap_err(), "t:1: 4294967295 triangles are announced, 1 are there");
    let nan = binary_stl(b"", &[stl_triangle([[f32::NAN; 3]; 3], 0)]);
    assert_eq!(parse(&nan, STL).unwrap_err(), "t:1: triangle 0 has a coordinate that is not finite");
}

#[test]
fn an_stl_comes_back_with_names_head_and_attributes() {
    assert_eq!(text(&parse(STL_TEXT, STL).unwrap(), STL), STL_TEXT);
    let two = STL_TEXT.replace("solid \n", "solid a b\n").replace("endsolid\n", "endsolid a b\n")
        + &STL_TEXT.replace("solid \n", "solid c\n").replace("endsolid\n", "endsolid c\n");
    let model = parse(&two, STL).unwrap();
    assert_eq!(model.points.len(), 4, "equal corners of both solids are one vertex");
    assert_eq!(text(&model, STL), two);
    assert!(text(&model, Format::Obj).contains("o a b\nf 1 2 3\nf 1 3 4\no c\nf 1 2 3"));

    let [first, second] = square_triangles();
    let second = [&second[..48], &[7, 1]].concat();
    let bytes = binary_stl(b"made by hand", &[first, second]);
    let model = parse(&bytes, STL).unwrap();
    assert_eq!(model.attributes.face_columns[0].values, [0.0, 263.0]);
    let mut expected = bytes.clone();
    for triangle in [84, 134] {
        expected[triangle + 8..triangle + 12].copy_from_slice(&1f32.to_le_bytes());
    }
    // The -0 of the second triangle is the 0 of the first.
    expected[134 + 12..134 + 24].copy_from_slice(&[0; 12]);
    assert_eq!(io::format_as(&model, STL), expected);
}

#[test]
fn harmless_off_files_give_the_square() {
    let plain = "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n";
    let cases = [
        ("plain", plain.to_owned()),
        ("CRLF", plain.replace('\n', "\r\n")),
        ("counts in the first line", plain.replacen("OFF\n", "OFF ", 1)),
        ("comments and blank lines", plain.replace('\n', " # c\n\n#\n")),
        ("no number of edges", plain.replace("4 2 0", "4 2")),
        ("colours", plain.replacen("OFF", "COFF", 1).replace("0 0\n1", "0 0 255 0 0 255\n1")),
        ("normals", plain.replacen("OFF", "NOFF", 1).replace("0\n", "0 0 0 1\n").replace("2 0 0 0 1", "2 0")),
        ("face colours", plain.replace("0 1 2", "0 1 2 255 0 0").replace("0 2 3", "0 2 3 0.5 0.5 1.0 1")),
        ("exponents", plain.replace("1 1 0", "1e0 10E-1 0.0")),
    ];
    for (name, text) in cases {
        let model = parse(&text, Format::Off).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_square(&model, name);
    }
}

#[test]
fn faulty_off_files_are_named_with_line_and_word() {
    let plain = "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n";
    let with = |old: &str, new: &str| plain.replacen(old, new, 1);
    let cases = [
        (String::new(), "t:1: an OFF file begins with \"OFF\", not with \"\""),
        ("v 0 0 0\n".into(), "t:1: an OFF file begins with \"OFF\", not with \"v\""),
        (with("OFF", "4OFF"), "t:1: this kind of OFF file is not read: \"4OFF\""),
        (with("OFF", "OFF BINARY"), "t:1: this kind of OFF file is not read: \"BINARY\""),
        (with("4 2 0", "four 2 0"), "t:2: \"four\" is no number of vertices or faces"),
        (with("4 2 0", "4 -2 0"), "t:2: \"-2\" is no number of vertices or faces"),
        (
            with("4 2 0", "4 99999999999999999999 0"),
            "t:3: the file is too short for 4 vertices and 9223372036854775807 faces",
        ),
        (with("1 1 0", "1 1"), "t:5: vertex 2 needs 3 numbers and has 2 only"),
        (with("1 1 0", "1 nan 0"), "t:5: \"nan\" is not a finite number"),
        (with("3 0 1 2", "3 0 1 4"), "t:7: \"4\" names no vertex (there are 4, from 0)"),
        (with("3 0 1 2", "3 0 1"), "t:7: a face of 3 corners has 2 only"),
        (with("3 0 1 2", "2 0 1"), "t:7: a face needs three corners and has 2 only"),
        (with("3 0 1 2", "3.5 0 1 2"), "t:7: \"3.5\" is no number of corners"),
        (with("4 2 0", "4 0 0"), "t:7: no faces (and 4 vertices)"),
        (with("3 0 2 3", "   #   "), "t:9: \"\" is no number of corners"),
        (with("3 0 2 3\n", ""), "t:3: the file is too short for 4 vertices and 2 faces"),
    ];
    for (text, fault) in cases {
        assert_eq!(parse(&text, Format::Off).unwrap_err(), fault, "{text}");
    }
}

#[test]
fn an_off_text_comes_back() {
    let cases = [
        "OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0.1\n0 1 0\n4 0 1 2 3\n",
        "COFF\n# head\n4 2 0\n0 0 0 255 0 0 128\n1 0 0 0 0 0 0\n1 1 0 1 2 3 4\n0 1 0 9 9 9 9\n3 0 1 2 1 2 3\n3 0 2 3\n",
        "STCNOFF\n3 1 0\n0 0 0 0 0 1 0.5 1.0 0.25 0 1\n1 0 0 0 0 1 1.0 0.0 0.0 1 1\n1 1 0 0 0 1 0.0 0.0 1.0 0 0\n3 0 1 2\n",
    ];
    for all in cases {
        let model = parse(all, Format::Off).unwrap();
        assert_eq!(model.notices, [""; 0]);
        assert_eq!(text(&model, Format::Off), all);
    }
}

#[test]
fn a_long_way_round_keeps_every_bit() {
    let obj = "v 0.1 -0 1e-320\nv 500000.12345678901 1e300 3\nv 0.3333333333333333 5e-324 -1e-7\nv 7 7 7\n\
        f 1 2 3\nf 3 2 1\n";
    let model = parse(obj, Format::Obj).unwrap();
    let way = ["ply", "off", "ply-ascii", "ply-binary-be", "obj", "off", "obj"];
    let mut here = model.clone();
    for format in way.map(|name| Format::by_name(name).unwrap()) {
        here = parse(io::format_as(&here, format), format).unwrap();
        assert_eq!((bits(&here), &here.faces), (bits(&model), &model.faces), "{format:?}");
    }
    assert_eq!(text(&here, Format::Obj), text(&model, Format::Obj));
    // STL text has all digits too, but joins, drops and turns -0 into 0 only where corners are equal.
    let stl = parse(io::format_as(&model, Format::Stl(Some(Encoding::Ascii))), STL).unwrap();
    assert_eq!((bits(&stl), &stl.faces), (bits(&model)[..3].to_vec(), &model.faces));
}

#[test]
fn names_and_comments_never_break_a_line() {
    let stl = STL_TEXT.replace("solid \n", "solid a\\\n").replace("endsolid\n", "endsolid a\\\n");
    let obj = text(&parse(stl, STL).unwrap(), Format::Obj);
    assert_square(&parse(&obj, Format::Obj).unwrap(), &obj);
    let ply = format!("{HEAD}{BODY}").replace("element v", "comment a\rf 1 1 1\nobj_info b\rc\nelement v");
    let obj = text(&parse(ply, PLY).unwrap(), Format::Obj);
    assert!(obj.starts_with("# a f 1 1 1\n# b c\nv 0 0 0\n"), "{obj}");
    let obj = parse("v 0 0 0\no a \\\n b\nf 1 1 1\n", Format::Obj).unwrap();
    let stl = text(&obj, Format::Stl(Some(Encoding::Ascii)));
    assert!(stl.starts_with("solid a \\  b\n facet"), "{stl}");
}

/// What ply-rs-bw makes of a file: coordinates and corners.
fn ply_oracle(bytes: &[u8]) -> (Vec<[f64; 3]>, Vec<Vec<i64>>) {
    let ply = Parser::<DefaultElement>::new().read_ply(&mut Cursor::new(bytes)).expect("the oracle reads it");
    let number = |p: &Property| match *p {
        Property::Double(x) => x,
        Property::Float(x) => x.into(),
        ref other => panic!("{other:?}"),
    };
    let points = ply.payload["vertex"].iter().map(|v| ["x", "y", "z"].map(|axis| number(&v[axis]))).collect();
    let corners = |p: &Property| match p {
        Property::ListInt(list) => list.iter().map(|&i| i.into()).collect(),
        other => panic!("{other:?}"),
    };
    (points, ply.payload["face"].iter().map(|f| corners(&f["vertex_indices"])).collect())
}

fn any_model() -> impl Strategy<Value = Model> {
    let finite = any::<[f64; 3]>().prop_filter("finite", |p| p.iter().all(|x| x.is_finite()));
    (
        proptest::collection::vec(finite, 1..20),
        proptest::collection::vec(any::<[prop::sample::Index; 3]>(), 1..20),
    )
        .prop_map(|(points, faces)| Model {
            faces: faces.iter().map(|face| face.map(|i| Vert::new(i.index(points.len())))).collect(),
            points: points.into_iter().map(Into::into).collect(),
            ..Model::default()
        })
}

proptest! {
    #[test]
    fn ply_files_are_read_by_others_as_they_were_meant(model in any_model(), encoding in prop::sample::select(
        vec![Encoding::Ascii, Encoding::LittleEndian, Encoding::BigEndian]
    )) {
        let bytes = io::format_as(&model, Format::Ply(Some(encoding)));
        let (points, corners) = ply_oracle(&bytes);
        prop_assert_eq!(points.iter().map(|p| p.map(f64::to_bits)).collect::<Vec<_>>(), bits(&model));
        let expected: Vec<Vec<i64>> = faces(&model).iter().map(|f| f.iter().map(|&i| i as i64).collect()).collect();
        prop_assert_eq!(corners, expected);
        let again = parse(&bytes, PLY).unwrap();
        prop_assert_eq!((bits(&again), again.faces), (bits(&model), model.faces));
    }

    #[test]
    fn stl_files_are_read_as_others_read_them(
        triangles in proptest::collection::vec(prop::array::uniform3(prop::array::uniform3(0..4u8)), 1..30),
        is_text in any::<bool>(),
    ) {
        // Few places, so that many corners are equal.
        let soup = triangles.iter().map(|t| stl_triangle(t.map(|p| p.map(|x| f32::from(x) * 0.1)), 0));
        let model = parse(binary_stl(b"", &soup.collect::<Vec<_>>()), STL).unwrap();
        let bytes = io::format_as(&model, Format::Stl(Some(if is_text { Encoding::Ascii } else { Encoding::LittleEndian })));
        let mesh = stl_io::read_stl(&mut Cursor::new(&bytes)).expect("the oracle reads it");
        let ours = model.faces.iter().map(|f| f.map(|v| model.points[v.index()].as_vec3().to_array()));
        let theirs = mesh.faces.iter().map(|f| f.vertices.map(|i| mesh.vertices[i].0));
        prop_assert_eq!(ours.collect::<Vec<_>>(), theirs.collect::<Vec<_>>());
        prop_assert_eq!(model.points.len(), mesh.vertices.len());
        let again = parse(&bytes, STL).unwrap();
        prop_assert_eq!((bits(&again), again.faces), (bits(&model), model.faces));
    }

    #[test]
    fn no_bytes_make_a_reader_panic(
        start in prop::sample::select(vec!["", HEAD, "OFF\n4 2 0\n", STL_TEXT]),
        bytes in proptest::collection::vec(prop_oneof![3 => prop::sample::select(b" 0123456789.-\n".to_vec()), 1 => any::<u8>()], 0..200),
        is_binary in any::<bool>(),
    ) {
        let start = if is_binary { start.replace("ascii", "binary_big_endian") } else { start.to_owned() };
        let bytes = [start.as_bytes(), &bytes].concat();
        for format in [PLY, STL, Format::Off, Format::Obj] {
            if let Err(fault) = parse(&bytes, format) {
                prop_assert_eq!(fault.lines().count(), 1);
            }
        }
    }
}
