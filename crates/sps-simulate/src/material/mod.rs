//! Materials: the shares in which they occur, their kinds, and the physical ranges of each kind.

mod assignment;
mod colour;
mod profile;

pub(crate) use assignment::material_of;
pub(crate) use colour::{Colours, Palette};
pub(crate) use profile::Profile;

use profile::KINDS;

/// What a surface is made of: one of the materials of `ranges.csv`.
///
/// The first fourteen are the named classes of the paper's figure 2a; the others are each so rare
/// that the paper's rule (fewer than six surfaces is `other`) gathers them in a set of 400.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Material(usize);

impl Material {
    /// All of them, the named classes first.
    pub fn all() -> impl ExactSizeIterator<Item = Self> {
        (0..KINDS.len()).map(Self)
    }

    /// Its place among all of them.
    pub fn index(self) -> usize {
        self.0
    }

    /// The label in the dataset's table, for example `denim`.
    pub fn label(self) -> &'static str {
        KINDS[self.0][0].material
    }

    /// How many of each 200 consecutive surfaces are of this material.
    pub(crate) fn per_block(self) -> usize {
        KINDS[self.0][0].per_block
    }

    /// The kinds it comes in.
    pub(crate) fn kinds(self) -> &'static [Profile] {
        &KINDS[self.0]
    }
}
