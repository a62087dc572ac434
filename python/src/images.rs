//! Images as Python hands them over: arrays of pixels, or paths.

use std::path::{Path, PathBuf};
use std::vec;

use numpy::ndarray::ArrayView3;
use numpy::{
    Element, PyArray3, PyArrayDescrMethods, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyIterator;
use rayon::prelude::*;
use sps_base::files::write_file;
use sps_dataset::{Extent, Frame, FrameFormat};
use sps_estimator::photographs_in;

use crate::errors::{estimator_error, file_error, value_error};

/// Images that are decoded and embedded at once, for each thread: as many as a thread takes through
/// the network together, and few enough that large ones fit in memory.
const IMAGES_PER_THREAD: usize = 4;

/// An image that is to be embedded.
pub(crate) struct Image {
    /// What to call it in errors.
    name: String,
    content: Content,
}

enum Content {
    /// With the format of a file that keeps them.
    Pixels(Frame, FrameFormat),
    File(PathBuf),
}

/// What was handed over, image by image.
pub(crate) struct Images<'py> {
    /// What begins their names in errors.
    of: String,
    handed: Handed<'py>,
}

enum Handed<'py> {
    One(Option<Bound<'py, PyAny>>),
    Folder(vec::IntoIter<PathBuf>),
    Several(usize, Bound<'py, PyIterator>),
}

impl<'py> Images<'py> {
    /// The path of a folder is the images in it by name, another path or an array of up to three axes one
    /// image; all else is gone through. `of` begins their names in errors.
    pub(crate) fn new(of: String, images: &Bound<'py, PyAny>) -> PyResult<Self> {
        let folder = images.extract::<PathBuf>().ok();
        let handed = if let Some(folder) = folder.filter(|path| path.is_dir()) {
            let inside = photographs_in(&folder).map_err(|error| estimator_error(&error))?;
            Handed::Folder(inside.into_iter())
        } else if is_one(images) {
            Handed::One(Some(images.clone()))
        } else {
            Handed::Several(0, images.try_iter()?)
        };
        Ok(Self { of, handed })
    }
}

/// Whether it is meant as one image: a path, or an array of up to three axes.
pub(crate) fn is_one(image: &Bound<'_, PyAny>) -> bool {
    match array(image) {
        Ok(Some(array)) => array.ndim() <= 3,
        Ok(None) => image.extract::<PathBuf>().is_ok(),
        // What is wrong with it is said where it is read.
        Err(_) => true,
    }
}

/// An array, an image of PIL or a tensor of torch as an array, the channels last.
fn array<'py>(image: &Bound<'py, PyAny>) -> PyResult<Option<Bound<'py, PyUntypedArray>>> {
    if let Ok(array) = image.cast::<PyUntypedArray>() {
        return Ok(Some(array.clone()));
    }
    let tensor = image.hasattr("__dlpack__")?;
    if !tensor && !image.hasattr("__array_interface__")? {
        return Ok(None);
    }
    let function = if tensor { "from_dlpack" } else { "asarray" };
    let mut array = image
        .py()
        .import("numpy")?
        .call_method1(function, (image,))?;
    if let Ok((3, _, columns)) = array.getattr("shape")?.extract::<(usize, usize, usize)>()
        && columns != 3
    {
        array = array.call_method1("transpose", (1, 2, 0))?;
    }
    Ok(Some(array.cast_into()?))
}

impl Iterator for Images<'_> {
    type Item = PyResult<Image>;

    fn next(&mut self) -> Option<Self::Item> {
        let of = &self.of;
        match &mut self.handed {
            Handed::One(image) => Some(Image::new(format!("{of}the image"), &image.take()?)),
            Handed::Folder(paths) => paths
                .next()
                .map(|path| Ok(Image::file(format!("{of}the image"), path))),
            Handed::Several(index, images) => {
                let image = images.next()?;
                let name = format!("{of}image {index}");
                *index += 1;
                Some(image.and_then(|image| Image::new(name, &image)))
            }
        }
    }
}

/// The embeddings of images, row-major, a few at a time by `embed`.
pub(crate) fn embed_each(
    py: Python<'_>,
    images: &mut impl Iterator<Item = PyResult<Image>>,
    mut embed: impl FnMut(Vec<Image>) -> PyResult<Vec<f32>> + Send,
) -> PyResult<Vec<f32>> {
    let at_once = IMAGES_PER_THREAD * rayon::current_num_threads();
    let mut embeddings = Vec::new();
    loop {
        py.check_signals()?;
        let some = images.by_ref().take(at_once);
        let some: Vec<Image> = some.collect::<PyResult<_>>()?;
        if some.is_empty() {
            return Ok(embeddings);
        }
        embeddings.extend(py.detach(|| embed(some))?);
    }
}

/// The pixels of images, each by `frame`, on all threads.
pub(crate) fn frames(
    images: Vec<Image>,
    frame: impl Fn(Image) -> PyResult<Frame> + Send + Sync,
) -> PyResult<Vec<Frame>> {
    let frames: Vec<PyResult<Frame>> = images.into_par_iter().map(frame).collect();
    // Of several failures the first, whichever thread was faster.
    frames.into_iter().collect()
}

impl Image {
    fn file(name: String, path: PathBuf) -> Self {
        Self {
            name,
            content: Content::File(path),
        }
    }

    pub(crate) fn new(name: String, image: &Bound<'_, PyAny>) -> PyResult<Self> {
        let content = if let Some(array) = array(image)? {
            let (frame, format) = pixels(&name, &array)?;
            Content::Pixels(frame, format)
        } else {
            Content::File(image.extract().map_err(|_| {
                PyTypeError::new_err(match image.get_type().fully_qualified_name() {
                    Ok(found) => format!("{name} is a {found}, expected an array or a path"),
                    Err(error) => error.to_string(),
                })
            })?)
        };
        Ok(Self { name, content })
    }

    /// The path of a file of it: its own, or `stem` with an ending, written now.
    pub(crate) fn into_file(self, stem: &Path) -> PyResult<PathBuf> {
        let (frame, format) = match self.content {
            Content::File(path) => return Ok(path),
            Content::Pixels(frame, format) => (frame, format),
        };
        let bytes = format.encode(&frame);
        let bytes = bytes.map_err(|error| value_error(format_args!("{}: {error}", self.name)))?;
        let path = stem.with_extension(format.extension());
        match write_file(&path, &bytes) {
            Ok(()) => Ok(path),
            Err(error) => Err(file_error(&error, &path)),
        }
    }

    /// The size that it comes in, of a file as `read` reads it.
    pub(crate) fn extent(&self, read: impl FnOnce(&Path) -> PyResult<Frame>) -> PyResult<Extent> {
        match &self.content {
            Content::Pixels(frame, _) => Ok(frame.extent()),
            Content::File(path) => Ok(read(path)?.extent()),
        }
    }

    /// The image as an encoder takes it, with sides of at least so many pixels: of a file as `read`
    /// reads it, of an array as `take` takes it.
    pub(crate) fn frame(
        self,
        least_side: usize,
        read: impl FnOnce(&Path) -> PyResult<Frame>,
        take: impl FnOnce(Frame) -> PyResult<Frame>,
    ) -> PyResult<Frame> {
        let frame = match self.content {
            Content::Pixels(frame, _) => take(frame)?,
            Content::File(path) => read(&path)?,
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
fn pixels(name: &str, array: &Bound<'_, PyUntypedArray>) -> PyResult<(Frame, FrameFormat)> {
    let &[height, width, 3] = array.shape() else {
        return Err(value_error(format_args!(
            "{name} is of shape {:?}, expected (height, width, 3)",
            array.shape()
        )));
    };
    let (data, format) = if let Ok(bytes) = array.cast::<PyArray3<u8>>() {
        let data = values(bytes, |byte| f32::from(byte) / 255.0)?;
        (data, FrameFormat::Png)
    } else if let Ok(floats) = array.cast::<PyArray3<f32>>() {
        let data = values(floats, |value| value)?;
        in_range(name, &data)?;
        (data, FrameFormat::Exr)
    } else {
        return Err(PyTypeError::new_err(format!(
            "{name} is of dtype {}, expected uint8, or float32 from 0 to 1",
            array.dtype().typeobj().name()?
        )));
    };
    let frame = Frame {
        width,
        height,
        data,
    };
    Ok((frame, format))
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
