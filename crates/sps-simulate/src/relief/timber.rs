//! Wood.

use super::super::grid::Grid;
use super::super::numeric::{mix, smoothstep};
use super::{Builder, Layers, fractal};

/// Along the grain.
const GRAIN: f64 = std::f64::consts::FRAC_PI_2;

impl Builder<'_> {
    /// Growth rings cut lengthwise: a slow rise from early to late wood and a sharp fall, with
    /// fibres and open pores along the grain.
    pub(super) fn grained(&mut self) -> Layers {
        let n = self.n;
        let rings = self.count as f32;
        let (wander, spread) = self.along(0.16, 2.0, 4.0);
        let (fibre, streak) = self.along(0.0035, 0.4, 26.0);
        let (pore, figure) = self.along(0.004, 0.9, 16.0);
        let cathedral = mix(0.5, 2.2, self.stream.unit() as f32) * (1.2 - self.regularity);
        let open = mix(1.6, 3.2, self.stream.unit() as f32);
        let contrast = mix(0.35, 0.75, self.stream.unit() as f32);
        let mut layers = Layers {
            height: Grid::filled(n, 0.0),
            tone: Grid::filled(n, 0.0),
            polish: Grid::filled(n, 1.0),
        };
        for at in 0..n * n {
            let u = ((at % n) as f32 + 0.5) / n as f32;
            let place = u * rings
                + cathedral * (wander.data()[at] + 0.35 * spread.data()[at])
                + 0.05 * figure.data()[at];
            let phase = place - place.floor();
            let late = smoothstep(0.25, 0.93, phase) * (1.0 - smoothstep(0.93, 1.0, phase));
            let early = 1.0 - smoothstep(0.0, 0.45, phase);
            let pit = smoothstep(open - 0.8 * early, open + 0.7, pore.data()[at]);
            layers.height.data_mut()[at] = 0.5 * late + 0.25 * fibre.data()[at] - 1.6 * pit;
            layers.tone.data_mut()[at] =
                0.82 - contrast * late + 0.035 * fibre.data()[at] + 0.04 * streak.data()[at]
                    - 0.35 * pit;
            layers.polish.data_mut()[at] = 1.0 - 0.7 * pit;
        }
        layers
    }

    fn along(&mut self, length: f64, hurst: f64, stretch: f64) -> (Grid, Grid) {
        let fractal = fractal::Fractal {
            length,
            hurst,
            stretch,
            direction: GRAIN,
        };
        fractal::pair(self.n, fractal, self.stream)
    }
}
