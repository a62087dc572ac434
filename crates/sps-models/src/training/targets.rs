use candle_core::{Device, Tensor};

use crate::data::Readings;
use crate::error::{Error, Result};
use crate::standardise::Standardiser;

/// What an image is to say: values, a class, or both.
#[derive(Clone, Debug)]
pub struct Targets {
    /// One row for each image; a missing value counts for nothing.
    pub values: Option<Readings>,
    /// One class for each image.
    pub classes: Option<Classes>,
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
    /// Checks that there are targets for each of so many images.
    pub(super) fn check(&self, images: usize) -> Result<()> {
        let rows = self.values.as_ref().map(Readings::surfaces);
        let labels = self.classes.as_ref().map(|classes| classes.of_image.len());
        if rows.is_none() && labels.is_none() {
            return Err(Error::input("targets", "none", "values or classes"));
        }
        for found in [rows, labels].into_iter().flatten() {
            if found != images {
                let expected = format_args!("{images}, one for each image");
                return Err(Error::input("targets", found, expected));
            }
        }
        let classes = self.classes.iter();
        for (class, count) in classes.flat_map(|c| c.of_image.iter().map(|i| (i, c.count))) {
            if *class >= count {
                let expected = format_args!("a class below {count}");
                return Err(Error::input("targets", class, expected));
            }
        }
        Ok(())
    }
}

/// How each value is standardised, by the training images; one that never changes in them becomes 0.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Standards(Vec<Standardiser>);

impl Standards {
    pub(super) fn of(readings: &Readings, training: &[usize]) -> Self {
        let columns = 0..readings.properties().len();
        let standard = |column| {
            let values = training.iter().filter_map(|&row| readings.get(row, column));
            Standardiser::of(values).unwrap_or_default()
        };
        Self(columns.map(standard).collect())
    }

    /// The standardised values of `images`, and 1 where there is one; `(images, columns)` each.
    pub(super) fn tensors(
        &self,
        readings: &Readings,
        images: &[usize],
    ) -> Result<(Tensor, Tensor)> {
        let shape = (images.len(), self.0.len());
        let mut values = Vec::with_capacity(shape.0 * shape.1);
        let mut present = Vec::with_capacity(shape.0 * shape.1);
        for &image in images {
            for (column, standard) in self.0.iter().enumerate() {
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
        let standards = Standards::of(&readings, &training);
        let (values, _) = standards.tensors(&readings, &[0, 10]).unwrap();
        let values: Vec<f32> = values.flatten_all().unwrap().to_vec1().unwrap();
        assert_eq!(values, [0.0, 0.0]);
    }
}
