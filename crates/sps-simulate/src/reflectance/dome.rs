//! The diffuse dome around the camera's axis.

/// Radiance of the dome as a polynomial in the cosine `c` from the camera's axis, over the whole
/// sphere: bright above, dim at the stage below. A polynomial of degree two has closed-form
/// irradiance and smooth integrals against every lobe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Dome {
    constant: f32,
    linear: f32,
    square: f32,
}

/// The instrument's dome: 1 straight above, 0.42 at the horizon, 0.04 below.
pub(crate) const DOME: Dome = Dome {
    constant: 0.42,
    linear: 0.48,
    square: 0.10,
};

impl Dome {
    /// Radiance from the direction at cosine `c` from the axis.
    pub(crate) fn radiance(self, c: f32) -> f32 {
        self.constant + c * (self.linear + c * self.square)
    }

    /// Irradiance on a plane whose normal is at cosine `c` from the axis.
    ///
    /// The clamped cosine passes bands 0, 1, 2 of the radiance by pi, 2 pi / 3, pi / 4
    /// (Ramamoorthi and Hanrahan, SIGGRAPH 2001).
    #[inline]
    pub(crate) fn irradiance(self, c: f32) -> f32 {
        let mean = self.constant + self.square / 3.0;
        let second = 2.0 / 3.0 * self.square * (1.5 * c * c - 0.5);
        std::f32::consts::PI * (mean + 2.0 / 3.0 * self.linear * c + 0.25 * second)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn irradiance_agrees_with_quadrature() {
        // The same radiance from everywhere: the white furnace.
        let uniform = Dome {
            constant: 1.0,
            linear: 0.0,
            square: 0.0,
        };
        for dome in [DOME, uniform] {
            for tilt in [0.0f64, 0.3, 0.8, 1.4] {
                let (mut sum, steps) = (0.0, 400);
                for i in 0..steps {
                    let c = (i as f64 + 0.5) / steps as f64;
                    let s = (1.0 - c * c).sqrt();
                    for j in 0..steps {
                        let phi = std::f64::consts::TAU * (j as f64 + 0.5) / steps as f64;
                        let along = s * phi.cos() * tilt.sin() + c * tilt.cos();
                        sum += f64::from(dome.radiance(along as f32)) * c;
                    }
                }
                let expected = sum * std::f64::consts::TAU / (steps * steps) as f64;
                let found = f64::from(dome.irradiance(tilt.cos() as f32));
                let error = (found / expected - 1.0).abs();
                assert!(error < 1e-4, "{tilt}: {found} {expected}");
            }
        }
    }
}
