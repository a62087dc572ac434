//! Statistics of the published dataset, to stand beside those of another.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use serde::Deserialize;

/// What the paper's figure of statistics shows.
#[derive(Deserialize)]
pub struct Published {
    /// Minimum, quartiles and maximum of each property over the surfaces.
    pub quantiles: BTreeMap<String, [f64; 5]>,
    /// Share of surfaces with each material label.
    pub materials: BTreeMap<String, f64>,
}

/// Statistics of the published dataset.
pub fn published() -> &'static Published {
    static PUBLISHED: LazyLock<Published> = LazyLock::new(|| {
        let committed = toml::from_str(include_str!("published.toml"));
        committed.expect("the committed statistics are read by a test")
    });
    &PUBLISHED
}

#[cfg(test)]
mod tests {
    use super::*;
    use sps_dataset::toccare;

    #[test]
    fn every_property_has_rising_quantiles() {
        for property in toccare::properties() {
            let quantiles = published().quantiles[property.code()];
            assert!(quantiles.is_sorted(), "{property}: {quantiles:?}");
        }
        let shares: f64 = published().materials.values().sum();
        // Printed to 0.1 % each, and cut out of a picture.
        assert!((shares - 1.0).abs() < 0.02, "{shares}");
    }
}
