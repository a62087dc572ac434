//! The instrument's fixed sizes and directions.

/// Side of one period of a surface, in mm; surfaces repeat beyond it.
pub(crate) const TILE_MM: f64 = 32.0;

/// Side of the square of the surface that a view at nadir shows, in mm.
pub(crate) const FIELD_MM: f64 = 24.0;

/// Distance from the camera's centre of projection to the roll axis, in mm.
pub(crate) const CAMERA_MM: f64 = 400.0;

/// Zenith angle of the soft light, in degrees.
pub(crate) const LIGHT_ZENITH_DEG: f64 = 56.0;

/// Azimuth of the soft light from the direction across the roll axis, in degrees.
pub(crate) const LIGHT_AZIMUTH_DEG: f64 = 6.0;

/// Texels across the grid that a view of `size` pixels is sampled from: bilinear interpolation on
/// it has the footprint of a pixel at nadir, and still covers the wider footprint at 45 degrees.
pub(crate) fn sampling_grid(size: usize) -> usize {
    (size as f64 * TILE_MM / FIELD_MM * std::f64::consts::SQRT_2).ceil() as usize
}

/// Texels across the map that a surface is built on for views of `size` pixels: a power of two
/// that holds the sampling grid and resolves `count` repeats of its structure. Small views share
/// one map, so that they show the same surface.
pub(crate) fn map_size(size: usize, count: usize) -> usize {
    let least = sampling_grid(size).max(3 * count);
    least.next_power_of_two().clamp(256, 1024)
}
