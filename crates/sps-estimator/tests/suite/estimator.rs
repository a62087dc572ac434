//! Fitting, asking, keeping and reading again.

use std::fs;
use std::thread;

use crate::support::{
    self, Tables, embedder, kernel, photograph, read_again, recipe, refused, ridge,
};
use sps_estimator::{
    Answer, Embedder, Estimate, Estimator, Frame, Regression, Scale, Session, Sight, Stacked,
    Widths, photographs_in, radius,
};
use sps_metrics::{Level, PredictionInterval};
use sps_models::encoders::Depths;
use sps_models::heads::{Head, HeadConfig, Input};
use sps_regress::ridge::Ridge;
use sps_regress::{AnyRegressor, Estimates, FittedRegressor, Plan, Rerun, Views};

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
    let views = views.iter();
    views.map(|&view| photograph(surface, view)).collect()
}

/// What is said of one photograph.
fn said_of(estimator: &Estimator, surface: usize) -> Answer {
    estimator.predict(&photographs(surface, &[0])).unwrap()
}

fn ends(estimate: &Estimate) -> (f64, f64) {
    (estimate.low.unwrap(), estimate.high.unwrap())
}

/// What ridge regression by its own crate makes of these views of all surfaces.
fn by_ridge(tables: &Tables, views: &[usize]) -> Vec<Estimates> {
    let rerun = Rerun::new(0, tables.all());
    let plan = Plan::each(1, tables.readings.properties(), vec![rerun]);
    let plan = plan.with_views(&Views::Fixed(views.to_vec()));
    let ridge = Ridge::default().train(&tables.examples().data, &plan);
    let seen = tables.embeddings.select(&tables.all(), views).unwrap();
    ridge.unwrap().predict(&seen).unwrap()
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
        assert_eq!(*encoder.depths(), Depths::All);
        assert_eq!(encoder.blocks().len(), 8);
        let asked = photographs(97, &[1, 0]);
        let answer = estimator.predict(&asked).unwrap();
        assert_eq!(again.predict(&asked).unwrap(), answer, "{kind}");
        assert!(answer.estimates[0].low.is_some(), "{kind}");
        assert!(answer.familiar.is_some(), "{kind}");
        assert_eq!(answer.estimates[0].name, "sliding resistance");
        assert_eq!(answer.estimates[1].name, "felt");
    }
}

#[test]
fn brightness_is_felt() {
    let tables = Tables::new(80, 1, 1);
    let estimator = tables.estimator(&recipe(ridge(), &[0]));
    let errors = (200..240).map(|surface| {
        let truth = 60.0 * support::brightness(surface) + 2.0;
        (said_of(&estimator, surface).estimates[0].value - truth).abs()
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
    let predictions = estimator.fitted().predict(&tables.embeddings).unwrap();
    let expected = by_ridge(&tables, &[0]);
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
    let fitted = tables.fit(&recipe).unwrap();
    let predictions = fitted.predict(&tables.embeddings).unwrap();
    let expected = by_ridge(&tables, &[0, 0, 1]);
    for (found, expected) in predictions.properties.iter().zip(&expected) {
        assert_eq!(found.values, expected.values);
    }
}

#[test]
fn the_angles_are_named_where_photographs_are_too_few() {
    let tables = Tables::new(20, 3, 1);
    let mut recipe = recipe(ridge(), &[0, 2]);
    for (one_by_one, count, expected) in [(false, 1, "2"), (true, 3, "1 or 2")] {
        recipe.one_by_one = one_by_one;
        let asked = vec![photograph(0, 0); count];
        let error = tables.estimator(&recipe).predict(&asked).unwrap_err();
        let found =
            format!("found {count}, expected {expected}, at 0 and 20 degrees, in this order");
        let error = error.to_string();
        assert_eq!(error, format!("photographs of a surface: {found}"));
    }
}

#[test]
fn the_photographs_of_a_folder_are_taken_by_name() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["2.PNG", "10.jpg", "notes.txt"] {
        fs::write(folder.path().join(name), "").unwrap();
    }
    let expected = ["10.jpg", "2.PNG"].map(|name| folder.path().join(name));
    assert_eq!(photographs_in(folder.path()).unwrap(), expected);
    let above = tempfile::tempdir().unwrap();
    let refused = |folder: &std::path::Path| photographs_in(folder).unwrap_err().to_string();
    let empty = refused(above.path());
    let expected = "found no photograph, expected files that end in png, jpg, jpeg, exr";
    assert!(empty.ends_with(expected), "{empty}");
    for surface in ["oak", "tile"] {
        fs::create_dir(above.path().join(surface)).unwrap();
    }
    let hint = refused(above.path());
    let each = above.path().join("*").display().to_string();
    assert!(hint.contains("it holds folders (2)"), "{hint}");
    assert!(hint.ends_with(&each), "{hint}");
    let missing = refused(&above.path().join("none"));
    assert!(missing.contains("none: "), "{missing}");
}

#[test]
fn several_photographs_of_one_view_are_averaged() {
    let tables = Tables::new(40, 1, 1);
    let estimator = tables.estimator(&recipe(ridge(), &[0]));
    let [one, two] = [60, 61].map(|surface| said_of(&estimator, surface));
    let both = estimator.predict(&[60, 61].map(|surface| photograph(surface, 0)));
    let both = both.unwrap();
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
        let (value, (low, high)) = (answer.estimates[0].value, ends(&answer.estimates[0]));
        let reach = residuals[rank - 1];
        assert!((high - low - 2.0 * reach).abs() < 1e-9, "{count}");
        assert!(low <= value && value <= high, "{count}");
        assert!(answer.no_interval.is_empty());
    }
    let four = estimator.predict(&photographs).unwrap();
    let Estimate { low, high, .. } = four.estimates[0];
    assert_eq!((low, high), (None, None));
    let reason = &four.no_interval["fRS"];
    assert!(reason.contains("found 4 photographs"), "{reason}");
    assert!(reason.contains("at most 3"), "{reason}");
    assert!(reason.ends_with("at 95.0 %"), "{reason}");
    assert!(estimator.no_interval().is_empty());
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
    let looks = [2, 0, 1].map(|view| session.look(&photograph(70, view)).unwrap());
    let next = looks.each_ref().map(|looked| looked.next);
    assert_eq!(next, [Some(0.0), Some(10.0), None]);
    let together = estimator.predict(&photographs(70, &[2, 0, 1])).unwrap();
    assert_eq!(looks[2].answer, together);
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
    let second = tables.estimator(&recipe).predict(&photographs(70, &[2]));
    let second = second.unwrap();
    assert_eq!(answer.estimates[1].value, second.estimates[0].value);
    let mut others = support::recipe(self::ridge(), &[0]);
    others.wanted[1].views = vec![2];
    others.one_by_one = true;
    refused(others.slots(), "others for felt");
}

#[test]
fn estimates_stay_where_values_can_be() {
    let tables = Tables::new(40, 1, 1);
    let mut recipe = recipe(ridge(), &[0]);
    recipe.wanted[0].range = Some([20.0, 25.0]);
    let estimator = tables.estimator(&recipe);
    for surface in 100..120 {
        let estimate = &said_of(&estimator, surface).estimates[0];
        let (low, high) = ends(estimate);
        assert!(20.0 <= low && low <= estimate.value && estimate.value <= high && high <= 25.0);
    }
}

#[test]
fn too_few_groups_have_no_interval_and_the_reason() {
    let tables = Tables::new(40, 1, 8);
    let estimator = tables.estimator(&recipe(ridge(), &[0]));
    let reason = "2 calibration group(s) allow a level of 2/3, a level of 0.8 needs at least 4";
    assert_eq!(estimator.no_interval()["fRS"], reason);
    let Estimate { low, high, .. } = said_of(&estimator, 99).estimates[0];
    assert_eq!((low, high), (None, None));
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
        let surfaces = 50..58;
        surfaces.map(|at| said_of(&estimator, at)).collect()
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
            let (low, high) = ends(&said_of(&estimator, surface).estimates[0]);
            high - low
        };
        (100..110).map(width).collect::<Vec<f64>>()
    };
    let constant = widths(Widths::Constant);
    let first = constant[0];
    assert!(constant.iter().all(|width| (width - first).abs() < 1e-9));
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

fn side_by_side(left: &Frame, right: &Frame) -> Frame {
    let rows = left.data.chunks(3 * 32).zip(right.data.chunks(3 * 32));
    Frame {
        width: 64,
        height: 32,
        data: rows
            .flat_map(|(left, right)| [left, right].concat())
            .collect(),
    }
}

#[test]
fn a_map_says_of_each_place_what_is_said_of_the_crop() {
    let tables = Tables::new(30, 1, 1);
    let estimator = tables.estimator(&recipe(ridge(), &[0]));
    let (left, right) = (photograph(40, 0), photograph(41, 0));
    let both = side_by_side(&left, &right);
    let map = estimator.map(&both, 16, Sight::Alone).unwrap();
    assert_eq!((map.rows, map.columns, map.window), (1, 3, [32, 32]));
    assert_eq!(map.centres, [[16.0, 16.0], [16.0, 32.0], [16.0, 48.0]]);
    for (place, photograph) in [(0, left), (2, right)] {
        let alone = estimator.predict(std::slice::from_ref(&photograph));
        let alone = alone.unwrap();
        let of_map = &map.predictions.properties[0];
        assert_eq!(of_map.values[place], alone.estimates[0].value);
        let familiar = map.predictions.familiar.as_ref();
        assert_eq!(familiar.unwrap()[place], alone.familiar.unwrap());
        // One pass over a photograph that is one window is the same but for rounding.
        let whole = estimator.map(&photograph, 16, Sight::Within).unwrap();
        let value = whole.predictions.properties[0].values[0];
        assert!((value - alone.estimates[0].value).abs() < 1e-3);
    }
    let small = estimator.rescale(photograph(0, 0), Scale::ShorterSide(20));
    refused(estimator.map(&small.unwrap(), 16, Sight::Within), "window");
    let several = Tables::new(30, 2, 1).estimator(&recipe(ridge(), &[0, 1]));
    refused(several.map(&both, 16, Sight::Within), "2 views");
}

/// The places of a map are those of the photograph as it came, whatever the encoder sees.
#[test]
fn a_map_by_a_model_with_a_size_of_its_own_has_the_places_of_the_photograph() {
    let tables = Tables::resized(30, Some(16));
    let estimator = tables.estimator(&recipe(ridge(), &[0]));
    let photograph = photograph(40, 0);
    let twice = side_by_side(&photograph, &photograph);
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
    let of = |tables: &Tables| {
        let one = &said_of(&tables.estimator(&recipe), 70).estimates[0];
        let (low, high) = ends(one);
        (one.value, f64::midpoint(low, high))
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
    let expected = "found 16 x 16 pixels, expected at least a window, 32 x 32";
    refused(one_view.map(&small, 16, Sight::Alone), expected);
    let mut none = recipe(ridge(), &[0]);
    none.wanted.clear();
    assert!(tables.fit(&none).is_err());
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("file"), "").unwrap();
    refused(estimator.save(&folder.path().join("file/model")), "file");
}
