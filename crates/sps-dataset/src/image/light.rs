use serde::Serialize;

/// What had to be done to the linear light of an EXR to show it, in samples (three per pixel).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct LightCounts {
    /// NaN, shown black.
    pub nan: usize,
    /// Infinite: shown white, or black where negative.
    pub infinite: usize,
    /// Finite light below zero, shown black.
    pub negative: usize,
    /// Finite light above 1 after exposure, shown white.
    pub clipped: usize,
}

impl LightCounts {
    /// Adds the counts of another frame.
    pub fn add(&mut self, other: &Self) {
        self.nan += other.nan;
        self.infinite += other.infinite;
        self.negative += other.negative;
        self.clipped += other.clipped;
    }
}
