use super::*;

fn embeddings(points: &[f32]) -> Embeddings {
    Embeddings::new(points.to_vec(), [points.len(), 1, 1]).unwrap()
}

/// Three clusters: one of each before a second of any, the largest first.
#[test]
fn clusters_are_measured_in_turn() {
    let points = [0.0, 0.01, 0.02, 0.03, 5.0, 5.01, 5.02, 9.0, 9.01];
    let ridge = KernelRidge::default();
    let chosen = ridge.most_telling(&embeddings(&points), &[], 3).unwrap();
    let cluster = |at: &usize| usize::from(points[*at] > 2.0) + usize::from(points[*at] > 7.0);
    let mut clusters: Vec<usize> = chosen.iter().map(cluster).collect();
    clusters.sort_unstable();
    assert_eq!(clusters, [0, 1, 2]);
    // What was measured is not asked for again.
    let next = ridge.most_telling(&embeddings(&points), &chosen[..2], 1);
    assert_eq!(next.unwrap(), chosen[2..]);
}

#[test]
fn no_more_than_there_are_are_chosen_and_too_many_are_refused() {
    let points = embeddings(&[0.0, 1.0, 2.0]);
    let ridge = KernelRidge::default();
    assert_eq!(ridge.most_telling(&points, &[1], 10).unwrap().len(), 2);
    let error = ridge.most_telling(&points, &[3], 1).unwrap_err();
    assert!(error.to_string().contains("measured surfaces"), "{error}");
    let config = KernelRidgeConfig {
        at_most: 2,
        ..KernelRidgeConfig::default()
    };
    let few = KernelRidge::new(config).unwrap();
    let error = few.most_telling(&points, &[], 1).unwrap_err().to_string();
    assert!(error.contains("found 3, expected at most 2"), "{error}");
}
