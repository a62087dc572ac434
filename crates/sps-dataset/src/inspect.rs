use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;
use sps_base::parallel;

use crate::intraclass::intraclass;
use crate::{
    DatasetFolder, Decoded, Description, Extent, LightCounts, OutOfRange, Property, Source,
    TactileSettings,
};

/// What a dataset holds, and what is wrong with it.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Inspection {
    /// What it is called.
    pub name: String,
    /// How many surfaces it has.
    pub surfaces: usize,
    /// How many views of each.
    pub views: usize,
    /// How many groups its surfaces are in.
    pub groups: usize,
    /// Surfaces per material, the most frequent first.
    pub materials: Vec<(String, usize)>,
    /// How many touches its table has.
    pub readings: usize,
    /// The surfaces that were never touched.
    pub untouched: Vec<String>,
    /// One summary per property, in the order of the table.
    pub properties: Vec<PropertySummary>,
    /// What the frames are, where they were checked.
    pub frames: Option<FrameSummary>,
}

/// One property over all surfaces.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct PropertySummary {
    /// The property.
    pub property: Property,
    /// Its name; empty where nobody says.
    pub name: String,
    /// The unit of its values; empty where they have none.
    pub unit: String,
    /// Surfaces with a value.
    pub measured: usize,
    /// Cells of the table that are empty.
    pub missing_cells: usize,
    /// Values outside of its range, before any were clamped.
    pub out_of_range: OutOfRange,
    /// Minimum, first quartile, median, third quartile and maximum over the surfaces' values, by
    /// linear interpolation (type 7 of Hyndman and Fan, NumPy's default).
    pub quantiles: Option<[f64; 5]>,
    /// Median over the surfaces of the standard deviation of repeats.
    pub repeat_std: Option<f64>,
    /// The share of the variance of the surfaces' values that lies between groups: the intraclass
    /// correlation ICC(1) (Donner, International Statistical Review 54, 1986). It does not grow as
    /// groups get smaller, and may be below 0 by chance where groups mean little. `None` where no
    /// group has two surfaces with a value, where one group has all, and where all values are equal.
    pub between_groups: Option<f64>,
}

/// What decoding every frame showed.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct FrameSummary {
    /// How many there should be: surfaces times views.
    pub expected: usize,
    /// Frames per size, as `(width, height, frames)`.
    pub sizes: Vec<(usize, usize, usize)>,
    /// What had to be done to the light of EXR frames, summed.
    pub light: LightCounts,
    /// Those that cannot be had, and why.
    pub broken: Vec<BrokenFrame>,
    /// Folders in `frames` that are no surface's.
    pub unknown_folders: Vec<String>,
}

/// A frame that cannot be had.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct BrokenFrame {
    /// The surface.
    pub surface: String,
    /// The view.
    pub view: usize,
    /// Why; names the file.
    pub error: String,
}

impl DatasetFolder {
    /// Summarises everything but the frames.
    pub fn inspect(&self, settings: &TactileSettings) -> Inspection {
        let surfaces = self.surfaces();
        let mut materials: BTreeMap<String, usize> = BTreeMap::new();
        for surface in surfaces {
            *materials.entry(surface.material.clone()).or_default() += 1;
        }
        let mut materials = Vec::from_iter(materials);
        materials.sort_by_key(|&(_, count)| Reverse(count));
        let groups: BTreeSet<&str> = surfaces.iter().map(|s| s.group.as_str()).collect();
        let readings = &self.tactile().readings;
        let touched: BTreeSet<usize> = readings.iter().map(|reading| reading.surface).collect();
        let untouched = (0..).zip(surfaces).filter(|(at, _)| !touched.contains(at));
        Inspection {
            name: self.name().to_owned(),
            surfaces: surfaces.len(),
            views: self.view_angles().len(),
            groups: groups.len(),
            materials,
            readings: readings.len(),
            untouched: untouched.map(|(_, surface)| surface.id.clone()).collect(),
            properties: self.property_summaries(*settings),
            frames: None,
        }
    }

    fn property_summaries(&self, settings: TactileSettings) -> Vec<PropertySummary> {
        let surfaces = self.surfaces();
        let averages = self.tactile().averages(&settings, surfaces.len());
        let summary = |(column, (property, out_of_range)): (usize, &(Property, OutOfRange))| {
            let cells = (0..surfaces.len()).filter_map(|s| averages.cell(s, property));
            let spreads: Vec<f64> = cells.filter_map(|cell| cell.repeat_std).collect();
            let values = averages.column(property);
            let grouped = surfaces.iter().zip(&values);
            let grouped =
                grouped.filter_map(|(surface, value)| Some((surface.group.as_str(), (*value)?)));
            let between_groups = intraclass(grouped);
            let values: Vec<f64> = values.into_iter().flatten().collect();
            let readings = self.tactile().readings.iter();
            let Description { name, unit, .. } = self.manifest().describe(property);
            PropertySummary {
                property: property.clone(),
                name,
                unit,
                measured: values.len(),
                missing_cells: readings.filter(|r| r.values[column].is_none()).count(),
                out_of_range: *out_of_range,
                quantiles: quantiles(values),
                repeat_std: quantiles(spreads).map(|[_, _, median, _, _]| median),
                between_groups,
            }
        };
        let properties = self.out_of_range().iter().enumerate();
        properties.map(summary).collect()
    }

    /// Decodes every frame in parallel; `progress` is called after each.
    pub fn inspect_frames(&self, progress: impl Fn() + Sync) -> FrameSummary {
        let views = self.view_angles().len();
        let expected = self.surfaces().len() * views;
        let check = |frame: usize| {
            let (surface, view) = (frame / views, frame % views);
            let decoded = self.decode(surface, view);
            progress();
            let decoded = decoded.map(|Decoded { frame, light }| (frame.extent(), light));
            decoded.map_err(|error| BrokenFrame {
                surface: self.surfaces()[surface].id.clone(),
                view,
                error: error.to_string(),
            })
        };
        let checked = parallel::map(0..expected, check);
        let mut summary = FrameSummary {
            expected,
            unknown_folders: self.unknown_folders(),
            ..FrameSummary::default()
        };
        let mut sizes: BTreeMap<(usize, usize), usize> = BTreeMap::new();
        for frame in checked {
            match frame {
                Ok((Extent { width, height }, light)) => {
                    *sizes.entry((width, height)).or_default() += 1;
                    summary.light.add(&light);
                }
                Err(broken) => summary.broken.push(broken),
            }
        }
        let sizes = sizes.into_iter();
        summary.sizes = sizes.map(|((w, h), count)| (w, h, count)).collect();
        summary
    }

    fn unknown_folders(&self) -> Vec<String> {
        let known: BTreeSet<&str> = self.surfaces().iter().map(|s| s.id.as_str()).collect();
        let entries = std::fs::read_dir(self.folder().join("frames"));
        let entries = entries.into_iter().flatten().flatten();
        let folders = entries.filter(|entry| entry.path().is_dir());
        let names = folders.map(|entry| entry.file_name().to_string_lossy().into_owned());
        let unknown = names.filter(|name| !known.contains(name.as_str()) && !name.starts_with('.'));
        unknown.collect::<BTreeSet<_>>().into_iter().collect()
    }
}

fn quantiles(mut values: Vec<f64>) -> Option<[f64; 5]> {
    values.sort_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    Some([0.0, 0.25, 0.5, 0.75, 1.0].map(|share| {
        let at = share * last as f64;
        let (low, high) = (values[at.floor() as usize], values[at.ceil() as usize]);
        low + (high - low) * at.fract()
    }))
}
