//! Folders through the binary, as a user runs it.

mod common;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use assert_cmd::Command;
use predicates::prelude::*;
use predicates::str::contains;
use serde_json::Value;
use sharpen::{Mesh, io};
use tempfile::TempDir;

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
const BROKEN: &str = "v 0 0 0\nf 1 2 3\n";
const STATE: &str = ".sharpen-state.jsonl";

/// A folder with an input folder `in` in it.
struct Place(TempDir);

impl Place {
    fn new() -> Self {
        let place = Self(tempfile::tempdir().unwrap());
        fs::create_dir(place.path("in")).unwrap();
        place
    }

    /// With a cube, a triangle two folders down, and a broken file between the two.
    fn with_three() -> Self {
        let place = Self::new();
        place.put("in/b/broken.obj", BROKEN);
        place.put("in/b/c/triangle.obj", TRIANGLE);
        write_mesh(&place.path("in/a.obj"), &common::chamfered_cube(8, 0.9));
        place
    }

    fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.0.path().join(name)
    }

    fn put(&self, name: impl AsRef<Path>, content: &str) {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
    }

    fn get(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }

    /// `sharpen in out`, run here.
    fn sharpen(&self) -> Command {
        let mut command = self.sharpen_alone();
        command.args(["in", "out"]);
        command
    }

    /// `sharpen`, run here.
    fn sharpen_alone(&self) -> Command {
        let mut command = Command::cargo_bin("sharpen").unwrap();
        command.current_dir(self.0.path()).timeout(Duration::from_secs(300));
        command
    }

    /// All files below `folder`, sorted, but for the state file.
    fn files(&self, folder: &str) -> Vec<String> {
        let root = self.path(folder);
        let entries = walkdir::WalkDir::new(&root).sort_by_file_name().into_iter().map(Result::unwrap);
        let files = entries.filter(|entry| !entry.file_type().is_dir() && entry.file_name() != STATE);
        files.map(|file| file.path().strip_prefix(&root).unwrap().to_string_lossy().into_owned()).collect()
    }

    /// The lines of a report by name, none of them twice.
    fn report(&self, name: &str) -> BTreeMap<String, Value> {
        let text = self.get(name);
        assert!(text.is_empty() || text.ends_with('\n'));
        let lines: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        let by_name: BTreeMap<_, _> =
            lines.iter().map(|line| (line["name"].as_str().unwrap().to_owned(), line.clone())).collect();
        assert_eq!(by_name.len(), lines.len(), "a file has two lines");
        by_name
    }

    fn statuses(&self, report: &str) -> Vec<(String, String)> {
        let status = |line: Value| line["status"].as_str().unwrap().to_owned();
        self.report(report).into_iter().map(|(name, line)| (name, status(line))).collect()
    }
}

fn write_mesh(path: &Path, mesh: &Mesh) {
    let attributes = sharpen::attributes::Attributes::default();
    io::write(path, io::View { points: mesh.points(), faces: mesh.faces(), attributes: &attributes })
        .unwrap();
}

fn statuses<const N: usize>(of: [(&str, &str); N]) -> Vec<(String, String)> {
    of.map(|(name, status)| (name.to_owned(), status.to_owned())).to_vec()
}

#[test]
fn a_tree_is_mirrored_past_a_file_that_fails() {
    let place = Place::with_three();
    place.put("in/b/c/colours.mtl", "not a mesh");
    fs::create_dir(place.path("in/empty")).unwrap();
    let broken = "sharpen: in/b/broken.obj:2: \"2\" names a vertex that does not exist (there are 1)\n";
    let summary = "in: 2 sharpened, 1 failed, 0 skipped; 765 -> 1141 faces in ";
    let said = contains(broken).and(contains(summary));
    place.sharpen().assert().code(1).stdout("").stderr(said);
    assert_eq!(place.files("out"), ["a.obj", "b/c/triangle.obj"]);
    assert_eq!(place.get("out/b/c/triangle.obj"), TRIANGLE);
    place.sharpen_alone().args(["in/a.obj", "alone.obj"]).assert().success();
    assert_eq!(place.get("out/a.obj"), place.get("alone.obj"));
    fs::remove_file(place.path("in/b/broken.obj")).unwrap();
    place.sharpen().assert().success();
}

#[test]
fn the_report_has_a_line_for_each_file() {
    let place = Place::with_three();
    place.sharpen().args(["--report", "report.jsonl"]).assert().code(1);
    let report = place.report("report.jsonl");
    let expected = statuses([("a.obj", "ok"), ("b/broken.obj", "failed"), ("b/c/triangle.obj", "ok")]);
    assert_eq!(place.statuses("report.jsonl"), expected);
    assert_eq!(report["a.obj"]["report"]["found"]["chamfer_edges"], 180);
    assert_eq!(report["a.obj"]["report"]["output"]["faces"], 1140);
    assert!(report["a.obj"]["seconds"].as_f64().unwrap() > 0.0);
    assert!(report["b/broken.obj"]["reason"].as_str().unwrap().starts_with("in/b/broken.obj:2: "));
    assert!(report["b/broken.obj"].get("report").is_none());
}

#[cfg(unix)]
#[test]
fn the_report_may_go_to_standard_output() {
    let place = Place::with_three();
    let is_json = |line: &str| serde_json::from_str::<Value>(line).is_ok();
    let lines =
        || predicate::function(move |text: &str| text.lines().count() == 3 && text.lines().all(is_json));
    place.sharpen().args(["--report", "/dev/stdout"]).assert().code(1).stdout(lines());
    place.sharpen().args(["--resume", "--report", "/dev/stdout"]).assert().code(1).stdout(lines());
    place.sharpen().args(["--resume", "--report", "-"]).assert().code(1).stdout(lines());
    assert!(!place.path("-").exists());
}

#[test]
fn every_format_stays_what_it_is() {
    let place = Place::new();
    for name in ["a.obj", "a.ply", "a.STL", "a.off", "stopped"] {
        let cube = common::chamfered_cube(8, 0.9);
        let attributes = sharpen::attributes::Attributes::default();
        let view = io::View { points: cube.points(), faces: cube.faces(), attributes: &attributes };
        let path = place.path("in").join(name);
        io::write_as(&path, view, io::Format::of(&path).unwrap_or(io::Format::Off)).unwrap();
    }
    place
        .sharpen()
        .assert()
        .success()
        .stderr(contains("4 sharpened, 0 failed, 0 skipped; 3056 -> 4560 faces"));
    assert_eq!(place.files("out"), ["a.STL", "a.obj", "a.off", "a.ply"]);
    let faces = |name: &str| io::read(&place.path("out").join(name)).unwrap().faces.len();
    assert!(place.files("out").iter().all(|name| faces(name) == 1140));
}

#[test]
fn what_is_no_input_for_sharpening_is_said() {
    let place = Place::new();
    let cube = common::chamfered_cube(8, 0.9);
    let noisy = cube.points().iter().enumerate();
    let points = noisy.map(|(i, p)| *p * (1.0 + 0.2 * (12.9898 * i as f64).sin())).collect();
    write_mesh(&place.path("in/noisy.obj"), &Mesh::new(points, cube.faces().to_vec()).unwrap());
    let said = contains("in/noisy.obj: left as it is: ");
    place.sharpen().args(["--report", "r"]).assert().success().stderr(said.clone());
    assert_eq!(place.get("in/noisy.obj"), place.get("out/noisy.obj"));
    assert!(said.eval(place.report("r")["noisy.obj"]["reason"].as_str().unwrap()));
}

#[test]
fn quiet_says_only_what_failed_and_verbose_says_more() {
    let place = Place::with_three();
    let one_line = predicate::function(|text: &str| text.lines().count() == 1);
    place.sharpen().arg("-q").assert().code(1).stderr(contains("broken.obj:2: ").and(one_line));
    place.sharpen().arg("-v").assert().code(1).stderr(contains("in/a.obj: 764 -> 1140 faces\n"));
}

#[test]
fn any_number_of_jobs_and_threads_writes_the_same_bytes() {
    let place = Place::with_three();
    for n in 6..12 {
        write_mesh(&place.path(format!("in/{n}.obj")), &common::chamfered_cube(n, 0.8));
    }
    let outputs = [
        &["--jobs", "1", "--threads", "1"][..],
        &["--jobs", "3", "--threads", "2"],
        &["--jobs", "9"],
        &["--jobs", "2", "--timeout", "200"],
        &["--memory", "1"],
    ]
    .map(|flags| {
        place.sharpen().args(flags).assert().code(1);
        let names = place.files("out");
        let contents: Vec<_> = names.iter().map(|name| place.get(&format!("out/{name}"))).collect();
        fs::remove_dir_all(place.path("out")).unwrap();
        (names, contents)
    });
    assert_eq!(outputs[0].0.len(), 8);
    assert!(outputs.iter().all(|output| *output == outputs[0]));
}

#[test]
fn an_empty_folder_is_no_error() {
    let place = Place::new();
    place.sharpen().args(["--report", "r.jsonl"]).assert().success().stderr("in: no files to sharpen\n");
    assert_eq!(place.get("r.jsonl"), "");
    place.put("in/notes.txt", "no mesh");
    place.sharpen().assert().success().stderr("in: no files to sharpen\n");
}

#[test]
fn include_takes_names_or_paths() {
    let place = Place::new();
    for name in ["a.obj", "b.OBJ", "b/a.obj", "b/c/a.obj", "b/c/d.txt", "x [1].obj"] {
        place.put(format!("in/{name}"), TRIANGLE);
    }
    for (globs, expected) in [
        (&[][..], &["a.obj", "b/a.obj", "b/c/a.obj", "b.OBJ", "x [1].obj"][..]),
        (&["a.*"], &["a.obj", "b/a.obj", "b/c/a.obj"]),
        (&["b/*"], &["b/a.obj"]),
        (&["b/**"], &["b/a.obj", "b/c/a.obj", "b/c/d.txt"]),
        (&["b/**/a.obj", "*.OBJ"], &["b/a.obj", "b/c/a.obj", "b.OBJ"]),
        (&["x \\[1\\].obj"], &["x [1].obj"]),
        (&["nothing"], &[]),
    ] {
        let flags = globs.iter().flat_map(|glob| ["--include", glob]);
        place.sharpen().args(flags).args(["--format", "obj"]).assert().success();
        let mut expected = expected.to_vec();
        expected.sort_unstable();
        let mut files = place.files("out");
        files.sort_unstable();
        assert_eq!(files, expected, "{globs:?}");
        fs::remove_dir_all(place.path("out")).unwrap();
    }
}

#[test]
fn wrong_usage_is_status_2_and_makes_nothing() {
    let place = Place::with_three();
    for flags in [
        &["--jobs", "0"][..],
        &["--timeout", "0"],
        &["--timeout", "-1"],
        &["--timeout", "nan"],
        &["--timeout", "1e99"],
        &["--memory", "0"],
        &["--include", "[a"],
        &["--classes", "classes.ply"],
        &["--sharp-edges", "edges.obj"],
    ] {
        place.sharpen().args(flags).assert().code(2);
        assert!(!place.path("out").exists());
    }
    for flags in
        [&["--resume"][..], &["--include", "*"], &["--jobs", "1"], &["--timeout", "1"], &["--memory", "1"]]
    {
        let refusal = contains("is for folders");
        place.sharpen_alone().args(["in/a.obj", "b.obj"]).args(flags).assert().code(2).stderr(refusal);
    }
    for same in ["in", "./in/", "in/b/.."] {
        let refusal = contains("may not be the input folder");
        place.sharpen_alone().args(["in", same]).assert().code(2).stderr(refusal);
    }
    assert_eq!(place.files("in"), ["a.obj", "b/broken.obj", "b/c/triangle.obj"]);
}

#[test]
fn an_output_folder_that_cannot_be_made_is_one_line() {
    let place = Place::with_three();
    place.put("out", "a file");
    let one_line = predicate::function(|text: &str| text.lines().count() == 1);
    place.sharpen().assert().code(1).stderr(contains("out: cannot make a folder").and(one_line));
    place.sharpen_alone().args(["in", "new", "--report", "no/such/folder"]).assert().code(1);
    assert_eq!(place.files("new"), [] as [&str; 0]);
}

#[test]
fn a_second_run_into_the_same_folder_is_kept_out() {
    let place = Place::with_three();
    fs::create_dir(place.path("out")).unwrap();
    let lock = fs::File::open(place.path("out")).unwrap();
    lock.try_lock().unwrap();
    place.sharpen().assert().code(1).stderr("sharpen: out: another run is writing into this folder\n");
    drop(lock);
    place.sharpen().assert().code(1).stderr(contains("2 sharpened"));
}

/// What a killed run has just forked may hold the lock a little longer.
#[test]
fn a_lock_that_is_let_go_within_a_second_is_waited_for() {
    let place = Place::with_three();
    fs::create_dir(place.path("out")).unwrap();
    let lock = fs::File::open(place.path("out")).unwrap();
    lock.try_lock().unwrap();
    let release = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(300));
        drop(lock);
    });
    place.sharpen().assert().code(1).stderr(contains("2 sharpened, 1 failed"));
    release.join().unwrap();
}

// Resuming.

/// Whether `--resume` leaves the output `name` alone: another content of the same length stays.
fn is_left_alone(place: &Place, name: &str, flags: &[&str]) -> bool {
    let path = place.path(name);
    let other = "x".repeat(fs::metadata(&path).unwrap().len() as usize);
    fs::write(&path, &other).unwrap();
    let run = place.sharpen().arg("--resume").args(flags).unwrap();
    assert!(run.status.success());
    fs::read_to_string(&path).unwrap() == other
}

#[test]
fn resume_skips_what_is_done_and_tries_again_what_failed() {
    let place = Place::with_three();
    place.sharpen().args(["--report", "r"]).assert().code(1);
    let first = place.report("r");
    let summary = contains("in: 0 sharpened, 1 failed, 2 skipped;").and(contains("broken.obj:2:"));
    place.sharpen().args(["--report", "r", "--resume"]).assert().code(1).stderr(summary);
    let second = place.report("r");
    assert_eq!(first["a.obj"], second["a.obj"], "the line of a file that is skipped stays");
    assert_eq!(first.len(), second.len());

    place.put("in/b/broken.obj", TRIANGLE);
    place.put("in/new.obj", TRIANGLE);
    let summary = contains("in: 2 sharpened, 0 failed, 2 skipped;");
    place.sharpen().args(["--report", "r", "--resume"]).assert().success().stderr(summary);
    assert!(place.statuses("r").iter().all(|(_, status)| status == "ok"));
    assert_eq!(place.report("r").len(), 4);
    let summary = contains("in: 0 sharpened, 0 failed, 4 skipped;");
    place.sharpen().args(["--report", "late", "--resume"]).assert().success().stderr(summary);
    assert_eq!(place.report("late"), place.report("r"), "also a report that was not asked for before");
    place.sharpen().assert().success().stderr(contains("in: 4 sharpened, 0 failed, 0 skipped;"));
}

#[test]
fn resume_does_again_what_is_not_the_same() {
    let place = Place::new();
    for name in ["a", "b"] {
        write_mesh(&place.path(format!("in/{name}.obj")), &common::chamfered_cube(6, 0.9));
    }
    place.sharpen().assert().success();
    assert!(is_left_alone(&place, "out/a.obj", &[]));
    assert!(is_left_alone(&place, "out/a.obj", &["--threads", "1", "--jobs", "1", "--timeout", "100", "-q"]));
    assert!(!is_left_alone(&place, "out/a.obj", &["--max-shift", "1"]), "other options");
    assert!(is_left_alone(&place, "out/a.obj", &["--max-shift", "1"]));
    assert!(!is_left_alone(&place, "out/a.obj", &[]), "back to the first options");

    let old = fs::metadata(place.path("in/a.obj")).unwrap().modified().unwrap();
    let set_time = |name: &str, time| {
        fs::File::options().write(true).open(place.path(name)).unwrap().set_modified(time).unwrap();
    };
    set_time("in/a.obj", old - Duration::from_secs(1000));
    assert!(!is_left_alone(&place, "out/a.obj", &[]), "an older input");
    set_time("in/a.obj", SystemTime::now() + Duration::from_secs(1000));
    assert!(!is_left_alone(&place, "out/a.obj", &[]), "an input from the future");
    assert!(is_left_alone(&place, "out/a.obj", &[]), "an input from the future is done once");
    set_time("out/a.obj", old - Duration::from_secs(1000));
    place.sharpen().arg("--resume").assert().success().stderr(contains("1 sharpened, 0 failed, 1 skipped"));
    for change in [
        &|| fs::remove_file(place.path("out/a.obj")).unwrap(),
        &|| place.put("out/a.obj", "cut off"),
        &|| place.put("out/a.obj", ""),
    ] as [&dyn Fn(); 3]
    {
        change();
        let summary = contains("1 sharpened, 0 failed, 1 skipped");
        place.sharpen().arg("--resume").assert().success().stderr(summary);
        assert_eq!(place.get("out/a.obj"), place.get("out/b.obj"));
    }
}

#[test]
fn a_state_that_is_torn_or_gone_or_nonsense_only_costs_time() {
    let place = Place::new();
    for name in ["a", "b", "c"] {
        place.put(format!("in/{name}.obj"), TRIANGLE);
    }
    place.sharpen().args(["--jobs", "1"]).assert().success();
    let state = place.get("out/.sharpen-state.jsonl");
    let lines = |n: usize| state.split_inclusive('\n').take(n).collect::<String>();
    let torn = lines(2) + &state[lines(2).len()..][..30];
    for (text, n_done) in
        [(torn, 2), (String::new(), 0), ("{}\n\0\u{1}\n[]".to_owned(), 0), (lines(1) + "\n\n" + &lines(2), 2)]
    {
        place.put("out/.sharpen-state.jsonl", &text);
        let summary = format!("{} sharpened, 0 failed, {n_done} skipped", 3 - n_done);
        place.sharpen().arg("--resume").assert().success().stderr(contains(summary));
        place.sharpen().arg("--resume").assert().success().stderr(contains("0 sharpened"));
    }
}

#[test]
fn a_run_on_other_files_forgets_nothing() {
    let place = Place::new();
    place.put("in/a.obj", TRIANGLE);
    place.put("in/b.obj", TRIANGLE);
    place.sharpen().args(["--include", "a.*"]).assert().success();
    place.sharpen().args(["--include", "b.*"]).assert().success();
    place.sharpen().arg("--resume").assert().success().stderr(contains("0 sharpened, 0 failed, 2 skipped"));
}

#[test]
fn what_killed_runs_left_is_removed_and_what_is_in_use_stays() {
    let place = Place::with_three();
    for name in ["out/.sharpen-abc.tmp", "out/b/c/.sharpen-def.tmp", "reports/.sharpen-ghi.tmp"] {
        place.put(name, "v 0 0");
    }
    place.put("out/b/c/.sharpen-used.tmp", "v 0 0");
    let used = fs::File::open(place.path("out/b/c/.sharpen-used.tmp")).unwrap();
    used.try_lock().unwrap();
    place.sharpen().args(["--report", "reports/r"]).assert().code(1);
    assert_eq!(place.files("out"), ["a.obj", "b/c/.sharpen-used.tmp", "b/c/triangle.obj"]);
    assert_eq!(place.files("reports"), ["r"]);
}

// Folders in folders, links and other oddities.

#[test]
fn outputs_are_never_inputs() {
    let place = Place::with_three();
    let run = |output: &str, summary: &str| {
        place.sharpen_alone().args(["in", output]).assert().code(1).stderr(contains(summary.to_owned()));
    };
    run("in/out", "2 sharpened, 1 failed, 0 skipped");
    run("in/out", "2 sharpened, 1 failed, 0 skipped");
    run("in/b/other", "in/out: holds the outputs of another run");
    run("out", "2 sharpened, 1 failed, 2 skipped");
    assert_eq!(place.files("in/b/other"), ["a.obj", "b/c/triangle.obj"]);
    assert_eq!(place.files("out"), ["a.obj", "b/c/triangle.obj"]);
    let summary = contains("in/out: 2 sharpened, 0 failed, 0 skipped");
    place.sharpen_alone().args(["in/out", "second"]).assert().success().stderr(summary);
}

#[test]
fn an_input_is_never_an_output() {
    let place = Place::new();
    place.put("in/a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 9 9 9\nf 1 2 3\n");
    place.put("in/in/a.obj", TRIANGLE);
    let reason = contains("in/in/a.obj: its output would lie among the inputs");
    place.sharpen_alone().args(["in", "."]).assert().code(1).stderr(reason);
    assert!(place.get("in/a.obj").contains("9 9 9"));
    assert_eq!(place.get("a.obj"), place.get("in/a.obj"));
}

#[cfg(unix)]
#[test]
fn links_to_files_are_read_and_links_to_folders_are_not_followed() {
    use std::os::unix::fs::symlink;
    let place = Place::new();
    place.put("elsewhere/a.obj", TRIANGLE);
    symlink("../elsewhere/a.obj", place.path("in/file.obj")).unwrap();
    symlink("../elsewhere", place.path("in/folder")).unwrap();
    symlink(".", place.path("in/circle")).unwrap();
    symlink("nowhere", place.path("in/dangling.obj")).unwrap();
    symlink("itself.obj", place.path("in/itself.obj")).unwrap();
    symlink("in", place.path("link")).unwrap();
    symlink("target", place.path("out")).unwrap();
    fs::create_dir(place.path("target")).unwrap();
    place.sharpen_alone().args(["link", "out", "--report", "r"]).assert().code(1);
    let expected = [
        ("circle", "skipped"),
        ("dangling.obj", "failed"),
        ("file.obj", "ok"),
        ("folder", "skipped"),
        ("itself.obj", "failed"),
    ];
    assert_eq!(place.statuses("r"), statuses(expected));
    assert_eq!(place.files("target"), ["file.obj"]);
    assert!(fs::symlink_metadata(place.path("target/file.obj")).unwrap().is_file());
}

#[cfg(unix)]
#[test]
fn a_link_in_the_output_folder_never_leads_to_harm() {
    use std::os::unix::fs::symlink;
    let place = Place::with_three();
    let before = place.get("in/a.obj");
    fs::create_dir(place.path("out")).unwrap();
    symlink("../in/a.obj", place.path("out/a.obj")).unwrap();
    symlink("../in/b", place.path("out/b")).unwrap();
    let reasons = contains("out/a.obj: is a link to its input in/a.obj")
        .and(contains("out/b/c/triangle.obj: is a link to its input"));
    place.sharpen().assert().code(1).stderr(reasons);
    assert_eq!(place.get("in/a.obj"), before);
    assert_eq!(place.get("in/b/c/triangle.obj"), TRIANGLE);
}

#[cfg(unix)]
#[test]
fn what_is_no_regular_file_is_skipped() {
    let place = Place::new();
    place.put("in/a.obj", TRIANGLE);
    fs::create_dir(place.path("in/folder.obj")).unwrap();
    let Ok(status) = std::process::Command::new("mkfifo").arg(place.path("in/pipe.obj")).status() else {
        return eprintln!("skipped: no mkfifo");
    };
    assert!(status.success());
    place.sharpen().args(["--report", "r"]).assert().success().stderr(contains("is not a regular file"));
    assert_eq!(place.statuses("r"), statuses([("a.obj", "ok"), ("pipe.obj", "skipped")]));
}

#[cfg(unix)]
#[test]
fn what_cannot_be_read_fails_and_the_rest_goes_on() {
    use std::os::unix::fs::PermissionsExt;
    let place = Place::with_three();
    for (name, mode) in [("in/a.obj", 0o000), ("in/b/c", 0o000)] {
        fs::set_permissions(place.path(name), fs::Permissions::from_mode(mode)).unwrap();
    }
    if fs::read(place.path("in/a.obj")).is_ok() {
        return eprintln!("skipped: this user may read everything");
    }
    place.put("in/z.obj", TRIANGLE);
    place.sharpen().args(["--report", "r"]).assert().code(1);
    let expected = [("a.obj", "failed"), ("b/broken.obj", "failed"), ("b/c", "failed"), ("z.obj", "ok")];
    assert_eq!(place.statuses("r"), statuses(expected));
    fs::set_permissions(place.path("in/b/c"), fs::Permissions::from_mode(0o755)).unwrap();
}

#[cfg(target_os = "linux")]
#[test]
fn any_name_will_do() {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;
    let place = Place::new();
    let names: [&[u8]; 7] = [
        b"\xff.obj",
        b"\xfe.obj",
        b"a b\n.obj",
        "ü.obj".as_bytes(),
        b"-q.obj",
        b"--\xff/--help.obj",
        b"{}.obj",
    ];
    let path = |folder: &str, name: &[u8]| place.path(folder).join(OsStr::from_bytes(name));
    for name in names {
        fs::create_dir_all(path("in", name).parent().unwrap()).unwrap();
        fs::write(path("in", name), TRIANGLE).unwrap();
    }
    for flags in [&[][..], &["--timeout", "100"]] {
        place.sharpen().args(flags).args(["--report", "r"]).assert().success();
        assert!(names.iter().all(|name| fs::read(path("out", name)).unwrap() == TRIANGLE.as_bytes()));
        assert_eq!(place.get("r").lines().count(), 7);
        let done: Vec<Value> =
            place.get("r").lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        assert!(done.iter().any(|line| line["name_bytes"] == "ff2e6f626a" && line["name"] == "\u{fffd}.obj"));
        place
            .sharpen()
            .arg("--resume")
            .assert()
            .success()
            .stderr(contains("0 sharpened, 0 failed, 7 skipped"));
        fs::remove_dir_all(path("out", b"")).unwrap();
    }
    // A folder with such a name, in front of which stands no `./`.
    fs::rename(place.path("in"), place.path("-in")).unwrap();
    place.sharpen_alone().args(["--timeout", "100", "--", "-in", "-out"]).assert().success();
    assert_eq!(place.files("-out").len(), 7);
}

// Time and processes.

#[test]
fn a_file_that_takes_too_long_is_given_up() {
    let place = Place::new();
    write_mesh(&place.path("in/large.obj"), &common::sphere(if cfg!(debug_assertions) { 5 } else { 7 }));
    place.put("in/small.obj", TRIANGLE);
    let reason = contains("in/large.obj: took longer than 1.5 seconds");
    place
        .sharpen()
        .args(["--timeout", "1.5", "--bend", "4", "--report", "r"])
        .assert()
        .code(1)
        .stderr(reason);
    assert_eq!(place.statuses("r"), statuses([("large.obj", "failed"), ("small.obj", "ok")]));
    assert!(place.report("r")["large.obj"]["seconds"].as_f64().unwrap() >= 1.5);
    assert_eq!(place.files("out"), ["small.obj"]);
}

#[test]
fn a_file_in_a_process_of_its_own_says_the_same() {
    let place = Place::with_three();
    place.sharpen().args(["--report", "a"]).assert().code(1);
    let broken = contains("sharpen: in/b/broken.obj:2: ").and(contains("2 sharpened, 1 failed, 0 skipped"));
    place.sharpen().args(["--report", "b", "--timeout", "100"]).assert().code(1).stderr(broken);
    assert_eq!(place.statuses("a"), place.statuses("b"));
    assert_eq!(place.report("b")["a.obj"]["report"]["found"], place.report("a")["a.obj"]["report"]["found"]);
}

// Other programs that walk.

/// Runs a script here in which `$SHARPEN` is the binary; `None` where one of `programs` is missing.
fn shell(place: &Place, programs: &[&str], script: &str) -> Option<std::process::Output> {
    let is_there = |name: &&str| {
        std::env::split_paths(&std::env::var_os("PATH")?).any(|p| p.join(name).is_file()).then_some(())
    };
    if let Some(missing) = programs.iter().find(|name| is_there(name).is_none()) {
        eprintln!("skipped: no {missing}");
        return None;
    }
    let mut command = std::process::Command::new("sh");
    command.args(["-ec", script]).current_dir(place.0.path());
    command.env("SHARPEN", assert_cmd::cargo::cargo_bin("sharpen"));
    Some(command.output().unwrap())
}

#[test]
fn find_and_xargs_run_files_in_parallel() {
    let place = Place::with_three();
    place.put("in/name with 'quotes' and spaces.obj", TRIANGLE);
    let script = "find in -name '*.obj' -print0 | xargs -0 -P 4 -I{} \"$SHARPEN\" -q {} {}";
    let Some(output) = shell(&place, &["find", "xargs"], script) else { return };
    assert_eq!(output.status.code(), Some(123), "one of them failed");
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(said.lines().count(), 1);
    assert!(said.starts_with("sharpen: in/b/broken.obj:2: "), "{said}");
    assert_eq!(io::read(&place.path("in/a.obj")).unwrap().faces.len(), 1140);
    assert_eq!(place.files("in").len(), 4);
}

#[test]
fn parallel_runs_files_in_parallel() {
    let place = Place::with_three();
    fs::create_dir(place.path("out")).unwrap();
    let script = "parallel \"$SHARPEN\" -q {} out/{/} ::: in/*.obj in/*/*.obj";
    let Some(output) = shell(&place, &["parallel"], script) else { return };
    assert_eq!(output.status.code(), Some(1), "one of them failed");
    assert_eq!(place.files("out"), ["a.obj"]);
}

#[test]
fn make_makes_what_is_older_or_missing() {
    let place = Place::with_three();
    fs::rename(place.path("in/b/broken.obj"), place.path("in/broken.obj")).unwrap();
    place.put("in/c.obj", TRIANGLE);
    fs::create_dir(place.path("out")).unwrap();
    let rules = "all: $(patsubst in/%,out/%,$(wildcard in/*.obj))\nout/%.obj: in/%.obj ; $(SHARPEN) $< $@\n";
    place.put("Makefile", rules);
    let Some(output) = shell(&place, &["make"], "make -k -j 2") else { return };
    assert_eq!(output.status.code(), Some(2), "one of them failed");
    assert_eq!(place.files("out"), ["a.obj", "c.obj"]);
    fs::remove_file(place.path("in/broken.obj")).unwrap();
    let output = shell(&place, &["make"], "make").unwrap();
    assert!(String::from_utf8(output.stdout).unwrap().contains("Nothing to be done"));
    let later = SystemTime::now() + Duration::from_secs(5);
    fs::File::options().write(true).open(place.path("in/c.obj")).unwrap().set_modified(later).unwrap();
    let output = shell(&place, &["make"], "make").unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("in/c.obj: nothing to sharpen") && !said.contains("a.obj"), "{said}");
}

#[test]
fn a_terminal_shows_a_bar_and_a_pipe_none() {
    let place = Place::with_three();
    place.sharpen().assert().code(1).stderr(contains("\u{1b}").not().and(contains("\r").not()));
    let script = "script -qec '\"$SHARPEN\" in out' /dev/null < /dev/null || true";
    let Some(output) = shell(&place, &["script"], script) else { return };
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(said.contains("/3 files") && said.contains(" faces, ") && said.contains(" left"), "{said:?}");
    assert!(said.contains("2 sharpened, 1 failed, 0 skipped"), "{said:?}");
}

// Kills.

/// The small version of `scripts/batch_torture.py`, which says what it checks.
#[cfg(target_os = "linux")]
fn torture(flags: &[&str]) {
    let place = tempfile::tempdir().unwrap();
    let mut command = std::process::Command::new("python3");
    command.arg(concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/batch_torture.py"));
    command.args(["--files", "300", "--binary"]).arg(assert_cmd::cargo::cargo_bin("sharpen"));
    command.arg("--place").arg(place.path()).args(flags);
    match command.output() {
        Ok(output) => assert!(output.status.success(), "{output:#?}"),
        Err(error) => eprintln!("skipped: no python3: {error}"),
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_run_that_is_killed_again_and_again_loses_nothing() {
    torture(&[]);
}

#[cfg(target_os = "linux")]
#[test]
fn so_does_one_with_a_process_for_each_file() {
    torture(&["--isolate", "--jobs", "4", "--files", "100"]);
}
