//! The paper's printed results, to stand beside measured ones.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use serde::Deserialize;

const TABLES: &str = include_str!("paper.toml");

/// One printed row; what the paper does not print is empty.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct PaperRow {
    /// R² per property.
    #[serde(default)]
    pub r2: BTreeMap<String, f64>,
    /// Median percentage error per property.
    #[serde(default)]
    pub median_percent_error: BTreeMap<String, f64>,
    /// Mean R² over the properties.
    pub r2_mean: f64,
    /// Mean absolute error, over the properties.
    pub mae_mean: f64,
    /// Mean of the median percentage errors.
    pub median_percent_error_mean: f64,
    /// The same over the paper's fixed list of eight.
    pub median_percent_error_top8: f64,
}

#[derive(Deserialize)]
struct Tables {
    top8: Vec<String>,
    methods: BTreeMap<String, PaperRow>,
    ablation: Vec<PaperRow>,
}

static PRINTED: LazyLock<Tables> =
    LazyLock::new(|| toml::from_str(TABLES).expect("the committed tables are read by a test"));

/// The eight properties of the paper's top-8 average.
pub(crate) fn top8() -> &'static [String] {
    &PRINTED.top8
}

/// The printed row that a config calls `name`: a method of the per-property tables
/// (`cross-modal`), or `ablation.N` for the N-th row of the ablation.
pub fn row(name: &str) -> Option<&'static PaperRow> {
    match name.strip_prefix("ablation.") {
        Some(index) => PRINTED.ablation.get(index.parse::<usize>().ok()?),
        None => PRINTED.methods.get(name),
    }
}

pub(crate) fn names() -> Vec<String> {
    let ablation = (0..PRINTED.ablation.len()).map(|i| format!("ablation.{i}"));
    PRINTED.methods.keys().cloned().chain(ablation).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn every_printed_row_is_whole() {
        let tables: toml::Table = TABLES.parse().unwrap();
        let properties = tables["properties"].as_array().unwrap().iter();
        let properties: BTreeSet<&str> = properties.map(|code| code.as_str().unwrap()).collect();
        assert_eq!(properties.len(), 15);
        assert_eq!(names().len(), 10 + 7);
        for method in PRINTED.methods.values() {
            for values in [&method.r2, &method.median_percent_error] {
                assert!(values.keys().eq(&properties), "{values:?}");
            }
        }
        let keys = TABLES.lines().filter_map(|line| line.split_once(" = "));
        let keys: BTreeSet<&str> = keys.map(|(key, _)| key).collect();
        let known = [
            "adversarial",
            "classification",
            "cross-modal",
            "label",
            "mae-mean",
            "median-percent-error",
            "median-percent-error-mean",
            "median-percent-error-top8",
            "properties",
            "r2",
            "r2-mean",
            "top8",
        ];
        assert_eq!(keys, known.into());
    }

    #[test]
    fn rows_are_found_by_name() {
        assert_eq!(row("vb-nvs").unwrap().r2["fRS"], 0.65);
        assert_eq!(row("ablation.0").unwrap().mae_mean, 6.17);
        assert_eq!(row("ablation.7"), None);
        assert_eq!(row("nothing"), None);
    }
}
