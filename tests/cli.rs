//! The binary as a user runs it.

mod common;

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use glam::DVec3;
use predicates::prelude::*;
use predicates::str::contains;
use sharpen::{Mesh, io};
use tempfile::TempDir;

fn sharpen() -> Command {
    Command::cargo_bin("sharpen").unwrap()
}

fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

fn write_mesh(path: &Path, mesh: &Mesh) {
    let attributes = sharpen::attributes::Attributes::default();
    io::write(path, io::View { points: mesh.points(), faces: mesh.faces(), attributes: &attributes })
        .unwrap();
}

/// A folder with a chamfered cube in it: 384 vertices, 764 faces; sharpened, each of its 180 chamfer edges
/// adds two faces and each of its 8 corners two more.
fn folder_with_cube() -> (TempDir, PathBuf) {
    let folder = folder();
    let path = folder.path().join("cube.obj");
    write_mesh(&path, &common::chamfered_cube(8, 0.9));
    (folder, path)
}

fn names(folder: &TempDir) -> Vec<String> {
    let name = |entry: Result<fs::DirEntry, _>| entry.unwrap().file_name().to_string_lossy().into_owned();
    let mut names: Vec<_> = fs::read_dir(folder.path()).unwrap().map(name).collect();
    names.sort();
    names
}

#[test]
fn a_cube_is_sharpened_and_one_line_says_so() {
    let (folder, cube) = folder_with_cube();
    let out = folder.path().join("out.obj");
    let line = "180 chamfer edges and 8 corners; 188 of 188 new vertices on the feature; 764 -> 1140 faces\n";
    sharpen().arg(&cube).arg(&out).assert().success().stdout("").stderr(contains(line));
    let model = io::read(&out).unwrap();
    assert_eq!((model.points.len(), model.faces.len()), (384 + 188, 1140));
    assert_eq!(model.points[..384], io::read(&cube).unwrap().points);
}

#[test]
fn quiet_says_nothing_and_verbose_says_more() {
    let (folder, cube) = folder_with_cube();
    let out = folder.path().join("out.obj");
    sharpen().arg("-q").arg(&cube).arg(&out).assert().success().stdout("").stderr("");
    sharpen().arg("-v").arg(&cube).arg(&out).assert().success().stderr(contains("smooth below"));
    sharpen().args(["-v", "-q"]).arg(&cube).arg(&out).assert().code(2);
}

#[test]
fn the_output_may_be_the_input() {
    let (folder, cube) = folder_with_cube();
    sharpen().arg(&cube).arg(&cube).assert().success();
    assert_eq!(io::read(&cube).unwrap().faces.len(), 1140);
    assert_eq!(names(&folder), ["cube.obj"]);
}

#[test]
fn where_nothing_is_found_the_same_mesh_comes_out() {
    let folder = folder();
    let (sphere, out) = (folder.path().join("sphere.obj"), folder.path().join("out.obj"));
    write_mesh(&sphere, &common::sphere(3));
    sharpen().arg(&sphere).arg(&out).assert().success().stderr(contains("nothing to sharpen in 512 faces"));
    assert_eq!(fs::read(&sphere).unwrap(), fs::read(&out).unwrap());
}

#[test]
fn two_runs_and_any_number_of_threads_write_the_same_bytes() {
    let (folder, cube) = folder_with_cube();
    let outputs: Vec<Vec<u8>> = [("1", "a"), ("2", "b"), ("2", "c"), ("7", "d")]
        .into_iter()
        .map(|(threads, name)| {
            let out = folder.path().join(name).with_extension("obj");
            sharpen().args(["-q", "--threads", threads]).arg(&cube).arg(&out).assert().success();
            fs::read(out).unwrap()
        })
        .collect();
    assert!(outputs.iter().all(|bytes| *bytes == outputs[0]));
}

#[test]
fn the_report_counts_what_the_line_says() {
    let (folder, cube) = folder_with_cube();
    let (out, report) = (folder.path().join("out.obj"), folder.path().join("report.json"));
    sharpen().arg("-q").arg(&cube).arg(&out).arg("--report").arg(&report).assert().success();
    let report: serde_json::Value = serde_json::from_slice(&fs::read(report).unwrap()).unwrap();
    assert_eq!(report["found"]["chamfer_edges"], 180);
    assert_eq!(report["found"]["corner_triangles"], 8);
    assert_eq!(report["inserted"]["moved"], 188);
    assert_eq!(report["input"]["faces"], 764);
    assert_eq!(report["output"]["faces"], 1140);
    assert_eq!(report["changed"], true);
    let threshold = report["found"]["threshold_deg"].as_f64().unwrap();
    assert!(threshold > 0.0 && threshold < 45.0, "{threshold}");
    assert!(report["seconds"]["classify"].as_f64().unwrap() >= 0.0);
}

/// The files that the tool is measured on, where they are at hand.
fn reference_inputs() -> Vec<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/inputs");
    let Ok(entries) = fs::read_dir(&path) else {
        eprintln!("skipped: {} is not there", path.display());
        return Vec::new();
    };
    entries.map(|entry| entry.unwrap().path()).collect()
}

#[test]
fn where_nothing_is_found_the_file_comes_back_byte_for_byte() {
    let (folder, cube) = folder_with_cube();
    let odd = folder.path().join("odd.obj");
    fs::write(&odd, "# odd\r\nv 0 0 0.10\nv +1 0 0\nv 0 1e0 0\n\ng a  b\nf 1 2 \\\n3").unwrap();
    let out = folder.path().join("out.obj");
    for input in [cube, odd].into_iter().chain(reference_inputs()) {
        sharpen().args(["-q", "--smooth-angle", "0"]).arg(&input).arg(&out).assert().success();
        assert!(fs::read(&input).unwrap() == fs::read(&out).unwrap(), "{}", input.display());
    }
}

#[test]
fn positions_survive_the_way_through_a_ply_bit_for_bit() {
    let (folder, cube) = folder_with_cube();
    let [ply, back] = ["way.ply", "back.obj"].map(|name| folder.path().join(name));
    let pass = |from: &Path, to: &Path| {
        sharpen().args(["-q", "--smooth-angle", "0"]).arg(from).arg(to).assert().success();
    };
    for input in [cube].into_iter().chain(reference_inputs()) {
        pass(&input, &ply);
        pass(&ply, &back);
        let (before, after) = (io::read(&input).unwrap(), io::read(&back).unwrap());
        let bits = |model: &io::Model| -> Vec<[u64; 3]> {
            model.points.iter().map(|p| p.to_array().map(f64::to_bits)).collect()
        };
        assert!(bits(&before) == bits(&after) && before.faces == after.faces, "{}", input.display());
    }
}

/// The JSON that `--report` wrote, and what was said, for the input and the output `files`.
fn report_on(folder: &TempDir, files: [&str; 2], flags: &[&str]) -> (serde_json::Value, String) {
    let report = folder.path().join("report.json");
    let run = sharpen().current_dir(folder).args(flags).arg("--report").arg(&report).args(files).assert();
    let said = String::from_utf8(run.success().get_output().stderr.clone()).unwrap();
    (serde_json::from_slice(&fs::read(report).unwrap()).unwrap(), said)
}

#[test]
fn the_report_names_what_could_not_be_kept_as_the_screen_does() {
    let folder = folder();
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\ng a\ncstype bezier\nf 1 2 3\n";
    fs::write(folder.path().join("a.obj"), text).unwrap();
    let (report, said) = report_on(&folder, ["a.obj", "out.ply"], &["--bend", "1"]);
    let notices = ["left out: 1 x \"cstype\" (first in line 5)", "left out: groups, materials and the like"];
    assert_eq!(report["notices"], serde_json::json!(notices));
    assert!(notices.iter().all(|notice| said.contains(&format!("a.obj: {notice}\n"))), "{said}");

    // A copy, byte for byte, has all of it.
    let (report, said) = report_on(&folder, ["a.obj", "out.obj"], &[]);
    assert_eq!(report["notices"], serde_json::json!([]));
    assert!(!said.contains("left out"), "{said}");
    assert_eq!(fs::read_to_string(folder.path().join("out.obj")).unwrap(), text);
}

#[test]
fn all_that_is_irregular_is_counted_and_comes_back() {
    let folder = folder();
    // Three faces on the edge 1-2; a face with its reverse and one without area on the edge 6-7; one that
    // names a vertex twice. Vertices 12 to 14 stand where 1 to 3 do, so that the last face is 1 3 3, and
    // neither 11 nor 13 are in a face. Sides without a neighbour: 9 and 5, and 3 of each collapsed face.
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 -1 0\nv 0 0 1\nv 5 0 0\nv 6 0 0\nv 5 1 0\nv 7 0 0\nv 5 5 5\nv 9 9 9\n\
        v 0 0 0\nv 1 0 0\nv 0 1 0\n\
        f 1 2 3\nf 1 2 4\nf 2 1 5\nf 6 7 8\nf 8 7 6\nf 6 7 9\nf 10 10 6\nf 12 14 3\n";
    fs::write(folder.path().join("a.obj"), text).unwrap();
    let (report, said) = report_on(&folder, ["a.obj", "out.obj"], &["-v"]);
    let left = serde_json::json!({
        "border_edges": 9 + 5 + 6, "non_manifold_edges": 2, "misoriented_edges": 0, "collapsed_faces": 2,
        "components": 2, "isolated_vertices": 2, "zero_area_faces": 1, "doubled_faces": 1, "joined_vertices": 2,
    });
    assert_eq!(report["left_alone"], left);
    for line in [
        "a.obj: 2 of 14 vertices count as one with an earlier one in their place (--weld)",
        "  left alone: 2 non-manifold edges",
        "  left alone: 2 faces that name a vertex twice",
        "  left alone: 1 faces without area",
        "  left alone: 1 faces with the corners of another",
        "  left alone: 2 vertices without a face",
    ] {
        assert!(said.lines().any(|said| said == line), "{line} in {said}");
    }
    assert_eq!(fs::read_to_string(folder.path().join("out.obj")).unwrap(), text);
}

#[test]
fn a_noisy_mesh_that_is_bent_all_the_same_is_not_said_to_be_left_as_it_is() {
    let folder = folder();
    let tetrahedron = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";
    fs::write(folder.path().join("a.obj"), tetrahedron).unwrap();
    let (report, said) = report_on(&folder, ["a.obj", "out.obj"], &["--bend", "1"]);
    assert_eq!(report["changed"], true);
    assert!(said.starts_with("a.obj: bent and not sharpened: noisy or terraced: "), "{said}");
    assert!(said.ends_with("; 4 -> 16 faces\n"), "{said}");
    let (_, said) = report_on(&folder, ["a.obj", "out.obj"], &[]);
    assert!(said.starts_with("a.obj: left as it is: noisy or terraced: "), "{said}");
}

#[test]
fn the_painted_classes_are_a_ply_of_the_input() {
    let (folder, cube) = folder_with_cube();
    let (out, classes) = (folder.path().join("out.obj"), folder.path().join("classes.ply"));
    sharpen().arg("-q").arg(&cube).arg(&out).arg("--classes").arg(&classes).assert().success();
    let bytes = fs::read(classes).unwrap();
    let header = String::from_utf8_lossy(&bytes[..600]).into_owned();
    assert!(header.contains("element vertex 384\n") && header.contains("element face 764\n"), "{header}");
    assert!(header.contains("element edge 1146\n"), "{header}");
}

#[test]
fn the_smooth_angle_and_the_shift_limit_are_obeyed() {
    let (folder, cube) = folder_with_cube();
    let out = folder.path().join("out.obj");
    let nothing = contains("nothing to sharpen");
    sharpen().args(["--smooth-angle", "0"]).arg(&cube).arg(&out).assert().success().stderr(nothing.clone());
    sharpen().args(["--smooth-angle", "50"]).arg(&cube).arg(&out).assert().success().stderr(nothing);
    let middle = contains("0 of 188 new vertices on the feature");
    sharpen().args(["--max-shift", "0.01"]).arg(&cube).arg(&out).assert().success().stderr(middle);
}

#[test]
fn wrong_usage_is_status_2() {
    let (folder, cube) = folder_with_cube();
    let out = folder.path().join("out.obj");
    for flags in [
        &["--smooth-factor", "-1"][..],
        &["--smooth-factor", "nan"],
        &["--smooth-angle", "181"],
        &["--smooth-angle", "5", "--smooth-factor", "2"],
        &["--threads", "0"],
        &["--no-such-flag"],
    ] {
        sharpen().args(flags).arg(&cube).arg(&out).assert().code(2);
    }
    sharpen().assert().code(2);
    assert_eq!(names(&folder), ["cube.obj"]);
}

#[test]
fn help_and_version_succeed() {
    sharpen().arg("--help").assert().success().stdout(contains("Usage: sharpen"));
    sharpen().arg("--version").assert().success().stdout(contains(env!("CARGO_PKG_VERSION")));
}

#[test]
fn completions_and_the_man_page_know_every_option() {
    let help = sharpen().arg("--help").output().unwrap();
    let help = String::from_utf8(help.stdout).unwrap();
    let options: Vec<_> = help.lines().filter_map(|line| line.trim().strip_prefix("--")).collect();
    assert!(options.len() > 10);
    for what in ["bash", "zsh", "fish", "man"] {
        let output = sharpen().args(["--generate", what]).assert().success().stderr("").get_output().clone();
        let text = String::from_utf8(output.stdout).unwrap().replace('\\', "");
        for option in &options {
            let name = option.split([' ', ',', '=']).next().unwrap();
            assert!(text.contains(name), "{what} does not know --{name}");
        }
    }
    sharpen().args(["--generate", "bash", "a.obj", "b.obj"]).assert().code(2);
    sharpen().args(["--generate", "tcsh"]).assert().code(2);
}

#[test]
fn bash_takes_its_completions() {
    let completions = sharpen().args(["--generate", "bash"]).output().unwrap().stdout;
    let ask = "COMP_WORDS=(sharpen --ti); COMP_CWORD=1; _sharpen sharpen --ti sharpen; echo \"$COMPREPLY\"";
    let script = format!("{}\n{ask}", String::from_utf8(completions).unwrap());
    match std::process::Command::new("bash").args(["-ec", &script]).output() {
        Ok(output) => assert_eq!(String::from_utf8_lossy(&output.stdout), "--timeout\n", "{output:?}"),
        Err(error) => eprintln!("skipped: no bash: {error}"),
    }
}

/// Whether a program takes what `--generate` prints, as a file behind `arguments`; true where there is none.
fn takes_generated(what: &str, program: &str, arguments: &[&str]) -> bool {
    let folder = folder();
    let file = folder.path().join(what);
    fs::write(&file, sharpen().args(["--generate", what]).output().unwrap().stdout).unwrap();
    match std::process::Command::new(program).args(arguments).arg(&file).output() {
        Ok(output) => output.status.success() && output.stderr.is_empty(),
        Err(error) => {
            eprintln!("skipped: no {program}: {error}");
            true
        }
    }
}

#[test]
fn the_other_shells_and_the_typesetter_take_theirs() {
    assert!(takes_generated("zsh", "zsh", &["-n"]));
    assert!(takes_generated("fish", "fish", &["-n"]));
    assert!(takes_generated("man", "groff", &["-man", "-Tutf8", "-ww", "-z"]));
}

#[test]
fn bad_input_is_one_line_with_file_line_and_reason_and_writes_nothing() {
    let folder = folder();
    let out = folder.path().join("out.obj");
    fs::write(&out, "kept").unwrap();
    for (name, content, expected) in [
        ("empty.obj", "", "no faces"),
        ("points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no faces"),
        ("range.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "range.obj:4: "),
        ("nan.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "nan.obj:1: "),
        ("comma.obj", "v 0,5 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "comma.obj:1: "),
        ("zero.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "zero.obj:4: "),
    ] {
        let path = folder.path().join(name);
        fs::write(&path, content).unwrap();
        let one_line = predicate::function(|text: &str| text.lines().count() == 1);
        sharpen().arg(&path).arg(&out).assert().code(1).stdout("").stderr(contains(expected).and(one_line));
        fs::remove_file(&path).unwrap();
    }
    let one_line = predicate::str::is_match("^[^\n]+\n$").unwrap();
    let missing = folder.path().join("none.obj");
    sharpen().arg(missing).arg(&out).assert().code(1).stderr(contains("cannot read").and(one_line.clone()));
    let no_folder = contains("cannot make a folder").and(one_line);
    sharpen().arg(folder.path()).arg(&out).assert().code(1).stderr(no_folder);
    assert_eq!(fs::read_to_string(&out).unwrap(), "kept");
    assert_eq!(names(&folder), ["out.obj"]);
}

#[test]
fn bending_splits_every_face_in_four_and_keeps_what_is_flat_flat() {
    let (folder, cube) = folder_with_cube();
    let (out, edges) = (folder.path().join("out.obj"), folder.path().join("edges.obj"));
    sharpen()
        .args(["-q", "--bend", "1"])
        .arg(&cube)
        .arg(&out)
        .arg("--sharp-edges")
        .arg(&edges)
        .assert()
        .success();
    let model = io::read(&out).unwrap();
    assert_eq!(model.faces.len(), 4 * 1140);
    for p in &model.points[384..] {
        let farthest = p.abs().max_element();
        assert!((farthest - 1.0).abs() < 1e-9, "{p} is off the cube");
    }
    // The twelve edges of the cube, from corner to corner.
    let text = fs::read_to_string(&edges).unwrap();
    assert_eq!(text.lines().filter(|line| line.starts_with("l ")).count(), 12);
    let vertices = text.lines().filter(|line| line.starts_with("v ")).count();
    let on_lines: usize =
        text.lines().filter(|l| l.starts_with("l ")).map(|l| l.split(' ').count() - 1).sum();
    assert_eq!(on_lines, vertices + 2 * 12 - 8, "corners are shared by three lines");
}

#[test]
fn a_mesh_can_be_bent_without_being_sharpened() {
    let (folder, cube) = folder_with_cube();
    let out = folder.path().join("out.obj");
    let bent = contains("not sharpened; 764 -> 3056 faces");
    sharpen().args(["--no-sharpen", "--bend", "1"]).arg(&cube).arg(&out).assert().success().stderr(bent);
    sharpen().args(["--sharp-angle", "30"]).arg(&cube).arg(&out).assert().code(2);
    // A square whose diagonal the file itself calls sharp.
    let square = folder.path().join("square.obj");
    fs::write(&square, "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\nl 1 3\n").unwrap();
    let edges = folder.path().join("edges.obj");
    sharpen()
        .args(["-q", "--no-sharpen", "--bend", "1", "--sharp-edges"])
        .arg(&edges)
        .arg(&square)
        .arg(&out)
        .assert()
        .success();
    assert_eq!(fs::read_to_string(edges).unwrap(), "v 0 0 0\nv 1 1 0\nv 0.5 0.5 0\nl 1 3 2\n");
}

#[test]
fn a_flat_sheet_with_rounded_coordinates_is_split_in_the_middles() {
    // An uneven, tilted sheet of 12 x 12 points, edges near 0.01: four decimals are too coarse to be taken for flat,
    // five are not.
    let sheet = |decimals: usize| {
        let mut text = String::new();
        for (i, j) in (0..144).map(|k| (f64::from(k / 12), f64::from(k % 12))) {
            let (x, y) = (0.01 * i + 0.004 * (1.7 * j).sin(), 0.01 * j + 0.003 * i.sin());
            text += &format!("v {x:.decimals$} {y:.decimals$} {:.decimals$}\n", 0.31 * x - 0.27 * y);
        }
        for (i, j) in (0..121).map(|k| (k / 11, k % 11)) {
            let [a, b, c, d] = [0, 12, 13, 1].map(|step| 12 * i + j + 1 + step);
            text += &format!("f {a} {b} {c}\nf {a} {c} {d}\n");
        }
        text
    };
    let folder = folder();
    let (flat, out) = (folder.path().join("flat.obj"), folder.path().join("out.obj"));
    let off_middle = |decimals| {
        fs::write(&flat, sheet(decimals)).unwrap();
        sharpen().args(["-q", "--no-sharpen", "--bend", "1"]).arg(&flat).arg(&out).assert().success();
        let (before, after) = (io::read(&flat).unwrap(), io::read(&out).unwrap());
        let before = Mesh::new(before.points, before.faces).unwrap();
        let inner = before.edges().zip(&after.points[144..]).filter(|&(h, _)| !before.is_border(h));
        let middle =
            inner.map(|(h, p)| p.distance(before.point(before.from(h)).midpoint(before.point(before.to(h)))));
        middle.fold(0.0, f64::max)
    };
    assert_eq!(off_middle(5), 0.0);
    assert!(off_middle(4) > 1e-4);
}

#[test]
fn without_sharpening_the_dihedral_angle_says_what_is_sharp() {
    let folder = folder();
    let (cube, out, edges) =
        (folder.path().join("cube.obj"), folder.path().join("out.obj"), folder.path().join("e.obj"));
    let points = (0..8).map(|k| format!("v {} {} {}\n", k & 1, k >> 1 & 1, k >> 2)).collect::<String>();
    fs::write(&cube, points + "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n").unwrap();
    // Below the cube's right angles all its edges are sharp, above them none, as when nothing is said.
    for (flags, n_sharp) in [(&["--sharp-angle", "89"][..], 12), (&["--sharp-angle", "91"], 0), (&[], 0)] {
        let bend = ["-q", "--no-sharpen", "--bend", "2"];
        sharpen()
            .args(bend)
            .args(flags)
            .arg("--sharp-edges")
            .arg(&edges)
            .arg(&cube)
            .arg(&out)
            .assert()
            .success();
        let lines = fs::read_to_string(&edges).unwrap();
        let lines: Vec<_> = lines.lines().filter(|line| line.starts_with("l ")).collect();
        assert_eq!(lines.len(), n_sharp, "{flags:?}");
        assert!(lines.iter().all(|line| line.split(' ').count() == 1 + 5), "two levels make four of an edge");
        let is_on_cube = |p: &DVec3| (*p - 0.5).abs().max_element() == 0.5;
        assert_eq!(io::read(&out).unwrap().points.iter().all(is_on_cube), n_sharp > 0, "{flags:?}");
    }
}

#[test]
fn denoising_comes_before_bending() {
    let (folder, cube) = folder_with_cube();
    let (smooth, bent) = (folder.path().join("smooth.obj"), folder.path().join("bent.obj"));
    sharpen().args(["-q", "--denoise", "2"]).arg(&cube).arg(&smooth).assert().success();
    sharpen().args(["-q", "--denoise", "2", "--bend", "1"]).arg(&cube).arg(&bent).assert().success();
    let [smooth, bent] = [smooth, bent].map(|path| io::read(&path).unwrap().points);
    assert_eq!(bent[..smooth.len()], smooth, "bending leaves old vertices where denoising put them");
}

#[test]
fn the_report_counts_how_bending_placed_vertices_and_what_held_them_back() {
    let folder = folder();
    let bracket = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/bracket_mc.obj");
    let files = [bracket.to_str().unwrap(), "out.obj"];
    let (report, _) = report_on(&folder, files, &["--bend", "2"]);
    let levels = report["bent"].as_array().unwrap();
    assert_eq!(levels.len(), 2);
    let faces = report["output"]["faces"].as_u64().unwrap() / 16;
    for (level, faces) in levels.iter().zip([faces, 4 * faces]) {
        let rules = level["rules"].as_object().unwrap();
        // A closed surface has three edges for two faces.
        assert_eq!(rules.values().map(|n| n.as_u64().unwrap()).sum::<u64>(), 3 * faces / 2);
        assert!(["r1", "r2", "r3", "r6", "e1", "e2"].iter().all(|rule| rules.contains_key(*rule)), "{level}");
        assert!(
            ["doubted", "shortened", "retreated"].iter().all(|n| level[n].as_u64().unwrap() > 0),
            "{level}"
        );
    }
}

#[test]
fn too_many_levels_are_refused_with_the_figure_before_any_work() {
    let (folder, cube) = folder_with_cube();
    let out = folder.path().join("out.obj");
    for (flags, figure) in [
        (&["--bend", "10"][..], "801112064 faces are more than the 200000000 that are allowed (--max-faces)"),
        (
            &["--bend", "1", "--max-faces", "3000"],
            "3056 faces are more than the 3000 that are allowed (--max-faces)",
        ),
        // The input would do, but not what sharpening makes of it.
        (
            &["--bend", "1", "--max-faces", "4000"],
            "4560 faces are more than the 4000 that are allowed (--max-faces)",
        ),
        (&["--bend", "11", "--max-faces", "99999999999"], "that the index type holds"),
        (&["--bend", "4000000000"], "are allowed (--max-faces)"),
    ] {
        sharpen().args(flags).arg(&cube).arg(&out).assert().code(1).stderr(contains(format!("{figure}\n")));
    }
    assert_eq!(names(&folder), ["cube.obj"]);
}

#[test]
fn denoising_holds_what_is_sharp() {
    let (folder, cube) = folder_with_cube();
    let (plain, out) = (folder.path().join("plain.obj"), folder.path().join("out.obj"));
    sharpen().arg("-q").arg(&cube).arg(&plain).assert().success();
    sharpen().args(["-q", "--denoise", "3"]).arg(&cube).arg(&out).assert().success();
    let (plain, smoothed) = (io::read(&plain).unwrap(), io::read(&out).unwrap());
    assert_eq!(plain.faces, smoothed.faces);
    assert_eq!(plain.points[384..], smoothed.points[384..], "inserted vertices are tagged");
    assert_ne!(plain.points[..384], smoothed.points[..384]);
}
