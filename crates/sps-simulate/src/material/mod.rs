//! Materials, the shares in which they occur, and the physical ranges of each.

mod assignment;
mod colour;
mod profile;
mod ranges;

pub(crate) use assignment::material_of;
pub(crate) use colour::Colours;
pub use colour::Palette;
pub use profile::{Profile, Range, Structure, Weave};

macro_rules! materials {
    ($($variant:ident $label:literal $per_block:literal;)*) => {
        /// What a surface is made of.
        ///
        /// The first fourteen are the named classes of the paper's figure 2a; the others are each
        /// so rare that the paper's rule (fewer than six surfaces is `other`) gathers them in a
        /// set of 400.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        #[allow(missing_docs, reason = "`label` says it")]
        #[non_exhaustive]
        pub enum Material { $($variant,)* }

        impl Material {
            /// All of them, the named classes first.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)*];

            /// The label in the dataset's table, for example `denim`.
            pub const fn label(self) -> &'static str {
                match self { $(Self::$variant => $label,)* }
            }

            /// How many of each 200 consecutive surfaces are of this material.
            pub const fn per_block(self) -> usize {
                match self { $(Self::$variant => $per_block,)* }
            }

            /// The kinds it comes in, each with a weight and its physical ranges.
            pub fn variants(self) -> &'static [(f64, Profile)] {
                                &ranges::KINDS[self as usize]

            }
        }
    };
}

materials! {
    Plastic "plastic" 32;
    Leather "leather" 21;
    Wood "wood" 19;
    Cotton "cotton" 9;
    Upholstery "upholstery" 9;
    Towel "towel" 7;
    Sponge "sponge" 7;
    Denim "denim" 7;
    Foam "foam" 7;
    Carpet "carpet" 7;
    Stone "stone" 4;
    Linen "linen" 3;
    Silk "silk" 3;
    Ceramic "ceramic" 3;
    Steel "steel" 2;
    Aluminium "aluminium" 2;
    Brass "brass" 2;
    Copper "copper" 2;
    Glass "glass" 2;
    Concrete "concrete" 2;
    Plaster "plaster" 2;
    Sandpaper "sandpaper" 2;
    Bamboo "bamboo" 2;
    Cork "cork" 2;
    Rubber "rubber" 2;
    Vinyl "vinyl" 2;
    Silicone "silicone" 2;
    Neoprene "neoprene" 2;
    Suede "suede" 2;
    Paper "paper" 2;
    Cardboard "cardboard" 2;
    Wallpaper "wallpaper" 2;
    Felt "felt" 2;
    Fur "fur" 2;
    Fleece "fleece" 2;
    Velvet "velvet" 2;
    Microfibre "microfibre" 2;
    Corduroy "corduroy" 2;
    Nylon "nylon" 2;
    Polyester "polyester" 2;
    Wool "wool" 2;
    Knit "knit" 2;
    Canvas "canvas" 2;
    Burlap "burlap" 2;
    Straw "straw" 2;
}
