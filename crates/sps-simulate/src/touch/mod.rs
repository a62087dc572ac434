//! The measurement model: fifteen Toccare properties from a surface's physical parameters.
//!
//! Each property is first a physical quantity of the contact between a soft finger and the
//! surface, its *response*; the response is then read on the Toccare's scale of 0 to 100 by a
//! fixed monotone map that gives the published quantiles (see [`scale`]).

mod compliance;
mod friction;
mod scale;
mod texture;
mod thermal;

use sps_dataset::{Reading, TactileTable, toccare};

use super::latent::Scores;
use super::parameters::{Parameters, Specimen};
use super::stream::{Purpose, Stream};

/// One number for each property, in the order of [`toccare::ALL`].
pub(crate) type Values = [f64; 15];

/// How far the parameters of two places of one surface differ, in standard scores.
const PLACE_SPREAD: f64 = 0.15;

/// Spread of repeated touches: a share of the value, and a part in units of the scale.
const REPEAT_SHARE: f64 = 0.04;
const REPEAT_UNITS: f64 = 0.25;

/// The physical response behind each property; only its order over surfaces matters.
pub(crate) fn responses(parameters: &Parameters) -> Values {
    let spectrum = texture::Spectrum::of(parameters);
    let contact = friction::Contact::of(parameters, &spectrum);
    let depth = compliance::depth(parameters);
    [
        contact.sliding(),
        contact.stiction(),
        spectrum.micro_coarseness(),
        spectrum.micro_roughness(),
        spectrum.regularity(),
        spectrum.macro_coarseness(),
        spectrum.macro_texture(),
        thermal::cooling(parameters),
        thermal::persistence(parameters),
        compliance::compliance(depth),
        compliance::local_deformation(depth, parameters.relief_mm),
        // Energy lost in a press and release of a standard linear solid, the fall of the force at
        // constant depth, and the depth that is gained at constant force.
        compliance::log_share(depth, parameters.loss),
        compliance::log_share(depth, parameters.relaxation),
        compliance::log_share(depth, parameters.creep),
        contact.tack(),
    ]
}

/// The values at one place of a surface, without the noise of a touch.
fn at_place(specimen: &Specimen, own: &Scores, place: u64) -> Values {
    let key = [specimen.index, place];
    let mut stream = Stream::new(specimen.seed, Purpose::LOCATION, &key);
    let moved = own.moved(&Scores::draw_own(&mut stream), PLACE_SPREAD);
    let parameters = Parameters::at(specimen.profile, &moved.linked());
    scale::read(&responses(&parameters))
}

/// The mean over places, without the noise of touches, of a surface with these own scores.
pub(crate) fn mean_values(
    specimen: &Specimen,
    own: &Scores,
    places: std::ops::Range<u64>,
) -> Values {
    let count = places.clone().count() as f64;
    let mut mean = [0.0; 15];
    for place in places {
        for (sum, value) in mean.iter_mut().zip(at_place(specimen, own, place)) {
            *sum += value / count;
        }
    }
    mean
}

/// Touches every surface at every place as often as asked.
pub(crate) fn readings(specimens: &[Specimen], places: u32, repeats: u32) -> TactileTable {
    let mut table = TactileTable {
        properties: toccare::properties(),
        readings: Vec::with_capacity(specimens.len() * (places * repeats) as usize),
    };
    for (surface, specimen) in specimens.iter().enumerate() {
        for location in 0..places {
            let values = at_place(specimen, &specimen.own, u64::from(location));
            for repeat in 0..repeats {
                table.readings.push(Reading {
                    surface,
                    location,
                    repeat,
                    values: touched(specimen, location, repeat, &values),
                });
            }
        }
    }
    table
}

/// One touch: the values with its noise, on the scale from 0 to 100.
fn touched(specimen: &Specimen, place: u32, repeat: u32, values: &Values) -> Vec<Option<f64>> {
    let key = [specimen.index, u64::from(place), u64::from(repeat)];
    let mut stream = Stream::new(specimen.seed, Purpose::REPEAT, &key);
    let touched = values.iter().map(|&value| {
        let noise = REPEAT_SHARE * value * stream.normal() + REPEAT_UNITS * stream.normal();
        Some((value + noise).clamp(0.0, 100.0))
    });
    touched.collect()
}
