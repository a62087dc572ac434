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

/// What a structure's builder starts from.
struct Builder<'a> {
    /// Texels across.
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
    let mut stream = specimen.stream(Purpose::Relief);
    let mut builder = Builder {
        n,
        count: repeats(parameters),
        regularity: parameters.regularity as f32,
        stream: &mut stream,
    };
    let mut layers = builder.structure(parameters.profile.structure);
    layers.height.standardise(parameters.relief_mm as f32);
    let (micro, fade) = fractal::pair(
        n,
        fractal::Fractal::isotropic(parameters.micro_length_mm / TILE_MM, 0.6),
        &mut stream,
    );
    layers
        .height
        .add_scaled(&micro, parameters.micro_um as f32 * 1e-3);
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
        let (mut x, mut y) = fractal::pair(
            self.n,
            fractal::Fractal::isotropic(length, hurst),
            self.stream,
        );
        let scale = share * (1.0 - self.regularity);
        x.map_in_place(|v| v * scale);
        y.map_in_place(|v| v * scale);
        (x, y)
    }
}
