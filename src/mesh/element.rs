//! Vertices, faces and half-edges as numbers, and arrays with a value for each of them.
//!
//! ```text
//!          2            face f has the half-edges 3f from corner 0 to 1, 3f + 1 from 1 to 2, 3f + 2 from 2 to 0:
//!    3f+2 / ^ 3f+1      next, previous and face are arithmetic
//!        v   \
//!       0 --> 1
//!          3f
//! ```

use std::fmt;
use std::ops::{Index, IndexMut};

/// What kinds of elements have in common: an index of their own type.
pub(crate) trait Element: Copy {
    fn of(i: usize) -> Self;
    fn at(self) -> usize;
}

macro_rules! index_type {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[repr(transparent)]
        pub struct $name(pub(super) u32);

        impl $name {
            /// The index that stands for "there is none". Never a valid index into a mesh.
            pub const NONE: Self = Self(u32::MAX);

            /// Makes the index `i`.
            ///
            /// # Panics
            /// When `i` is `u32::MAX` or more.
            #[inline]
            #[must_use]
            pub fn new(i: usize) -> Self {
                assert!(i < u32::MAX as usize, "index {i} does not fit");
                Self(i as u32)
            }

            /// The index as a plain number, for arrays.
            #[inline]
            #[must_use]
            pub fn index(self) -> usize {
                self.0 as usize
            }

            /// Whether this is an index at all, that is, not [`NONE`](Self::NONE).
            #[inline]
            #[must_use]
            pub fn is_some(self) -> bool {
                self != Self::NONE
            }
        }

        impl Element for $name {
            #[inline]
            fn of(i: usize) -> Self {
                Self::new(i)
            }

            #[inline]
            fn at(self) -> usize {
                self.index()
            }
        }

        impl fmt::Debug for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                if self.is_some() {
                    write!(f, concat!(stringify!($name), "({})"), self.0)
                } else {
                    write!(f, concat!(stringify!($name), "(none)"))
                }
            }
        }

        impl<T> Index<$name> for PerElement<$name, T> {
            type Output = T;
            #[inline]
            fn index(&self, i: $name) -> &T {
                &self.values[i.index()]
            }
        }

        impl<T> IndexMut<$name> for PerElement<$name, T> {
            #[inline]
            fn index_mut(&mut self, i: $name) -> &mut T {
                &mut self.values[i.index()]
            }
        }
    };
}

index_type!(
    /// Index of a vertex.
    Vert
);
index_type!(
    /// Index of a half-edge: `3f + i` runs from corner `i` to corner `i + 1` of face `f`.
    Half
);
index_type!(
    /// Index of a triangle.
    Face
);

impl Half {
    /// The next half-edge of the same face.
    #[inline]
    #[must_use]
    pub fn next(self) -> Self {
        // Whether a number is a multiple is told without the remainder.
        let next = self.0 + 1;
        Self(if next.is_multiple_of(3) { next - 3 } else { next })
    }

    /// The previous half-edge of the same face.
    #[inline]
    #[must_use]
    pub fn prev(self) -> Self {
        Self(if self.0.is_multiple_of(3) { self.0 + 2 } else { self.0 - 1 })
    }

    /// The face that this half-edge belongs to.
    #[inline]
    #[must_use]
    pub fn face(self) -> Face {
        Face(self.0 / 3)
    }

    /// Which corner of its face this half-edge starts from: 0, 1 or 2.
    #[inline]
    #[must_use]
    pub fn corner(self) -> usize {
        (self.0 % 3) as usize
    }
}

impl Face {
    /// The three half-edges of the face, in order.
    #[inline]
    #[must_use]
    pub fn halves(self) -> [Half; 3] {
        [0, 1, 2].map(|i| Half(3 * self.0 + i))
    }

    /// The half-edge from corner `i` to corner `i + 1`.
    #[inline]
    #[must_use]
    pub fn half(self, i: usize) -> Half {
        debug_assert!(i < 3);
        Half(3 * self.0 + i as u32)
    }
}

/// An array with one value per element of one kind: `PerVert<f64>` takes a [`Vert`] as its index and
/// nothing else.
#[derive(Clone, Debug, PartialEq)]
pub struct PerElement<I, T> {
    values: Vec<T>,
    kind: std::marker::PhantomData<I>,
}

/// One value per vertex.
pub type PerVert<T> = PerElement<Vert, T>;
/// One value per half-edge.
pub type PerHalf<T> = PerElement<Half, T>;
/// One value per face.
pub type PerFace<T> = PerElement<Face, T>;

impl<I, T> PerElement<I, T> {
    /// `n` copies of `value`.
    #[must_use]
    pub fn filled(n: usize, value: T) -> Self
    where
        T: Clone,
    {
        vec![value; n].into()
    }

    /// How many elements there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Whether there is no element.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// The values in index order.
    #[must_use]
    pub fn as_slice(&self) -> &[T] {
        &self.values
    }

    /// The values in index order, to be changed in place.
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        &mut self.values
    }

    /// The plain vector.
    #[must_use]
    pub fn into_vec(self) -> Vec<T> {
        self.values
    }
}

impl<I, T> From<Vec<T>> for PerElement<I, T> {
    fn from(values: Vec<T>) -> Self {
        Self { values, kind: std::marker::PhantomData }
    }
}

impl<I, T> Default for PerElement<I, T> {
    fn default() -> Self {
        Vec::new().into()
    }
}
