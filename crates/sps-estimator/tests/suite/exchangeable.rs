//! What p-values and intervals promise, simulated: no encoder, and surfaces that are drawn.

use crate::support::{calibration, examples, grouped, ridge, uniform};
use sps_estimator::{Fitted, Predictions, Recipe, Widths};
use sps_metrics::Level;
use sps_regress::{Embeddings, Readings};

const WIDTH: usize = 6;
const DRAWS: usize = 1500;

/// Normal numbers (Box and Muller 1958).
fn normal(purpose: &str, index: u64) -> f64 {
    let (radius, angle) = (uniform(purpose, 2 * index), uniform(purpose, 2 * index + 1));
    (-2.0 * radius.ln()).sqrt() * (std::f64::consts::TAU * angle).cos()
}

fn normals<const N: usize>(purpose: &str, index: usize) -> [f64; N] {
    std::array::from_fn(|at| normal(purpose, (index * N + at) as u64))
}

fn recipe<P: Into<String>>(properties: impl IntoIterator<Item = P>, seed: u64) -> Recipe {
    Recipe {
        widths: Widths::Constant,
        ..Recipe::new(ridge(), properties, &[0], calibration(0.4, 0.8, seed))
    }
}

/// Fits to single surfaces and what was felt on each, a value for each property.
fn fitted(recipe: &Recipe, embedded: &Embeddings, felt: &[Vec<f64>], draw: usize) -> Fitted {
    let cells = |felt: &Vec<f64>| felt.iter().copied().map(Some).collect();
    let rows: Vec<Vec<Option<f64>>> = felt.iter().map(cells).collect();
    let names = recipe.wanted.iter().map(|wanted| wanted.property.clone());
    let readings = Readings::new(names.collect(), &rows).unwrap();
    let (units, all) = (grouped(0..rows.len()), (0..rows.len()).collect::<Vec<_>>());
    let examples = examples(embedded, &readings, &units);
    recipe.fit(&examples, &all, draw as u64).unwrap()
}

/// Whether the interval of a property of a surface holds a value.
fn holds(predictions: &Predictions, property: usize, surface: usize, value: f64) -> bool {
    let interval = predictions.properties[property].intervals.as_ref().unwrap()[surface];
    (interval.low..=interval.high).contains(&value)
}

/// Three standard errors of a share of 0.8 that draws of so many new surfaces each find. Surfaces of one
/// draw share their calibration: its spread is that of a Beta(20, 5) variable, 0.078.
fn error(draws: usize, new: usize) -> f64 {
    3.0 * (0.078_f64.powi(2) / draws as f64 + 0.16 / (draws * new) as f64).sqrt()
}

fn embeddings(rows: &[[f64; WIDTH]]) -> Embeddings {
    let values = rows.as_flattened().iter().map(|&x| x as f32).collect();
    Embeddings::new(values, [rows.len(), 1, WIDTH]).unwrap()
}

/// What the encoder makes of a surface: it pulls what it learned from towards one point.
fn embedded(group: usize, member: usize, learned: bool) -> [f64; WIDTH] {
    let (own, common): ([f64; WIDTH], [f64; WIDTH]) =
        (normals("own", member), normals("group", group));
    let pull = if learned { 0.3 } else { 1.0 };
    std::array::from_fn(|at| 2.0 + pull * (common[at] + 0.3 * own[at]))
}

/// The p-value of a surface of a new group, of a model whose encoder learned from the surfaces that are
/// fitted to; none where the fit is not told.
fn p_value(draw: usize, (groups, of_group): (usize, usize), told: bool) -> Option<f64> {
    let all: Vec<usize> = (0..groups * of_group).collect();
    let units = grouped(all.iter().map(|at| at / of_group));
    let recipe = recipe(["felt"], draw as u64);
    let part = recipe.calibration.part(&units, &all, 0).unwrap();
    let of = |at: usize| {
        let group = draw * (groups + 1) + at / of_group;
        let member = draw * (all.len() + 1) + at;
        embedded(group, member, part.train.contains(&at))
    };
    let rows: Vec<[f64; WIDTH]> = all.iter().map(|&at| of(at)).collect();
    let felt: Vec<Vec<Option<f64>>> = rows.iter().map(|row| vec![Some(row[0])]).collect();
    let embedded = embeddings(&rows);
    let readings = Readings::new(vec!["felt".into()], &felt).unwrap();
    let mut examples = examples(&embedded, &readings, &units);
    examples.encoder_saw = if told { &part.train } else { &[] };
    let fitted = recipe.fit(&examples, &all, 0).unwrap();
    let new = fitted.predict(&embeddings(&[of(all.len())])).unwrap();
    Some(new.familiar?[0])
}

/// The share of draws whose p-value is at most `q`, and three standard errors of it where it is `q`.
fn at_most(q: f64, p_values: &[f64]) -> (f64, f64) {
    let share = p_values.iter().filter(|p| **p <= q + 1e-12).count() as f64 / p_values.len() as f64;
    (share, 3.0 * (q * (1.0 - q) / p_values.len() as f64).sqrt())
}

/// 19 of 48 surfaces calibrate, so p-values are multiples of 1 / 20, each as likely as any other.
#[test]
fn p_values_are_uniform_where_an_encoder_was_trained() {
    let p_values = |told| -> Vec<f64> {
        let each = (0..DRAWS).map(|draw| p_value(draw, (48, 1), told));
        each.collect::<Option<_>>().unwrap()
    };
    let told = p_values(true);
    for q in [0.05, 0.2, 0.5] {
        let (share, error) = at_most(q, &told);
        assert!((share - q).abs() < error, "{share} of {q}");
    }
    // Held against what the encoder learned from, new surfaces look strange.
    let (share, error) = at_most(0.05, &p_values(false));
    assert!(share > 0.05 + 2.0 * error, "{share}");
}

/// 20 of 50 groups calibrate, three surfaces each: a surface of a new group is held against one of each.
#[test]
fn p_values_are_uniform_for_new_groups() {
    let p_values = (0..DRAWS).map(|draw| p_value(draw, (50, 3), true));
    let p_values: Vec<f64> = p_values.collect::<Option<_>>().unwrap();
    for q in [1.0, 4.0, 10.0].map(|rank| rank / 21.0) {
        let (share, error) = at_most(q, &p_values);
        assert!((share - q).abs() < error, "{share} of {q}");
    }
}

/// 18 of 46 surfaces calibrate.
#[test]
fn too_few_that_the_encoder_has_not_seen_have_no_p_value() {
    assert_eq!(p_value(0, (46, 1), true), None);
    assert!(p_value(0, (46, 1), false).is_some());
}

const SURFACES: usize = 99;
const PHOTOGRAPHS: usize = 4;

/// How far off estimates of photographs of one surface are: by the same, each by its own where large
/// errors are frequent (the share above x falls as 1 / sqrt(x)), or partly by the same.
#[derive(Clone, Copy, Debug)]
enum Errors {
    Alike,
    Apart,
    Partly,
}

fn errors(of: Errors, surface: usize) -> [f64; PHOTOGRAPHS] {
    let heavy = |at: usize| {
        let index = (surface * PHOTOGRAPHS + at) as u64;
        uniform("heavy", index).powi(-2)
    };
    let own: [f64; PHOTOGRAPHS] = normals("apart", surface);
    let common = normal("alike", surface as u64);
    std::array::from_fn(|at| match of {
        Errors::Alike => common,
        Errors::Apart => heavy(at),
        Errors::Partly => common + own[at],
    })
}

/// Whether the mean of four intervals holds the truth, 0, and whether the mean of four that hold at 90 %
/// each does. Photographs of 99 surfaces calibrate, one of each.
fn held(of: Errors, trial: usize) -> [bool; 2] {
    let first = trial * (SURFACES + 1);
    let units = grouped(0..SURFACES);
    let calibrating = (0..SURFACES).map(|at| (at, errors(of, first + at)[0]));
    let calibrating: Vec<(usize, f64)> = calibrating.collect();
    let new = errors(of, first + SURFACES);
    let mean = new.iter().sum::<f64>() / PHOTOGRAPHS as f64;
    [0.975, 0.9].map(|level| {
        let level = Level::new(level).unwrap();
        mean.abs() <= sps_estimator::radius(&units, &calibrating, level).unwrap()
    })
}

/// Of errors that are one, the mean of intervals is one interval: at 97.5 % its coverage is 0.98, the
/// 98th of 100. Of errors apart, the mean of intervals that hold at 90 % holds about
/// 1 - sqrt(4) * 0.1 = 0.8 of the truths, since the largest error decides.
#[test]
fn the_mean_of_several_intervals_holds_what_it_promises() {
    for of in [Errors::Alike, Errors::Apart, Errors::Partly] {
        let trials: Vec<[bool; 2]> = (0..DRAWS).map(|trial| held(of, trial)).collect();
        let coverage = |which: usize| {
            let held = trials.iter().filter(|trial| trial[which]).count();
            held as f64 / DRAWS as f64
        };
        let error = 3.0 * (0.9 * 0.1 / DRAWS as f64).sqrt();
        assert!(coverage(0) >= 0.9 - error, "{of:?}: {}", coverage(0));
        match of {
            Errors::Alike => assert!((coverage(0) - 0.98).abs() < 0.011, "{}", coverage(0)),
            Errors::Apart => assert!(coverage(1) < 0.9 - error, "{}", coverage(1)),
            Errors::Partly => {}
        }
    }
}

/// The share of new surfaces whose three readings all lie in their intervals, each by itself and at once.
/// 24 of 60 surfaces calibrate at 80 %; readings are of one thing with errors of their own.
#[test]
fn joint_intervals_hold_all_properties_at_once() {
    const PROPERTIES: usize = 3;
    const SURFACES: usize = 60;
    const NEW: usize = 20;
    let names: Vec<String> = (0..PROPERTIES).map(|at| at.to_string()).collect();
    let recipe = recipe(&names, 0);
    let (mut alone, mut at_once) = (0, 0);
    let draws = DRAWS / 10;
    for draw in 0..draws {
        let of = |at: usize| -> ([f64; WIDTH], Vec<f64>) {
            let member = draw * (SURFACES + NEW) + at;
            let row: [f64; WIDTH] = normals("joint", member);
            let errors: [f64; PROPERTIES] = normals("joint errors", member);
            (row, errors.iter().map(|error| row[0] + error).collect())
        };
        let (rows, felt): (Vec<_>, Vec<_>) = (0..SURFACES + NEW).map(of).unzip();
        let (rows, new) = rows.split_at(SURFACES);
        let (felt, truths) = felt.split_at(SURFACES);
        let fitted = fitted(&recipe, &embeddings(rows), felt, draw);
        let hold = |predictions: &Predictions| {
            let hold = |&surface: &usize| {
                let held = |at: usize| holds(predictions, at, surface, truths[surface][at]);
                (0..PROPERTIES).all(held)
            };
            (0..NEW).filter(hold).count()
        };
        alone += hold(&fitted.predict(&embeddings(new)).unwrap());
        at_once += hold(&fitted.predict_jointly(&embeddings(new)).unwrap());
    }
    let share = |count: usize| count as f64 / (draws * NEW) as f64;
    let [alone, at_once] = [alone, at_once].map(share);
    println!("all three held: {alone:.3} alone, {at_once:.3} at once");
    assert!((at_once - 0.8).abs() < error(draws, NEW), "{at_once}");
    assert!(alone < 0.7, "{alone}");
}

/// Surfaces that differ in how hard they are, seen in three views that are each as hard. 24 of 60 calibrate
/// at 80 %.
#[test]
fn intervals_hold_at_the_promised_rate_wherever_one_stops() {
    const VIEWS: usize = 3;
    const SURFACES: usize = 60;
    const NEW: usize = 20;
    let mut recipe = recipe(["felt"], 0);
    recipe.one_by_one = true;
    recipe.widths = Widths::ByPhotograph;
    recipe.wanted[0].views = (0..VIEWS).collect();
    let draws = DRAWS / 10;
    let (mut held, mut views) = ([0; 2], [0; VIEWS]);
    for draw in 0..draws {
        let felt = |at: usize| normal("felt", (draw * (SURFACES + NEW) + at) as u64);
        let of = |surfaces: std::ops::Range<usize>| {
            let rows = surfaces.clone().flat_map(|at| {
                let member = draw * (SURFACES + NEW) + at;
                let hard = 0.1 + uniform("hard", member as u64);
                let errors: [f64; VIEWS] = normals("errors", member);
                errors.map(|error| [(felt(at) + hard * error) as f32, hard as f32])
            });
            let values = rows.flatten().collect();
            Embeddings::new(values, [surfaces.len(), VIEWS, 2]).unwrap()
        };
        let (embedded, new) = (of(0..SURFACES), of(SURFACES..SURFACES + NEW));
        let rows: Vec<Vec<f64>> = (0..SURFACES).map(|at| vec![felt(at)]).collect();
        let fitted = fitted(&recipe, &embedded, &rows, draw);
        let surfaces: Vec<usize> = (0..NEW).collect();
        let step = |count| {
            let slots: Vec<usize> = (0..count).collect();
            let seen = new.select(&surfaces, &slots).unwrap();
            fitted.predict(&seen).unwrap()
        };
        let steps: Vec<Predictions> = fitted.steps().map(step).collect();
        for (surface, end) in fitted.ends(&steps, 1.6, 0..1).into_iter().enumerate() {
            views[end] += 1;
            let holds = |step: &Predictions| holds(step, 0, surface, felt(SURFACES + surface));
            held[0] += usize::from(holds(&steps[end]));
            // Whoever stops where it is worst.
            held[1] += usize::from(steps.iter().all(holds));
        }
    }
    let share = held.map(|count| count as f64 / (draws * NEW) as f64);
    println!("held {share:?}, views {views:?}");
    assert!(share[0] >= share[1]);
    assert!((share[1] - 0.8).abs() < error(draws, NEW), "{share:?}");
    // Easy surfaces take fewer views.
    assert!(views.iter().all(|count| *count > 0), "{views:?}");
}
