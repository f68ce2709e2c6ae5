//! Colours and normals in the form that formats with plain vertices want.

use super::View;
use crate::attributes::{Channel, Column, Kind};

/// The columns of a colour.
pub(super) const COLOURS: [&str; 4] = ["red", "green", "blue", "alpha"];

/// The colours in bytes, if they came as real numbers from a format without types: 0 to 1, or 0 to 255
/// if any is above 1. None if there are no such colours.
pub(super) fn byte_colours(view: View) -> Option<Vec<Column>> {
    let attributes = view.attributes;
    attributes.columns(["red", "green", "blue"])?;
    let is_colour = |column: &&Column| COLOURS.contains(&column.name.as_str());
    let colours: Vec<&Column> = attributes.vertex_columns.iter().filter(is_colour).collect();
    if attributes.storage.is_some() || colours.iter().any(|column| column.kind != Kind::F64) {
        return None;
    }
    // NaN, which stands for no colour, is never the larger one.
    let largest =
        colours.iter().flat_map(|column| &column.values).fold(0.0f64, |most, &value| most.max(value));
    let scale = if largest > 1.0 { 1.0 } else { 255.0 };
    let byte = |&value: &f64| (scale * value).round().clamp(0.0, 255.0);
    let column = |column: &Column| Column {
        name: column.name.clone(),
        kind: Kind::U8,
        values: column.values.iter().map(byte).collect(),
    };
    Some(colours.into_iter().map(column).collect())
}

/// The corners' normals as columns of the vertices, if all corners of each vertex have one value. Zero
/// where there is none.
pub(super) fn vertex_normals(view: View) -> Option<[Column; 3]> {
    let normals = &view.attributes.normals;
    if normals.at.is_empty() {
        return None;
    }
    let bits = |value: [f64; 3]| value.map(f64::to_bits);
    let mut found: Vec<Option<[f64; 3]>> = vec![None; view.points.len()];
    for (v, &entry) in view.faces.as_flattened().iter().zip(normals.at.as_slice()) {
        let value =
            Some(entry).filter(|&entry| entry != Channel::NONE).map(|entry| normals.values[entry as usize]);
        match (&mut found[v.index()], value) {
            (slot @ None, value) => *slot = value,
            (Some(old), Some(new)) if bits(*old) == bits(new) => {}
            _ => return None,
        }
    }
    let column = |axis: usize| Column {
        name: ["nx", "ny", "nz"][axis].to_owned(),
        kind: Kind::F64,
        values: found.iter().map(|value| value.map_or(0.0, |value| value[axis])).collect(),
    };
    Some([0, 1, 2].map(column))
}
