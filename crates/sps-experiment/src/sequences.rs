//! A source whose one view of a surface is a sequence of another source's views.

use sps_dataset::{
    Description, Frame, FrameKey, Origin, Property, RollAngle, Source, SourceError, Surface,
    TactileTable,
};

/// Frames of several views, one below the other, as one frame; it stands at angle 0.
pub(crate) struct Sequences<'a> {
    source: &'a dyn Source,
    views: Vec<usize>,
}

impl<'a> Sequences<'a> {
    pub(crate) fn new(source: &'a dyn Source, views: Vec<usize>) -> Self {
        Self { source, views }
    }
}

impl Source for Sequences<'_> {
    fn name(&self) -> &str {
        self.source.name()
    }

    fn origin(&self) -> Option<Origin> {
        self.source.origin()
    }

    fn surfaces(&self) -> &[Surface] {
        self.source.surfaces()
    }

    fn view_angles(&self) -> &[RollAngle] {
        &[RollAngle(0.0)]
    }

    fn tactile(&self) -> &TactileTable {
        self.source.tactile()
    }

    fn describe(&self, property: &Property) -> Description {
        self.source.describe(property)
    }

    fn frame(&self, surface: usize, view: usize) -> Result<Frame, SourceError> {
        self.frame_to_resize(surface, view, None)
    }

    fn frame_to_resize(
        &self,
        surface: usize,
        _: usize,
        shorter_side: Option<usize>,
    ) -> Result<Frame, SourceError> {
        let mut stack = Frame {
            width: 0,
            height: 0,
            data: Vec::new(),
        };
        for &view in &self.views {
            let frame = self.source.frame_to_resize(surface, view, shorter_side)?;
            stack.width = frame.width;
            stack.height += frame.height;
            stack.data.extend(frame.data);
        }
        Ok(stack)
    }

    fn frame_key(&self, surface: usize, _: usize) -> Result<FrameKey, SourceError> {
        let mut hasher = blake3::Hasher::new();
        for &view in &self.views {
            hasher.update(&self.source.frame_key(surface, view)?);
        }
        Ok(*hasher.finalize().as_bytes())
    }
}
