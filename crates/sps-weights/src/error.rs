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
    /// A tensor is missing or has no place in the network, or its shape, type or values are not what they
    /// must be.
    #[error("tensor {tensor:?} {what}")]
    Tensor {
        /// The tensor's name.
        tensor: String,
        /// What is wrong with it.
        what: String,
    },
}

impl WeightsErrorKind {
    pub(crate) fn format(message: impl fmt::Display) -> Self {
        Self::Format(message.to_string())
    }

    /// Takes a tensor's name, and what is wrong with the tensor.
    pub fn tensor(name: &str, what: impl fmt::Display) -> Self {
        Self::Tensor {
            tensor: name.to_owned(),
            what: what.to_string(),
        }
    }
}
