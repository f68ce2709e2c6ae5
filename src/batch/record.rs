//! A line of the report: what became of one file.

use std::path::{MAIN_SEPARATOR_STR, Path};

use serde::{Deserialize, Serialize};
use sharpen::Report;

/// The name of a file below its folder, as JSON can hold it: every name has one and no two the same.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Name {
    /// With slashes. What is no Unicode is replaced.
    pub name: String,
    /// All bytes in hexadecimal, where something was replaced.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    name_bytes: Option<String>,
}

impl Name {
    pub fn of(path: &Path) -> Self {
        let hexadecimal = || path.as_os_str().as_encoded_bytes().iter().map(|b| format!("{b:02x}")).collect();
        Self {
            name: path.to_string_lossy().replace(MAIN_SEPARATOR_STR, "/"),
            name_bytes: path.to_str().is_none().then(hexadecimal),
        }
    }
}

/// What became of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// Its output is whole.
    Ok,
    /// It has no output, or an old one.
    Failed,
    /// Nothing was tried.
    Skipped,
}

/// A line of the report.
#[derive(Debug, Serialize)]
pub struct Line {
    #[serde(flatten)]
    pub name: Name,
    pub status: Status,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    pub seconds: f64,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notices: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub report: Option<Report>,
}

impl Line {
    /// A file that was not sharpened, for a reason.
    pub fn without_mesh(name: Name, status: Status, reason: String) -> Self {
        Self { name, status, reason: Some(reason), seconds: 0.0, notices: Vec::new(), report: None }
    }

    pub fn to_json(&self) -> serde_json::Result<String> {
        serde_json::to_string(self)
    }
}

/// What of a line is needed again.
#[derive(Debug, Deserialize)]
pub struct Glance {
    pub status: Status,
    pub reason: Option<String>,
    #[serde(default)]
    pub notices: Vec<String>,
    pub report: Option<Sizes>,
}

/// The meshes before and after.
#[derive(Debug, Deserialize)]
pub struct Sizes {
    pub input: Faces,
    pub output: Faces,
}

/// A number of faces.
#[derive(Debug, Deserialize)]
pub struct Faces {
    pub faces: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_can_be_read_again() {
        let name = Name::of(Path::new("a/ü \"b\"\n.obj"));
        let report = Report::default();
        let line = Line { report: Some(report), ..Line::without_mesh(name, Status::Ok, "x\ny".to_owned()) };
        let text = line.to_json().unwrap();
        assert!(!text.contains('\n'), "{text}");
        let glance: Glance = serde_json::from_str(&text).unwrap();
        assert_eq!((glance.status, glance.reason), (Status::Ok, line.reason));
        assert_eq!(serde_json::from_str::<Name>(&text).unwrap(), line.name);
        assert_eq!(glance.report.unwrap().output.faces, 0);
    }

    #[cfg(unix)]
    #[test]
    fn names_that_are_no_unicode_stay_apart() {
        use std::ffi::OsStr;
        use std::os::unix::ffi::OsStrExt;
        let [a, b] = [b"a\xff", b"a\xfe"].map(|bytes| Name::of(Path::new(OsStr::from_bytes(bytes))));
        assert_ne!(a, b);
        let text = serde_json::to_string(&a).unwrap();
        assert_eq!(text, "{\"name\":\"a\u{fffd}\",\"name_bytes\":\"61ff\"}");
        assert_eq!(serde_json::from_str::<Name>(&text).unwrap(), a);
    }
}
