//! Height fields, and the tone that goes with them.

mod cells;
mod fourier;
mod fractal;
mod granular;
mod knitted;
mod moulded;
mod pile;
mod print;
mod strokes;
mod timber;
mod woven;

use super::geometry::TILE_MM;
use super::grid::Grid;
use super::material::Structure;
use super::parameters::{Parameters, Specimen};
use super::stream::{Purpose, Stream};
use fractal::Fractal;

pub(crate) use print::print_mask;

/// What the shape of a surface is made of, on one period.
#[derive(Clone, Debug)]
pub(crate) struct Layers {
    /// Height in mm, mean zero.
    pub(crate) height: Grid,
    /// Place in the palette, 0 to 1.
    pub(crate) tone: Grid,
    /// Share of the specular reflection that is left, 0 to 1.
    pub(crate) polish: Grid,
}

impl Layers {
    /// Of a height and a tone, polished alike everywhere.
    fn new(height: Grid, tone: Grid, polish: f32) -> Self {
        Self {
            polish: Grid::filled(height.n(), polish),
            height,
            tone,
        }
    }

    /// Height, tone and polish of each texel, given its index and its centre in units of the period.
    fn of_texels(n: usize, mut f: impl FnMut(usize, f32, f32) -> (f32, f32, f32)) -> Self {
        let mut layers = Self::new(Grid::filled(n, 0.0), Grid::filled(n, 0.0), 0.0);
        let step = 1.0 / n as f32;
        for at in 0..n * n {
            let (x, y) = ((at % n) as f32 + 0.5, (at / n) as f32 + 0.5);
            let (height, tone, polish) = f(at, x * step, y * step);
            layers.height.data_mut()[at] = height;
            layers.tone.data_mut()[at] = tone;
            layers.polish.data_mut()[at] = polish;
        }
        layers
    }
}

/// What a structure's builder starts from.
struct Builder<'a> {
    /// Texels across, a power of two.
    n: usize,
    /// Repeats of the structure in one period.
    count: usize,
    /// 0 is disordered, 1 a perfect lattice.
    regularity: f32,
    stream: &'a mut Stream,
}

/// How often the structure repeats in one period.
pub(crate) fn repeats(parameters: &Parameters) -> usize {
    let exact = TILE_MM / parameters.period_mm;
    let multiple = match parameters.profile.structure {
        Structure::Woven(weave) => woven::repeat(weave),
        Structure::Embossed => 2,
        _ => 1,
    };
    ((exact / multiple as f64).round() as usize).max(1) * multiple
}

/// Builds the layers of a surface on `n x n` texels.
pub(crate) fn layers(specimen: &Specimen, parameters: &Parameters, n: usize) -> Layers {
    let mut stream = specimen.stream(Purpose::RELIEF);
    let mut builder = Builder {
        n,
        count: repeats(parameters),
        regularity: parameters.regularity as f32,
        stream: &mut stream,
    };
    let mut layers = builder.structure(parameters.profile.structure);
    layers.height.standardise(parameters.relief_mm as f32);
    let micro = Fractal::isotropic(parameters.micro_length_mm / TILE_MM, 0.6);
    let (micro, fade) = builder.fields(micro);
    let deviation = parameters.micro_um as f32 * 1e-3;
    layers.height.add_scaled(&micro, deviation);
    layers.tone.add_scaled(&fade, 0.03);
    layers
}

impl Builder<'_> {
    fn structure(&mut self, structure: Structure) -> Layers {
        match structure {
            Structure::Smooth => self.smooth(),
            Structure::Glazed => self.glazed(),
            Structure::Brushed => self.brushed(),
            Structure::Embossed => self.embossed(),
            Structure::Woven(weave) => self.woven(weave),
            Structure::Knitted => self.knitted(),
            Structure::Ribbed => self.ribbed(),
            Structure::Looped => self.looped(),
            Structure::Tufted => self.tufted(),
            Structure::Haired => self.haired(),
            Structure::Fibrous => self.fibrous(),
            Structure::Pebbled => self.pebbled(),
            Structure::Porous => self.porous(),
            Structure::Granular => self.granular(),
            Structure::Speckled => self.speckled(),
            Structure::Veined => self.veined(),
            Structure::Grained => self.grained(),
        }
    }

    /// Two smooth fields that displace the structure by about `share` of a repeat where there is
    /// no order, varying over `repeats` of them.
    fn disorder(&mut self, share: f32, repeats: f32) -> (Grid, Grid) {
        self.displacement(share, repeats, 2.5)
    }

    /// The same with a Hurst exponent: 1 frays edges as broken mineral does.
    fn displacement(&mut self, share: f32, repeats: f32, hurst: f64) -> (Grid, Grid) {
        let length = f64::from(repeats) / self.count as f64 / std::f64::consts::TAU;
        let (mut x, mut y) = self.fields(Fractal::isotropic(length, hurst));
        let scale = share * (1.0 - self.regularity);
        x.map_in_place(|v| v * scale);
        y.map_in_place(|v| v * scale);
        (x, y)
    }

    /// Two independent fields.
    fn fields(&mut self, fractal: Fractal) -> (Grid, Grid) {
        fractal::pair(self.n, fractal, self.stream)
    }

    /// The same with three repeats for one.
    fn finer(&mut self) -> Builder<'_> {
        Builder {
            count: self.count * 3,
            stream: &mut *self.stream,
            ..*self
        }
    }

    /// Uniform from -1 to 1.
    fn signed(&mut self) -> f32 {
        2.0 * self.stream.unit() as f32 - 1.0
    }
}
