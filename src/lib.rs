//! Gives triangle meshes back the sharp edges and corners that sampling took away.

pub mod attributes;
pub mod classify;
pub mod error;
pub mod geometry;
pub mod io;
pub mod mesh;
pub mod place;
pub mod refine;
pub mod tags;
