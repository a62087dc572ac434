/// P-values corrected for how many were looked at (Holm, "A simple sequentially rejective multiple
/// test procedure", Scandinavian Journal of Statistics 6, 1979), in the same order. If those are
/// called real whose corrected p-value is at most q, chance alone makes any call at all with a
/// probability of at most q, however the values depend on one another.
///
/// ```
/// let corrected = sps_metrics::holm(&[0.01, 0.04, 0.03]);
/// assert_eq!(corrected, [0.03, 0.06, 0.06]);
/// ```
pub fn holm(p_values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p_values.len()).collect();
    order.sort_by(|&a, &b| p_values[a].total_cmp(&p_values[b]));
    let mut corrected = vec![1.0; p_values.len()];
    let mut least: f64 = 0.0;
    for (before, at) in order.into_iter().enumerate() {
        least = least.max((p_values.len() - before) as f64 * p_values[at]);
        corrected[at] = least.min(1.0);
    }
    corrected
}
