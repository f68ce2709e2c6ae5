//! What a file says about a mesh beyond points and faces: carried through the passes here and nowhere
//! else.

/// Everything of a file that is not a position or a triangle. Empty for a plain mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Attributes {}
