//! Fitting, asking, keeping and reading again.

mod support;

use std::fs;
use std::thread;

use sps_estimator::{
    Answer, Embedder, Estimate, Estimator, Frame, Regression, Scale, Session, Sight, Stacked,
    Widths, photographs_in, radius,
};
use sps_metrics::{Level, PredictionInterval};
use sps_models::encoders::Depths;
use sps_models::heads::{Head, HeadConfig, Input};
use sps_regress::kernel_ridge::KernelRidge;
use sps_regress::ridge::Ridge;
use sps_regress::{AnyRegressor, FittedRegressor, Plan, Rerun, Views};
use support::{Tables, embedder, photograph, read_again, recipe, refused, ridge};

fn kernel() -> Regression {
    Regression::Rows(AnyRegressor::KernelRidge(KernelRidge::default()))
}

fn network(views: usize) -> Regression {
    let config = HeadConfig {
        epochs: 2,
        input: match views {
            1 => Input::Single {},
            views => Input::LateFusion { views },
        },
        ..HeadConfig::default()
    };
    Regression::Head(Head::new(config).unwrap())
}

fn photographs(surface: usize, views: &[usize]) -> Vec<Frame> {
    views
        .iter()
        .map(|&view| photograph(surface, view))
        .collect()
}

#[test]
fn every_regression_is_read_again_to_the_bit() {
    let tables = Tables::new(40, 2, 1);
    let stacked = Regression::Stacked(Stacked {
        members: vec![ridge(), kernel(), network(2)],
        folds: 3,
    });
    for regression in [
        ridge(),
        kernel(),
        network(2),
        Regression::Rows(AnyRegressor::Nearest),
        stacked,
    ] {
        let kind = regression.kind();
        let estimator = tables.estimator(&recipe(regression, &[1, 0]));
        let again = read_again(&estimator);
        assert_eq!(again.about(), estimator.about());
        let encoder = again.embedder().network().encoder().unwrap();
        assert_eq!(
            (encoder.depths(), encoder.blocks().len()),
            (&Depths::All, 7)
        );
        let asked = photographs(97, &[1, 0]);
        let answer = estimator.predict(&asked).unwrap();
        assert_eq!(again.predict(&asked).unwrap(), answer, "{kind}");
        assert!(
            answer.estimates[0].low.is_some() && answer.familiar.is_some(),
            "{kind}"
        );
        assert_eq!(answer.estimates[0].name, "sliding resistance");
        assert_eq!(answer.estimates[1].name, "felt");
    }
}

#[test]
fn brightness_is_felt() {
    let tables = Tables::new(80, 1, 1);
    let estimator = tables.estimator(&recipe(ridge(), &[0]));
    let errors = (200..240).map(|surface| {
        let answer = estimator.predict(&photographs(surface, &[0])).unwrap();
        let truth = 60.0 * support::brightness(surface) + 2.0;
        (answer.estimates[0].value - truth).abs()
    });
    let mean = errors.sum::<f64>() / 40.0;
    assert!(mean < 4.0, "{mean}");
}

/// Without a part that calibrates, the estimates are those of a regression of all surfaces, by its own
/// crate.
#[test]
fn all_surfaces_are_fitted_to_where_none_calibrates() {
    let tables = Tables::new(30, 1, 1);
    let mut recipe = recipe(ridge(), &[0]);
    recipe.calibration.share = None;
    let estimator = tables.estimator(&recipe);
    let rerun = Rerun::new(0, tables.all());
    let plan = Plan::each(1, tables.readings.properties(), vec![rerun]);
    let ridge = Ridge::default()
        .train(&tables.examples().data, &plan)
        .unwrap();
    let expected = ridge.predict(&tables.embeddings).unwrap();
    let predictions = estimator.fitted().predict(&tables.embeddings).unwrap();
    for (found, expected) in predictions.properties.iter().zip(&expected) {
        assert_eq!(found.values, expected.values);
        let reason = found.intervals.as_ref().unwrap_err();
        assert!(reason.contains("kept aside"), "{reason}");
    }
    assert!(predictions.familiar.is_some());
    assert_eq!(estimator.no_interval().len(), 2);
}

/// A view that is looked at twice counts twice, and hides none behind it.
#[test]
fn a_view_may_be_looked_at_twice() {
    let tables = Tables::new(30, 2, 1);
    let mut recipe = recipe(ridge(), &[0, 0, 1]);
    recipe.calibration.share = None;
    let rerun = Rerun::new(0, tables.all());
    let plan = Plan::each(1, tables.readings.properties(), vec![rerun]);
    let plan = plan.with_views(&Views::Fixed(vec![0, 0, 1]));
    let ridge = Ridge::default().train(&tables.examples().data, &plan);
    let seen = tables.embeddings.select(&tables.all(), &[0, 0, 1]).unwrap();
    let expected = ridge.unwrap().predict(&seen).unwrap();
    let fitted = tables.fit(&recipe).unwrap();
    let predictions = fitted.predict(&tables.embeddings).unwrap();
    for (found, expected) in predictions.properties.iter().zip(&expected) {
        assert_eq!(found.values, expected.values);
    }
}

#[test]
fn the_angles_are_named_where_photographs_are_too_few() {
    let tables = Tables::new(20, 3, 1);
    let refused = |recipe: &sps_estimator::Recipe, count: usize| {
        let estimator = tables.estimator(recipe);
        let asked = vec![photograph(0, 0); count];
        estimator.predict(&asked).unwrap_err().to_string()
    };
    let mut recipe = recipe(ridge(), &[0, 2]);
    assert_eq!(
        refused(&recipe, 1),
        "photographs of a surface: found 1, expected 2, at 0 and 20 degrees, in this order"
    );
    recipe.one_by_one = true;
    assert_eq!(
        refused(&recipe, 3),
        "photographs of a surface: found 3, expected 1 or 2, at 0 and 20 degrees, in this order"
    );
}

#[test]
fn the_photographs_of_a_folder_are_taken_by_name() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["2.PNG", "10.jpg", "notes.txt"] {
        fs::write(folder.path().join(name), "").unwrap();
    }
    let found = photographs_in(folder.path()).unwrap();
    assert_eq!(
        found,
        ["10.jpg", "2.PNG"].map(|name| folder.path().join(name))
    );
    let above = tempfile::tempdir().unwrap();
    let refused = |folder: &std::path::Path| photographs_in(folder).unwrap_err().to_string();
    let empty = refused(above.path());
    assert!(
        empty.ends_with("found no photograph, expected files that end in png, jpg, jpeg, exr"),
        "{empty}"
    );
    for surface in ["oak", "tile"] {
        fs::create_dir(above.path().join(surface)).unwrap();
    }
    let hint = refused(above.path());
    let each = above.path().join("*").display().to_string();
    assert!(
        hint.contains("it holds folders (2)") && hint.ends_with(&each),
        "{hint}"
    );
    let missing = refused(&above.path().join("none"));
    assert!(missing.contains("none: "), "{missing}");
}

#[test]
fn several_photographs_of_one_view_are_averaged() {
    let tables = Tables::new(40, 1, 1);
    let estimator = tables.estimator(&recipe(ridge(), &[0]));
    let [one, two] =
        [60, 61].map(|surface| estimator.predict(&photographs(surface, &[0])).unwrap());
    let both = estimator
        .predict(&[photograph(60, 0), photograph(61, 0)])
        .unwrap();
    for (at, estimate) in both.estimates.iter().enumerate() {
        let mean = f64::midpoint(one.estimates[at].value, two.estimates[at].value);
        assert!((estimate.value - mean).abs() < 1e-9);
        // Wider than the mean of intervals of one photograph each.
        let low = |answer: &Answer| answer.estimates[at].low.unwrap();
        assert!(low(&both) < f64::midpoint(low(&one), low(&two)));
    }
    let smallest = one.familiar.unwrap().min(two.familiar.unwrap());
    assert_eq!(both.familiar, Some((2.0 * smallest).min(1.0)));
    refused(estimator.predict(&[]), "none");
}

/// 16 of 40 surfaces calibrate at 80 %: of their residuals in order the 14th (17 * 0.8 = 13.6) reaches to
/// either side of one photograph, the 16th of the mean of two (17 * 0.9 = 15.3) and of three (15.9), and
/// none of four (17 * 0.95 = 16.15).
#[test]
fn the_interval_of_several_photographs_holds_at_the_level() {
    let tables = Tables::new(40, 1, 1);
    let mut recipe = recipe(ridge(), &[0]);
    recipe.widths = Widths::Constant;
    let fitted = tables.estimator(&recipe);
    let estimator = read_again(&fitted);
    let part = tables.part(&recipe);
    let embeddings = tables.embeddings.select(&part.validation, &[0]).unwrap();
    let estimates = estimator.fitted().predict(&embeddings).unwrap();
    let intervals = estimates.properties[0].intervals.as_ref().unwrap();
    let pairs = part.validation.iter().zip(intervals);
    let residual = |(&at, interval): (&usize, &PredictionInterval)| {
        let centre = f64::midpoint(interval.low, interval.high);
        (tables.readings.get(at, 0).unwrap() - centre).abs()
    };
    let mut residuals: Vec<f64> = pairs.map(residual).collect();
    residuals.sort_by(f64::total_cmp);
    let photographs: Vec<Frame> = (60..64).map(|surface| photograph(surface, 0)).collect();
    for (count, rank) in [(1, 14), (2, 16), (3, 16)] {
        let answer = estimator.predict(&photographs[..count]).unwrap();
        assert_eq!(fitted.predict(&photographs[..count]).unwrap(), answer);
        let Estimate {
            value, low, high, ..
        } = answer.estimates[0].clone();
        let (low, high) = (low.unwrap(), high.unwrap());
        let reach = residuals[rank - 1];
        assert!((high - low - 2.0 * reach).abs() < 1e-9, "{count}");
        assert!(low <= value && value <= high, "{count}");
        assert!(answer.no_interval.is_empty());
    }
    let four = estimator.predict(&photographs).unwrap();
    assert_eq!(
        (four.estimates[0].low, four.estimates[0].high),
        (None, None)
    );
    let reason = &four.no_interval["fRS"];
    assert!(
        reason.contains("found 4 photographs") && reason.contains("at most 3"),
        "{reason}"
    );
    assert!(
        reason.ends_with("at 95.0 %") && estimator.no_interval().is_empty(),
        "{reason}"
    );
}

#[test]
fn a_session_ends_when_it_is_sure_and_says_where_to_look() {
    let tables = Tables::new(60, 3, 1);
    let mut recipe = recipe(ridge(), &[2, 0, 1]);
    recipe.one_by_one = true;
    let estimator = read_again(&tables.estimator(&recipe));
    assert!(estimator.fitted().steps().eq([1, 2, 3]));

    // As narrow as anything is: one photograph is enough.
    let mut session = Session::new(&estimator, 1e9).unwrap();
    assert_eq!(session.next_angle(), Some(20.0));
    let looked = session.look(&photograph(70, 2)).unwrap();
    assert_eq!((looked.views, looked.next), (1, None));
    refused(session.look(&photograph(70, 0)), "over");

    // Never narrow enough: all views, and what they say together.
    let mut session = Session::new(&estimator, 1e-9).unwrap();
    let angles = [2, 0, 1].map(|view| session.look(&photograph(70, view)).unwrap());
    assert_eq!(
        angles.each_ref().map(|looked| looked.next),
        [Some(0.0), Some(10.0), None]
    );
    let together = estimator.predict(&photographs(70, &[2, 0, 1])).unwrap();
    assert_eq!(angles[2].answer, together);
    assert!(Session::new(&estimator, 0.0).is_err());

    let at_once = tables.estimator(&support::recipe(self::ridge(), &[0, 1]));
    refused(Session::new(&at_once, 1.0), "2 views at once");
}

#[test]
fn properties_may_look_at_views_of_their_own() {
    let tables = Tables::new(40, 3, 1);
    let mut recipe = recipe(ridge(), &[0]);
    recipe.wanted[1].views = vec![2];
    assert_eq!(recipe.slots().unwrap(), [0, 2]);
    let both = tables.estimator(&recipe);
    let answer = both.predict(&photographs(70, &[0, 2])).unwrap();
    recipe.wanted.remove(0);
    let second = tables
        .estimator(&recipe)
        .predict(&photographs(70, &[2]))
        .unwrap();
    assert_eq!(answer.estimates[1].value, second.estimates[0].value);
    recipe.one_by_one = true;
    recipe
        .wanted
        .insert(0, support::recipe(self::ridge(), &[0]).wanted.remove(0));
    refused(recipe.slots(), "others for felt");
}

#[test]
fn estimates_stay_where_values_can_be() {
    let tables = Tables::new(40, 1, 1);
    let mut recipe = recipe(ridge(), &[0]);
    recipe.wanted[0].range = Some([20.0, 25.0]);
    let estimator = tables.estimator(&recipe);
    for surface in 100..120 {
        let answer = estimator.predict(&photographs(surface, &[0])).unwrap();
        let estimate = &answer.estimates[0];
        let (low, high) = (estimate.low.unwrap(), estimate.high.unwrap());
        assert!(20.0 <= low && low <= estimate.value && estimate.value <= high && high <= 25.0);
    }
}

#[test]
fn too_few_groups_have_no_interval_and_the_reason() {
    let tables = Tables::new(40, 1, 8);
    let estimator = tables.estimator(&recipe(ridge(), &[0]));
    let reason = estimator.no_interval()["fRS"];
    assert_eq!(
        reason,
        "2 calibration group(s) allow a level of 2/3, a level of 0.8 needs at least 4"
    );
    let answer = estimator.predict(&photographs(99, &[0])).unwrap();
    assert_eq!(
        (answer.estimates[0].low, answer.estimates[0].high),
        (None, None)
    );
    refused(Session::new(&estimator, 1.0), "2 calibration group(s)");
}

#[test]
fn what_was_never_seen_is_unfamiliar() {
    let tables = Tables::new(60, 1, 1);
    let estimator = tables.estimator(&recipe(ridge(), &[0]));
    let red_and_blue = |at: usize| match (at / 3 / 4 % 2, at % 3) {
        (0, 0) | (1, 2) => 1.0,
        _ => 0.0,
    };
    let strange = Frame {
        data: (0..3 * 32 * 32).map(red_and_blue).collect(),
        ..photograph(0, 0)
    };
    let familiar = |asked: &[Frame]| estimator.predict(asked).unwrap().familiar.unwrap();
    let (seen, strange) = (familiar(&photographs(7, &[0])), familiar(&[strange]));
    assert!(strange < 0.05 && seen > 0.05, "{strange} {seen}");
}

#[test]
fn threads_do_not_change_bits() {
    let tables = Tables::new(40, 1, 1);
    let estimator = tables.estimator(&recipe(kernel(), &[0]));
    let ask = || -> Vec<Answer> {
        let asked = (50..58).map(|surface| photographs(surface, &[0]));
        asked
            .map(|asked| estimator.predict(&asked).unwrap())
            .collect()
    };
    let expected = ask();
    thread::scope(|scope| {
        let all: Vec<_> = (0..8).map(|_| scope.spawn(ask)).collect();
        for one in all {
            assert_eq!(one.join().unwrap(), expected);
        }
    });
}

#[test]
fn widths_that_are_all_alike_are_alike() {
    let tables = Tables::new(60, 1, 1);
    let widths = |widths| {
        let mut recipe = recipe(ridge(), &[0]);
        recipe.widths = widths;
        let estimator = tables.estimator(&recipe);
        let width = |surface| {
            let answer = estimator.predict(&photographs(surface, &[0])).unwrap();
            let estimate = &answer.estimates[0];
            estimate.high.unwrap() - estimate.low.unwrap()
        };
        (100..110).map(width).collect::<Vec<f64>>()
    };
    let constant = widths(Widths::Constant);
    assert!(
        constant
            .iter()
            .all(|width| (width - constant[0]).abs() < 1e-9)
    );
    let own = widths(Widths::ByPhotograph);
    assert!(own.iter().any(|width| (width - own[0]).abs() > 1e-9));
}

#[test]
fn photographs_come_to_the_scale_of_the_model() {
    let tables = Tables::new(20, 1, 1);
    let estimator = tables.estimator(&recipe(ridge(), &[0]));
    let large = || Frame {
        width: 100,
        height: 70,
        data: vec![0.5; 3 * 100 * 70],
    };
    let size = |scale| {
        let frame = estimator.rescale(large(), scale).unwrap();
        (frame.width, frame.height)
    };
    assert_eq!(size(Scale::OfModel), (46, 32));
    assert_eq!(size(Scale::Keep), (100, 70));
    assert_eq!(size(Scale::ShorterSide(35)), (50, 35));
}

#[test]
fn a_map_says_of_each_place_what_is_said_of_the_crop() {
    let tables = Tables::new(30, 1, 1);
    let estimator = tables.estimator(&recipe(ridge(), &[0]));
    let (left, right) = (photograph(40, 0), photograph(41, 0));
    let rows = left.data.chunks(3 * 32).zip(right.data.chunks(3 * 32));
    let both = Frame {
        width: 64,
        height: 32,
        data: rows
            .flat_map(|(left, right)| [left, right].concat())
            .collect(),
    };
    let map = estimator.map(&both, 16, Sight::Alone).unwrap();
    assert_eq!((map.rows, map.columns, map.window), (1, 3, [32, 32]));
    assert_eq!(map.centres, [[16.0, 16.0], [16.0, 32.0], [16.0, 48.0]]);
    for (place, photograph) in [(0, left), (2, right)] {
        let alone = estimator
            .predict(std::slice::from_ref(&photograph))
            .unwrap();
        let of_map = &map.predictions.properties[0];
        assert_eq!(of_map.values[place], alone.estimates[0].value);
        assert_eq!(
            map.predictions.familiar.as_ref().unwrap()[place],
            alone.familiar.unwrap()
        );
        // One pass over a photograph that is one window is the same but for rounding.
        let whole = estimator.map(&photograph, 16, Sight::Within).unwrap();
        let value = whole.predictions.properties[0].values[0];
        assert!((value - alone.estimates[0].value).abs() < 1e-3);
    }
    let small = estimator
        .rescale(photograph(0, 0), Scale::ShorterSide(20))
        .unwrap();
    refused(estimator.map(&small, 16, Sight::Within), "window");
    let several = Tables::new(30, 2, 1).estimator(&recipe(ridge(), &[0, 1]));
    refused(several.map(&both, 16, Sight::Within), "2 views");
}

/// The places of a map are those of the photograph as it came, whatever the encoder sees.
#[test]
fn a_map_by_a_model_with_a_size_of_its_own_has_the_places_of_the_photograph() {
    let tables = Tables::resized(30, Some(16));
    let estimator = tables.estimator(&recipe(ridge(), &[0]));
    let photograph = photograph(40, 0);
    let rows = photograph.data.chunks(3 * 32);
    let twice = Frame {
        width: 64,
        height: 32,
        data: rows.flat_map(|row| [row, row].concat()).collect(),
    };
    let map = estimator.map(&twice, 16, Sight::Alone).unwrap();
    assert_eq!((map.rows, map.columns, map.window), (1, 3, [32, 32]));
    assert_eq!(map.centres, [[16.0, 16.0], [16.0, 32.0], [16.0, 48.0]]);
    // But for what the filter takes from beyond the edge.
    let alone = estimator.predict(&[photograph]).unwrap().estimates[0].value;
    let of_map = &map.predictions.properties[0].values;
    assert!((of_map[0] - alone).abs() < 2.0, "{of_map:?} {alone}");
}

/// Whatever calibrates is not among what is fitted to.
/// Values are of a fit to all surfaces; where intervals lie, hangs on those alone that do not calibrate.
#[test]
fn intervals_do_not_lie_by_readings_that_calibrate_them() {
    let mut tables = Tables::new(40, 1, 1);
    let recipe = recipe(ridge(), &[0]);
    let part = tables.part(&recipe);
    let asked = photographs(70, &[0]);
    let of = |tables: &Tables| {
        let answer = tables.estimator(&recipe).predict(&asked).unwrap();
        let one = answer.estimates[0].clone();
        (
            one.value,
            f64::midpoint(one.low.unwrap(), one.high.unwrap()),
        )
    };
    let (value, centre) = of(&tables);
    tables.set(part.validation[0], 500.0);
    let (other_value, same_centre) = of(&tables);
    assert!((same_centre - centre).abs() < 1e-9 && other_value != value);
    tables.set(part.train[0], 500.0);
    assert!((of(&tables).1 - centre).abs() > 1e-3);
}

#[test]
fn what_does_not_fit_together_is_refused() {
    let tables = Tables::new(20, 2, 1);
    let estimator = tables.estimator(&recipe(ridge(), &[0, 1]));
    let one = estimator.predict(&photographs(1, &[0]));
    refused(one, "found 1, expected 2, at 0 and 10 degrees");
    let mut about = estimator.about().clone();
    about.angles.pop();
    let fitted = tables.fit(&recipe(ridge(), &[0, 1])).unwrap();
    let fewer = Estimator::new(embedder(), fitted, about);
    refused(fewer, "one for each of 2 views");
    let mut twice = recipe(ridge(), &[0, 1, 0]);
    twice.one_by_one = true;
    refused(twice.slots(), "view 0 twice");
    let mut share = recipe(ridge(), &[0]);
    share.calibration.share = Some(1.5);
    refused(tables.fit(&share), "calibration: found 1.5");
    let beyond = radius(&Tables::new(8, 1, 2).units, &[(99, 1.0)], Level::P90);
    assert!(beyond.is_err());
    let no_pixel = Embedder::new(embedder().network().clone(), Some(0));
    refused(no_pixel, "resize");
    let mut short = photograph(0, 0);
    short.data.pop();
    let one_view = tables.estimator(&recipe(ridge(), &[0]));
    assert!(one_view.map(&short, 16, Sight::Alone).is_err());
    let small = photograph(0, 0).resized(16).unwrap().into_owned();
    let small = one_view.map(&small, 16, Sight::Alone);
    let expected = "found 16 x 16 pixels, expected at least a window, 32 x 32";
    refused(small, expected);
    let mut none = recipe(ridge(), &[0]);
    none.wanted.clear();
    assert!(tables.fit(&none).is_err());
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("file"), "").unwrap();
    refused(estimator.save(&folder.path().join("file/model")), "file");
}
