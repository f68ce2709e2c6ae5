//! Which neighbours decide where the new vertex of an edge goes, and with what weights.
//!
//! Sharp and border edges *cut* the mesh. What an end of an edge is depends on its sector: the triangles
//! round that end from one cut edge to the next, on the side where the edge lies.
//!
//! ```text
//!      2 = = q = = 0      crease end q: k = 3 triangles between two cut edges (=); the edge
//!     / \   / \ i /       to n[1] is the second spoke, i = 1
//!    /   \ /   \ /        interior end: no cut edge, or one (a dead end); k is the valence
//!   -     n2    n1
//! ```
//!
//! An end is *regular* when it is interior with k = 6 or crease with k = 3.
//!
//! Based on: Zorin, Schröder and Sweldens 1996 with Zorin's later corrections; Sharpen&Bend section 4.2.
//! Differs: no mesh is cut and healed; a sector is a walk round a vertex. Paper silent: where several
//! fans touch in a vertex each counts for itself; edges with three or more faces form curves of their
//! own; ends of fewer than three neighbours leave the new vertex in the middle.
//! In/out: `Mesh` + `Tags` -> `Stencils`, which gives a point and a [`Rule`] per edge.
//! Cost: O(F) for all edges: ends of more than [`WIDE`] triangles are summed once, not once an edge.

use std::f64::consts::PI;

use glam::DVec3;

use crate::mesh::{Half, Mesh, PerHalf, Vert};
use crate::refine::alone_on_their_pair;
use crate::tags::Tags;
