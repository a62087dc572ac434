//! Between linear light and display-referred values.

/// The sRGB transfer function, linear to display-referred, for light in `[0, 1]`.
pub(super) fn srgb_encode(light: f32) -> f32 {
    if light <= 0.003_130_8 {
        light * 12.92
    } else {
        1.055 * light.powf(1.0 / 2.4) - 0.055
    }
}

/// Its inverse.
#[cfg(any(feature = "exr", test))]
pub(super) fn srgb_decode(value: f32) -> f32 {
    if value <= 0.040_45 {
        value / 12.92
    } else {
        ((value + 0.055) / 1.055).powf(2.4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of the standard's formula, computed with 50 digits.
    #[test]
    fn srgb_is_the_standards() {
        let values = [
            (0.0, 0.0),
            (0.001, 0.012_92),
            (0.003_130_8, 0.040_449_936),
            (0.01, 0.099_852_93),
            (0.18, 0.461_356_13),
            (0.5, 0.735_357),
            (1.0, 1.0),
        ];
        for (light, value) in values {
            assert!((srgb_encode(light) - value).abs() < 2e-7, "{light}");
            assert!((srgb_decode(value) - light).abs() < 4e-7, "{value}");
        }
    }
}
