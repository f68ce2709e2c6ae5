//! Gives triangle meshes back the sharp edges and corners that sampling took away.

pub mod mesh;
