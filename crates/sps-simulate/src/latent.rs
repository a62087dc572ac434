//! The latent causes of what is seen and felt, and how much of each an image shows.

use super::stream::Stream;

/// A cause that differs between surfaces of one kind; each is a standard-normal score.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Latent {
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
const LATENTS: usize = Latent::Seating as usize + 1;

/// What a perfect reader of images knows of a latent: the correlation between its score and the
/// best reading of it in one view at nadir, and in all views together. All others do not show.
///
/// Pitch and order are in the picture at any angle. Height, gloss and fuzz change shading at nadir
/// by amounts that paint could also cause; the roll reveals them. The bulk shows only through the
/// material and through its links with what shows.
const VISIBLE: [(Latent, [f64; 2]); 7] = [
    (Latent::Period, [1.0, 1.0]),
    (Latent::Regularity, [1.0, 1.0]),
    (Latent::Relief, [0.8, 1.0]),
    (Latent::Gloss, [0.6, 1.0]),
    (Latent::Fuzz, [0.6, 1.0]),
    (Latent::Microrelief, [0.6, 0.9]),
    (Latent::Microlength, [0.7, 0.9]),
];

/// Who reads the images; the order is that of the numbers in [`VISIBLE`].
#[derive(Clone, Copy)]
pub(crate) enum Reader {
    /// Of one view, at nadir.
    OneView,
    /// Of all views together.
    AllViews,
}

/// Part of the first score follows the second, with this correlation.
///
/// Finer cells and tighter weaves make a denser, stiffer body; hard surfaces polish better.
const LINKS: [(Latent, Latent, f64); 6] = [
    (Latent::Stiffness, Latent::Period, -0.45),
    (Latent::Stiffness, Latent::Regularity, 0.2),
    (Latent::Effusivity, Latent::Period, -0.5),
    (Latent::Thickness, Latent::Period, 0.5),
    (Latent::Damping, Latent::Regularity, -0.3),
    (Latent::Adhesion, Latent::Gloss, -0.3),
];

/// The score of every latent of one surface, in their order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Scores([f64; LATENTS]);

impl Scores {
    /// The score of one latent: standard normal over surfaces.
    pub(crate) fn of(&self, latent: Latent) -> f64 {
        self.0[latent as usize]
    }

    /// Draws the causes' own parts, before the links.
    pub(crate) fn draw_own(stream: &mut Stream) -> Self {
        Self(std::array::from_fn(|_| stream.normal()))
    }

    /// Adds the links between own parts; each score stays standard normal.
    pub(crate) fn linked(&self) -> Self {
        Self(std::array::from_fn(|i| {
            let (mut score, mut left) = (0.0, 1.0);
            for &(_, source, weight) in LINKS.iter().filter(|link| link.0 as usize == i) {
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
    pub(crate) fn redrawn(&self, other: &Self, reader: Reader) -> Self {
        Self(std::array::from_fn(|i| {
            let visible = VISIBLE.iter().find(|visible| visible.0 as usize == i);
            let c = visible.map_or(0.0, |visible| visible.1[reader as usize]);
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
        let stream = |i| Stream::new(1, Purpose::LATENTS, &[i]);
        let draws = (0..20_000).map(|i| Scores::draw_own(&mut stream(i)).linked());
        let draws: Vec<Scores> = draws.collect();
        let mean =
            |f: &dyn Fn(&Scores) -> f64| draws.iter().map(f).sum::<f64>() / draws.len() as f64;
        for latent in 0..LATENTS {
            let square = mean(&|s| s.0[latent] * s.0[latent]);
            assert!((square - 1.0).abs() < 0.05, "{latent}: {square}");
        }
        for (latent, source, weight) in LINKS {
            let both = mean(&|s| s.of(latent) * s.of(source));
            let error = (both - weight).abs();
            assert!(error < 0.04, "{latent:?} and {source:?}: {both}");
        }
    }
}
