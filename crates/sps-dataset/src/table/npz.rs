use std::io::{Cursor, Read};
use std::path::Path;

use zip::ZipArchive;

use super::keyed::{KeyedTable, Touch};
use super::npy::{self, Array, Items};
use super::rows::RawTable;
use super::{Npz, NpzLayout, Stacked};
use crate::PropertyOrder;
use crate::tactile::is_plausible;
use crate::{DatasetError, DatasetErrorKind, Place, Surface};

/// What a value costs in memory until its table is assembled, about.
const BYTES_PER_VALUE: u64 = 64;

/// Reads an archive of at most `limit` bytes once unpacked.
pub(super) fn read(
    path: &Path,
    bytes: &[u8],
    format: &Npz,
    surfaces: &[Surface],
    limit: u64,
) -> Result<RawTable, DatasetError> {
    let order = format.property_order.as_ref();
    let order =
        order.ok_or_else(|| DatasetError::file(path, DatasetErrorKind::no_property_order()))?;
    let arrays = Arrays::unpack(path, bytes, limit)?;
    let mut table = KeyedTable::new(path, &format.statistics);
    let mut push = |name: &str, values: &Numbers<'_>| {
        let touches = values
            .touches(order)
            .map_err(|kind| DatasetError::key(path, name, kind))?;
        table.push(Place::Key(name.to_owned()), name, touches)
    };
    match &format.layout {
        NpzLayout::Keyed => {
            for (name, array) in &arrays.named {
                push(name, &arrays.numbers(name, array)?)?;
            }
        }
        NpzLayout::Stacked(stacked) => {
            for statistic in [&format.statistics.mean, &format.statistics.std] {
                if let Some(array) = arrays.find(statistic) {
                    push(statistic, &arrays.numbers(statistic, array)?)?;
                }
            }
            let values = arrays.numbers(&stacked.values, arrays.required(&stacked.values)?)?;
            let names = arrays.surface_names(stacked, surfaces)?;
            let (stack, each) = values
                .split()
                .map_err(|kind| DatasetError::key(path, &stacked.values, kind))?;
            if stack != names.len() {
                let kind = DatasetErrorKind::unexpected(
                    "the first axis",
                    stack.to_string(),
                    format!("{}, one per surface", names.len()),
                );
                return Err(DatasetError::key(path, &stacked.values, kind));
            }
            for (name, values) in names.iter().zip(each) {
                push(name, &values)?;
            }
        }
    }
    table.finish(order.to_vec())
}

/// The arrays of an archive, in its order.
struct Arrays<'a> {
    path: &'a Path,
    named: Vec<(String, Array)>,
}

impl<'a> Arrays<'a> {
    fn unpack(path: &'a Path, bytes: &[u8], limit: u64) -> Result<Self, DatasetError> {
        let malformed = |reason: String| {
            let format = "NPZ";
            DatasetError::file(path, DatasetErrorKind::Malformed { format, reason })
        };
        let in_zip = |error: zip::result::ZipError| malformed(error.to_string());
        let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(in_zip)?;
        let mut named: Vec<(String, Array)> = Vec::new();
        let mut left = limit;
        for index in 0..archive.len() {
            let file = archive.by_index(index).map_err(in_zip)?;
            let name = file.name().map_err(|error| malformed(error.to_string()))?;
            let name = name.into_owned();
            let name = name.strip_suffix(".npy").unwrap_or(&name);
            let mut unpacked = Vec::new();
            let read = file.take(left.saturating_add(1)).read_to_end(&mut unpacked);
            read.map_err(|error| malformed(format!("array `{name}`: {error}")))?;
            let most = format!("its arrays unpack to more than the limit of {limit} bytes");
            left = left
                .checked_sub(unpacked.len() as u64)
                .ok_or_else(|| malformed(most))?;
            let array = npy::read(&unpacked, limit / BYTES_PER_VALUE).map_err(|reason| {
                let format = "NPY";
                DatasetError::key(path, name, DatasetErrorKind::Malformed { format, reason })
            })?;
            named.push((name.to_owned(), array));
        }
        Ok(Self { path, named })
    }

    fn find(&self, name: &str) -> Option<&Array> {
        let found = self.named.iter().find(|(named, _)| named == name);
        found.map(|(_, array)| array)
    }

    fn required(&self, name: &str) -> Result<&Array, DatasetError> {
        self.find(name).ok_or_else(|| {
            let found: Vec<_> = self.named.iter().map(|(name, _)| name.as_str()).collect();
            let expected = format!("an array `{name}`");
            let kind = DatasetErrorKind::unexpected("its arrays", found.join(", "), expected);
            DatasetError::file(self.path, kind)
        })
    }

    fn numbers<'b>(&self, name: &str, array: &'b Array) -> Result<Numbers<'b>, DatasetError> {
        match &array.items {
            Items::Numbers(values) => Ok(Numbers {
                shape: &array.shape,
                values,
            }),
            Items::Texts(_) => {
                let kind = DatasetErrorKind::unexpected("the array", "texts", "numbers");
                Err(DatasetError::key(self.path, name, kind))
            }
        }
    }

    fn surface_names(
        &self,
        stacked: &Stacked,
        surfaces: &[Surface],
    ) -> Result<Vec<String>, DatasetError> {
        let Some(name) = &stacked.surfaces else {
            return Ok(surfaces.iter().map(|surface| surface.id.clone()).collect());
        };
        match self.required(name)? {
            Array {
                shape,
                items: Items::Texts(texts),
            } if shape.len() == 1 => Ok(texts.clone()),
            Array { shape, .. } => {
                let found = format!("shape {shape:?}, or numbers");
                let kind = DatasetErrorKind::unexpected("the array", found, "one axis of texts");
                Err(DatasetError::key(self.path, name, kind))
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
    /// Along the first axis: its length, and each part.
    fn split(
        &self,
    ) -> Result<(usize, impl Iterator<Item = Numbers<'a>> + use<'a>), DatasetErrorKind> {
        let Some((&count, rest)) = self.shape.split_first() else {
            let expected = "one for surfaces and one for properties";
            return Err(DatasetErrorKind::unexpected("its axes", "none", expected));
        };
        let size = rest.iter().product::<usize>();
        let values = self.values;
        let part = move |index: usize| {
            let values = values
                .get(index * size..(index + 1) * size)
                .unwrap_or_default();
            Numbers {
                shape: rest,
                values,
            }
        };
        Ok((count, (0..count).map(part)))
    }

    /// `(properties)`, `(repeats, properties)` or `(locations, repeats, properties)` as touches.
    fn touches(&self, order: &PropertyOrder) -> Result<Vec<Touch>, DatasetErrorKind> {
        let repeats = match *self.shape {
            [_] => 1,
            [repeats, _] | [_, repeats, _] => repeats,
            _ => 0,
        };
        if repeats == 0 || self.shape.last() != Some(&order.len()) {
            return Err(DatasetErrorKind::unexpected(
                "the axes of a surface",
                format!("{:?}", self.shape),
                format!(
                    "(properties), (repeats, properties) or (locations, repeats, properties) with \
                     {} properties, as in `property-order`",
                    order.len()
                ),
            ));
        }
        let touch = |(index, values): (usize, &[f64])| {
            let values = order.iter().zip(values);
            let measured = values.map(|(property, &value)| match value {
                _ if value.is_nan() => Ok(None),
                _ if is_plausible(value) => Ok(Some(value)),
                _ => {
                    let expected = "a number within 1e9 of 0, or NaN";
                    let found = value.to_string();
                    Err(DatasetErrorKind::not_a_number(
                        property.code(),
                        &found,
                        expected,
                    ))
                }
            });
            let values = measured.collect::<Result<_, _>>()?;
            Ok(((index / repeats) as u32, (index % repeats) as u32, values))
        };
        self.values
            .chunks_exact(order.len())
            .enumerate()
            .map(touch)
            .collect()
    }
}
