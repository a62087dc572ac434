use std::io::{Cursor, Read};

use zip::ZipArchive;
use zip::result::ZipError;

use super::keyed::{KeyedTable, Touch};
use super::npy::{self, Array, Items};
use super::rows::RawTable;
use super::{Npz, NpzLayout, Stacked};
use crate::error::{Fault, Place};
use crate::tactile::is_plausible;
use crate::{PropertyOrder, Surface};

/// What a value costs in memory until its table is assembled, about.
const BYTES_PER_VALUE: u64 = 64;

/// Reads an archive of at most `limit` bytes once unpacked.
pub(super) fn read(
    bytes: &[u8],
    format: &Npz,
    surfaces: &[Surface],
    limit: u64,
) -> Result<RawTable, Fault> {
    let order = format.property_order.as_ref();
    let order = order.ok_or_else(Fault::no_property_order)?;
    let arrays = Arrays::unpack(bytes, limit)?;
    let mut table = KeyedTable::new(&format.statistics);
    let mut push = |name: &str, values: &Numbers<'_>| {
        let touches = values.touches(order).map_err(|fault| fault.at_key(name))?;
        table.push(Place::Key(name.to_owned()), name, touches)
    };
    match &format.layout {
        NpzLayout::Keyed => {
            for (name, array) in &arrays.0 {
                push(name, &Numbers::of(name, array)?)?;
            }
        }
        NpzLayout::Stacked(stacked) => {
            for statistic in [&format.statistics.mean, &format.statistics.std] {
                if let Some(array) = arrays.find(statistic) {
                    push(statistic, &Numbers::of(statistic, array)?)?;
                }
            }
            let values = Numbers::of(&stacked.values, arrays.required(&stacked.values)?)?;
            let names = arrays.surface_names(stacked, surfaces)?;
            let each = values.split(names.len());
            let each = each.map_err(|fault| fault.at_key(&stacked.values))?;
            for (name, values) in names.iter().zip(each) {
                push(name, &values)?;
            }
        }
    }
    table.finish(order.to_vec())
}

/// The arrays of an archive by name, in its order.
struct Arrays(Vec<(String, Array)>);

impl Arrays {
    fn unpack(bytes: &[u8], limit: u64) -> Result<Self, Fault> {
        let malformed = |reason: String| Fault::malformed("NPZ", reason);
        let in_zip = |error: ZipError| malformed(error.to_string());
        let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(in_zip)?;
        let mut named = Vec::new();
        let mut left = limit;
        for index in 0..archive.len() {
            let file = archive.by_index(index).map_err(in_zip)?;
            let name = file.name().map_err(|error| malformed(error.to_string()))?;
            let name = name.strip_suffix(".npy").unwrap_or(&name).to_owned();
            let mut unpacked = Vec::new();
            let read = file.take(left.saturating_add(1)).read_to_end(&mut unpacked);
            read.map_err(|error| malformed(format!("array `{name}`: {error}")))?;
            let Some(rest) = left.checked_sub(unpacked.len() as u64) else {
                let most = format!("its arrays unpack to more than the limit of {limit} bytes");
                return Err(malformed(most));
            };
            left = rest;
            let array = npy::read(&unpacked, limit / BYTES_PER_VALUE)
                .map_err(|reason| Fault::malformed("NPY", reason).at_key(&name))?;
            named.push((name, array));
        }
        Ok(Self(named))
    }

    fn find(&self, name: &str) -> Option<&Array> {
        let found = self.0.iter().find(|(named, _)| named == name);
        found.map(|(_, array)| array)
    }

    fn required(&self, name: &str) -> Result<&Array, Fault> {
        self.find(name).ok_or_else(|| {
            let found: Vec<_> = self.0.iter().map(|(name, _)| name.as_str()).collect();
            let expected = format!("an array `{name}`");
            Fault::unexpected("its arrays", found.join(", "), expected)
        })
    }

    fn surface_names(&self, stacked: &Stacked, surfaces: &[Surface]) -> Result<Vec<String>, Fault> {
        let Some(name) = &stacked.surfaces else {
            return Ok(surfaces.iter().map(|surface| surface.id.clone()).collect());
        };
        let Array { shape, items } = self.required(name)?;
        match items {
            Items::Texts(texts) if shape.len() == 1 => Ok(texts.clone()),
            _ => {
                let found = format!("shape {shape:?}, or numbers");
                Err(Fault::unexpected("the array", found, "one axis of texts").at_key(name))
            }
        }
    }
}

/// An array of numbers, or a part of one.
struct Numbers<'a> {
    shape: &'a [usize],
    values: &'a [f64],
}

impl<'a> Numbers<'a> {
    fn of(name: &str, array: &'a Array) -> Result<Self, Fault> {
        match &array.items {
            Items::Numbers(values) => Ok(Self {
                shape: &array.shape,
                values,
            }),
            Items::Texts(_) => Err(Fault::unexpected("the array", "texts", "numbers").at_key(name)),
        }
    }

    /// The parts along the first axis, of which there must be so many.
    fn split(&self, parts: usize) -> Result<impl Iterator<Item = Self> + use<'a>, Fault> {
        let Some((&count, shape)) = self.shape.split_first() else {
            let expected = "one for surfaces and one for properties";
            return Err(Fault::unexpected("its axes", "none", expected));
        };
        if count != parts {
            let (what, expected) = ("the first axis", format!("{parts}, one per surface"));
            return Err(Fault::unexpected(what, count, expected));
        }
        let (all, size) = (self.values, shape.iter().product::<usize>());
        Ok((0..count).map(move |part| Self {
            shape,
            values: all.get(part * size..(part + 1) * size).unwrap_or_default(),
        }))
    }

    /// `(properties)`, `(repeats, properties)` or `(locations, repeats, properties)` as touches.
    fn touches(&self, order: &PropertyOrder) -> Result<Vec<Touch>, Fault> {
        let repeats = match *self.shape {
            [_] => 1,
            [repeats, _] | [_, repeats, _] => repeats,
            _ => 0,
        };
        if repeats == 0 || self.shape.last() != Some(&order.len()) {
            let expected = format!(
                "(properties), (repeats, properties) or (locations, repeats, properties) with {} \
                 properties, as in `property-order`",
                order.len()
            );
            let (what, found) = ("the axes of a surface", format!("{:?}", self.shape));
            return Err(Fault::unexpected(what, found, expected));
        }
        let touch = |(index, values): (usize, &[f64])| {
            let values = order.iter().zip(values);
            let measured = values.map(|(property, &value)| {
                if value.is_nan() || is_plausible(value) {
                    return Ok((!value.is_nan()).then_some(value));
                }
                let expected = "a number within 1e9 of 0, or NaN";
                Err(Fault::not_a_number(property, value, expected))
            });
            let values = measured.collect::<Result<_, _>>()?;
            Ok(((index / repeats) as u32, (index % repeats) as u32, values))
        };
        let touches = self.values.chunks_exact(order.len()).enumerate();
        touches.map(touch).collect()
    }
}
