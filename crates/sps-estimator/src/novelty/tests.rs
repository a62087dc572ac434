use proptest::prelude::*;

use super::*;

/// Numbers that look normal, from a hash of where they stand.
fn numbers(seed: u64, count: usize) -> Vec<f32> {
    let uniform = |at: u64| {
        let hash = blake3::hash(&[seed.to_le_bytes(), at.to_le_bytes()].concat());
        let bytes = hash.as_bytes().first_chunk().copied().unwrap_or_default();
        f64::from(u32::from_le_bytes(bytes)) / f64::from(u32::MAX)
    };
    let normal = |at: u64| (0..4).map(|k| uniform(4 * at + k)).sum::<f64>() - 2.0;
    (0..count as u64).map(|at| normal(at) as f32).collect()
}

fn embeddings(values: Vec<f32>, views: usize, width: usize) -> Embeddings {
    let surfaces = values.len() / (views * width);
    Embeddings::new(values, [surfaces, views, width]).unwrap()
}

/// Of one view each.
fn familiar(values: Vec<f32>, width: usize) -> Familiar {
    Familiar::of(&embeddings(values, 1, width), &[1]).unwrap()
}

/// As the definition has it: every surface scored among all others, in f64. The least and the most
/// that rounding to f32 can make of it; scores that are equal are so in either.
fn naive(all: &[&[f32]], new: &[f32]) -> [f64; 2] {
    let unit = |x: &&[f32]| -> Vec<f64> {
        let length = x.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>().sqrt();
        x.iter().map(|&x| f64::from(x) / length).collect()
    };
    let units: Vec<Vec<f64>> = all.iter().chain([&new]).map(unit).collect();
    let neighbours = 5.min(all.len() - 1);
    let score = |at: usize| {
        let others = units.iter().enumerate().filter(|(other, _)| *other != at);
        let distance = |other: &Vec<f64>| {
            let pairs = other.iter().zip(&units[at]);
            pairs.map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
        };
        let mut distances: Vec<f64> = others.map(|(_, other)| distance(other)).collect();
        distances.sort_by(f64::total_cmp);
        distances[..neighbours].iter().sum::<f64>() / neighbours as f64
    };
    let of_new = score(all.len());
    let scores: Vec<f64> = (0..=all.len()).map(score).collect();
    let share = |strange: &dyn Fn(&f64) -> bool| {
        let count = scores.iter().filter(|score| strange(score)).count();
        count as f64 / scores.len() as f64
    };
    let least = share(&|score| *score == of_new || *score > of_new + 1e-6);
    [least, share(&|score| *score > of_new - 1e-6)]
}

proptest! {
    #[test]
    fn is_full_conformal_prediction(seed in any::<u64>(), surfaces in 2_usize..30) {
        const WIDTH: usize = 19;
        let values = numbers(seed, (surfaces + 1) * WIDTH);
        let (known, new) = values.split_at(surfaces * WIDTH);
        let familiar = familiar(known.to_vec(), WIDTH);
        let found = familiar.p_values(&embeddings(new.to_vec(), 1, WIDTH)).unwrap()[0];
        let all: Vec<&[f32]> = known.chunks_exact(WIDTH).collect();
        let [least, most] = naive(&all, new);
        prop_assert!(least <= found && found <= most, "{found}, expected {least} to {most}");
    }
}

/// Of exchangeable surfaces a share of at most q has a p-value of at most q, and not much less.
#[test]
fn p_values_are_uniform_where_nothing_is_new() {
    const DRAWS: u64 = 2000;
    const SURFACES: usize = 24;
    let p_value = |seed: u64| {
        let values = numbers(seed, (SURFACES + 1) * 6);
        let (known, new) = values.split_at(SURFACES * 6);
        let familiar = familiar(known.to_vec(), 6);
        familiar.p_values(&embeddings(new.to_vec(), 1, 6)).unwrap()[0]
    };
    let p_values: Vec<f64> = (0..DRAWS).map(p_value).collect();
    for q in [0.04, 0.2, 0.52] {
        let share = p_values.iter().filter(|p| **p <= q + 1e-12).count() as f64 / DRAWS as f64;
        let error = 3.0 * (q * (1.0 - q) / DRAWS as f64).sqrt();
        assert!((share - q).abs() < error, "{share} of {q}");
    }
}

#[test]
fn hard_cases() {
    let one = embeddings(numbers(1, 8), 1, 8);
    let reason = Familiar::of(&one, &[1]).unwrap_err();
    assert!(reason.contains("found 1 surface"), "{reason}");
    // Black photographs have no direction; identical ones no distance.
    let familiar = familiar([vec![0.0; 8], vec![1.0; 16]].concat(), 8);
    let p_values = familiar.p_values(&embeddings([vec![0.0; 8], vec![2.0; 8]].concat(), 1, 8));
    assert_eq!(p_values.unwrap(), [1.0, 1.0]);
    for (views, width, found) in [(1, 9, "1 views of width 9"), (2, 8, "2 views")] {
        let other = embeddings(vec![1.0; views * width], views, width);
        let error = familiar.p_values(&other).unwrap_err().to_string();
        assert!(error.contains(found), "{error}");
    }
}

#[test]
fn several_views_are_held_against_several() {
    let known = embeddings(numbers(3, 12 * 3 * 5), 3, 5);
    let familiar = Familiar::of(&known, &[1, 3]).unwrap();
    let bytes = familiar.to_bytes().unwrap();
    assert_eq!(Familiar::from_bytes(&bytes).as_ref(), Ok(&familiar));
    assert!(familiar.answers(&[3, 1], 5) && !familiar.answers(&[2], 5));
    let new = embeddings(numbers(4, 3 * 5), 3, 5);
    // The first view alone is what it would be without the others.
    let first = (0..12).flat_map(|at| known.get(at, 0).unwrap().to_vec());
    let alone = self::familiar(first.collect(), 5);
    let new_first = embeddings(new.get(0, 0).unwrap().to_vec(), 1, 5);
    let p_values = [familiar.clone(), alone].map(|one| one.p_values(&new_first).unwrap());
    assert_eq!(p_values[0], p_values[1]);
    assert_eq!(familiar.p_values(&new).unwrap().len(), 1);
}

#[test]
fn other_bytes_are_refused() {
    let familiar = familiar(numbers(3, 12 * 5), 5);
    let bytes = familiar.to_bytes().unwrap();
    for at in 0..bytes.len().min(200) {
        assert!(Familiar::from_bytes(&bytes[..at]).is_err(), "{at}");
    }
    let mut not_finite = bytes.clone();
    let end = not_finite.len();
    not_finite[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
    let reason = Familiar::from_bytes(&not_finite).unwrap_err();
    assert!(reason.contains("NaN"), "{reason}");
}

/// Distances between points of a circle, by hand: the chord of an angle a is 2 sin(a / 2).
#[test]
fn the_nearest_is_nearest_by_the_mean_over_photographs() {
    let at = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        [cos as f32, sin as f32]
    };
    let points = |all: &[f64]| all.iter().copied().flat_map(at).collect::<Vec<f32>>();
    let familiar = familiar(points(&[0.0, 60.0, 90.0, 180.0]), 2);
    let two = points(&[150.0, 0.0, 120.0]);
    let found = familiar.nearest(&embeddings(two, 1, 2), 1..3);
    let chord = |degrees: f64| 2.0 * (degrees / 2.0).to_radians().sin();
    let mean = |a: f64, b: f64| f64::midpoint(chord(a), chord(b));
    let mut expected = [
        (0, mean(0.0, 120.0)),
        (1, mean(60.0, 60.0)),
        (2, mean(90.0, 30.0)),
        (3, mean(180.0, 60.0)),
    ];
    expected.sort_by(|a, b| a.1.total_cmp(&b.1));
    for (found, expected) in found.iter().zip(&expected) {
        assert_eq!(found.0, expected.0);
        let near = (found.1 - expected.1).abs() < 1e-6;
        assert!(near, "{found:?}, expected {expected:?}");
    }
    assert_eq!(found.len(), 4);
}
