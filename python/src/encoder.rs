//! Networks that turn images into embeddings.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sps_dataset::Frame;
use sps_experiment::config::Setting;
use sps_models::candle::{Device, Tensor};
use sps_models::encoders::{self, Depths, EncoderKind, Precision};
use sps_models::weights::Weights;

use crate::errors::Raises;
use crate::images::{self, Image, embed_each, frames, write};
use crate::settings::python;

/// In place of the path of a weights file.
const BUILT_IN: &str = "built-in";

/// A network with its weights, ready to embed images.
///
/// `name` is one of `list_encoders()`; `weights` the path of a safetensors or PyTorch file, or "built-in"
/// for those of efficientnet-lite-body, which come with the package; `precision` is f32, bf16x2 or bf16, which are faster
/// on some processors, or int8 where the file holds scales for it, as one that `calibrated`
/// wrote does, and that of a model trained with `encoder.precision = "int8"`; `depths` the feature maps whose
/// means make an embedding, side by side: "all", "last", or a list of their names (`blocks` has them).
///
/// Raises OSError where the file cannot be read, ValueError where it does not fit the network or a
/// name is unknown.
#[pyclass(module = "sps", frozen)]
pub(crate) struct Encoder {
    network: encoders::Encoder,
    /// As it was asked for.
    weights: PathBuf,
}

#[pymethods]
impl Encoder {
    #[new]
    #[pyo3(
        signature = (name, weights, precision = "f32", depths = Words::Word("all".to_owned())),
        text_signature = "(name, weights, precision='f32', depths='all')"
    )]
    fn new(
        py: Python<'_>,
        name: &str,
        weights: PathBuf,
        precision: &str,
        depths: Words,
    ) -> Raises<Self> {
        let depths = match depths {
            Words::Word(word) => serde_json::from_value(word.into()).context("depths")?,
            Words::Names(names) => Depths::Named(names),
        };
        let network = py.detach(|| network(name, &weights, precision, &depths))?;
        Ok(Self { network, weights })
    }

    /// The network's name.
    #[getter]
    fn name(&self) -> &'static str {
        self.network.kind().name()
    }

    /// The length of an embedding.
    #[getter]
    fn width(&self) -> usize {
        self.network.width()
    }

    /// The blocks that an embedding is made of, in their order: the name of each depth, and its width.
    #[getter]
    fn blocks(&self) -> Vec<(String, usize)> {
        let blocks = self.network.blocks().into_iter();
        blocks.map(|block| (block.name, block.width)).collect()
    }

    /// What the network computes in: f32, bf16 or int8.
    #[getter]
    fn precision(&self) -> &'static str {
        self.network.precision().name()
    }

    /// Embeds images: float32 of shape (images, width), in the order given.
    ///
    /// An image is an array of shape (height, width, 3), display-referred RGB, uint8 or float32 from
    /// 0 to 1, an image of PIL, a tensor of torch (also of shape (3, height, width)), or the path of a
    /// PNG, JPEG or EXR. `images` is one, or any iterable of them, of any sizes, or the path of a folder,
    /// whose images are taken by name; also an array of shape (images, height, width, 3). Images keep their size. An embedding
    /// is the same to the last bit whatever is embedded beside it and however many threads there are.
    ///
    /// Raises TypeError for other dtypes and things, ValueError for other shapes and values and for
    /// broken files, OSError where a file cannot be read.
    fn transform<'py>(
        &self,
        py: Python<'py>,
        images: &Bound<'py, PyAny>,
    ) -> Raises<Bound<'py, PyArray2<f32>>> {
        let mut images = images::images(String::new(), images)?;
        let embeddings = embed_each(py, &mut images, |some| self.embed_some(some))?;
        let shape = [embeddings.len() / self.width(), self.width()];
        Ok(PyArray1::from_vec(py, embeddings).reshape(shape)?)
    }

    /// The same network in int8: in a fraction of the time where the processor has AVX512-VNNI, with
    /// embeddings that move by some hundredths of their norm.
    ///
    /// Its feature maps are scaled by `images`, as `transform` takes them: of the kind that it is to embed, a few
    /// dozen are enough. Its weights are written to `file` with the scales, from which
    /// `Encoder(name, file, "int8")` reads them.
    ///
    /// Raises what `transform` raises, ValueError where there is no image, and OSError where the file cannot
    /// be written.
    fn calibrated(&self, py: Python<'_>, images: &Bound<'_, PyAny>, file: PathBuf) -> Raises<Self> {
        let images = images::images(String::new(), images)?;
        let images: Vec<Image> = images.collect::<Result<_>>()?;
        py.detach(|| {
            let frames = self.frames(images)?;
            let network = calibrated(&self.network, frames)?;
            write(&file, &network.weights().to_bytes()?)?;
            Ok(Self {
                network,
                weights: file,
            })
        })
    }

    /// What a copy is made of, such as another process's.
    fn __getnewargs__<'py>(&self, py: Python<'py>) -> Raises<Arguments<'py>> {
        let depths = python(py, &self.depths())?;
        Ok((self.name(), self.weights.clone(), self.precision(), depths))
    }

    fn __repr__(&self) -> String {
        let (name, precision) = (self.name(), self.precision());
        let (weights, depths) = (self.weights.display(), self.depths());
        format!("Encoder({name:?}, \"{weights}\", precision={precision:?}, depths={depths})")
    }
}

/// The networks that Encoder takes: a dictionary for each, with its name, its depths from shallow to deep,
/// and whether its weights are built-in.
#[pyfunction]
pub(crate) fn list_encoders(py: Python<'_>) -> PyResult<Vec<Bound<'_, PyDict>>> {
    let kinds = EncoderKind::ALL.into_iter();
    let of_images = kinds.filter(|kind| !kind.takes_sequences());
    let listed = of_images.map(|kind| {
        let depths = kind.depths().into_iter().map(|block| block.name);
        let listed = PyDict::new(py);
        listed.set_item("name", kind.name())?;
        listed.set_item("depths", depths.collect::<Vec<_>>())?;
        listed.set_item("built_in", kind.check_built_in().is_ok())?;
        Ok(listed)
    });
    listed.collect()
}

/// Depths as Python gives them; anything else is a TypeError.
#[derive(FromPyObject)]
pub(crate) enum Words {
    Word(String),
    Names(Vec<String>),
}

/// What Encoder is called with.
type Arguments<'py> = (&'static str, PathBuf, &'static str, Bound<'py, PyAny>);

impl Encoder {
    /// The network alone.
    pub(crate) fn network(&self) -> &encoders::Encoder {
        &self.network
    }

    /// What a config says of it.
    pub(crate) fn settings(&self) -> Vec<Setting> {
        let weights = self.weights.display().to_string();
        vec![
            Setting::new("encoder.name", self.name()),
            Setting::new("encoder.weights", weights),
            Setting::new("encoder.precision", self.precision()),
            Setting::new("encoder.depths", self.depths()),
        ]
    }

    /// The depths as a config has them.
    fn depths(&self) -> toml::Value {
        match self.network.depths() {
            Depths::Named(names) => names.clone().into(),
            word => word.to_string().into(),
        }
    }

    /// The pixels of images that are large enough.
    fn frames(&self, images: Vec<Image>) -> Result<Vec<Frame>> {
        frames(images, |image| image.resized(None, self.network.kind()))
    }

    fn embed_some(&self, images: Vec<Image>) -> Result<Vec<f32>> {
        let frames = self.frames(images)?;
        let mut embeddings = Vec::with_capacity(frames.len() * self.width());
        for alike in frames.chunk_by(|one, next| size(one) == size(next)) {
            let pixels: Vec<&[f32]> = alike.iter().map(|frame| &frame.data[..]).collect();
            embeddings.extend(self.network.embed_pixels(&pixels, size(&alike[0]))?);
        }
        ensure!(
            embeddings.iter().all(|value| value.is_finite()),
            "{} gave an embedding that is not finite",
            self.name()
        );
        Ok(embeddings)
    }
}

/// The network in int8, its maps scaled by images.
fn calibrated(
    network: &encoders::Encoder,
    images: Vec<Frame>,
) -> sps_models::Result<encoders::Encoder> {
    let tensor = |frame: Frame| -> sps_models::Result<Tensor> {
        let shape = (1, frame.height, frame.width, 3);
        Ok(Tensor::from_vec(frame.data, shape, &Device::Cpu)?.permute((0, 3, 1, 2))?)
    };
    let tensors: Vec<Tensor> = images.into_iter().map(tensor).collect::<Result<_, _>>()?;
    let tensors: Vec<&Tensor> = tensors.iter().collect();
    let network = network.clone().calibrated(&tensors)?;
    network.with_precision(Precision::Int8)
}

fn size(frame: &Frame) -> [usize; 2] {
    [frame.height, frame.width]
}

/// The encoder that comes with the package, at all depths.
pub(crate) fn built_in() -> sps_models::Result<encoders::Encoder> {
    encoders::Encoder::built_in(EncoderKind::EfficientNetLiteBody)?.with_depths(&Depths::All)
}

fn network(
    name: &str,
    weights: &Path,
    precision: &str,
    depths: &Depths,
) -> Result<encoders::Encoder> {
    let kind: EncoderKind = name.parse()?;
    ensure!(
        !kind.takes_sequences(),
        "{kind} embeds sequences of images, expected a network of images"
    );
    let precision: Precision = precision.parse()?;
    let network = if weights == Path::new(BUILT_IN) {
        encoders::Encoder::built_in(kind)?
    } else {
        encoders::Encoder::new(kind, Weights::read(weights)?)?
    };
    Ok(network.with_depths(depths)?.with_precision(precision)?)
}
