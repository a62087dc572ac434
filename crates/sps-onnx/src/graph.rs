//! The network of a file, as rten reads and runs it.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use rayon::prelude::*;
use rten::{Dimension, Model, ModelOptions, NodeId, NodeInfo, RunOptions, ThreadPool, Value};
use rten_tensor::prelude::*;

use crate::error::ErrorKind;
use crate::limits;

pub(crate) struct Graph {
    model: Model,
    input: NodeId,
    /// Height and width of images, where the file has them fixed.
    size: Option<usize>,
    outputs: Vec<(String, NodeId)>,
    pool: Arc<ThreadPool>,
}

impl Graph {
    /// The network of a file, for the outputs of these names, or for all.
    pub(crate) fn load(bytes: &[u8], outputs: &[String]) -> Result<Self, ErrorKind> {
        limits::check(bytes).map_err(ErrorKind::Network)?;
        contained(|| {
            let model = ModelOptions::with_all_ops().load(bytes.to_vec());
            let model = model.map_err(|error| ErrorKind::Network(error.to_string()))?;
            let (input, size) = input(&model)?;
            Ok(Self {
                input,
                size,
                outputs: chosen(&model, outputs)?,
                pool: Arc::new(ThreadPool::with_num_threads(rayon::current_num_threads())),
                model,
            })
        })
    }

    pub(crate) fn size(&self) -> Option<usize> {
        self.size
    }

    /// The names of the outputs.
    pub(crate) fn outputs(&self) -> Vec<String> {
        self.outputs.iter().map(|(name, _)| name.clone()).collect()
    }

    /// What the network makes of so many images, each `(3, size, size)`: a vector for each output.
    pub(crate) fn each(
        &self,
        images: usize,
        size: usize,
        image: impl Fn(usize) -> Vec<f32> + Sync,
    ) -> Result<Vec<Vec<Vec<f32>>>, ErrorKind> {
        let each = || {
            let images = (0..images).into_par_iter();
            let run = images.map(|at| self.run(image(at), size));
            run.collect()
        };
        contained(|| self.pool.run(each))
    }

    fn run(&self, image: Vec<f32>, size: usize) -> Result<Vec<Vec<f32>>, ErrorKind> {
        let failed = |error: &dyn std::error::Error| ErrorKind::Network(error.to_string());
        let image = Value::from_shape([1, 3, size, size], image).map_err(|error| failed(&error))?;
        let ids: Vec<NodeId> = self.outputs.iter().map(|(_, id)| *id).collect();
        let options = RunOptions::default().with_thread_pool(Some(Arc::clone(&self.pool)));
        let inputs = vec![(self.input, image.into())];
        let values = self.model.run(inputs, &ids, Some(options));
        let values = values.map_err(|error| failed(&error))?.into_iter();
        let named = self.outputs.iter().zip(values);
        let pooled = named.map(|((name, _), value)| pooled(name, value));
        pooled.collect()
    }
}

/// The input of images, with their height and width where the file has them fixed.
fn input(model: &Model) -> Result<(NodeId, Option<usize>), ErrorKind> {
    let refused = |found: String| {
        let expected = "one, of shape (batch, 3, size, size)";
        ErrorKind::input("inputs of the file", found, expected)
    };
    let &[input] = model.input_ids() else {
        return Err(refused(model.input_ids().len().to_string()));
    };
    let shape = model.input_shape(0).unwrap_or_default();
    let fixed = shape.iter().map(|extent| match extent {
        Dimension::Fixed(extent) => Some(*extent),
        Dimension::Symbolic(_) => None,
    });
    match fixed.collect::<Vec<_>>()[..] {
        [None | Some(1), None | Some(3), height, width] if height == width => Ok((input, height)),
        [] => Ok((input, None)),
        _ => Err(refused(format!("one of shape {shape:?}"))),
    }
}

/// The outputs of these names, or all, with their names.
fn chosen(model: &Model, names: &[String]) -> Result<Vec<(String, NodeId)>, ErrorKind> {
    let named = |id: &NodeId| {
        let info = model.node_info(*id);
        let name = info.as_ref().and_then(NodeInfo::name);
        (name.unwrap_or_default().to_owned(), *id)
    };
    let all: Vec<(String, NodeId)> = model.output_ids().iter().map(named).collect();
    let wanted: Vec<&String> = match names {
        [] => all.iter().map(|(name, _)| name).collect(),
        names => names.iter().collect(),
    };
    let mut chosen: Vec<(String, NodeId)> = Vec::new();
    for name in wanted {
        match all.iter().find(|(other, _)| other == name) {
            Some(output) if !chosen.contains(output) => chosen.push(output.clone()),
            _ => {
                let all: Vec<&str> = all.iter().map(|(name, _)| name.as_str()).collect();
                let expected = format!("each once of {}", all.join(", "));
                return Err(ErrorKind::input("outputs", format!("`{name}`"), expected));
            }
        }
    }
    Ok(chosen)
}

/// An output of one image as a vector: averaged over tokens, or over places.
fn pooled(name: &str, value: Value) -> Result<Vec<f32>, ErrorKind> {
    let refused = |found: String| {
        let expected =
            "f32 of shape (1, width), (1, tokens, width) or (1, channels, height, width)";
        ErrorKind::input(format!("the output `{name}`"), found, expected)
    };
    let kind = value.dtype();
    let Some(tensor) = value.into_tensor::<f32>() else {
        return Err(refused(kind.to_string()));
    };
    let values = tensor.to_vec();
    let mean = |values: &mut dyn Iterator<Item = f32>, count: usize| {
        (values.map(f64::from).sum::<f64>() / count as f64) as f32
    };
    match *tensor.shape() {
        [1, _] => Ok(values),
        [1, tokens, width] if tokens > 0 => {
            let of = |at| mean(&mut values[at..].iter().step_by(width).copied(), tokens);
            Ok((0..width).map(of).collect())
        }
        [1, _, height, width] if height * width > 0 => {
            let maps = values.chunks_exact(height * width);
            let means = maps.map(|map| mean(&mut map.iter().copied(), map.len()));
            Ok(means.collect())
        }
        ref shape => Err(refused(format!("shape {shape:?}"))),
    }
}

/// What `work` gives; an error where it panics, as rten does on some files.
fn contained<T>(work: impl FnOnce() -> Result<T, ErrorKind>) -> Result<T, ErrorKind> {
    let text = |panic: Box<dyn Any + Send>| {
        let text = panic.downcast_ref::<String>().map(String::as_str);
        let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
        ErrorKind::Panicked(text.unwrap_or("a panic without words").to_owned())
    };
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| Err(text(panic)))
}
