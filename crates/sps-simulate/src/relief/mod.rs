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
use super::parameters::{Parameters, Specimen};
use super::stream::{Purpose, Stream};
use fractal::Fractal;
use woven::Weave;

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

/// What the height field is built of: the place of its row in [`STRUCTURES`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Structure(usize);

struct Row {
    /// As `ranges.csv` has it.
    name: &'static str,
    /// Threads or motifs after which it repeats.
    threads: usize,
    /// How much dye and dirt its hollows hold, 0 to 1; polished ones hold none.
    dirt: f32,
    build: Build,
}

type Build = fn(&mut Builder<'_>) -> Layers;

const fn row(name: &'static str, threads: usize, dirt: f32, build: Build) -> Row {
    Row {
        name,
        threads,
        dirt,
        build,
    }
}

// A method by its name would be of one lifetime of the builder; a closure is of any.
#[allow(clippy::redundant_closure_for_method_calls)]
static STRUCTURES: [Row; 20] = [
    row("smooth", 1, 0.0, |b| b.smooth()),
    row("glazed", 1, 0.0, |b| b.glazed()),
    row("brushed", 1, 0.0, |b| b.brushed()),
    row("embossed", 2, 0.0, |b| b.embossed()),
    row("woven plain", 2, 1.0, |b| b.woven(Weave::Plain)),
    row("woven twill", 4, 1.0, |b| b.woven(Weave::Twill)),
    row("woven satin", 5, 1.0, |b| b.woven(Weave::Satin)),
    row("woven basket", 4, 1.0, |b| b.woven(Weave::Basket)),
    row("knitted", 1, 1.0, |b| b.knitted()),
    row("ribbed", 1, 1.0, |b| b.ribbed()),
    row("looped", 1, 1.0, |b| b.looped()),
    row("tufted", 1, 1.0, |b| b.tufted()),
    row("haired", 1, 1.0, |b| b.haired()),
    row("fibrous", 1, 1.0, |b| b.fibrous()),
    row("pebbled", 1, 0.5, |b| b.pebbled()),
    row("porous", 1, 1.0, |b| b.porous()),
    row("granular", 1, 1.0, |b| b.granular()),
    row("speckled", 1, 0.0, |b| b.speckled()),
    row("veined", 1, 0.0, |b| b.veined()),
    row("grained", 1, 0.5, |b| b.grained()),
];

impl Structure {
    pub(crate) fn named(name: &str) -> Self {
        let place = STRUCTURES.iter().position(|row| row.name == name);
        Self(place.expect("a structure that there is"))
    }

    fn row(self) -> &'static Row {
        &STRUCTURES[self.0]
    }

    pub(crate) fn dirt(self) -> f32 {
        self.row().dirt
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
    let multiple = parameters.profile.structure.row().threads;
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
    let build = parameters.profile.structure.row().build;
    let mut layers = build(&mut builder);
    layers.height.standardise(parameters.relief_mm as f32);
    let micro = Fractal::isotropic(parameters.micro_length_mm / TILE_MM, 0.6);
    let (micro, fade) = builder.fields(micro);
    let deviation = parameters.micro_um as f32 * 1e-3;
    layers.height.add_scaled(&micro, deviation);
    layers.tone.add_scaled(&fade, 0.03);
    layers
}

impl Builder<'_> {
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
