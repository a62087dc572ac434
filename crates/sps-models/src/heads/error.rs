/// Why a head could not be configured, trained, stored or used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HeadError {
    /// A value of the configuration is out of its range.
    #[error("head configuration: {key} is {found}, expected {expected}")]
    Config {
        /// The key.
        key: &'static str,
        /// Its value.
        found: String,
        /// What it may be.
        expected: &'static str,
    },
    /// A parameter received no gradient: the model and its losses do not fit together.
    #[error("parameter {name} has no gradient")]
    NoGradient {
        /// The parameter.
        name: String,
    },
    /// The observer has stopped the training.
    #[error("the training was stopped")]
    Stopped,
    /// Embeddings that the heads were not trained for.
    #[error("embeddings for prediction: found {found}, expected {expected}")]
    Embeddings {
        /// What they are.
        found: String,
        /// What the heads take.
        expected: String,
    },
    /// A file that does not hold trained heads.
    #[error("{file}: {what}: found {found}, expected {expected}")]
    Format {
        /// The file.
        file: String,
        /// The part of the file: a tensor's name, or the metadata.
        what: String,
        /// What it is.
        found: String,
        /// What it must be.
        expected: String,
    },
}
