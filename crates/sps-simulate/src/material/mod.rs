//! Materials, the shares in which they occur, and the physical ranges of each.

mod assignment;
mod colour;
mod hard;
mod pile;
mod profile;
mod soft;
mod textile;

pub(crate) use assignment::material_of;
pub(crate) use colour::Colours;
pub use colour::Palette;
pub use profile::{Profile, Range, Structure, Weave};

macro_rules! materials {
    ($($variant:ident $label:literal $per_block:literal $table:path;)*) => {
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
                match self { $(Self::$variant => $table,)* }
            }
        }
    };
}

materials! {
    Plastic "plastic" 32 hard::PLASTIC;
    Leather "leather" 21 soft::LEATHER;
    Wood "wood" 19 hard::WOOD;
    Cotton "cotton" 9 textile::COTTON;
    Upholstery "upholstery" 9 textile::UPHOLSTERY;
    Towel "towel" 7 pile::TOWEL;
    Sponge "sponge" 7 soft::SPONGE;
    Denim "denim" 7 textile::DENIM;
    Foam "foam" 7 soft::FOAM;
    Carpet "carpet" 7 pile::CARPET;
    Stone "stone" 4 hard::STONE;
    Linen "linen" 3 textile::LINEN;
    Silk "silk" 3 textile::SILK;
    Ceramic "ceramic" 3 hard::CERAMIC;
    Steel "steel" 2 hard::STEEL;
    Aluminium "aluminium" 2 hard::ALUMINIUM;
    Brass "brass" 2 hard::BRASS;
    Copper "copper" 2 hard::COPPER;
    Glass "glass" 2 hard::GLASS;
    Concrete "concrete" 2 hard::CONCRETE;
    Plaster "plaster" 2 hard::PLASTER;
    Sandpaper "sandpaper" 2 hard::SANDPAPER;
    Bamboo "bamboo" 2 hard::BAMBOO;
    Cork "cork" 2 soft::CORK;
    Rubber "rubber" 2 soft::RUBBER;
    Vinyl "vinyl" 2 soft::VINYL;
    Silicone "silicone" 2 soft::SILICONE;
    Neoprene "neoprene" 2 soft::NEOPRENE;
    Suede "suede" 2 soft::SUEDE;
    Paper "paper" 2 soft::PAPER;
    Cardboard "cardboard" 2 soft::CARDBOARD;
    Wallpaper "wallpaper" 2 soft::WALLPAPER;
    Felt "felt" 2 pile::FELT;
    Fur "fur" 2 pile::FUR;
    Fleece "fleece" 2 pile::FLEECE;
    Velvet "velvet" 2 pile::VELVET;
    Microfibre "microfibre" 2 pile::MICROFIBRE;
    Corduroy "corduroy" 2 textile::CORDUROY;
    Nylon "nylon" 2 textile::NYLON;
    Polyester "polyester" 2 textile::POLYESTER;
    Wool "wool" 2 textile::WOOL;
    Knit "knit" 2 textile::KNIT;
    Canvas "canvas" 2 textile::CANVAS;
    Burlap "burlap" 2 textile::BURLAP;
    Straw "straw" 2 textile::STRAW;
}
