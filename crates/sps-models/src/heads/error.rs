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
    /// The plan names something that the data does not have, or contradicts itself.
    #[error("training plan: {what}: found {found}, expected {expected}")]
    Plan {
        /// The part of the plan.
        what: String,
        /// What it says.
        found: String,
        /// What it may say.
        expected: String,
    },
    /// None of a rerun's training surfaces has a reading of the property.
    #[error("no training surface of rerun {rerun} has a reading of {property}")]
    NotMeasured {
        /// The property.
        property: String,
        /// The rerun's number.
        rerun: u64,
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
