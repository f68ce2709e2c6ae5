//! The body of a PLY file, number by number.

use super::super::text::Cursor;
use super::header::{Element, Header, Property};
use crate::attributes::{Encoding, Kind};
use crate::error::{Fault, Quoted};

/// The numbers of the body.
pub(super) enum Body<'a> {
    Text(Cursor<'a>),
    Binary { rest: &'a [u8], is_big: bool, line: usize },
}

impl<'a> Body<'a> {
    pub fn new(bytes: &'a [u8], header: &Header) -> Self {
        let (rest, line) = (&bytes[header.body..], header.body_line);
        match header.encoding {
            Encoding::Ascii => Self::Text(Cursor::new(rest, line)),
            Encoding::LittleEndian => Self::Binary { rest, is_big: false, line },
            Encoding::BigEndian => Self::Binary { rest, is_big: true, line },
        }
    }

    pub fn fault(&self, reason: impl std::fmt::Display) -> Fault {
        let line = match self {
            Self::Text(text) => text.line,
            Self::Binary { line, .. } => *line,
        };
        Fault { line, reason: reason.to_string() }
    }

    /// Refuses an element of which there cannot be as many as the head says, before memory is taken.
    pub fn check_room(&self, element: &Element) -> Result<(), Fault> {
        let (room, least) = match self {
            // A digit and a blank each; the last blank may be missing.
            Self::Text(text) => (text.bytes.len() - text.at + 1, 2 * element.properties.len()),
            Self::Binary { rest, .. } => {
                let sizes =
                    element.properties.iter().map(|property| property.list.unwrap_or(property.kind).size());
                (rest.len(), sizes.sum())
            }
        };
        match room.checked_div(least) {
            Some(most) if most < element.count => {
                let (count, name) = (element.count, &element.name);
                Err(self
                    .fault(format_args!("the file is too short for {count} x \"{name}\" ({most} at most)")))
            }
            _ => Ok(()),
        }
    }

    /// The next number.
    #[inline]
    pub fn number(&mut self, kind: Kind) -> Result<f64, Fault> {
        match self {
            Self::Text(text) => text_number(text),
            Self::Binary { rest, is_big, .. } => match binary_number(rest, kind, *is_big) {
                Some(number) => Ok(number),
                None => Err(self.fault("the file ends too early")),
            },
        }
    }

    /// The next value: a number, or for a list its length; what is in the list is passed over.
    #[inline]
    pub fn value(&mut self, property: &Property) -> Result<f64, Fault> {
        if property.list.is_none() {
            return self.number(property.kind);
        }
        let length = self.length(property)?;
        for _ in 0..length {
            self.number(property.kind)?;
        }
        Ok(length as f64)
    }

    /// The length of a list.
    #[inline]
    pub fn length(&mut self, property: &Property) -> Result<usize, Fault> {
        let length = self.number(property.list.unwrap_or(Kind::U8))?;
        if length >= 0.0 && length <= f64::from(u32::MAX) && length.fract() == 0.0 {
            Ok(length as usize)
        } else {
            Err(self.fault(format_args!("{length} is no length of a list")))
        }
    }

    /// Appends the numbers of a list.
    pub fn list(&mut self, property: &Property, numbers: &mut Vec<f64>) -> Result<(), Fault> {
        for _ in 0..self.length(property)? {
            numbers.push(self.number(property.kind)?);
        }
        Ok(())
    }
}

fn text_number(text: &mut Cursor) -> Result<f64, Fault> {
    loop {
        text.skip_blanks();
        if !text.skip_line_end() {
            break;
        }
    }
    if text.is_at_end() {
        return Err(text.fault("the file ends too early"));
    }
    match fast_float2::parse_partial::<f64, _>(&text.bytes[text.at..]) {
        Ok((number, length)) if text.ends_word_after(length) => {
            text.at += length;
            Ok(number)
        }
        _ => Err(text.fault(format_args!("{} is not a number", Quoted(text.peek_word())))),
    }
}

#[inline]
fn binary_number(rest: &mut &[u8], kind: Kind, is_big: bool) -> Option<f64> {
    macro_rules! take {
        ($type:ty) => {{
            let (bytes, after) = rest.split_first_chunk()?;
            *rest = after;
            let number = if is_big { <$type>::from_be_bytes(*bytes) } else { <$type>::from_le_bytes(*bytes) };
            f64::from(number)
        }};
    }
    Some(match kind {
        Kind::I8 => take!(i8),
        Kind::U8 => take!(u8),
        Kind::I16 => take!(i16),
        Kind::U16 => take!(u16),
        Kind::I32 => take!(i32),
        Kind::U32 => take!(u32),
        Kind::F32 => take!(f32),
        Kind::F64 => take!(f64),
    })
}
