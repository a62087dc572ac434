//! The latent causes of what is seen and felt, and how much of each an image shows.

use serde::Serialize;

use super::stream::Stream;

/// A cause that differs between surfaces of one kind; each is a standard-normal score.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Latent {
    /// Pitch of the structure.
    Period,
    /// Order of the structure.
    Regularity,
    /// Height of the structure.
    Relief,
    /// Height of the microrelief.
    Microrelief,
    /// Correlation length of the microrelief.
    Microlength,
    /// Roughness of what is too fine to resolve.
    Gloss,
    /// Strength of the fuzz.
    Fuzz,
    /// Indentation modulus.
    Stiffness,
    /// Loss tangent.
    Damping,
    /// Stress relaxation.
    Relaxation,
    /// Creep.
    Creep,
    /// Thickness on the stage.
    Thickness,
    /// Thermal effusivity.
    Effusivity,
    /// Work of adhesion.
    Adhesion,
    /// Plasticiser and finish.
    Tack,
    /// What lies on the surface: dust, grease, glue.
    Deposit,
    /// How well skin and surface seat on each other.
    Seating,
}

/// How many there are.
pub(crate) const LATENTS: usize = Latent::ALL.len();

/// The correlation between a latent score and the best reading of it in images.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Visibility {
    /// In one view at nadir.
    pub nadir: f64,
    /// In all views together.
    pub all: f64,
}

impl Latent {
    /// All of them.
    pub const ALL: [Self; 17] = [
        Self::Period,
        Self::Regularity,
        Self::Relief,
        Self::Microrelief,
        Self::Microlength,
        Self::Gloss,
        Self::Fuzz,
        Self::Stiffness,
        Self::Damping,
        Self::Relaxation,
        Self::Creep,
        Self::Thickness,
        Self::Effusivity,
        Self::Adhesion,
        Self::Tack,
        Self::Deposit,
        Self::Seating,
    ];

    /// What a perfect reader of images knows of it.
    ///
    /// Pitch and order are in the picture at any angle. Height, gloss and fuzz change shading at
    /// nadir by amounts that paint could also cause; the roll reveals them. The bulk shows only
    /// through the material and through its links with what shows.
    pub const fn visibility(self) -> Visibility {
        let (nadir, all) = match self {
            Self::Period | Self::Regularity => (1.0, 1.0),
            Self::Relief => (0.8, 1.0),
            Self::Gloss | Self::Fuzz => (0.6, 1.0),
            Self::Microrelief => (0.6, 0.9),
            Self::Microlength => (0.7, 0.9),
            _ => (0.0, 0.0),
        };
        Visibility { nadir, all }
    }

    /// Causes that part of this score follows, with their correlations.
    ///
    /// Finer cells and tighter weaves make a denser, stiffer body; hard surfaces polish better.
    const fn links(self) -> &'static [(Self, f64)] {
        match self {
            Self::Stiffness => &[(Self::Period, -0.45), (Self::Regularity, 0.2)],
            Self::Effusivity => &[(Self::Period, -0.5)],
            Self::Thickness => &[(Self::Period, 0.5)],
            Self::Damping => &[(Self::Regularity, -0.3)],
            Self::Adhesion => &[(Self::Gloss, -0.3)],
            _ => &[],
        }
    }
}

/// The score of every latent of one surface, in the order of [`Latent::ALL`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scores([f64; LATENTS]);

impl Scores {
    /// The score of one latent: standard normal over surfaces.
    pub fn of(&self, latent: Latent) -> f64 {
        self.0[latent as usize]
    }

    /// Draws the causes' own parts, before the links.
    pub(crate) fn draw_own(stream: &mut Stream) -> Self {
        Self(std::array::from_fn(|_| stream.normal()))
    }

    /// Adds the links between own parts; each score stays standard normal.
    pub(crate) fn linked(&self) -> Self {
        Self(std::array::from_fn(|i| {
            let links = Latent::ALL[i].links();
            let (mut score, mut left) = (0.0, 1.0);
            for &(source, weight) in links {
                score += weight * self.of(source);
                left -= weight * weight;
            }
            score + left.max(0.0).sqrt() * self.0[i]
        }))
    }

    /// Scores that a reader cannot tell from these: `other` with what the reader sees of these.
    ///
    /// For an observation `o = c z + sqrt(1 - c^2) e` of a standard-normal `z`, `z` given `o` is
    /// normal with mean `c o` and variance `1 - c^2`, so two draws of it correlate by `c^2`.
    pub(crate) fn redrawn(&self, other: &Self, seen: impl Fn(Latent) -> f64) -> Self {
        Self(std::array::from_fn(|i| {
            let c = seen(Latent::ALL[i]);
            let shared = c * c;
            shared * self.0[i] + (1.0 - shared * shared).sqrt() * other.0[i]
        }))
    }

    /// These scores moved by `amount` times `by`: the difference between places of one surface.
    pub(crate) fn moved(&self, by: &Self, amount: f64) -> Self {
        Self(std::array::from_fn(|i| self.0[i] + amount * by.0[i]))
    }
}

#[cfg(test)]
mod tests {
    use super::super::stream::Purpose;
    use super::*;

    #[test]
    fn linked_scores_stay_standard_normal_and_follow_their_links() {
        let draws: Vec<Scores> = (0..20_000)
            .map(|i| Scores::draw_own(&mut Stream::new(1, Purpose::Latents, &[i])).linked())
            .collect();
        let mean =
            |f: &dyn Fn(&Scores) -> f64| draws.iter().map(f).sum::<f64>() / draws.len() as f64;
        for latent in Latent::ALL {
            let square = mean(&|s| s.of(latent) * s.of(latent));
            assert!((square - 1.0).abs() < 0.05, "{latent:?}: {square}");
            for &(source, weight) in latent.links() {
                let both = mean(&|s| s.of(latent) * s.of(source));
                assert!(
                    (both - weight).abs() < 0.04,
                    "{latent:?} and {source:?}: {both}"
                );
            }
        }
    }
}
