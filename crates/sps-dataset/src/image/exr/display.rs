//! Linear light to display-referred values.

use half::f16;
use half::slice::HalfFloatSliceExt;

use super::super::srgb::srgb_encode;
use super::super::{DecodeSettings, FrameErrorKind, LightCounts, NonFinite};

/// From here on a picture has more samples than there are halves between 0 and 1, so that it is
/// quicker to encode each of those once.
const WORTH_A_TABLE: usize = 1 << 15;

/// Turns linear light into display-referred values in place: each sample is multiplied by
/// `2^exposure_stops`, clipped to `[0, 1]` and encoded as sRGB (IEC 61966-2-1). NaN becomes 0;
/// infinities clip like any other value.
///
/// `halves` says that every sample was a half; it changes no value.
pub(super) fn to_display(
    light: &mut [f32],
    halves: bool,
    settings: &DecodeSettings,
) -> Result<LightCounts, FrameErrorKind> {
    let gain = settings.exposure_stops.exp2();
    let counts = count(light, gain);
    if settings.non_finite == NonFinite::Reject && counts.nan + counts.infinite > 0 {
        let LightCounts { nan, infinite, .. } = counts;
        let found = format!("{nan} NaN and {infinite} infinite samples");
        let text = format!("has {found}, and the policy is to reject them");
        return Err(FrameErrorKind::Invalid(text));
    }
    if halves && light.len() >= WORTH_A_TABLE {
        show_halves(light, gain);
    } else {
        for sample in light {
            *sample = show(*sample, gain);
        }
    }
    Ok(counts)
}

fn count(light: &[f32], gain: f32) -> LightCounts {
    let mut counts = LightCounts::default();
    for &sample in light {
        counts.nan += usize::from(sample.is_nan());
        counts.infinite += usize::from(sample.is_infinite());
        counts.negative += usize::from(sample < 0.0 && sample.is_finite());
        counts.clipped += usize::from(sample * gain > 1.0 && sample.is_finite());
    }
    counts
}

fn show(light: f32, gain: f32) -> f32 {
    let exposed = light * gain;
    // Also where light is infinite and the gain nothing.
    if exposed.is_nan() {
        0.0
    } else {
        srgb_encode(exposed.clamp(0.0, 1.0))
    }
}

fn show_halves(light: &mut [f32], gain: f32) {
    let all = (0..=u16::MAX).map(|bits| show(f16::from_bits(bits).to_f32(), gain));
    let shown: Vec<f32> = all.collect();
    let mut halves = [f16::ZERO; 1024];
    for samples in light.chunks_mut(halves.len()) {
        let halves = &mut halves[..samples.len()];
        halves.convert_from_f32_slice(samples);
        for (sample, half) in samples.iter_mut().zip(halves) {
            *sample = shown[usize::from(half.to_bits())];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_changes_no_value_of_any_half() {
        let all = (0..=u16::MAX).map(|bits| f16::from_bits(bits).to_f32());
        let all: Vec<f32> = all.collect();
        for exposure_stops in [0.0, -3.5, 7.0, f32::INFINITY, f32::NEG_INFINITY, f32::NAN] {
            let settings = DecodeSettings {
                exposure_stops,
                ..DecodeSettings::default()
            };
            let (mut direct, mut by_table) = (all.clone(), all.clone());
            let counts = to_display(&mut direct, false, &settings).unwrap();
            assert_eq!(to_display(&mut by_table, true, &settings).unwrap(), counts);
            assert_eq!(direct, by_table, "{exposure_stops} stops");
            let shown = direct.iter().all(|value| (0.0..=1.0).contains(value));
            assert!(shown, "{exposure_stops} stops");
        }
    }
}
