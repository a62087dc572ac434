//! Wood.

use super::super::numeric::{mix, smoothstep};
use super::{Builder, Fractal, Layers};

impl Builder<'_> {
    /// Growth rings cut lengthwise: a slow rise from early to late wood and a sharp fall, with
    /// fibres and open pores along the grain.
    pub(super) fn grained(&mut self) -> Layers {
        let rings = self.count as f32;
        let mut along = |length, hurst, stretch| {
            let fractal = Fractal::isotropic(length, hurst);
            self.fields(fractal.stretched(stretch, std::f64::consts::FRAC_PI_2))
        };
        let (wander, spread) = along(0.16, 2.0, 4.0);
        let (fibre, streak) = along(0.0035, 0.4, 26.0);
        let (pore, figure) = along(0.004, 0.9, 16.0);
        let cathedral = mix(0.5, 2.2, self.stream.unit() as f32) * (1.2 - self.regularity);
        let open = mix(1.6, 3.2, self.stream.unit() as f32);
        let contrast = mix(0.35, 0.75, self.stream.unit() as f32);
        Layers::of_texels(self.n, |at, u, _| {
            let wandered = cathedral * (wander[at] + 0.35 * spread[at]);
            let place = u * rings + wandered + 0.05 * figure[at];
            let phase = place - place.floor();
            let late = smoothstep(0.25, 0.93, phase) * (1.0 - smoothstep(0.93, 1.0, phase));
            let early = 1.0 - smoothstep(0.0, 0.45, phase);
            let pit = smoothstep(open - 0.8 * early, open + 0.7, pore[at]);
            let height = 0.5 * late + 0.25 * fibre[at] - 1.6 * pit;
            let tone = 0.82 - contrast * late + 0.035 * fibre[at] + 0.04 * streak[at] - 0.35 * pit;
            (height, tone, 1.0 - 0.7 * pit)
        })
    }
}
