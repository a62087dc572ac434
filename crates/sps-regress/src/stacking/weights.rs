use std::cmp::Ordering;

/// A pivot below this part of its diagonal element says that columns depend on each other.
const DEPENDENT: f64 = 1e-12;

/// The weights, none below zero, of the columns' sum nearest to `target` by least squares: the best
/// of the unconstrained solutions over all subsets of the columns whose weights are above zero. All
/// weights are zero where no column helps.
pub(super) fn nonnegative_least_squares(columns: &[Vec<f64>], target: &[f64]) -> Vec<f64> {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let row = |a: &Vec<f64>| columns.iter().map(|b| dot(a, b)).collect();
    let gram: Vec<Vec<f64>> = columns.iter().map(row).collect();
    let right: Vec<f64> = columns.iter().map(|column| dot(column, target)).collect();
    let mut best = (0.0, vec![0.0; columns.len()]);
    for subset in 1..1_u32 << columns.len() {
        let members = (0..columns.len()).filter(|m| subset >> m & 1 == 1);
        let members: Vec<usize> = members.collect();
        let Some(solution) = solve(&gram, &right, &members) else {
            continue;
        };
        // What the squared error falls by.
        let gain = members.iter().zip(&solution).map(|(&m, w)| right[m] * w);
        let gain: f64 = gain.sum();
        if gain > best.0 && solution.iter().all(|&weight| weight > 0.0) {
            let mut weights = vec![0.0; columns.len()];
            for (&member, weight) in members.iter().zip(solution) {
                weights[member] = weight;
            }
            best = (gain, weights);
        }
    }
    best.1
}

/// Solves the normal equations of some of the columns by Gaussian elimination, which needs no
/// exchange of rows for such a matrix; `None` where the columns depend on each other.
fn solve(gram: &[Vec<f64>], right: &[f64], members: &[usize]) -> Option<Vec<f64>> {
    let row = |&i: &usize| -> Vec<f64> {
        let row = members.iter().map(|&j| gram[i][j]);
        row.chain([right[i]]).collect()
    };
    let mut rows: Vec<Vec<f64>> = members.iter().map(row).collect();
    let size = members.len();
    for pivot in 0..size {
        let diagonal = gram[members[pivot]][members[pivot]];
        if rows[pivot][pivot].partial_cmp(&(DEPENDENT * diagonal)) != Some(Ordering::Greater) {
            return None;
        }
        let of_pivot = rows[pivot].clone();
        for row in &mut rows[pivot + 1..] {
            let factor = row[pivot] / of_pivot[pivot];
            for (value, other) in row.iter_mut().zip(&of_pivot) {
                *value -= factor * other;
            }
        }
    }
    let mut solution = vec![0.0; size];
    for i in (0..size).rev() {
        let known: f64 = (i + 1..size).map(|j| rows[i][j] * solution[j]).sum();
        solution[i] = (rows[i][size] - known) / rows[i][i];
    }
    Some(solution)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::golden::uniform;

    fn estimate(columns: &[Vec<f64>], weights: &[f64], i: usize) -> f64 {
        columns.iter().zip(weights).map(|(c, w)| c[i] * w).sum()
    }

    fn squared_error(columns: &[Vec<f64>], target: &[f64], weights: &[f64]) -> f64 {
        let left = target.iter().enumerate();
        let left = left.map(|(i, t)| t - estimate(columns, weights, i));
        left.map(|error| error.powi(2)).sum()
    }

    /// Against projected coordinate descent until nothing moves.
    #[test]
    fn no_other_weights_are_better() {
        for case in 0..40 {
            let draw = |name: &str| uniform(&format!("stacking.{case}.{name}"), 12);
            let columns: Vec<Vec<f64>> = (0..4).map(|m| draw(&m.to_string())).collect();
            let target = draw("target");
            let found = nonnegative_least_squares(&columns, &target);
            let mut weights = vec![0.0; 4];
            for _ in 0..2000 {
                for m in 0..4 {
                    weights[m] = 0.0;
                    let rest = |i: usize| target[i] - estimate(&columns, &weights, i);
                    let along: f64 = (0..12).map(|i| columns[m][i] * rest(i)).sum();
                    let squared: f64 = columns[m].iter().map(|v| v * v).sum();
                    weights[m] = (along / squared).max(0.0);
                }
            }
            for (found, expected) in found.iter().zip(&weights) {
                assert!((found - expected).abs() < 1e-9, "{found} {expected}");
            }
            assert!(squared_error(&columns, &target, &found) <= target.iter().map(|t| t * t).sum());
        }
    }

    #[test]
    fn equal_and_empty_columns_are_no_trouble() {
        let target = vec![1.0, -2.0, 3.0];
        let columns = [vec![0.0; 3], target.clone(), target.clone()];
        let weights = nonnegative_least_squares(&columns, &target);
        assert_eq!(weights, [0.0, 1.0, 0.0]);
        assert_eq!(nonnegative_least_squares(&columns[..1], &target), [0.0]);
        assert_eq!(nonnegative_least_squares(&[vec![]], &[]), [0.0]);
    }
}
