//! What splits hold out, in words: which question the scores answer.

use std::collections::HashSet;

use sps_dataset::{Split, Surface, Unit};

use super::Splits;

/// What splits keep together, and hence what scores tell, in one sentence.
pub(crate) fn what_is_measured(splits: &Splits, surfaces: &[Surface]) -> String {
    let unit = splits.units.unit();
    let by = format!("splits are by {}", unit.name());
    let groups = known(&splits.all, surfaces, Unit::Group);
    let materials = known(&splits.all, surfaces, Unit::Material);
    let several = surfaces
        .windows(2)
        .any(|two| two[0].material != two[1].material);
    let mut sentence = if groups > 0.0 {
        format!(
            "{by}: {groups:.1} % of the surfaces held out are of a group that was trained on, so \
             scores tell how well known groups are recognised, not what is known of new ones"
        )
    } else if several && materials > 0.0 {
        format!(
            "{by}: scores tell what is known of new {unit}; {materials:.1} % of the surfaces held \
             out are of a material that was trained on"
        )
    } else {
        format!("{by}: scores tell what is known of new {unit}")
    };
    if unit != Unit::Surface {
        let portion = portion(splits, &splits.all);
        sentence = format!("{sentence}; a split holds out {portion}");
    }
    sentence
}

/// How much these splits keep aside, for example `2 to 3 of 26 groups, 0.05 to 0.23 of the surfaces`.
pub(crate) fn portion(splits: &Splits, of: &[Split]) -> String {
    let among = |surfaces: &[usize]| splits.units.among(surfaces);
    let aside: Vec<usize> = of.iter().map(|split| among(&split.validation)).collect();
    let all = of.iter().zip(&aside);
    let all = all.map(|(split, aside)| aside + among(&split.train)).max();
    let shares = of.iter().map(|Split { train, validation }| {
        validation.len() as f64 / (train.len() + validation.len()) as f64
    });
    format!(
        "{} of {} {}, {} of the surfaces",
        ends(aside.iter().map(|&units| units as f64), 0),
        all.unwrap_or_default(),
        splits.units.unit(),
        ends(shares, 2),
    )
}

/// The least and the greatest of some values, or the one that all are when shown so.
fn ends(values: impl Iterator<Item = f64> + Clone, decimals: usize) -> String {
    let least = values.clone().fold(f64::INFINITY, f64::min);
    let greatest = values.fold(f64::NEG_INFINITY, f64::max);
    let [least, greatest] = [least, greatest].map(|value| format!("{value:.decimals$}"));
    if least == greatest {
        least
    } else {
        format!("{least} to {greatest}")
    }
}

/// How many of 100 surfaces held out have a name of this kind that a surface trained on has too, over
/// all splits.
fn known(splits: &[Split], surfaces: &[Surface], unit: Unit) -> f64 {
    let name = |&at: &usize| surfaces.get(at).and_then(|surface| unit.of(surface));
    let (mut known, mut all) = (0, 0);
    for split in splits {
        let trained: HashSet<&str> = split.train.iter().filter_map(name).collect();
        let held_out = split.validation.iter();
        let names = held_out.filter_map(name);
        known += names.filter(|name| trained.contains(name)).count();
        all += split.validation.len();
    }
    100.0 * known as f64 / all.max(1) as f64
}

#[cfg(test)]
mod tests {
    use sps_dataset::{KFold, SplitPlan};

    use super::*;

    /// Two groups of three surfaces and one of six: two of cloth, one of wood.
    fn surfaces() -> Vec<Surface> {
        let surface = |at: usize| Surface {
            id: at.to_string(),
            material: if at < 6 { "cloth" } else { "wood" }.to_owned(),
            group: ["a", "b", "c", "c"][at / 3].to_owned(),
        };
        (0..12).map(surface).collect()
    }

    #[test]
    fn splits_say_which_question_their_scores_answer() {
        let (named, mut unnamed) = (surfaces(), surfaces());
        for surface in &mut unnamed {
            surface.material.clear();
            surface.group.clear();
        }
        let by_group = "splits are by group: scores tell what is known of new groups; 50.0 % of the \
                        surfaces held out are of a material that was trained on; a split holds out \
                        1 of 3 groups, 0.25 to 0.50 of the surfaces";
        for (by, surfaces, expected) in [
            (
                Some(Unit::Surface),
                &named,
                "splits are by surface: 100.0 % of the surfaces held out are of a group that was \
                 trained on, so scores tell how well known groups are recognised, not what is known \
                 of new ones",
            ),
            // Of the twelve surfaces held out, the six of cloth are of a known material.
            (Some(Unit::Group), &named, by_group),
            (None, &named, by_group),
            (
                Some(Unit::Material),
                &named,
                "splits are by material: scores tell what is known of new materials; a split holds \
                 out 1 of 2 materials, 0.50 of the surfaces",
            ),
            // A surface without a group or material is like no other.
            (
                None,
                &unnamed,
                "splits are by surface: scores tell what is known of new surfaces",
            ),
        ] {
            let plan = SplitPlan::LeaveOneOut { by };
            let splits = Splits::parted(&plan, surfaces, 0, 1).unwrap();
            assert_eq!(what_is_measured(&splits, surfaces), expected);
        }
    }

    #[test]
    fn folds_of_different_sizes_are_told_by_their_ends() {
        let surfaces = &surfaces()[..7];
        let plan = SplitPlan::KFold(KFold {
            folds: 2,
            by: Some(Unit::Surface),
        });
        let splits = Splits::parted(&plan, surfaces, 0, 1).unwrap();
        let told = "3 to 4 of 7 surfaces, 0.43 to 0.57 of the surfaces";
        assert_eq!(portion(&splits, &splits.all), told);
    }
}
