//! Nothing but the features that its Cargo.toml asks for.
