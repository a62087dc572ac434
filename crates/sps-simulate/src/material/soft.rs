//! Leather, foams, rubbers and paper.

use super::Palette;
use super::profile::{Profile, Structure, r};

const HIDE: Profile = Profile {
    structure: Structure::Pebbled,
    period_mm: r(0.7, 2.6),
    relief_mm: r(0.013, 0.15),
    regularity: r(0.1, 0.5),
    micro_um: r(2.0, 14.0),
    micro_length_mm: r(0.15, 0.5),
    alpha: r(0.12, 1.0),
    anisotropy: 1.0,
    sheen: r(0.0, 0.2),
    f0: 0.042,
    coated: 0.2,
    palette: Palette::Leather,
    printed: 0.0,
    modulus_kpa: r(600.0, 6000.0),
    loss: r(0.1, 0.25),
    relaxation: r(0.1, 0.3),
    creep: r(0.05, 0.2),
    thickness_mm: r(0.9, 2.6),
    effusivity: r(190.0, 780.0),
    adhesion: r(30.0, 60.0),
    tack: r(0.8, 1.6),
};

const CELLULAR: Profile = Profile {
    structure: Structure::Porous,
    period_mm: r(0.6, 1.4),
    relief_mm: r(0.052, 0.38),
    regularity: r(0.0, 0.4),
    micro_um: r(10.0, 45.0),
    alpha: r(0.15, 1.0),
    f0: 0.04,
    coated: 0.0,
    palette: Palette::Foam,
    modulus_kpa: r(8.0, 90.0),
    loss: r(0.15, 0.5),
    relaxation: r(0.15, 0.5),
    creep: r(0.1, 0.45),
    thickness_mm: r(8.0, 30.0),
    effusivity: r(22.0, 110.0),
    adhesion: r(25.0, 45.0),
    tack: r(0.8, 1.3),
    ..HIDE
};

const SHEET: Profile = Profile {
    structure: Structure::Fibrous,
    period_mm: r(0.5, 1.2),
    relief_mm: r(0.0026, 0.025),
    regularity: r(0.0, 0.1),
    micro_um: r(1.5, 8.0),
    alpha: r(0.12, 1.0),
    coated: 0.15,
    palette: Palette::Paper,
    printed: 0.3,
    modulus_kpa: r(2.0e4, 2.0e5),
    loss: r(0.05, 0.15),
    relaxation: r(0.05, 0.2),
    creep: r(0.02, 0.1),
    thickness_mm: r(0.1, 0.4),
    effusivity: r(160.0, 680.0),
    adhesion: r(25.0, 45.0),
    tack: r(0.8, 1.2),
    ..HIDE
};

const ELASTOMER: Profile = Profile {
    structure: Structure::Smooth,
    period_mm: r(2.0, 5.0),
    relief_mm: r(0.0065, 0.062),
    regularity: r(0.0, 0.3),
    micro_um: r(1.0, 10.0),
    alpha: r(0.12, 1.0),
    coated: 0.0,
    palette: Palette::Plastic,
    modulus_kpa: r(1000.0, 8000.0),
    loss: r(0.1, 0.4),
    thickness_mm: r(1.5, 5.0),
    effusivity: r(290.0, 1000.0),
    adhesion: r(50.0, 120.0),
    tack: r(1.0, 4.0),
    ..HIDE
};

pub(crate) const LEATHER: &[(f64, Profile)] = &[
    (0.75, HIDE),
    (
        0.25,
        Profile {
            period_mm: r(0.35, 0.8),
            relief_mm: r(0.0052, 0.05),
            alpha: r(0.1, 0.95),
            coated: 0.4,
            ..HIDE
        },
    ),
];

pub(crate) const SPONGE: &[(f64, Profile)] = &[
    (
        0.6,
        Profile {
            period_mm: r(1.4, 3.6),
            relief_mm: r(0.2, 1.1),
            palette: Palette::Sponge,
            modulus_kpa: r(10.0, 120.0),
            ..CELLULAR
        },
    ),
    (
        0.4,
        Profile {
            structure: Structure::Fibrous,
            period_mm: r(1.6, 3.6),
            relief_mm: r(0.2, 1.0),
            regularity: r(0.0, 0.1),
            palette: Palette::Sponge,
            micro_um: r(30.0, 90.0),
            modulus_kpa: r(20.0, 200.0),
            effusivity: r(32.0, 160.0),
            ..CELLULAR
        },
    ),
];

pub(crate) const FOAM: &[(f64, Profile)] = &[
    (0.6, CELLULAR),
    (
        0.4,
        Profile {
            structure: Structure::Pebbled,
            period_mm: r(0.6, 2.4),
            relief_mm: r(0.013, 0.12),
            regularity: r(0.2, 0.7),
            micro_um: r(3.0, 18.0),
            alpha: r(0.12, 1.0),
            modulus_kpa: r(40.0, 400.0),
            effusivity: r(29.0, 150.0),
            ..CELLULAR
        },
    ),
];

pub(crate) const CORK: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Granular,
        period_mm: r(1.2, 3.5),
        relief_mm: r(0.013, 0.12),
        palette: Palette::Cork,
        micro_um: r(8.0, 30.0),
        modulus_kpa: r(4000.0, 2.0e4),
        thickness_mm: r(2.0, 6.0),
        effusivity: r(70.0, 300.0),
        ..CELLULAR
    },
)];

pub(crate) const RUBBER: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Embossed,
        relief_mm: r(0.033, 0.38),
        regularity: r(0.8, 1.0),
        palette: Palette::Dark,
        ..ELASTOMER
    },
)];

pub(crate) const SILICONE: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        modulus_kpa: r(500.0, 3000.0),
        adhesion: r(60.0, 160.0),
        tack: r(1.2, 8.0),
        ..ELASTOMER
    },
)];

pub(crate) const NEOPRENE: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Knitted,
        period_mm: r(0.5, 0.9),
        relief_mm: r(0.0065, 0.062),
        regularity: r(0.7, 0.95),
        micro_um: r(5.0, 18.0),
        palette: Palette::Dark,
        modulus_kpa: r(150.0, 700.0),
        thickness_mm: r(2.0, 6.0),
        effusivity: r(80.0, 350.0),
        adhesion: r(30.0, 50.0),
        tack: r(0.9, 1.4),
        ..ELASTOMER
    },
)];

pub(crate) const VINYL: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        period_mm: r(0.8, 2.2),
        relief_mm: r(0.013, 0.11),
        regularity: r(0.4, 0.8),
        alpha: r(0.1, 1.0),
        coated: 0.3,
        modulus_kpa: r(3000.0, 2.0e4),
        thickness_mm: r(0.6, 1.5),
        effusivity: r(260.0, 900.0),
        adhesion: r(35.0, 70.0),
        tack: r(0.9, 3.0),
        ..HIDE
    },
)];

pub(crate) const SUEDE: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Fibrous,
        period_mm: r(0.6, 1.2),
        relief_mm: r(0.019, 0.12),
        regularity: r(0.0, 0.1),
        micro_um: r(10.0, 35.0),
        alpha: r(0.3, 1.0),
        sheen: r(0.12, 0.8),
        coated: 0.0,
        modulus_kpa: r(300.0, 2000.0),
        effusivity: r(110.0, 500.0),
        ..HIDE
    },
)];

pub(crate) const PAPER: &[(f64, Profile)] = &[(1.0, SHEET)];

pub(crate) const CARDBOARD: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Ribbed,
        period_mm: r(4.0, 8.0),
        relief_mm: r(0.013, 0.15),
        regularity: r(0.8, 1.0),
        palette: Palette::Cardboard,
        printed: 0.2,
        micro_um: r(4.0, 14.0),
        modulus_kpa: r(1000.0, 1.0e4),
        thickness_mm: r(1.5, 5.0),
        effusivity: r(80.0, 360.0),
        ..SHEET
    },
)];

pub(crate) const WALLPAPER: &[(f64, Profile)] = &[(
    1.0,
    Profile {
        structure: Structure::Embossed,
        period_mm: r(2.0, 6.4),
        relief_mm: r(0.019, 0.19),
        regularity: r(0.7, 1.0),
        printed: 0.6,
        ..SHEET
    },
)];
