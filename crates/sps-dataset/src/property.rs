use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

use sps_base::names::nearest;

/// One of the fifteen tactile properties that the SynTouch Toccare measures (Purri and Dana, ECCV
/// 2020, table 1). All are unitless, nominally 0 to 100.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[allow(missing_docs, reason = "`name` says it")]
pub enum Property {
    FRS,
    FST,
    UCO,
    URO,
    MRG,
    MCO,
    MTX,
    TCO,
    TPR,
    CCM,
    CDF,
    CDP,
    CRX,
    CYD,
    ATK,
}

/// The five groups of tactile properties (section 3, "Tactile Data").
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Category {
    /// Static and sliding friction.
    Friction,
    /// Small and large height variation along the surface.
    Texture,
    /// Heat drawn from the warm sensor.
    ThermalConductance,
    /// Deformation under load.
    Compliance,
    /// Effort to break contact.
    Adhesion,
}

/// A property code that is none of the fifteen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownProperty(
    /// What was found.
    pub String,
);

impl Property {
    /// All fifteen, by category.
    pub const ALL: [Self; 15] = [
        Self::FRS,
        Self::FST,
        Self::UCO,
        Self::URO,
        Self::MRG,
        Self::MCO,
        Self::MTX,
        Self::TCO,
        Self::TPR,
        Self::CCM,
        Self::CDF,
        Self::CDP,
        Self::CRX,
        Self::CYD,
        Self::ATK,
    ];

    /// The acronym of the paper, for example `fRS`.
    pub const fn code(self) -> &'static str {
        match self {
            Self::FRS => "fRS",
            Self::FST => "fST",
            Self::UCO => "uCO",
            Self::URO => "uRO",
            Self::MRG => "mRG",
            Self::MCO => "mCO",
            Self::MTX => "mTX",
            Self::TCO => "tCO",
            Self::TPR => "tPR",
            Self::CCM => "cCM",
            Self::CDF => "cDF",
            Self::CDP => "cDP",
            Self::CRX => "cRX",
            Self::CYD => "cYD",
            Self::ATK => "aTK",
        }
    }

    /// The property in words, for example "sliding resistance".
    pub const fn name(self) -> &'static str {
        match self {
            Self::FRS => "sliding resistance",
            Self::FST => "tactile stiction",
            Self::UCO => "microtexture coarseness",
            Self::URO => "microtexture roughness",
            Self::MRG => "macrotexture regularity",
            Self::MCO => "macrotexture coarseness",
            Self::MTX => "macrotexture",
            Self::TCO => "thermal cooling",
            Self::TPR => "thermal persistence",
            Self::CCM => "tactile compliance",
            Self::CDF => "local deformation",
            Self::CDP => "damping",
            Self::CRX => "relaxation",
            Self::CYD => "yielding",
            Self::ATK => "adhesive tack",
        }
    }

    /// The group it belongs to.
    pub const fn category(self) -> Category {
        match self {
            Self::FRS | Self::FST => Category::Friction,
            Self::UCO | Self::URO | Self::MRG | Self::MCO | Self::MTX => Category::Texture,
            Self::TCO | Self::TPR => Category::ThermalConductance,
            Self::CCM | Self::CDF | Self::CDP | Self::CRX | Self::CYD => Category::Compliance,
            Self::ATK => Category::Adhesion,
        }
    }
}

impl FromStr for Property {
    type Err = UnknownProperty;

    fn from_str(code: &str) -> Result<Self, UnknownProperty> {
        Self::ALL
            .into_iter()
            .find(|property| property.code() == code)
            .ok_or_else(|| UnknownProperty(code.to_owned()))
    }
}

impl fmt::Display for Property {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.code())
    }
}

/// As its code, for example `"fRS"`.
impl Serialize for Property {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.code())
    }
}

/// From its code; anything else is an error that lists the fifteen.
impl<'de> Deserialize<'de> for Property {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let code = String::deserialize(deserializer)?;
        code.parse().map_err(de::Error::custom)
    }
}

impl UnknownProperty {
    /// The code that was probably meant, where one is close.
    pub fn nearest(&self) -> Option<Property> {
        let codes = Property::ALL.map(Property::code);
        nearest(&self.0, codes)?.parse().ok()
    }
}

impl fmt::Display for UnknownProperty {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "unknown tactile property `{}`", self.0)?;
        if let Some(meant) = self.nearest() {
            write!(f, ", did you mean `{meant}`?")?;
        }
        write!(f, " The fifteen are")?;
        for (i, property) in Property::ALL.into_iter().enumerate() {
            write!(f, "{} {property}", if i == 0 { "" } else { "," })?;
        }
        Ok(())
    }
}

impl std::error::Error for UnknownProperty {}
