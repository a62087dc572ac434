use std::fmt;

/// Why a set of weights was refused, and where it came from.
#[derive(Debug, thiserror::Error)]
#[error("{origin}: {kind}")]
pub struct WeightsError {
    origin: String,
    kind: WeightsErrorKind,
}

impl WeightsError {
    /// Takes a file, or what else the weights came from, and what is wrong.
    pub fn new(origin: impl fmt::Display, kind: WeightsErrorKind) -> Self {
        Self {
            origin: origin.to_string(),
            kind,
        }
    }

    /// The file, or what else the weights came from.
    pub fn origin(&self) -> &str {
        &self.origin
    }

    /// What is wrong with them.
    pub fn kind(&self) -> &WeightsErrorKind {
        &self.kind
    }
}

/// What is wrong with a set of weights.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WeightsErrorKind {
    /// The file cannot be read.
    #[error("cannot be read: {0}")]
    Io(#[from] std::io::Error),
    /// The bytes are not a weights file of a known format.
    #[error("{0}")]
    Format(String),
    /// A pickle in a PyTorch file does what no dictionary of tensors needs.
    #[error("byte {offset} of the pickle: {found}; only a dictionary of tensors is read")]
    Pickle {
        /// Where the instruction begins.
        offset: usize,
        /// The opcode, global or value that was found.
        found: String,
    },
    /// The network has a tensor that the weights lack.
    #[error("tensor {tensor:?}{} is missing", of_shape(expected.as_ref()))]
    Missing {
        /// The tensor's name.
        tensor: String,
        /// The shape the network needs, where a network asks.
        expected: Option<Vec<usize>>,
    },
    /// The weights have a tensor that the network lacks.
    #[error("tensor {tensor:?} of shape {found:?} has no place in {network}")]
    Extra {
        /// The tensor's name.
        tensor: String,
        /// Its shape.
        found: Vec<usize>,
        /// The network's name.
        network: String,
    },
    /// A tensor has another shape than the network's.
    #[error("tensor {tensor:?} has shape {found:?}, expected {expected:?}")]
    Shape {
        /// The tensor's name.
        tensor: String,
        /// The shape in the weights.
        found: Vec<usize>,
        /// The shape the network needs.
        expected: Vec<usize>,
    },
    /// A tensor holds a value that is not a finite f32.
    #[error("tensor {tensor:?} holds {found} at flat index {index}, expected finite f32 values")]
    NotFinite {
        /// The tensor's name.
        tensor: String,
        /// The first such position, row-major.
        index: usize,
        /// The value, as f32.
        found: f32,
    },
    /// A tensor's elements are of a type that cannot become f32.
    #[error("tensor {tensor:?} has elements of type {found}, expected f16, bf16, f32 or f64")]
    ElementType {
        /// The tensor's name.
        tensor: String,
        /// The type in the file.
        found: String,
    },
}

impl WeightsErrorKind {
    pub(crate) fn format(message: impl fmt::Display) -> Self {
        Self::Format(message.to_string())
    }
}

fn of_shape(shape: Option<&Vec<usize>>) -> String {
    shape.map_or_else(String::new, |shape| format!(" of shape {shape:?}"))
}
