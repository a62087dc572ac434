//! TensorBoard's event files: records of protocol buffers (tensorflow/core/util/event.proto), each
//! with the masked CRC-32C of its length and of its content.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::{Context, Result};
use sps_models::heads::{EpochLosses, TrainedHead};
use sps_models::training::{Epoch, Losses, TrainingStep};

use crate::files::create_folder;

/// A file of scalars that grows while training runs.
pub(crate) struct EventFile {
    file: File,
    pending: Vec<u8>,
    epochs: usize,
}

impl EventFile {
    /// A new file in `folder`, beside those of earlier runs.
    pub(crate) fn create(folder: &Path) -> Result<Self> {
        create_folder(folder)?;
        let now = seconds();
        let path = folder.join(format!("events.out.tfevents.{now:.6}.sps"));
        let file = OpenOptions::new().create(true).append(true).open(&path);
        let mut events = Self {
            file: file.with_context(|| format!("cannot write {}", path.display()))?,
            pending: Vec::new(),
            epochs: 0,
        };
        let mut version = Message::default();
        version.double(1, now);
        version.bytes(3, b"brain.Event:2");
        record(&mut events.pending, &version.0);
        events.flush()?;
        Ok(events)
    }

    /// What a step did; it reaches the file with the next [`EventFile::epochs`].
    pub(crate) fn step(&mut self, step: &TrainingStep) {
        let mut scalars = there("training", losses(&step.losses));
        scalars.push(("training/gradient-norm".into(), step.gradient_norm));
        scalars.push(("training/learning-rate".into(), step.learning_rate));
        self.scalars(step.number, &scalars);
    }

    /// What the epochs did that are not in the file yet.
    pub(crate) fn epochs(&mut self, history: &[Epoch]) -> Result<()> {
        for epoch in &history[self.epochs.min(history.len())..] {
            if let Some(validation) = &epoch.validation {
                self.scalars(epoch.steps, &there("validation", losses(validation)));
            }
        }
        self.epochs = history.len();
        self.flush()
    }

    /// What the epochs of a head's training did: the losses that it has, and the error on the part that
    /// stops it early.
    pub(crate) fn head(&mut self, head: &TrainedHead) -> Result<()> {
        // The first is that of the training mean.
        let errors = head.kept_epoch().and_then(|kept| kept.errors.get(1..));
        let errors = errors.unwrap_or_default();
        for (epoch, losses) in head.history().iter().enumerate() {
            let mut scalars = there("training", of_head(losses));
            let error = errors.get(epoch);
            scalars.extend(error.map(|&error| ("validation/estimation".to_owned(), error)));
            self.scalars(epoch + 1, &scalars);
        }
        self.flush()
    }

    fn scalars(&mut self, step: usize, scalars: &[(String, f64)]) {
        let mut summary = Message::default();
        for (tag, value) in scalars {
            let mut scalar = Message::default();
            scalar.bytes(1, tag.as_bytes());
            scalar.float(2, *value as f32);
            summary.bytes(1, &scalar.0);
        }
        let mut event = Message::default();
        event.double(1, seconds());
        event.integer(2, step as u64);
        event.bytes(5, &summary.0);
        record(&mut self.pending, &event.0);
    }

    fn flush(&mut self) -> Result<()> {
        let written = self.file.write_all(&self.pending);
        written.context("cannot write TensorBoard events")?;
        self.pending.clear();
        Ok(())
    }
}

type Named = (&'static str, f64);

/// The losses of a part that there are: one that is not used is 0.
fn there(part: &str, losses: impl IntoIterator<Item = Named>) -> Vec<(String, f64)> {
    let losses = losses.into_iter().filter(|(_, value)| *value != 0.0);
    let named = losses.map(|(name, value)| (format!("{part}/{name}"), value));
    named.collect()
}

fn losses(losses: &Losses) -> [Named; 8] {
    [
        ("loss", losses.total()),
        ("squared-error", losses.values),
        ("cross-entropy", losses.classes),
        ("accuracy", losses.accuracy),
        ("kept", losses.kept),
        ("embedding", losses.embedding),
        ("generator", losses.generator),
        ("discriminator", losses.discriminator),
    ]
}

fn of_head(losses: &EpochLosses) -> [Named; 5] {
    [
        ("estimation", losses.estimation),
        ("embedding", losses.embedding),
        ("generator", losses.generator),
        ("discriminator", losses.discriminator),
        ("classification", losses.classification),
    ]
}

fn seconds() -> f64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0.0, |since| since.as_secs_f64())
}

/// Length, its checksum, content, its checksum.
fn record(to: &mut Vec<u8>, content: &[u8]) {
    let length = (content.len() as u64).to_le_bytes();
    to.extend(length);
    to.extend(masked(&length).to_le_bytes());
    to.extend(content);
    to.extend(masked(content).to_le_bytes());
}

fn masked(bytes: &[u8]) -> u32 {
    crc32c::crc32c(bytes)
        .rotate_right(15)
        .wrapping_add(0xa282_ead8)
}

#[derive(Default)]
struct Message(Vec<u8>);

impl Message {
    fn double(&mut self, field: u64, value: f64) {
        self.varint(field << 3 | 1);
        self.0.extend(value.to_le_bytes());
    }

    fn float(&mut self, field: u64, value: f32) {
        self.varint(field << 3 | 5);
        self.0.extend(value.to_le_bytes());
    }

    fn integer(&mut self, field: u64, value: u64) {
        self.varint(field << 3);
        self.varint(value);
    }

    fn bytes(&mut self, field: u64, value: &[u8]) {
        self.varint(field << 3 | 2);
        self.varint(value.len() as u64);
        self.0.extend(value);
    }

    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The bytes are those of TensorFlow's own writer for the same record, as its
    /// `record_writer_test` and any file that it wrote begin.
    #[test]
    fn a_record_has_the_form_that_tensorboard_reads() {
        let mut version = Message::default();
        version.double(1, 0.0);
        version.bytes(3, b"brain.Event:2");
        assert_eq!(
            version.0,
            b"\x09\0\0\0\0\0\0\0\0\x1a\x0dbrain.Event:2".as_slice()
        );
        let mut file = Vec::new();
        record(&mut file, &version.0);
        assert_eq!(file.len(), 8 + 4 + version.0.len() + 4);
        // The masked checksum of a length of 24, as in every event file.
        assert_eq!(file[..8], 24u64.to_le_bytes());
        assert_eq!(file[8..12], [0xa3, 0x7f, 0x4b, 0x22]);
    }

    #[test]
    fn numbers_of_several_bytes_are_written_low_first() {
        let mut message = Message::default();
        message.integer(2, 300);
        assert_eq!(message.0, [0x10, 0xac, 0x02]);
    }
}
