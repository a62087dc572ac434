use candle_core::{Device, Tensor};
use sps_regress::{Embeddings, Readings, Standardiser};

use super::kept::Kept;
use crate::error::{Error, Result, require};

/// What an image is to say: values, a class, or both.
///
/// A row is an image; or, where heads are trained on several views, a surface, whose view `v` is
/// image `row x views + v`.
#[derive(Clone, Debug, Default)]
pub struct Targets {
    /// One row for each image; a missing value counts for nothing.
    pub values: Option<Readings>,
    /// One class for each image.
    pub classes: Option<Classes>,
    /// Features that stay as they are; validation says nothing of them.
    pub kept: Option<Kept>,
    /// What the encoder sees of each surface before it is trained, in the views that it is trained on:
    /// heads scale their inputs by it and form visual labels from it. For heads alone.
    pub start: Option<Embeddings>,
    /// The material of each surface, for heads whose labels come from it.
    pub materials: Option<Vec<String>>,
}

/// One class for each image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Classes {
    /// The class of each image.
    pub of_image: Vec<u32>,
    /// How many classes there are.
    pub count: u32,
}

impl Targets {
    /// Images of a row.
    pub(super) fn views(&self) -> usize {
        self.start.as_ref().map_or(1, Embeddings::views)
    }

    /// Checks them; returns how many rows they have.
    pub(super) fn check(&self) -> Result<usize> {
        let rows = self.values.as_ref().map(Readings::surfaces);
        let labels = self.classes.as_ref().map(|classes| classes.of_image.len());
        let start = self.start.as_ref().map(Embeddings::surfaces);
        let materials = self.materials.as_ref().map(Vec::len);
        let counts = [rows, labels, start, materials];
        let Some(images) = counts.into_iter().flatten().next() else {
            return Err(Error::input("targets", "none", "values or classes"));
        };
        for found in counts.into_iter().flatten() {
            let expected = format_args!("{images}, one for each image");
            require(found == images, "targets", found, expected)?;
        }
        if let Some(Classes { of_image, count }) = &self.classes {
            for class in of_image {
                let expected = format_args!("a class below {count}");
                require(class < count, "targets", class, expected)?;
            }
        }
        Ok(images)
    }
}

/// Values, and how each is standardised, by the training images; one that never changes in them becomes 0.
#[derive(Debug)]
pub(super) struct Standards(Readings, Vec<Standardiser>);

impl Standards {
    pub(super) fn of(readings: Readings, training: &[usize]) -> Self {
        let columns = 0..readings.properties().len();
        let standard = |column| {
            let values = training.iter().filter_map(|&row| readings.get(row, column));
            Standardiser::of(values).unwrap_or_default()
        };
        let standards = columns.map(standard).collect();
        Self(readings, standards)
    }

    /// How many values these images have.
    pub(super) fn count(&self, images: &[usize]) -> usize {
        let rows = images.iter().filter_map(|&image| self.0.row(image));
        rows.flatten().flatten().count()
    }

    /// The standardised values of `images`, and 1 where there is one; `(images, columns)` each.
    pub(super) fn tensors(&self, images: &[usize]) -> Result<(Tensor, Tensor)> {
        let Self(readings, standards) = self;
        let shape = (images.len(), standards.len());
        let mut values = Vec::with_capacity(shape.0 * shape.1);
        let mut present = Vec::with_capacity(shape.0 * shape.1);
        for &image in images {
            for (column, standard) in standards.iter().enumerate() {
                let value = readings.get(image, column);
                values.push(value.map_or(0.0, |value| standard.standardise(value) as f32));
                present.push(f32::from(u8::from(value.is_some())));
            }
        }
        let tensor = |values| Tensor::from_vec(values, shape, &Device::Cpu);
        Ok((tensor(values)?, tensor(present)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean of ten times 0.1 is not 0.1: its rounding must not pass for a spread, by which
    /// another value would come to 1e16.
    #[test]
    fn a_value_that_hardly_changes_in_training_stays_small() {
        let mut rows = vec![vec![Some(0.1)]; 10];
        rows.push(vec![Some(0.2)]);
        let readings = Readings::new(vec!["p".into()], &rows).unwrap();
        let training: Vec<usize> = (0..10).collect();
        let standards = Standards::of(readings, &training);
        let (values, _) = standards.tensors(&[0, 10]).unwrap();
        let values: Vec<f32> = values.flatten_all().unwrap().to_vec1().unwrap();
        assert_eq!(values, [0.0, 0.0]);
    }
}
