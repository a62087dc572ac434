//! Embeddings of windows of an image, from one pass through the network.

use sps_kernels::{WindowEmbeddings, Windows};

use super::Encoder;
use super::input::check_pixels;
use crate::error::{Error, Result};

impl Encoder {
    /// Embeds windows of one image from a single pass through the network, where [`Encoder::embed`]
    /// of each would be a pass of its own: what maps of an image are made of. The image is as
    /// [`Encoder::embed_pixels`] takes it, `(height, width, 3)`; `size` and `window` are heights and
    /// widths in pixels. The first window begins in the image's upper left corner, the others
    /// `stride` pixels further to the right and down, as long as they lie in the image as a whole.
    ///
    /// The embedding of a window has for each depth the mean of its feature map over the cells whose centres
    /// lie in it. A feature map of `n` rows cuts the image into `n` rows of one height, 32 pixels or 16
    /// where the network has such strides, and a cell's centre is that of its piece; so with columns.
    /// A window as large as the image has the embedding that [`Encoder::embed`] gives, up to rounding.
    /// That of a smaller one differs from the embedding of a photograph that ends where the window
    /// does: cells see beyond the window's edges, the window's place is rounded to whole cells, and
    /// the squeeze-and-excitation gates of an SE-ResNeXt see the whole image.
    ///
    /// The time is that of the pass, and for each window the same whatever its size. The embeddings
    /// are the same to the last bit however many threads there are.
    ///
    /// ```
    /// use sps_models::encoders::{Encoder, EncoderKind};
    ///
    /// let encoder = Encoder::seeded(EncoderKind::EfficientNetLiteBody, 0)?;
    /// let image = vec![0.5; 128 * 192 * 3];
    /// let windows = encoder.embed_windows(&image, [128, 192], [64, 64], 32)?;
    /// assert_eq!((windows.rows, windows.columns), (3, 5));
    /// assert_eq!(windows.embeddings.len(), 3 * 5 * encoder.width());
    /// assert_eq!(windows.centres[6], [64.0, 64.0]); // the second of the second row
    /// # Ok::<(), sps_models::Error>(())
    /// ```
    ///
    /// # Errors
    /// When the network is one of sequences; when the image does not fill its size or has a side below
    /// the network's least; when the window is larger than the image or smaller than a cell of the
    /// feature map, the stride is 0, or the embeddings take more than a gibibyte.
    pub fn embed_windows(
        &self,
        image: &[f32],
        size: [usize; 2],
        window: [usize; 2],
        stride: usize,
    ) -> Result<WindowEmbeddings> {
        let extents = check_pixels(&self.network, &[image], size)?;
        if self.network.sequences {
            let expected = "a network of images";
            return Err(Error::input("encoder", self.kind, expected));
        }
        let windows = Windows::new(size, window, stride)?;
        let image = [image];
        let sums = self.kernels.cell_sums(&self.of_pixels(&image, extents)?)?;
        Ok(windows.embed(&sums)?)
    }
}
