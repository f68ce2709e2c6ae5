//! The head of a PLY file.

use super::super::looks_like;
use crate::attributes::{Encoding, Kind, Text};
use crate::error::{Fault, Quoted};

/// What the head says.
pub(super) struct Header {
    pub encoding: Encoding,
    pub elements: Vec<Element>,
    pub comments: Vec<Text>,
    pub info: Vec<Text>,
    /// Where the body begins, and in which line.
    pub body: usize,
    pub body_line: usize,
}

/// One kind of element.
pub(super) struct Element {
    pub name: String,
    pub count: usize,
    pub properties: Vec<Property>,
    pub line: usize,
}

/// One property of each element of a kind.
pub(super) struct Property {
    pub name: String,
    pub kind: Kind,
    /// For a list, how its length is stored.
    pub list: Option<Kind>,
}

impl Property {
    pub fn is_scalar(&self, name: &str) -> bool {
        self.name == name && self.list.is_none()
    }
}

impl Header {
    pub fn parse(bytes: &[u8]) -> Result<Self, Fault> {
        let Some(line_end) = line_end_after_magic(bytes) else {
            let seems = looks_like(bytes).map_or(String::new(), |kind| format!("; this looks like {kind}"));
            return Err(Fault { line: 1, reason: format!("a PLY file begins with \"ply\"{seems}") });
        };
        let mut header = Self {
            encoding: Encoding::Ascii,
            elements: Vec::new(),
            comments: Vec::new(),
            info: Vec::new(),
            body: 3 + line_end.len(),
            body_line: 2,
        };
        let mut has_format = false;
        loop {
            let rest = &bytes[header.body..];
            let Some(length) = memchr::memmem::find(rest, line_end) else {
                return Err(header.fault("the head has no \"end_header\"".to_owned()));
            };
            let line = &rest[..length];
            header.body += length + line_end.len();
            let word_end = line.iter().position(u8::is_ascii_whitespace).unwrap_or(line.len());
            let (word, after) = line.split_at(word_end);
            match word {
                b"comment" => header.comments.push(after.into()),
                b"obj_info" => header.info.push(after.trim_ascii().into()),
                b"format" => {
                    header.encoding = encoding(after).ok_or_else(|| header.unknown("format", after))?;
                    has_format = true;
                }
                b"element" => {
                    let element =
                        element(after, header.body_line).ok_or_else(|| header.unknown("element", after))?;
                    header.elements.push(element);
                }
                b"property" => {
                    let property = property(after).ok_or_else(|| header.unknown("property", after))?;
                    let Some(element) = header.elements.last_mut() else {
                        return Err(header.fault("a property before the first element".to_owned()));
                    };
                    element.properties.push(property);
                }
                b"" => {}
                b"end_header" => break,
                _ => return Err(header.fault(format!("{} does not belong into a PLY head", Quoted(word)))),
            }
            header.body_line += 1;
        }
        header.body_line += 1;
        if has_format { Ok(header) } else { Err(header.fault("the head has no \"format\"".to_owned())) }
    }

    pub fn element(&self, name: &str) -> Option<&Element> {
        self.elements.iter().find(|element| element.name == name)
    }

    fn fault(&self, reason: String) -> Fault {
        Fault { line: self.body_line, reason }
    }

    fn unknown(&self, what: &str, words: &[u8]) -> Fault {
        self.fault(format!("{} is no {what} of a PLY file", Quoted(words.trim_ascii())))
    }
}

/// How lines end in this file, told by the first one. In a binary body every byte counts.
fn line_end_after_magic(bytes: &[u8]) -> Option<&'static [u8]> {
    let rest = bytes.strip_prefix(b"ply")?;
    let ends: [&[u8]; 3] = [b"\r\n", b"\n", b"\r"];
    ends.into_iter().find(|&end| rest.starts_with(end))
}

fn words(bytes: &[u8]) -> Vec<&str> {
    std::str::from_utf8(bytes).map(|line| line.split_ascii_whitespace().collect()).unwrap_or_default()
}

fn encoding(line: &[u8]) -> Option<Encoding> {
    let words = words(line);
    let all = [Encoding::Ascii, Encoding::LittleEndian, Encoding::BigEndian];
    all.into_iter().find(|encoding| words == [encoding.name(), "1.0"])
}

fn element(line: &[u8], number: usize) -> Option<Element> {
    let [name, count] = words(line)[..] else { return None };
    Some(Element { name: name.to_owned(), count: count.parse().ok()?, properties: Vec::new(), line: number })
}

fn property(line: &[u8]) -> Option<Property> {
    let (list, kind, name) = match words(line)[..] {
        ["list", length, kind, name] => {
            (Some(kind_called(length).filter(|kind| kind.is_whole())?), kind, name)
        }
        [kind, name] => (None, kind, name),
        _ => return None,
    };
    Some(Property { name: name.to_owned(), kind: kind_called(kind)?, list })
}

fn kind_called(name: &str) -> Option<Kind> {
    use Kind::{F32, F64, I8, I16, I32, U8, U16, U32};
    [I8, U8, I16, U16, I32, U32, F32, F64].into_iter().find(|kind| kind.names().contains(&name))
}
