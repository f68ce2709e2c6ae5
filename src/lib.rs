//! Gives triangle meshes back the sharp edges and corners that sampling took away.

pub mod classify;
pub mod collapse;
mod edit;
pub mod geometry;
pub mod mesh;
pub mod place;
pub mod refine;
pub mod tags;
