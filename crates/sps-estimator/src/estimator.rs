//! An encoder and what was fitted to its embeddings, as one.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use serde::{Deserialize, Serialize};
use sps_dataset::{DecodeSettings, Frame, Limits, decode_image_resized, toccare};
use sps_regress::Embeddings;

use crate::embedder::{Embedder, Network, read_photograph};
use crate::error::{Result, refuse};
use crate::fitted::{Fitted, Interval, Predictions};
use crate::novelty::Shown;

/// What goes with a model beside its numbers: where it comes from, and how photographs are to be taken
/// and read.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct About {
    /// What it is called.
    pub name: String,
    /// The method, in words.
    pub method: String,
    /// What it was fitted on, in words.
    pub data: String,
    /// Where that comes from and under which licence.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub source: String,
    /// Height and width of the photographs that it was fitted on, in pixels.
    pub frame_size: [usize; 2],
    /// The roll angle of each view, in degrees; 0 is straight down. In the order in which photographs
    /// are given.
    pub angles: Vec<f64>,
    /// How image files are decoded.
    #[serde(default)]
    pub decode: DecodeSettings,
    /// What properties are called and measured in, by their codes; those of the Toccare need no entry.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub described: BTreeMap<String, Described>,
    /// How well models of this kind do on units that they were not fitted to, by property.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub measured: BTreeMap<String, Measured>,
}

/// What a person reads in place of a property's code.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct Described {
    /// Its name; empty where it has none but its code.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub name: String,
    /// The unit of its values; empty where they have none.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub unit: String,
}

/// How well models do on units that they were not fitted to.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Measured {
    /// How many readings were scored, over all splits.
    pub readings: usize,
    /// R² against the training mean of each split.
    pub r2: Option<f64>,
    /// The mean absolute error, in measured units.
    pub mae: Option<f64>,
    /// The share of truths that lie in their interval; none where there are no intervals.
    pub coverage: Option<f64>,
    /// `coverage`, averaged over the units that were held out.
    pub unit_coverage: Option<f64>,
    /// The mean width of an interval, in measured units.
    pub mean_width: Option<f64>,
}

/// To which size photographs are brought before they are looked at. Texture means something at one
/// scale only.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scale {
    /// Their shorter side to that of the photographs that the model was fitted on: right where both
    /// show as much of a surface.
    #[default]
    OfModel,
    /// Their shorter side to so many pixels.
    ShorterSide(usize),
    /// No resizing: right where a pixel shows as much as in the photographs of the fit, as in crops.
    Keep,
}

/// A model that takes photographs.
///
/// It is `Send` and `Sync`, and the same photographs give the same bits on any thread and beside any
/// other photographs.
pub struct Estimator {
    pub(crate) about: About,
    pub(crate) embedder: Embedder,
    pub(crate) fitted: Fitted,
    /// Whether the intervals of all properties hold at once.
    joint: bool,
}

/// What is said of one surface.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Answer {
    /// One for each property.
    pub estimates: Vec<Estimate>,
    /// The p-value of "these photographs are like those that the model was fitted on": where they are,
    /// it is at most q with a probability of at most q. `None` where the model does not know
    /// ([`Fitted::no_familiar`]).
    pub familiar: Option<f64>,
    /// The reason of each property that has no interval, by its code.
    pub no_interval: BTreeMap<String, String>,
    /// The surfaces fitted on that look most like this one, nearest first, at most five; none where the
    /// model does not know their names.
    pub nearest: Vec<Near>,
}

/// A surface that a model was fitted on, and how unlike it a photograph is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Near {
    /// Its place for [`Estimator::shown`].
    pub at: usize,
    /// What the dataset called it.
    pub surface: String,
    /// The Euclidean distance of the embeddings, each block of which has unit length.
    pub distance: f64,
}

/// An estimate with its interval, in the property's measured units.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// The property's code.
    pub property: String,
    /// Its name, or its code again where it has none.
    pub name: String,
    /// The unit of its values; empty where they have none.
    pub unit: String,
    /// The estimate.
    pub value: f64,
    /// The lower end of the interval; `None` where there is none ([`Answer::no_interval`]).
    pub low: Option<f64>,
    /// The upper end.
    pub high: Option<f64>,
}

impl Estimator {
    /// Takes an embedder, and what was fitted to its embeddings.
    ///
    /// # Errors
    /// Embeddings of another width than were fitted, another number of angles than views, a frame
    /// without pixels.
    pub fn new(embedder: Embedder, fitted: Fitted, about: About) -> Result<Self> {
        if embedder.width() != fitted.width() {
            let (name, width) = (embedder.network().name(), embedder.width());
            let found = format!("{name} of width {width}");
            return refuse("encoder", found, format!("width {}", fitted.width()));
        }
        if let Network::Sequences(encoder, _) = embedder.network() {
            let found = format!("{}, which embeds sequences", encoder.kind());
            return refuse("network", found, "an encoder of single images");
        }
        let views = fitted.steps().next_back().unwrap_or(0);
        if about.angles.len() != views || !about.angles.iter().all(|angle| angle.is_finite()) {
            let found = format!("{:?}", about.angles);
            return refuse("angles", found, format!("one for each of {views} views"));
        }
        if about.frame_size.contains(&0) {
            let found = format!("{:?}", about.frame_size);
            return refuse("frame size", found, "at least a pixel");
        }
        Ok(Self {
            about,
            embedder,
            fitted,
            joint: false,
        })
    }

    /// Widens intervals so that those of all properties of a surface hold at once at the level
    /// ([`Fitted::predict_jointly`]); none for the mean of several photographs. Only
    /// [`Estimator::predict`], [`Estimator::predict_embedded`] and [`Estimator::predict_all`] use them.
    #[must_use]
    pub fn jointly(self) -> Self {
        Self {
            joint: true,
            ..self
        }
    }

    /// Adds what people are shown of each surface that it holds photographs against; `shown` gets the place
    /// of the surface among those that were fitted.
    ///
    /// # Errors
    /// What `shown` says.
    pub fn with_shown<E>(
        mut self,
        shown: impl FnMut(usize) -> Result<Shown, E>,
    ) -> Result<Self, E> {
        if let Ok(familiar) = &mut self.fitted.familiar {
            let all = familiar.places.iter().copied().map(shown);
            familiar.shown = all.collect::<Result<_, E>>()?;
        }
        Ok(self)
    }

    /// The surface at [`Near::at`]; `None` where the model keeps no names.
    pub fn shown(&self, at: usize) -> Option<&Shown> {
        self.fitted.familiar.as_ref().ok()?.shown.get(at)
    }

    /// What goes with it.
    pub fn about(&self) -> &About {
        &self.about
    }

    /// What makes embeddings of photographs.
    pub fn embedder(&self) -> &Embedder {
        &self.embedder
    }

    /// What makes estimates of embeddings.
    pub fn fitted(&self) -> &Fitted {
        &self.fitted
    }

    /// The properties without any interval, and why.
    pub fn no_interval(&self) -> BTreeMap<&str, &str> {
        let measures = self.fitted.measures.iter();
        let reasons = measures.filter_map(|measure| match &measure.interval {
            Interval::None(reason) => Some((measure.property.as_str(), reason.as_str())),
            Interval::Errors(_) => None,
        });
        reasons.collect()
    }

    /// Reads a photograph as the model was taught to, and brings it to its scale.
    ///
    /// # Errors
    /// What [`read_photograph`] says.
    pub fn read(&self, path: &Path, scale: Scale) -> Result<Frame> {
        let (decode, shorter_side) = (&self.about.decode, self.shorter_side(scale));
        Ok(read_photograph(path, decode, shorter_side)?)
    }

    /// Decodes the bytes of an image file as the model was taught to, and brings it to its scale: what
    /// [`Estimator::read`] makes of the file, within limits of the caller.
    ///
    /// # Errors
    /// What [`decode_image_resized`] says.
    pub fn decode(&self, bytes: &[u8], limits: Limits, scale: Scale) -> Result<Frame> {
        let decode = DecodeSettings {
            limits,
            ..self.about.decode.clone()
        };
        Ok(decode_image_resized(bytes, &decode, self.shorter_side(scale))?.frame)
    }

    /// Brings a photograph that is in memory to the model's scale.
    ///
    /// # Errors
    /// A photograph without its pixels, or one that becomes too large.
    pub fn rescale(&self, photograph: Frame, scale: Scale) -> Result<Frame> {
        Ok(match self.shorter_side(scale) {
            Some(shorter) => photograph.resized(shorter)?.into_owned(),
            None => photograph,
        })
    }

    fn shorter_side(&self, scale: Scale) -> Option<usize> {
        match scale {
            Scale::OfModel => {
                let of_frames = self.about.frame_size.into_iter().min();
                self.embedder.resize().or(of_frames)
            }
            Scale::ShorterSide(pixels) => Some(pixels),
            Scale::Keep => None,
        }
    }

    /// What is said of one surface from photographs of it, which have the model's scale
    /// ([`Estimator::read`]): one for each view, in the order of [`About::angles`]. A model of one view
    /// takes any number of photographs: the answer is the mean of what each says, with the smallest
    /// p-value times their number. The interval is the mean of one for each photograph. Those of k
    /// photographs hold at 1 - (1 - level) / k each, so all at once at the level, and their mean with
    /// them; where too few units calibrate for that there is none ([`Answer::no_interval`]).
    ///
    /// # Errors
    /// No photograph, another number than the model takes, what the encoder says.
    pub fn predict(&self, photographs: &[Frame]) -> Result<Answer> {
        let values = self.embedder.embed(photographs)?;
        self.predict_embedded(&values, photographs.len())
    }

    /// As [`Estimator::predict`], from the embeddings of so many photographs, `(photographs, width)`.
    ///
    /// # Errors
    /// As [`Estimator::predict`].
    pub fn predict_embedded(&self, values: &[f32], photographs: usize) -> Result<Answer> {
        if photographs == 0 {
            return refuse("photographs", "none", "at least one");
        }
        let (surfaces, views) = if self.fitted.averages() {
            (photographs, 1)
        } else {
            (1, photographs)
        };
        self.check_views(views)?;
        let embeddings = self.embedder.table(values, surfaces, views)?;
        let fitted = &self.fitted;
        let predictions = fitted.predict_at_once(&embeddings, surfaces, self.joint)?;
        Ok(self.answer(&predictions, &embeddings, 0..surfaces))
    }

    /// What is said of several surfaces, each from as many photographs as the model has views, from
    /// their embeddings, `(surfaces, views, width)`.
    ///
    /// # Errors
    /// As [`Estimator::predict`].
    pub fn predict_all(
        &self,
        values: &[f32],
        surfaces: usize,
        views: usize,
    ) -> Result<Vec<Answer>> {
        if surfaces == 0 {
            return Ok(Vec::new());
        }
        self.check_views(views)?;
        let embeddings = self.embedder.table(values, surfaces, views)?;
        let predictions = self.fitted.predict_at_once(&embeddings, 1, self.joint)?;
        let answer = |at| self.answer(&predictions, &embeddings, at..at + 1);
        Ok((0..surfaces).map(answer).collect())
    }

    /// Refuses so many photographs of a surface, where the model looks at another number.
    fn check_views(&self, photographs: usize) -> Result<()> {
        if self.fitted.steps().any(|views| views == photographs) {
            return Ok(());
        }
        let what = "photographs of a surface";
        refuse(what, photographs, self.views_in_words())
    }

    /// How many photographs of a surface it looks at, and from which angles: `2, at 0 and 45 degrees`.
    pub fn views_in_words(&self) -> String {
        let steps = listed(self.fitted.steps(), "or");
        let angles = listed(self.about.angles.iter(), "and");
        let several = self.about.angles.len() > 1;
        let ordered = if several { ", in this order" } else { "" };
        format!("{steps}, at {angles} degrees{ordered}")
    }

    /// What is said of some photographs that are of one surface: the mean.
    pub(crate) fn answer(
        &self,
        predictions: &Predictions,
        embeddings: &Embeddings,
        of: Range<usize>,
    ) -> Answer {
        let count = of.len() as f64;
        let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / count;
        let estimates = predictions.properties.iter().map(|predicted| {
            let intervals = predicted.intervals.as_ref().ok();
            let intervals = intervals.map(|all| &all[of.clone()]);
            let property = &predicted.property;
            let Described { name, unit } = self.about.describe(property);
            Estimate {
                name,
                unit,
                property: property.clone(),
                value: mean(&mut predicted.values[of.clone()].iter().copied()),
                low: intervals.map(|all| mean(&mut all.iter().map(|interval| interval.low))),
                high: intervals.map(|all| mean(&mut all.iter().map(|interval| interval.high))),
            }
        });
        let reasons = predictions.properties.iter().filter_map(|predicted| {
            let reason = predicted.intervals.as_ref().err()?;
            Some((predicted.property.clone(), reason.clone()))
        });
        let familiar = predictions.familiar.as_ref().map(|all| {
            let smallest = all[of.clone()].iter().copied().fold(1.0, f64::min);
            (smallest * count).min(1.0)
        });
        let known = self.fitted.familiar.iter();
        let known = known.filter(|familiar| !familiar.shown.is_empty());
        let nearest = known.flat_map(|known| {
            let nearest = known.nearest(embeddings, of.clone()).into_iter();
            nearest.map(|(at, distance)| Near {
                at,
                surface: known.shown[at].name.clone(),
                distance,
            })
        });
        Answer {
            estimates: estimates.collect(),
            familiar,
            no_interval: reasons.collect(),
            nearest: nearest.collect(),
        }
    }
}

impl About {
    /// What a property is called, its code where it has no other name, and the unit of its values.
    pub fn describe(&self, property: &str) -> Described {
        let mut described = self.described.get(property).cloned().unwrap_or_default();
        if described.name.is_empty() {
            let known = toccare::find(property).map_or(property, |known| known.name);
            known.clone_into(&mut described.name);
        }
        described
    }
}

/// `1, 2 or 3`.
fn listed(items: impl Iterator<Item = impl ToString>, before_last: &str) -> String {
    let mut items: Vec<String> = items.map(|item| item.to_string()).collect();
    let last = items.pop().unwrap_or_default();
    if items.is_empty() {
        return last;
    }
    format!("{} {before_last} {last}", items.join(", "))
}
