//! Plastic, wood, mineral, glass and metal.

use super::Palette;
use super::profile::{Profile, Structure, r};

const MOULDED: Profile = Profile {
    structure: Structure::Smooth,
    period_mm: r(2.0, 5.0),
    relief_mm: r(0.0026, 0.037),
    regularity: r(0.0, 0.3),
    micro_um: r(0.3, 4.0),
    micro_length_mm: r(0.2, 0.8),
    alpha: r(0.06, 1.0),
    anisotropy: 1.0,
    sheen: r(0.0, 0.0),
    f0: 0.045,
    coated: 0.1,
    palette: Palette::Plastic,
    printed: 0.1,
    modulus_kpa: r(5.0e5, 3.5e6),
    loss: r(0.02, 0.12),
    relaxation: r(0.02, 0.12),
    creep: r(0.01, 0.08),
    thickness_mm: r(1.5, 5.0),
    effusivity: r(290.0, 1100.0),
    adhesion: r(30.0, 60.0),
    tack: r(0.8, 2.0),
};

const MINERAL: Profile = Profile {
    structure: Structure::Speckled,
    period_mm: r(0.9, 3.6),
    relief_mm: r(0.0026, 0.062),
    micro_um: r(0.5, 12.0),
    alpha: r(0.08, 1.0),
    coated: 0.1,
    palette: Palette::Granite,
    printed: 0.0,
    modulus_kpa: r(2.0e7, 7.0e7),
    loss: r(0.003, 0.02),
    relaxation: r(0.0, 0.01),
    creep: r(0.0, 0.01),
    thickness_mm: r(6.0, 20.0),
    effusivity: r(1100.0, 4400.0),
    adhesion: r(30.0, 70.0),
    tack: r(0.8, 1.2),
    ..MOULDED
};

const METAL: Profile = Profile {
    structure: Structure::Brushed,
    period_mm: r(0.5, 1.5),
    relief_mm: r(0.00065, 0.0075),
    regularity: r(0.0, 0.1),
    micro_um: r(0.2, 2.5),
    alpha: r(0.09, 0.9),
    anisotropy: 3.0,
    f0: 0.0,
    coated: 0.1,
    printed: 0.0,
    palette: Palette::Steel,
    modulus_kpa: r(7.0e7, 2.1e8),
    loss: r(0.001, 0.01),
    effusivity: r(5600.0, 1.7e+04),
    thickness_mm: r(0.5, 4.0),
    adhesion: r(30.0, 70.0),
    tack: r(0.8, 1.2),
    ..MINERAL
};

const TIMBER: Profile = Profile {
    structure: Structure::Grained,
    period_mm: r(1.6, 5.4),
    relief_mm: r(0.0039, 0.088),
    regularity: r(0.2, 0.6),
    micro_um: r(1.0, 12.0),
    alpha: r(0.12, 1.0),
    anisotropy: 1.4,
    coated: 0.35,
    palette: Palette::Wood,
    printed: 0.0,
    modulus_kpa: r(4.0e5, 2.0e6),
    loss: r(0.02, 0.08),
    relaxation: r(0.03, 0.12),
    creep: r(0.02, 0.1),
    thickness_mm: r(5.0, 20.0),
    effusivity: r(180.0, 840.0),
    adhesion: r(25.0, 50.0),
    tack: r(0.8, 1.4),
    ..MOULDED
};

pub(crate) const PLASTIC: &[(f64, Profile)] = &[
    (0.35, MOULDED),
    (
        0.35,
        Profile {
            structure: Structure::Pebbled,
            period_mm: r(0.5, 1.6),
            relief_mm: r(0.0065, 0.075),
            regularity: r(0.2, 0.6),
            micro_um: r(1.0, 8.0),
            alpha: r(0.12, 1.0),
            coated: 0.0,
            ..MOULDED
        },
    ),
    (
        0.3,
        Profile {
            structure: Structure::Embossed,
            period_mm: r(1.3, 5.4),
            relief_mm: r(0.026, 0.38),
            regularity: r(0.9, 1.0),
            alpha: r(0.08, 1.0),
            coated: 0.0,
            ..MOULDED
        },
    ),
];

pub(crate) const WOOD: &[(f64, Profile)] = &[(1.0, TIMBER)];

pub(crate) const BAMBOO: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Ribbed,
        period_mm: r(4.0, 10.7),
        relief_mm: r(0.013, 0.31),
        regularity: r(0.6, 0.95),
        palette: Palette::Bamboo,
        ..TIMBER
    },
)];

pub(crate) const STONE: &[(f64, Profile)] = &[
    (0.45, MINERAL),
    (
        0.3,
        Profile {
            structure: Structure::Veined,
            period_mm: r(6.0, 14.0),
            relief_mm: r(0.002, 0.025),
            alpha: r(0.06, 1.0),
            palette: Palette::Marble,
            ..MINERAL
        },
    ),
    (
        0.25,
        Profile {
            structure: Structure::Granular,
            period_mm: r(0.4, 1.0),
            relief_mm: r(0.026, 0.2),
            micro_um: r(10.0, 40.0),
            alpha: r(0.2, 1.0),
            coated: 0.0,
            palette: Palette::Sandstone,
            effusivity: r(880.0, 3200.0),
            ..MINERAL
        },
    ),
];

pub(crate) const CERAMIC: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Glazed,
        period_mm: r(2.0, 6.0),
        relief_mm: r(0.0039, 0.075),
        micro_um: r(0.2, 3.0),
        alpha: r(0.06, 1.0),
        coated: 0.8,
        palette: Palette::Glaze,
        printed: 0.2,
        effusivity: r(700.0, 2900.0),
        ..MINERAL
    },
)];

pub(crate) const GLASS: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Embossed,
        period_mm: r(2.6, 8.0),
        relief_mm: r(0.0065, 0.25),
        regularity: r(0.6, 1.0),
        micro_um: r(0.05, 0.6),
        alpha: r(0.03, 0.5),
        coated: 0.0,
        palette: Palette::Glass,
        effusivity: r(770.0, 2400.0),
        adhesion: r(40.0, 80.0),
        ..MINERAL
    },
)];

pub(crate) const CONCRETE: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Porous,
        period_mm: r(2.0, 6.0),
        relief_mm: r(0.019, 0.2),
        micro_um: r(15.0, 50.0),
        alpha: r(0.2, 1.0),
        coated: 0.0,
        palette: Palette::Concrete,
        modulus_kpa: r(1.5e7, 4.0e7),
        effusivity: r(770.0, 3000.0),
        ..MINERAL
    },
)];

pub(crate) const PLASTER: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Pebbled,
        period_mm: r(1.6, 5.0),
        relief_mm: r(0.033, 0.44),
        regularity: r(0.0, 0.2),
        micro_um: r(6.0, 25.0),
        alpha: r(0.2, 1.0),
        coated: 0.0,
        palette: Palette::Paint,
        modulus_kpa: r(2.0e6, 1.0e7),
        effusivity: r(380.0, 1500.0),
        ..MINERAL
    },
)];

pub(crate) const SANDPAPER: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Granular,
        period_mm: r(0.35, 1.2),
        relief_mm: r(0.033, 0.31),
        micro_um: r(15.0, 50.0),
        alpha: r(0.15, 0.9),
        coated: 0.0,
        palette: Palette::Grit,
        modulus_kpa: r(1.0e5, 1.0e6),
        thickness_mm: r(0.3, 0.8),
        effusivity: r(260.0, 1200.0),
        ..MINERAL
    },
)];

pub(crate) const STEEL: &[(f64, Profile)] = &[(1.0, METAL)];

pub(crate) const ALUMINIUM: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        alpha: r(0.1, 0.95),
        palette: Palette::Aluminium,
        effusivity: r(1.1e+04, 2.8e+04),
        ..METAL
    },
)];

pub(crate) const BRASS: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        palette: Palette::Brass,
        effusivity: r(1.2e+04, 2.4e+04),
        ..METAL
    },
)];

pub(crate) const COPPER: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Smooth,
        period_mm: r(3.0, 8.0),
        relief_mm: r(0.0065, 0.12),
        alpha: r(0.08, 0.9),
        anisotropy: 1.0,
        palette: Palette::Copper,
        effusivity: r(2.0e+04, 4.4e+04),
        ..METAL
    },
)];
