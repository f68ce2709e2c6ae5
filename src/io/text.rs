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
        if self.peek() == b'\n' {
            self.at += 1; // As behind nearly all statements.
            self.line += 1;
            return;
        }
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
        if let Some((value, length)) = plain_decimal(&self.bytes[start..]) {
            self.at += length;
            if self.ends_word() {
                return Ok(value);
            }
            self.at = start;
        }
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
        let digits = &self.bytes[self.at..];
        let (value, n) = match up_to_eight_digits(digits) {
            Some((value, n)) if n < 8 => (value as i64, n),
            _ => saturating_whole(digits),
        };
        self.at += n;
        if n == 0 || !(self.peek() == b'/' || self.ends_word()) {
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

/// The digits that begin `bytes` as a whole number, and how many they are; at most `i64::MAX`.
fn saturating_whole(bytes: &[u8]) -> (i64, usize) {
    let n = bytes.iter().position(|byte| !byte.is_ascii_digit()).unwrap_or(bytes.len());
    let add = |value: i64, digit: &u8| value.saturating_mul(10).saturating_add(i64::from(digit - b'0'));
    (bytes[..n].iter().fold(0, add), n)
}

/// The digits that begin `bytes` as a whole number, and how many they are: up to eight, all at once. None near the
/// end of the text.
#[inline]
pub(super) fn up_to_eight_digits(bytes: &[u8]) -> Option<(u64, usize)> {
    const EACH: u64 = 0x0101_0101_0101_0101;
    // The first digit is the lowest byte; a digit becomes its value, any other byte more than nine.
    let word = u64::from_le_bytes(*bytes.first_chunk()?) ^ (EACH * u64::from(b'0'));
    let others = (word.wrapping_add(EACH * (0x80 - 10)) | word) & (EACH * 0x80);
    let n = others.trailing_zeros() / 8;
    if n == 0 {
        return Some((0, 0));
    }
    // Leading zeros in place of what follows; then pairs of digits, and the four pairs by their weights.
    let digits = word << (64 - 8 * n);
    let pairs = digits.wrapping_mul(10).wrapping_add(digits >> 8);
    let every_other = |pairs: u64| pairs & 0x0000_00ff_0000_00ff;
    let sum = every_other(pairs)
        .wrapping_mul(100 + (1_000_000 << 32))
        .wrapping_add(every_other(pairs >> 16).wrapping_mul(1 + (10_000 << 32)));
    Some((sum >> 32, n as usize))
}

/// The number that begins `bytes`, and how long it is, if it has at most 15 digits and no exponent: both its
/// digits as a whole number and the power of ten to divide them by are exact, so that one division rounds it
/// as it should (Clinger 1990). None where anything else may follow that belongs to it.
#[inline]
pub(super) fn plain_decimal(bytes: &[u8]) -> Option<(f64, usize)> {
    const MOST_DIGITS: usize = 15;
    const POWERS: [u64; MOST_DIGITS + 1] = {
        let mut powers = [1; MOST_DIGITS + 1];
        let mut i = 1;
        while i <= MOST_DIGITS {
            powers[i] = 10 * powers[i - 1];
            i += 1;
        }
        powers
    };
    let sign = usize::from(bytes.first() == Some(&b'-'));
    let (mut digits, n_whole) = up_to_eight_digits(bytes.get(sign..)?)?;
    let mut at = sign + n_whole;
    let mut n_decimals = 0;
    if bytes.get(at) == Some(&b'.') {
        at += 1;
        // Eight decimals, and then some more.
        for _ in 0..2 {
            let (more, n) = up_to_eight_digits(bytes.get(at..)?)?;
            n_decimals += n;
            at += n;
            if n_whole + n_decimals > MOST_DIGITS {
                return None;
            }
            digits = digits * POWERS[n] + more;
            if n < 8 {
                break;
            }
        }
        if n_decimals == 0 {
            return None;
        }
    }
    let goes_on = matches!(bytes.get(at), Some(b'0'..=b'9' | b'.' | b'e' | b'E'));
    if n_whole == 0 || goes_on {
        return None;
    }
    // Both are below 2^63: one instruction makes a float of a signed number, several of an unsigned one.
    let value = digits.cast_signed() as f64 / POWERS[n_decimals].cast_signed() as f64;
    Some((if sign == 1 { -value } else { value }, at))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_read_as_the_standard_library_reads_them() {
        for text in [
            "",
            "7",
            "07",
            "42/",
            "999999",
            "1234567 ",
            "12345678",
            "123456789",
            "9a9",
            "/1",
            ":1",
            "\u{b1}1",
        ] {
            let mut padded = text.as_bytes().to_vec();
            padded.resize(16, b' ');
            let n = padded.iter().take(8).take_while(|byte| byte.is_ascii_digit()).count();
            let value = text[..n].parse().unwrap_or(0);
            assert_eq!(up_to_eight_digits(&padded), Some((value, n)), "{text:?}");
        }
        assert_eq!(up_to_eight_digits(b"1234567"), None);
    }

    #[test]
    fn numbers_are_read_as_the_standard_library_reads_them() {
        let mut state = 1u64;
        // So many random digits.
        let mut digits = |n: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            format!("{:017}", (state >> 7) % 10u64.pow(17))[..n].to_owned()
        };
        for i in 0..20_000 {
            let (whole, decimals) = (digits(1 + i % 9), digits(1 + i % 17));
            for text in [format!("{whole}.{decimals}"), format!("-{whole}.{decimals}"), whole.clone()] {
                let expected: f64 = text.parse().unwrap();
                for end in [" ", "\n", " 1.5 2.5 3.5\n", "e2 ", ""] {
                    let line = format!("{text}{end}");
                    let expected = if end == "e2 " { format!("{text}e2").parse().unwrap() } else { expected };
                    let found = Cursor::new(line.as_bytes(), 1).number().unwrap();
                    assert_eq!(found.to_bits(), expected.to_bits(), "{line:?}");
                }
            }
        }
        for text in ["1.", ".5", "+1.5", "1.5.2", "1..5", "-", "-."] {
            let padded = format!("{text}          ");
            assert_eq!(plain_decimal(padded.as_bytes()), None, "{text:?}");
        }
    }

    #[test]
    fn whole_numbers_saturate() {
        let whole = |text: &str| Cursor::new(text.as_bytes(), 1).whole();
        assert_eq!(whole("12345678 "), Some(12_345_678));
        assert_eq!(whole("-123456789/1"), Some(-123_456_789));
        assert_eq!(whole("99999999999999999999 "), Some(i64::MAX));
        assert_eq!([whole("x"), whole("-"), whole("1x"), whole("")], [None; 4]);
        assert_eq!(whole("+7"), Some(7));
    }
}
