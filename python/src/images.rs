//! Images as Python hands them over: arrays of pixels, or paths.

use std::iter;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use numpy::ndarray::ArrayView3;
use numpy::{
    Element, PyArray3, PyArrayDescrMethods, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use rayon::prelude::*;
use sps_base::files::write_file;
use sps_dataset::{DecodeSettings, Extent, Frame, FrameFormat};
use sps_estimator::{photographs_in, read_photograph};
use sps_models::encoders::EncoderKind;

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
pub(crate) type Images<'py> = Box<dyn Iterator<Item = Result<Image>> + 'py>;

/// The images that a path or an object stands for. A folder: those in it, by name. Another path, or an array of up to
/// three axes: one image. All else is iterated. `of` begins their names in errors.
pub(crate) fn images<'py>(of: String, images: &Bound<'py, PyAny>) -> Result<Images<'py>> {
    let folder = images.extract::<PathBuf>().ok();
    if let Some(folder) = folder.filter(|path| path.is_dir()) {
        let image = move |path| Image {
            name: format!("{of}the image"),
            content: Content::File(path),
        };
        let inside = photographs_in(&folder)?.into_iter();
        return Ok(Box::new(inside.map(image).map(Ok)));
    }
    if is_one(images) {
        let image = Image::new(format!("{of}the image"), images);
        return Ok(Box::new(iter::once(image)));
    }
    let several = images.try_iter()?.enumerate();
    let image = move |(index, image): (usize, PyResult<Bound<'_, PyAny>>)| {
        Image::new(format!("{of}image {index}"), &image?)
    };
    Ok(Box::new(several.map(image)))
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
    let numpy = image.py().import("numpy")?;
    let mut array = numpy.call_method1(function, (image,))?;
    if let Ok((3, _, columns)) = array.getattr("shape")?.extract::<(usize, usize, usize)>()
        && columns != 3
    {
        array = array.call_method1("transpose", (1, 2, 0))?;
    }
    Ok(Some(array.cast_into()?))
}

/// The embeddings of images, row-major, a few at a time by `embed`.
pub(crate) fn embed_each(
    py: Python<'_>,
    images: &mut impl Iterator<Item = Result<Image>>,
    mut embed: impl FnMut(Vec<Image>) -> Result<Vec<f32>> + Send,
) -> Result<Vec<f32>> {
    let at_once = IMAGES_PER_THREAD * rayon::current_num_threads();
    let mut embeddings = Vec::new();
    loop {
        py.check_signals()?;
        let some = images.by_ref().take(at_once);
        let some: Vec<Image> = some.collect::<Result<_>>()?;
        if some.is_empty() {
            return Ok(embeddings);
        }
        embeddings.extend(py.detach(|| embed(some))?);
    }
}

/// The pixels of images, each by `frame`, on all threads.
pub(crate) fn frames(
    images: Vec<Image>,
    frame: impl Fn(Image) -> Result<Frame> + Send + Sync,
) -> Result<Vec<Frame>> {
    let frames: Vec<Result<Frame>> = images.into_par_iter().map(frame).collect();
    // Of several failures the first, whichever thread was faster.
    frames.into_iter().collect()
}

/// Writes a file in one step.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    write_file(path, bytes).with_context(|| format!("{}: cannot be written", path.display()))
}

impl Image {
    pub(crate) fn new(name: String, image: &Bound<'_, PyAny>) -> Result<Self> {
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
    pub(crate) fn into_file(self, stem: &Path) -> Result<PathBuf> {
        let (frame, format) = match self.content {
            Content::File(path) => return Ok(path),
            Content::Pixels(frame, format) => (frame, format),
        };
        let bytes = format.encode(&frame).context(self.name)?;
        let path = stem.with_extension(format.extension());
        write(&path, &bytes)?;
        Ok(path)
    }

    /// The size that it comes in.
    pub(crate) fn extent(&self) -> Result<Extent> {
        match &self.content {
            Content::Pixels(frame, _) => Ok(frame.extent()),
            Content::File(path) => Ok(photograph(path, None)?.extent()),
        }
    }

    /// The image as a network takes it, its shorter side brought to so many pixels where any are given.
    pub(crate) fn resized(self, shorter: Option<usize>, network: EncoderKind) -> Result<Frame> {
        self.frame(
            network.min_size(),
            |path| photograph(path, shorter),
            |frame| match shorter {
                Some(shorter) => Ok(frame.resized(shorter)?.into_owned()),
                None => Ok(frame),
            },
        )
    }

    /// The image as an encoder takes it, with sides of at least so many pixels: of a file as `read`
    /// reads it, of an array as `take` takes it.
    pub(crate) fn frame(
        self,
        least_side: usize,
        read: impl FnOnce(&Path) -> Result<Frame>,
        take: impl FnOnce(Frame) -> Result<Frame>,
    ) -> Result<Frame> {
        let frame = match self.content {
            Content::Pixels(frame, _) => take(frame)?,
            Content::File(path) => read(&path)?,
        };
        let Frame { width, height, .. } = frame;
        ensure!(
            height.min(width) >= least_side,
            "{} has {height} x {width} pixels, expected sides of at least {least_side}",
            self.name
        );
        Ok(frame)
    }
}

fn photograph(path: &Path, shorter: Option<usize>) -> Result<Frame> {
    Ok(read_photograph(path, &DecodeSettings::default(), shorter)?)
}

/// A copy of the array's pixels: bytes as the readers of image files take them, floats as they are.
fn pixels(name: &str, array: &Bound<'_, PyUntypedArray>) -> Result<(Frame, FrameFormat)> {
    let &[height, width, 3] = array.shape() else {
        let found = array.shape();
        bail!("{name} is of shape {found:?}, expected (height, width, 3)");
    };
    let (data, format) = if let Ok(bytes) = array.cast::<PyArray3<u8>>() {
        let data = values(bytes, |byte| f32::from(byte) / 255.0)?;
        (data, FrameFormat::Png)
    } else if let Ok(floats) = array.cast::<PyArray3<f32>>() {
        let data = values(floats, |value| value)?;
        in_range(name, &data)?;
        (data, FrameFormat::Exr)
    } else {
        let found = array.dtype().typeobj().name()?;
        let problem = format!("{name} is of dtype {found}, expected uint8, or float32 from 0 to 1");
        return Err(PyTypeError::new_err(problem).into());
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

fn in_range(name: &str, values: &[f32]) -> Result<()> {
    let fits = |value: &f32| (0.0..=1.0).contains(value);
    // Through to the end, so that several are compared at once; only a refusal looks for the first.
    if values.iter().fold(true, |all, value| all & fits(value)) {
        return Ok(());
    }
    match values.iter().find(|value| !fits(value)) {
        None => Ok(()),
        Some(found) => bail!("{name} holds {found}, expected values from 0 to 1"),
    }
}
