//! Errors of surfaces by fits to all others, in closed form.

use std::collections::BTreeMap;

use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};

use crate::dense::cleanly;

/// Which of the surfaces of a fit are left out together: those of one unit.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LeftOut {
    /// Places among the surfaces of the fit.
    parts: Vec<Vec<usize>>,
    surfaces: usize,
}

/// The block of one part.
pub(crate) enum LeftOutBlock {
    One(f64),
    /// None where the fit to the others says nothing of it.
    Several(Option<Llt<f64>>),
}

impl LeftOut {
    /// Of these surfaces of the tables; `units` has a number for each surface of the tables. Where
    /// there are none, or one alone, each surface is left out for itself.
    pub(crate) fn of(surfaces: &[usize], units: Option<&[usize]>) -> Self {
        let mut parts: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (place, &surface) in surfaces.iter().enumerate() {
            let unit = units.map_or(surface, |units| units[surface]);
            parts.entry(unit).or_default().push(place);
        }
        let surfaces = surfaces.len();
        let parts = match parts.len() {
            1 => (0..surfaces).map(|place| vec![place]).collect(),
            _ => parts.into_values().collect(),
        };
        Self { parts, surfaces }
    }

    /// The parts' blocks of the identity less the hat matrix `H` of a linear fit, made ready for any
    /// readings: `alone(i)` is the element of a surface, `several` the block of a part.
    pub(crate) fn blocks(
        &self,
        alone: impl Fn(usize) -> f64,
        several: impl Fn(&[usize]) -> Mat<f64>,
    ) -> Vec<LeftOutBlock> {
        let block = |part: &Vec<usize>| match part.as_slice() {
            // Surfaces that alone decide their own fit are predicted by nothing.
            &[one] => LeftOutBlock::One(alone(one).max(f64::EPSILON)),
            part => {
                let mut block = several(part);
                let diagonal = block.diagonal_mut().column_vector_mut();
                diagonal.iter_mut().for_each(|value| *value += f64::EPSILON);
                LeftOutBlock::Several(cleanly(|| block.llt(Side::Lower)).ok())
            }
        };
        self.parts.iter().map(block).collect()
    }

    /// The mean squared error when each part is left out of a linear fit: `residuals` are those of
    /// the fit to all, and `blocks` the fit's.
    pub(crate) fn squared_error(
        &self,
        residuals: impl Fn(usize) -> f64,
        blocks: &[LeftOutBlock],
    ) -> f64 {
        let mut sum = 0.0;
        self.each_error(residuals, blocks, |_, error| sum += error * error);
        sum / self.surfaces as f64
    }

    /// The errors themselves, by surface.
    pub(crate) fn errors(
        &self,
        residuals: impl Fn(usize) -> f64,
        blocks: &[LeftOutBlock],
    ) -> Vec<f64> {
        let mut errors = vec![0.0; self.surfaces];
        self.each_error(residuals, blocks, |surface, error| errors[surface] = error);
        errors
    }

    /// The errors of a part `B` solve `(I - H_BB) e = r_B` (Golub, Heath and Wahba 1979 for one surface; Cook and
    /// Weisberg 1982, section 3.2, for several).
    fn each_error(
        &self,
        residuals: impl Fn(usize) -> f64,
        blocks: &[LeftOutBlock],
        mut see: impl FnMut(usize, f64),
    ) {
        for (part, block) in self.parts.iter().zip(blocks) {
            match block {
                LeftOutBlock::One(slack) => see(part[0], residuals(part[0]) / slack),
                LeftOutBlock::Several(Some(factor)) => {
                    let residuals = Mat::from_fn(part.len(), 1, |i, _| residuals(part[i]));
                    let errors = cleanly(|| factor.solve(&residuals));
                    for (&surface, &error) in part.iter().zip(errors.col(0).iter()) {
                        see(surface, error);
                    }
                }
                LeftOutBlock::Several(None) => {
                    for &surface in part {
                        see(surface, f64::INFINITY);
                    }
                }
            }
        }
    }

    /// The mean squared error of the mean of all other parts, for values less their mean; none of
    /// one surface alone.
    pub(crate) fn error_of_the_mean(&self, centred: &[f64]) -> Option<f64> {
        let errors = self.parts.iter().map(|part| {
            let others = (self.surfaces - part.len()) as f64;
            let mean = -part.iter().map(|&i| centred[i]).sum::<f64>() / others;
            let squared = part.iter().map(|&i| (centred[i] - mean).powi(2));
            squared.sum::<f64>()
        });
        (self.parts.len() > 1).then(|| errors.sum::<f64>() / self.surfaces as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CENTRED: [f64; 5] = [-3.0, -1.0, 0.0, 1.5, 2.5];

    /// The mean of the others, unit by unit, written down surface by surface.
    fn directly(units: &[usize]) -> f64 {
        let error = |(out, value): (usize, &f64)| {
            let others = (0..CENTRED.len()).filter(|&s| units[s] != units[out]);
            let others: Vec<f64> = others.map(|s| CENTRED[s]).collect();
            (value - others.iter().sum::<f64>() / others.len() as f64).powi(2)
        };
        CENTRED.iter().enumerate().map(error).sum::<f64>() / CENTRED.len() as f64
    }

    #[test]
    fn the_mean_is_that_of_all_other_units() {
        let all = [0, 1, 2, 3, 4];
        for units in [[0, 1, 2, 3, 4], [7, 7, 2, 2, 2], [1, 0, 1, 0, 5]] {
            let found = LeftOut::of(&all, Some(&units)).error_of_the_mean(&CENTRED);
            assert!((found.unwrap() / directly(&units) - 1.0).abs() < 1e-12);
        }
        // Units are those of the tables, of which these are some surfaces.
        let some = LeftOut::of(&[1, 4], Some(&[0, 7, 0, 0, 7, 0]));
        assert_eq!(some, LeftOut::of(&[0, 1], None));
    }

    #[test]
    fn hard_cases() {
        // One unit: each surface for itself. One surface: nothing.
        let all = [0, 1, 2, 3, 4];
        assert_eq!(LeftOut::of(&all, Some(&[3; 5])), LeftOut::of(&all, None));
        assert_eq!(LeftOut::of(&[2], None).error_of_the_mean(&[0.0]), None);
        // A unit that alone decides its own fit.
        let units = [0, 0, 1, 1, 1];
        let left_out = LeftOut::of(&all, Some(&units));
        let blocks = left_out.blocks(|_| 0.0, |part| Mat::zeros(part.len(), part.len()));
        let error = left_out.squared_error(|i| CENTRED[i], &blocks);
        assert!(error > 1e20, "{error}");
    }
}
