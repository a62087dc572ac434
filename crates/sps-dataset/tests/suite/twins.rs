//! Surfaces that show one pattern in other colours are kept together.

use std::f64::consts::TAU;

use crate::made::Made;
use sps_dataset::{DatasetFolder, NearTwins, Source};

/// A coarse plain weave, stripes of another period, and a fine weave across both.
const TEXTURES: [fn(f64, f64) -> f64; 3] = [
    |x, y| (TAU * x / 16.0).sin() * (TAU * y / 16.0).sin(),
    |x, y| (TAU * y / 40.0).sin() + 0.3 * (TAU * x / 6.0).sin(),
    |x, y| (TAU * (x + y) / 7.0).sin() + 0.5 * (TAU * (x - y) / 5.0).sin(),
];

/// Of each channel the mean and the contrast: bright, dark and faint, and with light and dark turned.
const COLOURS: [[(f64, f64); 3]; 3] = [
    [(180.0, 30.0), (170.0, 28.0), (150.0, 20.0)],
    [(60.0, 12.0), (30.0, 4.0), (20.0, 2.0)],
    [(90.0, -20.0), (110.0, -30.0), (160.0, -40.0)],
];

/// A surface's id, its group and which texture it shows in which colour. Without one, its pixels
/// differ by one level.
type Row<'a> = (&'a str, &'a str, Option<(usize, usize)>);

/// A dataset of one view of 256 x 256 pixels.
fn made(surfaces: &[Row]) -> Made {
    let made = Made::long("surface,location,repeat,fRS,cDF\n");
    let row = |(id, group, _): &Row| format!("{id},cloth,{group}\n");
    let rows: String = surfaces.iter().map(row).collect();
    made.write("surfaces.csv", format!("surface,material,group\n{rows}"));
    for (at, (id, _, shown)) in surfaces.iter().enumerate() {
        let shift = 3.7 * at as f64;
        let image = image::RgbImage::from_fn(256, 256, |x, y| {
            let Some((texture, colour)) = *shown else {
                return image::Rgb([100 + ((x + y) % 2) as u8; 3]);
            };
            let value = TEXTURES[texture](f64::from(x) + shift, f64::from(y) - shift);
            image::Rgb(COLOURS[colour].map(|(mean, contrast)| (mean + contrast * value) as u8))
        });
        std::fs::create_dir_all(made.path().join("frames").join(id)).unwrap();
        let frame = made.path().join(format!("frames/{id}/000.png"));
        image.save(frame).unwrap();
    }
    made
}

fn groups(dataset: &DatasetFolder) -> Vec<&str> {
    let surfaces = dataset.surfaces().iter();
    surfaces.map(|surface| surface.group.as_str()).collect()
}

#[test]
fn one_texture_in_three_colours_is_one_group() {
    let made = made(&[
        ("a", "a", Some((0, 0))),
        ("b", "b", Some((1, 0))),
        ("c", "c", Some((0, 1))),
        ("d", "d", Some((2, 0))),
        ("e", "e", Some((1, 1))),
        ("f", "f", Some((1, 2))),
        ("g", "g", Some((0, 2))),
    ]);
    let mut dataset = made.open().unwrap();
    let found = dataset.keep_near_twins_together(0.75).unwrap();
    assert_eq!(groups(&dataset), ["a", "b", "a", "d", "b", "b", "a"]);
    let expected = NearTwins {
        groups: 3,
        largest: 3,
    };
    assert_eq!(found, expected);
}

#[test]
fn groups_of_the_dataset_are_joined_and_never_split() {
    let made = made(&[
        ("a", "roll", Some((0, 0))),
        ("b", "b", Some((1, 0))),
        ("c", "roll", Some((2, 0))),
        ("d", "d", Some((2, 1))),
    ]);
    let mut dataset = made.open().unwrap();
    dataset.keep_near_twins_together(1.1).unwrap();
    assert_eq!(groups(&dataset), ["roll", "b", "roll", "d"]);
    dataset.keep_near_twins_together(0.75).unwrap();
    assert_eq!(groups(&dataset), ["roll", "b", "roll", "roll"]);
}

#[test]
fn flat_photographs_are_no_twins() {
    let made = made(&[
        ("a", "a", None),
        ("b", "b", Some((0, 0))),
        ("c", "c", None),
        ("d", "d", Some((1, 0))),
    ]);
    let mut dataset = made.open().unwrap();
    let found = dataset.keep_near_twins_together(0.75).unwrap();
    assert_eq!(groups(&dataset), ["a", "b", "c", "d"]);
    assert_eq!((found.groups, found.largest), (4, 1));
    // Where no photograph shows a pattern, and where all show the same.
    for shown in [None, Some((0, 0))] {
        let made = self::made(&[("a", "a", shown), ("b", "b", shown)]);
        let mut dataset = made.open().unwrap();
        dataset.keep_near_twins_together(0.75).unwrap();
        assert_eq!(groups(&dataset), ["a", "b"], "{shown:?}");
    }
}

#[test]
fn a_missing_photograph_is_named() {
    let made = made(&[("a", "a", Some((0, 0))), ("b", "b", None)]);
    std::fs::remove_file(made.path().join("frames/b/000.png")).unwrap();
    let error = made.open().unwrap().keep_near_twins_together(0.75);
    let message = error.unwrap_err().to_string();
    assert!(message.contains("frames/b"), "{message}");
}
