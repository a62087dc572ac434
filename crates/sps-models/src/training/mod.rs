//! Training an encoder end to end, on images with values or classes to tell.
//!
//! The heads of [`crate::heads`] learn from embeddings that stay as they are. This module changes
//! the encoder itself: [`Trainer`] puts linear layers or the paper's heads on its embedding
//! ([`TrainingObjective`]) and trains both, on images that are read and varied while the last ones
//! are trained on.
//!
//! ```
//! use sps_models::encoders::{Encoder, EncoderKind};
//! use sps_models::training::{Classes, Image, ImageSource, Parts, Targets, Trainer, TrainingConfig};
//!
//! /// Black and white squares.
//! struct Squares;
//!
//! impl ImageSource for Squares {
//!     fn image(&self, index: usize) -> Result<Image, Box<dyn std::error::Error + Send + Sync>> {
//!         Ok(Image::new(32, 32, vec![(index % 2) as f32; 32 * 32 * 3])?)
//!     }
//! }
//!
//! let start = Encoder::seeded(EncoderKind::EfficientNetLiteBody, 0)?;
//! let targets = Targets {
//!     classes: Some(Classes { of_image: vec![0, 1, 0, 1], count: 2 }),
//!     ..Targets::default()
//! };
//! let parts = Parts { training: vec![0, 1, 2, 3], validation: vec![] };
//! let config = TrainingConfig { epochs: 1, validation: 0.0, ..TrainingConfig::default() };
//! let mut trainer = Trainer::new(&start, targets, parts, config, 0)?;
//! while !trainer.is_finished() {
//!     trainer.epoch(&Squares, |step| println!("{} of {}", step.number, step.of))?;
//! }
//! let trained = trainer.into_encoder()?;
//! # Ok::<(), sps_models::Error>(())
//! ```

mod batches;
mod config;
mod image;
mod kept;
mod objective;
mod state;
mod targets;
#[cfg(test)]
mod tests;
mod trainer;

pub use batches::ImageSource;
pub use config::{Augmentation, TrainingConfig, TrainingObjective};
pub use image::Image;
pub use kept::Kept;
pub use objective::Losses;
pub use targets::{Classes, Targets};
pub use trainer::{Epoch, Parts, Trainer, TrainingStep};
