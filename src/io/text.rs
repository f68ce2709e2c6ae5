//! Reading text by the byte: lines, words, numbers. Shared by every text format.

use crate::error::{Fault, Quoted};

/// A place in a text. It never stands beyond the end.
#[derive(Clone, Debug)]
pub(super) struct Cursor<'a> {
    pub bytes: &'a [u8],
    pub at: usize,
    /// Line of `at`, counted from 1.
    pub line: usize,
}

/// Whether `byte` parts words within a line.
#[inline]
pub(super) fn is_blank(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | 0x0b | 0x0c)
}

/// Whether `byte` ends a line. A file may use LF, CRLF or CR.
#[inline]
fn is_line_end(byte: u8) -> bool {
    matches!(byte, b'\n' | b'\r')
}

impl<'a> Cursor<'a> {
    pub fn new(bytes: &'a [u8], line: usize) -> Self {
        Self { bytes, at: 0, line }
    }

    /// The byte here; 0 at the end, which is neither blank nor part of any number.
    #[inline]
    pub fn peek(&self) -> u8 {
        self.bytes.get(self.at).copied().unwrap_or(0)
    }

    pub fn is_at_end(&self) -> bool {
        self.at >= self.bytes.len()
    }

    /// Steps over one line end, if one stands here, and counts it.
    #[inline]
    pub fn skip_line_end(&mut self) -> bool {
        let length = match self.bytes.get(self.at..) {
            Some([b'\r', b'\n', ..]) => 2,
            Some([b'\r' | b'\n', ..]) => 1,
            _ => return false,
        };
        self.at += length;
        self.line += 1;
        true
    }

    /// Steps over blanks, and over a backslash at the end of a line with that end.
    #[inline]
    pub fn skip_blanks(&mut self) {
        loop {
            match self.peek() {
                byte if is_blank(byte) => self.at += 1,
                b'\\' if self.bytes.get(self.at + 1).is_none_or(|&b| is_line_end(b)) => {
                    self.at += 1;
                    self.skip_line_end();
                }
                _ => return,
            }
        }
    }

    /// Steps over blanks; true when nothing but a comment follows on the line.
    #[inline]
    pub fn ends_statement(&mut self) -> bool {
        self.skip_blanks();
        matches!(self.peek(), b'\n' | b'\r' | b'#') || self.is_at_end()
    }

    /// Steps to the start of the next line, without a thought for backslashes.
    #[inline]
    pub fn skip_line(&mut self) {
        let rest = &self.bytes[self.at..];
        self.at += memchr::memchr2(b'\n', b'\r', rest).unwrap_or(rest.len());
        self.skip_line_end();
    }

    /// Steps over a whole statement and gives its bytes, without its last line end. A line that ends in
    /// a backslash goes on in the next one, unless it holds a `#`: a comment may end in a Windows path.
    #[inline]
    pub fn statement(&mut self) -> &'a [u8] {
        let start = self.at;
        loop {
            let line = self.at;
            let rest = &self.bytes[line..];
            self.at += memchr::memchr2(b'\n', b'\r', rest).unwrap_or(rest.len());
            let end = self.at;
            let is_last = !self.skip_line_end();
            let line = &self.bytes[line..end];
            if is_last || line.last() != Some(&b'\\') || line.contains(&b'#') {
                return &self.bytes[start..end];
            }
        }
    }

    /// The bytes from here to the next blank or line end.
    pub fn peek_word(&self) -> &'a [u8] {
        let rest = &self.bytes[self.at..];
        let end = rest.iter().position(|&b| is_blank(b) || is_line_end(b));
        &rest[..end.unwrap_or(rest.len())]
    }

    /// The word that begins here, stepped over.
    pub fn take_word(&mut self) -> &'a [u8] {
        let word = self.peek_word();
        self.at += word.len();
        word
    }

    /// The rest of the line without blanks round it; steps to the next line.
    pub fn rest_of_line(&mut self) -> &'a [u8] {
        let start = self.at;
        self.skip_line();
        self.bytes[start..self.at].trim_ascii()
    }

    /// Steps over blanks; true when nothing follows on the line.
    pub fn ends_line(&mut self) -> bool {
        while is_blank(self.peek()) {
            self.at += 1;
        }
        is_line_end(self.peek()) || self.is_at_end()
    }

    /// Whether a word may end here: before a blank, a line end, a comment, a continuation, the end.
    #[inline]
    pub fn ends_word(&self) -> bool {
        match self.peek() {
            // 1.#IND and 1.#QNAN are numbers gone wrong, not a 1 with a comment.
            b'#' => self.at > 0 && self.bytes[self.at - 1] != b'.',
            b'\\' => self.bytes.get(self.at + 1).is_none_or(|&b| is_line_end(b)),
            byte => is_blank(byte) || is_line_end(byte) || self.is_at_end(),
        }
    }

    /// Reads a finite number that begins here.
    #[inline]
    pub fn number(&mut self) -> Result<f64, Fault> {
        let start = self.at;
        match fast_float2::parse_partial::<f64, _>(&self.bytes[start..]) {
            Ok((value, length)) => {
                self.at += length;
                if self.ends_word() && value.is_finite() {
                    return Ok(value);
                }
                self.at = start;
                Err(self.not_a_number(value.is_finite() || !self.ends_word_after(length)))
            }
            Err(_) => Err(self.not_a_number(true)),
        }
    }

    pub fn ends_word_after(&self, length: usize) -> bool {
        Self { at: self.at + length, ..self.clone() }.ends_word()
    }

    #[cold]
    fn not_a_number(&self, is_word: bool) -> Fault {
        let word = self.peek_word();
        let reason = match is_word {
            false => "is not a finite number",
            true if is_with_comma(word) => "is not a number (a comma is no decimal sign)",
            true => "is not a number",
        };
        self.fault(format_args!("{} {reason}", Quoted(word)))
    }

    /// Reads a whole number that begins here, up to a slash or the end of the word. Too large a number
    /// is `i64::MAX` or `-i64::MAX`. None when there is no such number; then nothing is read.
    #[inline]
    pub fn whole(&mut self) -> Option<i64> {
        let start = self.at;
        let negative = self.peek() == b'-';
        self.at += usize::from(matches!(self.peek(), b'-' | b'+'));
        let first = self.at;
        let mut value = 0i64;
        while let digit @ b'0'..=b'9' = self.peek() {
            value = value.saturating_mul(10).saturating_add(i64::from(digit - b'0'));
            self.at += 1;
        }
        if self.at == first || !(self.peek() == b'/' || self.ends_word()) {
            self.at = start;
            return None;
        }
        Some(if negative { -value } else { value })
    }

    /// A fault on this line.
    #[cold]
    pub fn fault(&self, reason: impl std::fmt::Display) -> Fault {
        Fault { line: self.line, reason: reason.to_string() }
    }
}

/// Appends the shortest decimal that reads back as `number`; a whole one without ".0".
pub(super) fn push_number(out: &mut Vec<u8>, number: f64) {
    let mut buffer = zmij::Buffer::new();
    let text = buffer.format(number);
    out.extend_from_slice(text.strip_suffix(".0").unwrap_or(text).as_bytes());
}

/// Appends a whole number.
pub(super) fn push_whole(out: &mut Vec<u8>, number: usize) {
    out.extend_from_slice(itoa::Buffer::new().format(number).as_bytes());
}

/// Appends a line whose text may come from a format in which a line ends otherwise.
pub(super) fn push_one_line(out: &mut Vec<u8>, text: &[u8]) {
    out.extend(text.iter().map(|&byte| if is_line_end(byte) { b' ' } else { byte }));
    out.push(b'\n');
}

/// Whether `word` would be a number if its commas were points.
fn is_with_comma(word: &[u8]) -> bool {
    let with_points: Vec<u8> = word.iter().map(|&b| if b == b',' { b'.' } else { b }).collect();
    word.contains(&b',') && fast_float2::parse::<f64, _>(&with_points).is_ok()
}
