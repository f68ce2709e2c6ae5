//! The odd files of the reference data through the binary, each held against its row in `EXPECTED.md`.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use assert_cmd::Command;
use serde_json::Value;
use sharpen::io;
use tempfile::TempDir;

/// All numbers of files that `EXPECTED.md` has a row for.
const ALL: [&str; 45] = [
    "01", "02", "04", "06", "07", "09", "11", "12", "13", "14", "16", "17", "18", "19", "21", "23", "25",
    "26", "28", "29", "31", "32", "33", "35", "36", "37", "39", "40", "41", "43", "45", "47", "48", "49",
    "51", "52", "54", "56", "57", "58", "60", "62", "64", "65", "67",
];

/// The files that are refused: number, line, and what the reason names.
const REFUSED: [(&str, usize, &str); 14] = [
    ("14", 5, "\"nan\" is not a finite number"),
    ("16", 5, "\"0,5\" is not a number (a comma is no decimal sign)"),
    ("25", 12, "\"0\" names vertex 0"),
    ("26", 12, "\"99\" names a vertex that does not exist"),
    ("28", 12, "\"99999999999999999999\" names a vertex that does not exist"),
    ("29", 12, "\"1.0\" is no vertex index"),
    ("31", 12, "a face needs three corners and has \"1\" only"),
    ("32", 12, "a face needs three corners and has \"1 2\" only"),
    ("54", 11, "a face needs three corners and has \"4\" only"),
    ("56", 1, "no faces"),
    ("57", 2, "no faces"),
    ("58", 5, "no faces"),
    ("60", 1, "no faces; \"solid\" is how an STL file begins"),
    ("62", 6, "a vertex needs three coordinates and has \"1 2\" only"),
];

/// The files, where this machine has them.
fn odd_files() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/odd");
    let Ok(entries) = fs::read_dir(&folder) else {
        eprintln!("not tested: there is no {}", folder.display());
        return Vec::new();
    };
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    files.retain(|file| file.extension().is_some_and(|extension| extension == "obj"));
    files.sort();
    assert_eq!(files.iter().map(|file| number(file)).collect::<BTreeSet<_>>(), ALL.map(str::to_owned).into());
    files
}

fn number(file: &Path) -> String {
    file.file_name().unwrap().to_str().unwrap()[..2].to_owned()
}

/// What a run said, reported and wrote.
struct Ran {
    said: String,
    report: Value,
    output: Vec<u8>,
    took: Duration,
}

impl Ran {
    fn new(file: &Path, flags: &[&str]) -> Self {
        let folder = TempDir::new().unwrap();
        let (out, report) = (folder.path().join("out.obj"), folder.path().join("report.json"));
        let start = Instant::now();
        let mut command = Command::cargo_bin("sharpen").unwrap();
        let run = command.args(flags).arg("--report").args([&report, file, &out]).assert().success();
        let took = start.elapsed();
        Self {
            said: String::from_utf8(run.get_output().stderr.clone()).unwrap(),
            report: serde_json::from_slice(&fs::read(&report).unwrap()).unwrap(),
            output: fs::read(&out).unwrap(),
            took,
        }
    }

    fn size(&self) -> [u64; 2] {
        ["vertices", "faces"].map(|what| self.report["input"][what].as_u64().unwrap())
    }
}

/// The statements of a file that begin with `word`, each in words.
fn statements(bytes: &[u8], word: &str) -> Vec<Vec<String>> {
    let words = |line: &str| line.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
    let text = String::from_utf8_lossy(bytes);
    text.lines().map(words).filter(|words| words.first().is_some_and(|first| first == word)).collect()
}

/// The numbers of each vertex statement, colours and weights included.
fn vertices(bytes: &[u8]) -> Vec<Vec<u64>> {
    let numbers = |words: Vec<String>| {
        words[1..].iter().map(|word| word.parse::<f64>().unwrap().to_bits()).collect::<Vec<_>>()
    };
    statements(bytes, "v").into_iter().map(numbers).collect()
}

#[test]
fn the_odd_files_that_are_refused_name_file_line_and_word() {
    for file in odd_files() {
        let number = number(&file);
        let Some(&(_, line, word)) = REFUSED.iter().find(|(refused, ..)| *refused == number) else {
            continue;
        };
        let folder = TempDir::new().unwrap();
        let out = folder.path().join("out.obj");
        let mut command = Command::cargo_bin("sharpen").unwrap();
        let run = command.args([&file, &out]).assert().code(1).stdout("");
        let said = String::from_utf8(run.get_output().stderr.clone()).unwrap();
        let start = format!("sharpen: {}:{line}: ", file.display());
        assert!(said.starts_with(&start) && said.contains(word) && said.lines().count() == 1, "{said}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "{number}: something was written");
    }
}

#[test]
fn the_odd_files_that_are_accepted_lose_nothing() {
    for file in odd_files() {
        let number = number(&file);
        if REFUSED.iter().any(|(refused, ..)| *refused == number) {
            continue;
        }
        let size = match number.as_str() {
            "35" => [10_000, 9_998],
            "36" | "39" => [5, 7],
            "37" | "40" => [6, 7],
            "41" => [18, 6],
            _ => [5, 6],
        };
        let bytes = fs::read(&file).unwrap();
        let plain = Ran::new(&file, &[]);
        assert_eq!(plain.size(), size, "{number}");
        assert!(plain.output == bytes, "{number}: the same file comes back");
        assert_eq!(plain.report["notices"], Value::Array(Vec::new()), "{number}");
        assert_eq!(said_of_welding(&plain), number == "41", "{number}: {}", plain.said);
        if number == "35" {
            assert!(plain.took < Duration::from_secs(10), "{:?}", plain.took);
        }

        // The writer, too, keeps all vertices in the file's order, with what stands behind their coordinates.
        let bent = Ran::new(&file, &["--bend", "1"]);
        let (before, after) = (vertices(&bytes), vertices(&bent.output));
        assert_eq!(after[..size[0] as usize], before, "{number}");
        let n_faces = bent.report["output"]["faces"].as_u64().unwrap();
        let n_collapsed = bent.report["left_alone"]["collapsed_faces"].as_u64().unwrap();
        assert!(n_faces <= 4 * size[1] && n_faces + 3 * n_collapsed >= 4 * size[1], "{number}: {n_faces}");
        for word in ["usemtl", "mtllib", "l", "p", "g", "o", "s"] {
            assert_eq!(statements(&bent.output, word), statements(&bytes, word), "{number}: {word}");
        }
        // So do the faces that were not touched, with texture coordinates and normals.
        let written = io::format(&io::read(&file).unwrap());
        for word in ["vt", "vn", "f"] {
            if !matches!(number.as_str(), "11" | "23") {
                assert_eq!(statements(&written, word), statements(&bytes, word), "{number}: {word}");
            }
        }
        assert_eq!(io::parse(&written, "again").unwrap().faces, io::read(&file).unwrap().faces, "{number}");
    }
}

fn said_of_welding(ran: &Ran) -> bool {
    ran.report["left_alone"]["joined_vertices"].as_u64().unwrap() > 0
        && ran.said.contains(": 13 of 18 vertices count as one with an earlier one in their place")
}

#[test]
fn what_is_left_alone_of_the_odd_files_is_said() {
    for file in odd_files() {
        let expected = match number(&file).as_str() {
            "36" => "  left alone: 1 faces that name a vertex twice\n",
            "37" => "  left alone: 1 faces without area\n",
            "39" => "  left alone: 1 faces with the corners of another\n",
            "40" => "  left alone: 1 non-manifold edges\n",
            _ => continue,
        };
        let said = Ran::new(&file, &["-v"]).said;
        assert!(said.contains(expected), "{}: {said}", file.display());
    }
}

#[test]
fn the_odd_quadrilateral_is_cut_along_the_shorter_diagonal() {
    for file in odd_files().into_iter().filter(|file| number(file) == "33") {
        let model = io::read(&file).unwrap();
        let [first, second] = [0, 1].map(|f| model.faces[f].map(|v| v.index()));
        let shared: Vec<usize> = first.into_iter().filter(|v| second.contains(v)).collect();
        let others: Vec<usize> = (0..4).filter(|v| !shared.contains(v)).collect();
        let length = |ends: &[usize]| model.points[ends[0]].distance(model.points[ends[1]]);
        assert_eq!((shared.len(), others.len()), (2, 2));
        assert!(length(&shared) <= length(&others));
    }
}
