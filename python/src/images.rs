//! Images as Python hands them over: arrays of pixels, or paths.

use std::path::PathBuf;

use numpy::ndarray::ArrayView3;
use numpy::{
    Element, PyArray3, PyArrayDescrMethods, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyIterator;
use sps_dataset::{DecodeSettings, Frame, read_image};

use crate::errors::{frame_error, value_error};

/// An image that is to be embedded.
pub(crate) struct Image {
    /// What to call it in errors.
    name: String,
    content: Content,
}

enum Content {
    Pixels(Frame),
    File(PathBuf),
}

/// What was handed over, image by image.
pub(crate) enum Images<'py> {
    One(Option<Bound<'py, PyAny>>),
    Several(usize, Bound<'py, PyIterator>),
}

impl<'py> Images<'py> {
    /// A path or an array of up to three axes is one image, all else is gone through.
    pub(crate) fn new(images: &Bound<'py, PyAny>) -> PyResult<Self> {
        let is_one = match images.cast::<PyUntypedArray>() {
            Ok(array) => array.ndim() <= 3,
            Err(_) => images.extract::<PathBuf>().is_ok(),
        };
        Ok(if is_one {
            Self::One(Some(images.clone()))
        } else {
            Self::Several(0, images.try_iter()?)
        })
    }
}

impl Iterator for Images<'_> {
    type Item = PyResult<Image>;

    fn next(&mut self) -> Option<Self::Item> {
        match self {
            Self::One(image) => Some(Image::new("the image".to_owned(), &image.take()?)),
            Self::Several(index, images) => {
                let image = images.next()?;
                let name = format!("image {index}");
                *index += 1;
                Some(image.and_then(|image| Image::new(name, &image)))
            }
        }
    }
}

impl Image {
    fn new(name: String, image: &Bound<'_, PyAny>) -> PyResult<Self> {
        let content = match image.cast::<PyUntypedArray>() {
            Ok(array) => Content::Pixels(pixels(&name, array)?),
            Err(_) => Content::File(image.extract().map_err(|_| {
                PyTypeError::new_err(match image.get_type().fully_qualified_name() {
                    Ok(found) => format!("{name} is a {found}, expected a numpy array or a path"),
                    Err(error) => error.to_string(),
                })
            })?),
        };
        Ok(Self { name, content })
    }

    /// The image as the encoders take it, with sides of at least so many pixels.
    pub(crate) fn frame(self, least_side: usize) -> PyResult<Frame> {
        let frame = match self.content {
            Content::Pixels(frame) => frame,
            Content::File(path) => {
                read_image(&path, &DecodeSettings::default())
                    .map_err(|error| frame_error(&error))?
                    .frame
            }
        };
        let Frame { width, height, .. } = frame;
        if height.min(width) < least_side {
            return Err(value_error(format_args!(
                "{} has {height} x {width} pixels, expected sides of at least {least_side}",
                self.name
            )));
        }
        Ok(frame)
    }
}

/// A copy of the array's pixels: bytes as the readers of image files take them, floats as they are.
fn pixels(name: &str, array: &Bound<'_, PyUntypedArray>) -> PyResult<Frame> {
    let &[height, width, 3] = array.shape() else {
        return Err(value_error(format_args!(
            "{name} is of shape {:?}, expected (height, width, 3)",
            array.shape()
        )));
    };
    let data = if let Ok(bytes) = array.cast::<PyArray3<u8>>() {
        values(bytes, |byte| f32::from(byte) / 255.0)?
    } else if let Ok(floats) = array.cast::<PyArray3<f32>>() {
        let data = values(floats, |value| value)?;
        in_range(name, &data)?;
        data
    } else {
        return Err(PyTypeError::new_err(format!(
            "{name} is of dtype {}, expected uint8, or float32 from 0 to 1",
            array.dtype().typeobj().name()?
        )));
    };
    Ok(Frame {
        width,
        height,
        data,
    })
}

/// The array's elements, row-major, each turned into a value.
fn values<T: Element + Copy>(
    array: &Bound<'_, PyArray3<T>>,
    value: impl Fn(T) -> f32,
) -> PyResult<Vec<f32>> {
    let array = array.try_readonly()?;
    let array: ArrayView3<'_, T> = array.as_array();
    Ok(match array.as_slice() {
        Some(slice) => slice.iter().map(|&element| value(element)).collect(),
        None => array.iter().map(|&element| value(element)).collect(),
    })
}

fn in_range(name: &str, values: &[f32]) -> PyResult<()> {
    let fits = |value: &f32| (0.0..=1.0).contains(value);
    // Through to the end, so that several are compared at once; only a refusal looks for the first.
    if values.iter().fold(true, |all, value| all & fits(value)) {
        return Ok(());
    }
    match values.iter().find(|value| !fits(value)) {
        None => Ok(()),
        Some(found) => Err(value_error(format_args!(
            "{name} holds {found}, expected values from 0 to 1"
        ))),
    }
}
