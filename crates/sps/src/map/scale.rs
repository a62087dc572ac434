//! What the colours of a map stand for.

use colorous::CIVIDIS;
use sps_experiment::text::{decimals, number};

/// The ends of the colours, which are those of the estimates.
pub(super) struct Scale {
    pub lowest: f64,
    pub highest: f64,
    /// Half the mean width of the intervals, where there are any.
    pub half_width: Option<f64>,
    level: f64,
    decimals: usize,
}

impl Scale {
    /// Of estimates and intervals at this level, as [`super::Wanted::write`] has them, of a property
    /// whose readings have this standard deviation.
    pub(super) fn of(places: &[[f64; 4]], level: f64, deviation: f64) -> Self {
        let values = places.iter().map(|place| place[0]);
        let lowest = values.clone().fold(f64::INFINITY, f64::min);
        let highest = values.fold(f64::NEG_INFINITY, f64::max);
        let widths = places.iter().map(|place| place[2] - place[1]);
        let half = widths.sum::<f64>() / (2 * places.len()) as f64;
        let spread = highest - lowest;
        let spread = if spread > 0.0 { spread } else { deviation };
        Self {
            lowest,
            highest,
            half_width: half.is_finite().then_some(half),
            level,
            decimals: decimals(spread),
        }
    }

    /// A value with as many digits as tell the colours apart.
    pub(super) fn shown(&self, value: f64) -> String {
        number(Some(value), self.decimals)
    }

    /// How far the intervals reach to either side, with their level.
    pub(super) fn intervals(&self) -> Option<String> {
        let half = self.half_width?;
        let shown = number(Some(half), decimals(half));
        Some(format!("+/- {shown} ({:.0} %)", 100.0 * self.level))
    }

    /// What the map shows, in words.
    pub(super) fn in_words(&self) -> String {
        let [lowest, highest] = [self.lowest, self.highest].map(|value| self.shown(value));
        let colours = format!("colours from {lowest} to {highest}");
        let Some((half, intervals)) = self.half_width.zip(self.intervals()) else {
            return colours;
        };
        let narrow = if self.highest - self.lowest < half {
            ": the colours differ by less than that"
        } else {
            ""
        };
        format!("{colours}, intervals {intervals}{narrow}")
    }

    /// Cividis (Nuñez, Anderton and Renslow 2018), which people see alike whether or not they tell red from green.
    pub(super) fn colour(&self, value: f64) -> [f32; 3] {
        let share = (value - self.lowest) / (self.highest - self.lowest);
        // Where all are one value, that of the middle.
        let share = if share.is_finite() { share } else { 0.5 };
        let colour = CIVIDIS.eval_continuous(share.clamp(0.0, 1.0));
        [colour.r, colour.g, colour.b].map(|value| f32::from(value) / 255.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_of_a_narrow_map_differ() {
        let places = [[-1.04, -2.0, 0.0, 0.5], [-1.08, -3.0, 1.0, 0.5]];
        let scale = Scale::of(&places, 0.9, 30.0);
        let labels = [scale.highest, -1.06, scale.lowest].map(|value| scale.shown(value));
        assert_eq!(labels, ["-1.0400", "-1.0600", "-1.0800"]);
        let colours = "colours from -1.0800 to -1.0400, intervals +/- 1.50 (90 %)";
        let narrow = format!("{colours}: the colours differ by less than that");
        assert_eq!(scale.in_words(), narrow);
    }

    #[test]
    fn hard_cases() {
        let scale = Scale::of(&[[-0.001, f64::NAN, f64::NAN, f64::NAN]; 2], 0.9, 30.0);
        assert_eq!(scale.shown(scale.lowest), "0.0");
        assert_eq!(scale.in_words(), "colours from 0.0 to 0.0");
    }
}
