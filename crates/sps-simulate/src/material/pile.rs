//! Cloth with a pile: loops, tufts, hair and matted fibre.

use super::Palette;
use super::profile::{Profile, Structure, r};

const PILE: Profile = Profile {
    structure: Structure::Looped,
    period_mm: r(1.0, 2.0),
    relief_mm: r(0.16, 0.88),
    regularity: r(0.1, 0.5),
    micro_um: r(20.0, 60.0),
    micro_length_mm: r(0.2, 0.5),
    alpha: r(0.18, 1.0),
    anisotropy: 1.0,
    sheen: r(0.0, 0.7),
    f0: 0.04,
    coated: 0.0,
    palette: Palette::Dyed,
    printed: 0.15,
    modulus_kpa: r(4.0, 20.0),
    loss: r(0.2, 0.4),
    relaxation: r(0.2, 0.45),
    creep: r(0.15, 0.4),
    thickness_mm: r(2.0, 5.0),
    effusivity: r(32.0, 150.0),
    adhesion: r(25.0, 40.0),
    tack: r(0.8, 1.2),
};

pub(crate) const TOWEL: &[(f64, Profile)] = &[(1.0, PILE)];

pub(crate) const CARPET: &[(f64, Profile)] = &[
    (
        0.5,
        Profile {
            structure: Structure::Tufted,
            period_mm: r(2.0, 4.5),
            relief_mm: r(0.26, 1.5),
            regularity: r(0.2, 0.7),
            micro_um: r(40.0, 110.0),
            palette: Palette::Tweed,
            printed: 0.25,
            modulus_kpa: r(8.0, 40.0),
            thickness_mm: r(4.0, 10.0),
            ..PILE
        },
    ),
    (
        0.5,
        Profile {
            period_mm: r(1.8, 3.4),
            relief_mm: r(0.26, 1.4),
            regularity: r(0.4, 0.85),
            micro_um: r(40.0, 100.0),
            palette: Palette::Tweed,
            printed: 0.2,
            modulus_kpa: r(15.0, 80.0),
            thickness_mm: r(3.0, 7.0),
            ..PILE
        },
    ),
];

pub(crate) const FELT: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Fibrous,
        period_mm: r(0.8, 1.6),
        relief_mm: r(0.026, 0.18),
        regularity: r(0.0, 0.1),
        micro_um: r(15.0, 40.0),
        sheen: r(0.0, 0.4),
        printed: 0.0,
        modulus_kpa: r(20.0, 120.0),
        thickness_mm: r(1.0, 4.0),
        effusivity: r(38.0, 160.0),
        ..PILE
    },
)];

pub(crate) const FUR: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Haired,
        period_mm: r(1.6, 4.0),
        relief_mm: r(0.26, 1.4),
        regularity: r(0.0, 0.2),
        micro_um: r(30.0, 90.0),
        alpha: r(0.23, 0.75),
        sheen: r(0.16, 1.0),
        palette: Palette::Hide,
        printed: 0.3,
        modulus_kpa: r(1.5, 8.0),
        thickness_mm: r(6.0, 18.0),
        effusivity: r(26.0, 100.0),
        ..PILE
    },
)];

pub(crate) const FLEECE: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Fibrous,
        period_mm: r(1.4, 3.0),
        relief_mm: r(0.098, 0.62),
        regularity: r(0.0, 0.2),
        sheen: r(0.12, 0.8),
        printed: 0.2,
        modulus_kpa: r(2.5, 12.0),
        thickness_mm: r(2.0, 5.0),
        effusivity: r(26.0, 120.0),
        ..PILE
    },
)];

pub(crate) const VELVET: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Fibrous,
        period_mm: r(0.5, 1.0),
        relief_mm: r(0.033, 0.25),
        regularity: r(0.0, 0.2),
        micro_um: r(10.0, 35.0),
        sheen: r(0.28, 1.4),
        printed: 0.15,
        modulus_kpa: r(8.0, 40.0),
        thickness_mm: r(0.9, 2.2),
        effusivity: r(38.0, 180.0),
        ..PILE
    },
)];

pub(crate) const MICROFIBRE: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        period_mm: r(0.6, 1.2),
        relief_mm: r(0.039, 0.31),
        regularity: r(0.1, 0.4),
        micro_um: r(10.0, 35.0),
        sheen: r(0.0, 0.6),
        printed: 0.0,
        modulus_kpa: r(10.0, 50.0),
        thickness_mm: r(0.8, 2.0),
        effusivity: r(38.0, 180.0),
        ..PILE
    },
)];
