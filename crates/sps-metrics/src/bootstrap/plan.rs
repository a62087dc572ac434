use super::kernel::{Kernel, Ratio};
use super::{BootstrapError, Scored};
use crate::outcome::Undefined;

/// Whose score it is, in a difference first less second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    First,
    Second,
}

/// The mean of the first side's scores less that of the second's, for any resample.
pub(super) struct Plan<'a> {
    columns: Vec<PlannedColumn<'a>>,
    /// How many units there are to draw from: those that have a sample in any column.
    pub(super) units: u32,
    /// The value for the samples as they are.
    pub(super) estimate: f64,
}

struct PlannedColumn<'a> {
    kernel: Kernel<'a>,
    /// The same where it is a ratio of sums over units, which needs no look at single samples.
    ratio: Option<Ratio>,
    /// Position of each sample's unit among the drawn; `None` where that is the sample's own.
    unit_of: Option<Vec<u32>>,
    side: Side,
}

/// Room for one resample.
pub(super) struct Scratch {
    /// How often each unit was drawn.
    pub(super) counts: Vec<u32>,
    /// The same numbers.
    factors: Vec<f64>,
    weights: Vec<u32>,
}

impl<'a> Plan<'a> {
    pub(super) fn new(
        columns: impl Iterator<Item = (Side, Scored<'a>)>,
    ) -> Result<Self, BootstrapError> {
        let columns: Vec<(Side, Scored<'a>)> = columns.collect();
        let mut means = Means::default();
        for (side, scored) in &columns {
            means.add(*side, scored.metric.score(scored.samples)?.value);
        }
        let numbers = unit_numbers(&columns)?;
        let units = match u32::try_from(numbers.len()) {
            Ok(units) if units >= 2 => units,
            Ok(_) if columns.is_empty() => return Err(Undefined::Empty.into()),
            Ok(_) => {
                return Err(BootstrapError::TooFewUnits {
                    found: numbers.len(),
                });
            }
            Err(_) => {
                return Err(BootstrapError::TooManyUnits {
                    found: numbers.len(),
                });
            }
        };
        let planned = columns
            .into_iter()
            .map(|(side, scored)| PlannedColumn::new(side, scored, &numbers));
        Ok(Self {
            columns: planned.collect::<Result<_, Undefined>>()?,
            units,
            estimate: means.difference(),
        })
    }

    pub(super) fn scratch(&self) -> Scratch {
        Scratch {
            counts: vec![0; self.units as usize],
            factors: Vec::new(),
            weights: Vec::new(),
        }
    }

    /// The value for the resample whose counts are in `scratch`.
    pub(super) fn value(&self, scratch: &mut Scratch) -> Result<f64, Undefined> {
        let mut means = Means::default();
        scratch.factors.clear();
        let counts = scratch.counts.iter().copied();
        scratch.factors.extend(counts.map(f64::from));
        for column in &self.columns {
            let ratio = column.ratio.as_ref();
            if let Some(value) = ratio.and_then(|ratio| ratio.value(&scratch.factors)) {
                means.add(column.side, value);
                continue;
            }
            let weights = match &column.unit_of {
                None => &scratch.counts,
                Some(unit_of) => {
                    let count = |&unit: &u32| scratch.counts[unit as usize];
                    scratch.weights.clear();
                    scratch.weights.extend(unit_of.iter().map(count));
                    &scratch.weights
                }
            };
            means.add(column.side, column.kernel.value(weights)?);
        }
        Ok(means.difference())
    }
}

impl<'a> PlannedColumn<'a> {
    fn new(side: Side, scored: Scored<'a>, numbers: &[usize]) -> Result<Self, Undefined> {
        let position = |number: &usize| numbers.partition_point(|known| known < number) as u32;
        let samples = scored.samples.truth.len();
        let unit_of = match scored.units {
            Some(units) => Some(units.iter().map(position).collect()),
            None if numbers.len() == samples => None,
            None => Some((0..samples).map(|sample| position(&sample)).collect()),
        };
        let kernel = Kernel::new(scored.metric, scored.samples)?;
        Ok(Self {
            ratio: kernel.ratio(unit_of.as_deref(), numbers.len()),
            kernel,
            unit_of,
            side,
        })
    }
}

/// The numbers of all units that have a sample, ascending.
fn unit_numbers(columns: &[(Side, Scored<'_>)]) -> Result<Vec<usize>, BootstrapError> {
    let mut numbers = Vec::new();
    for (_, scored) in columns {
        let samples = scored.samples.truth.len();
        match scored.units {
            Some(units) if units.len() != samples => {
                return Err(BootstrapError::UnitMismatch {
                    samples,
                    units: units.len(),
                });
            }
            Some(units) => numbers.extend_from_slice(units),
            None => numbers.extend(0..samples),
        }
        numbers.sort_unstable();
        numbers.dedup();
    }
    Ok(numbers)
}

/// Running means of the two sides.
#[derive(Default)]
struct Means {
    first: (f64, usize),
    second: (f64, usize),
}

impl Means {
    fn add(&mut self, side: Side, value: f64) {
        let (sum, count) = match side {
            Side::First => &mut self.first,
            Side::Second => &mut self.second,
        };
        *sum += value;
        *count += 1;
    }

    fn difference(&self) -> f64 {
        let mean = |(sum, count): (f64, usize)| if count == 0 { 0.0 } else { sum / count as f64 };
        mean(self.first) - mean(self.second)
    }
}
