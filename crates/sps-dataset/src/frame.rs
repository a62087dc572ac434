/// One image of a surface: RGB, interleaved, row-major, f32.
///
/// Values are display-referred (sRGB-encoded) and nominally lie in `[0, 1]`; the value at row `y`,
/// column `x`, channel `c` is `data[(y * width + x) * 3 + c]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `height * width * 3` values.
    pub data: Vec<f32>,
}

/// One image of a surface in scene-linear light: RGB, interleaved, row-major, f32, laid out as a
/// [`Frame`] is. 1 is the display's white; highlights lie above it.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearFrame {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `height * width * 3` values.
    pub data: Vec<f32>,
}
