//! Texture values from the spectrum of the height field.

use super::super::parameters::Parameters;

/// Wavelength that parts microtexture from macrotexture, in mm: about the spacing at which touch
/// turns from vibration to shape (Hollins and Risner, Perception & Psychophysics 62, 2000).
const PARTING_MM: f64 = 1.0;

/// Heights that the finger no longer tells from nothing, in mm (Skedung et al., Scientific Reports
/// 3, 2013, find 13 nm; the BioTac's skin is coarser).
const MICRO_FLOOR_MM: f64 = 2e-4;
const MACRO_FLOOR_MM: f64 = 3e-3;

/// The power spectrum as lines: wavelength in mm and mean square height in mm^2.
pub(super) struct Spectrum {
    lines: [(f64, f64); 6],
    order: f64,
    /// Share of a line's amplitude that a soft body gives back to the sliding skin.
    response: f64,
}

/// Share of the structure's variance in its pitch and its second and third harmonics.
const HARMONICS: [(f64, f64); 3] = [(1.0, 0.72), (2.0, 0.2), (3.0, 0.08)];

/// Share of the microrelief's variance at multiples of its correlation length.
const MICRO_LINES: [(f64, f64); 3] = [(6.0, 0.55), (2.5, 0.33), (1.0, 0.12)];

impl Spectrum {
    pub(super) fn of(p: &Parameters) -> Self {
        let structure = p.relief_mm * p.relief_mm;
        let micro = p.micro_um * p.micro_um * 1e-6;
        let mut lines = [(1.0, 0.0); 6];
        for (line, (order, share)) in lines.iter_mut().zip(HARMONICS) {
            *line = (p.period_mm / order, share * structure);
        }
        for (line, (multiple, share)) in lines[3..].iter_mut().zip(MICRO_LINES) {
            *line = (multiple * p.micro_length_mm, share * micro);
        }
        Self {
            lines,
            order: p.regularity,
            response: (p.modulus_kpa / (p.modulus_kpa + 15.0)).sqrt(),
        }
    }

    /// Logarithm of the mean wavelength of the microtexture, weighted by how strongly it is felt.
    pub(super) fn micro_coarseness(&self) -> f64 {
        let (power, sum) = self.power_and_logarithms(micro_band);
        sum / power + 0.3 * libm::log(power.sqrt() + MICRO_FLOOR_MM)
    }

    /// Logarithm of the vibration that sliding over the microtexture excites; at constant speed a
    /// line's acceleration grows as its wavelength falls.
    pub(super) fn micro_roughness(&self) -> f64 {
        let lines = self.lines.iter();
        let power =
            lines.map(|&(wavelength, variance)| variance * micro_band(wavelength) / wavelength);
        libm::log(self.response * power.sum::<f64>().sqrt() + MICRO_FLOOR_MM)
    }

    /// Logarithm of the macrotexture's height.
    pub(super) fn macro_texture(&self) -> f64 {
        libm::log(self.macro_height() + MACRO_FLOOR_MM)
    }

    /// Order, as far as there is anything to be ordered.
    pub(super) fn regularity(&self) -> f64 {
        let height = self.macro_height();
        self.order * height / (height + 0.02)
    }

    /// Logarithm of the macrotexture's volume: what is high and wide is coarse.
    pub(super) fn macro_coarseness(&self) -> f64 {
        let (power, sum) = self.power_and_logarithms(|wavelength| 1.0 - micro_band(wavelength));
        self.macro_texture() + 1.5 * sum / power
    }

    /// Of the lines weighted by a band: the power, and the sum of the logarithms of wavelengths.
    fn power_and_logarithms(&self, band: impl Fn(f64) -> f64) -> (f64, f64) {
        let (mut power, mut sum) = (1e-12, 0.0);
        for (wavelength, variance) in self.lines {
            let weight = variance * band(wavelength);
            power += weight;
            sum += weight * libm::log(wavelength);
        }
        (power, sum)
    }

    fn macro_height(&self) -> f64 {
        let lines = self.lines.iter();
        let power = lines.map(|&(wavelength, variance)| variance * (1.0 - micro_band(wavelength)));
        power.sum::<f64>().sqrt()
    }

    /// Mean square slope of all lines, and of the macrotexture alone.
    pub(super) fn mean_square_slopes(&self) -> (f64, f64) {
        let (mut all, mut large) = (0.0, 0.0);
        for (wavelength, variance) in self.lines {
            let k = std::f64::consts::TAU / wavelength;
            all += k * k * variance;
            large += k * k * variance * (1.0 - micro_band(wavelength));
        }
        (all, large)
    }
}

/// Share of a wavelength that counts as microtexture.
fn micro_band(wavelength_mm: f64) -> f64 {
    let q = wavelength_mm / PARTING_MM;
    1.0 / (1.0 + q * q * q)
}

#[cfg(test)]
mod tests {
    use super::super::super::geometry::TILE_MM;
    use super::super::super::grid::Grid;
    use super::super::super::material::Material;
    use super::super::super::parameters::Specimen;
    use super::super::super::relief;
    use super::*;

    /// The mean over a square of about half the parting wavelength.
    fn blurred(grid: &Grid) -> Grid {
        let n = grid.n();
        let reach = (0.25 * PARTING_MM / TILE_MM * n as f64).round() as usize;
        let count = (2 * reach + 1) as f32;
        let pass = |value: &dyn Fn(usize, usize) -> f32| -> Vec<f32> {
            let mean = |at: usize| {
                let near = (0..=2 * reach).map(|k| (at % n + n + k - reach) % n);
                near.map(|x| value(x, at / n)).sum::<f32>() / count
            };
            (0..n * n).map(mean).collect()
        };
        let across = pass(&|x, y| grid.row(y)[x]);
        let both = pass(&|y, x| across[y * n + x]);
        // The second pass ran over columns and left its result transposed.
        Grid::from_data(n, (0..n * n).map(|at| both[at % n * n + at / n]).collect())
    }

    fn ranks(values: &[f64]) -> Vec<f64> {
        let mut order: Vec<usize> = (0..values.len()).collect();
        order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
        let mut ranks = vec![0.0; values.len()];
        for (rank, place) in order.into_iter().enumerate() {
            ranks[place] = rank as f64;
        }
        ranks
    }

    fn rank_correlation(a: &[f64], b: &[f64]) -> f64 {
        let (a, b) = (ranks(a), ranks(b));
        let n = a.len() as f64;
        let squares: f64 = a.iter().zip(&b).map(|(x, y)| (x - y) * (x - y)).sum();
        1.0 - 6.0 * squares / (n * (n * n - 1.0))
    }

    /// The line spectrum that touch is computed from orders surfaces as their height maps do.
    #[test]
    fn the_spectrum_is_that_of_the_height_field() {
        let (mut macro_model, mut macro_map) = (Vec::new(), Vec::new());
        let (mut micro_model, mut micro_map) = (Vec::new(), Vec::new());
        for material in Material::all() {
            let specimen = Specimen::of_material(11, 0, material);
            let parameters = specimen.parameters();
            let spectrum = Spectrum::of(&parameters);
            let mut height = relief::layers(&specimen, &parameters, 256).height;
            let coarse = blurred(&height);
            height.add_scaled(&coarse, -1.0);
            macro_model.push(spectrum.macro_height());
            macro_map.push(f64::from(coarse.deviation()));
            let micro = |line: &(f64, f64)| line.1 * micro_band(line.0);
            micro_model.push(spectrum.lines.iter().map(micro).sum::<f64>());
            micro_map.push(f64::from(height.deviation()));
        }
        let coarse = rank_correlation(&macro_model, &macro_map);
        let fine = rank_correlation(&micro_model, &micro_map);
        assert!(coarse > 0.95, "{coarse}");
        assert!(fine > 0.9, "{fine}");
    }
}
