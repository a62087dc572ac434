//! Woven and knitted cloth.

use super::Palette;
use super::profile::{Profile, Structure, Weave, r};

const CLOTH: Profile = Profile {
    structure: Structure::Woven(Weave::Plain),
    period_mm: r(0.4, 0.9),
    relief_mm: r(0.019, 0.12),
    regularity: r(0.6, 0.95),
    micro_um: r(6.0, 20.0),
    micro_length_mm: r(0.15, 0.4),
    alpha: r(0.13, 1.0),
    anisotropy: 1.0,
    sheen: r(0.0, 0.35),
    f0: 0.04,
    coated: 0.0,
    palette: Palette::Dyed,
    printed: 0.35,
    modulus_kpa: r(50.0, 250.0),
    loss: r(0.12, 0.3),
    relaxation: r(0.1, 0.3),
    creep: r(0.05, 0.2),
    thickness_mm: r(0.25, 0.6),
    effusivity: r(77.0, 350.0),
    adhesion: r(25.0, 45.0),
    tack: r(0.8, 1.3),
};

pub(crate) const COTTON: &[(f64, Profile)] = &[
    (0.6, CLOTH),
    (
        0.4,
        Profile {
            structure: Structure::Knitted,
            period_mm: r(0.8, 1.6),
            relief_mm: r(0.039, 0.22),
            printed: 0.2,
            modulus_kpa: r(25.0, 90.0),
            thickness_mm: r(0.5, 1.1),
            ..CLOTH
        },
    ),
];

pub(crate) const DENIM: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Woven(Weave::Twill),
        period_mm: r(0.42, 0.7),
        relief_mm: r(0.033, 0.18),
        regularity: r(0.6, 0.9),
        micro_um: r(8.0, 25.0),
        sheen: r(0.0, 0.15),
        palette: Palette::Denim,
        printed: 0.0,
        modulus_kpa: r(90.0, 350.0),
        thickness_mm: r(0.6, 1.2),
        effusivity: r(96.0, 380.0),
        ..CLOTH
    },
)];

pub(crate) const UPHOLSTERY: &[(f64, Profile)] = &[
    (
        0.5,
        Profile {
            structure: Structure::Woven(Weave::Basket),
            period_mm: r(0.7, 1.6),
            relief_mm: r(0.065, 0.44),
            micro_um: r(12.0, 40.0),
            printed: 0.5,
            modulus_kpa: r(30.0, 120.0),
            thickness_mm: r(0.9, 2.2),
            effusivity: r(58.0, 250.0),
            ..CLOTH
        },
    ),
    (
        0.5,
        Profile {
            structure: Structure::Woven(Weave::Plain),
            period_mm: r(1.0, 2.2),
            relief_mm: r(0.078, 0.5),
            micro_um: r(15.0, 45.0),
            printed: 0.4,
            modulus_kpa: r(25.0, 110.0),
            thickness_mm: r(1.0, 2.6),
            effusivity: r(51.0, 240.0),
            ..CLOTH
        },
    ),
];

pub(crate) const LINEN: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        period_mm: r(0.5, 1.1),
        relief_mm: r(0.033, 0.18),
        regularity: r(0.25, 0.6),
        micro_um: r(9.0, 28.0),
        sheen: r(0.0, 0.12),
        palette: Palette::Undyed,
        printed: 0.15,
        effusivity: r(96.0, 390.0),
        ..CLOTH
    },
)];

pub(crate) const SILK: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Woven(Weave::Satin),
        period_mm: r(0.2, 0.34),
        relief_mm: r(0.0039, 0.031),
        regularity: r(0.7, 0.97),
        micro_um: r(1.5, 6.0),
        alpha: r(0.1, 0.6),
        anisotropy: 2.0,
        sheen: r(0.0, 0.6),
        f0: 0.06,
        modulus_kpa: r(80.0, 300.0),
        thickness_mm: r(0.1, 0.3),
        effusivity: r(110.0, 420.0),
        ..CLOTH
    },
)];

pub(crate) const CORDUROY: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Ribbed,
        period_mm: r(1.2, 3.6),
        relief_mm: r(0.13, 0.75),
        regularity: r(0.7, 0.97),
        micro_um: r(15.0, 45.0),
        sheen: r(0.12, 0.8),
        printed: 0.0,
        modulus_kpa: r(15.0, 60.0),
        thickness_mm: r(1.0, 2.0),
        effusivity: r(51.0, 220.0),
        ..CLOTH
    },
)];

pub(crate) const NYLON: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        period_mm: r(0.25, 0.6),
        relief_mm: r(0.0065, 0.062),
        regularity: r(0.8, 0.99),
        micro_um: r(2.0, 8.0),
        alpha: r(0.12, 0.95),
        sheen: r(0.0, 0.2),
        f0: 0.045,
        printed: 0.1,
        modulus_kpa: r(150.0, 600.0),
        thickness_mm: r(0.1, 0.4),
        effusivity: r(130.0, 520.0),
        ..CLOTH
    },
)];

pub(crate) const POLYESTER: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Woven(Weave::Satin),
        period_mm: r(0.25, 0.5),
        relief_mm: r(0.0065, 0.075),
        micro_um: r(3.0, 12.0),
        alpha: r(0.12, 0.95),
        anisotropy: 1.6,
        printed: 0.5,
        ..CLOTH
    },
)];

pub(crate) const WOOL: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Woven(Weave::Twill),
        period_mm: r(0.8, 1.8),
        relief_mm: r(0.052, 0.35),
        regularity: r(0.4, 0.8),
        micro_um: r(20.0, 55.0),
        sheen: r(0.0, 0.6),
        palette: Palette::Tweed,
        modulus_kpa: r(15.0, 70.0),
        thickness_mm: r(1.0, 2.4),
        effusivity: r(45.0, 200.0),
        ..CLOTH
    },
)];

pub(crate) const KNIT: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Knitted,
        period_mm: r(2.0, 4.5),
        relief_mm: r(0.16, 1.0),
        regularity: r(0.5, 0.9),
        micro_um: r(20.0, 60.0),
        sheen: r(0.0, 0.7),
        printed: 0.2,
        modulus_kpa: r(6.0, 30.0),
        thickness_mm: r(1.8, 4.0),
        effusivity: r(35.0, 160.0),
        ..CLOTH
    },
)];

pub(crate) const CANVAS: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        period_mm: r(0.8, 1.5),
        relief_mm: r(0.065, 0.31),
        regularity: r(0.6, 0.92),
        micro_um: r(10.0, 30.0),
        sheen: r(0.0, 0.1),
        palette: Palette::Undyed,
        printed: 0.2,
        modulus_kpa: r(150.0, 600.0),
        thickness_mm: r(0.6, 1.2),
        effusivity: r(100.0, 390.0),
        ..CLOTH
    },
)];

pub(crate) const BURLAP: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        period_mm: r(1.6, 2.9),
        relief_mm: r(0.13, 0.62),
        regularity: r(0.2, 0.5),
        micro_um: r(30.0, 80.0),
        sheen: r(0.0, 0.1),
        palette: Palette::Jute,
        printed: 0.0,
        modulus_kpa: r(60.0, 250.0),
        thickness_mm: r(0.9, 1.8),
        ..CLOTH
    },
)];

pub(crate) const STRAW: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Woven(Weave::Basket),
        period_mm: r(1.6, 3.2),
        relief_mm: r(0.13, 0.75),
        regularity: r(0.4, 0.85),
        micro_um: r(10.0, 30.0),
        alpha: r(0.15, 0.9),
        sheen: r(0.0, 0.05),
        palette: Palette::Jute,
        printed: 0.0,
        modulus_kpa: r(500.0, 4000.0),
        thickness_mm: r(1.0, 2.5),
        effusivity: r(96.0, 450.0),
        ..CLOTH
    },
)];
