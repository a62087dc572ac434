//! Speed of the kernels at the shapes of the paper's network, beside another matrix product.
//!
//! `RAYON_NUM_THREADS=1 cargo test --release -p sps-kernels --lib -- --ignored --nocapture measure`

use std::hint::black_box;
use std::time::Instant;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

use super::super::bands::Threads;
use super::super::conv::{Conv, ConvShape};
use super::super::grid::{Grid, Window, pixels};
use super::super::image::rows_of_words;
use super::super::product::Epilogue;
use super::super::simd::Level;
use super::super::words::{Bf16Pair, Word};
use super::shape;

/// The shortest of several runs, in seconds.
fn shortest(mut run: impl FnMut()) -> f64 {
    (0..30).fold(f64::INFINITY, |shortest, _| {
        let start = Instant::now();
        run();
        shortest.min(start.elapsed().as_secs_f64())
    })
}

fn ramp(len: usize) -> Vec<f32> {
    (0..len).map(|i| (i % 251) as f32 / 251.0 - 0.5).collect()
}

/// A product of row-major matrices by `faer` (private-gemm-x86), GFLOP/s.
fn faer(m: usize, k: usize, n: usize) -> f64 {
    let (left, right) = (ramp(m * k), ramp(k * n));
    let mut out = vec![0.0_f32; m * n];
    let left = MatRef::from_row_major_slice(&left, m, k);
    let right = MatRef::from_row_major_slice(&right, k, n);
    let seconds = shortest(|| {
        let target = MatMut::from_row_major_slice_mut(black_box(&mut out), m, n);
        matmul(target, Accum::Replace, left, right, 1.0, Par::Seq);
    });
    2e-9 * (m * k * n) as f64 / seconds
}

/// A convolution of the network.
struct Row {
    name: &'static str,
    /// Height and width of the input.
    extent: usize,
    /// Frames that go through together.
    frames: usize,
    shape: ConvShape,
    /// How often the network has it.
    count: usize,
}

impl Row {
    fn output(&self) -> [usize; 3] {
        let size = [1, self.extent, self.extent];
        self.shape.window.output(size).unwrap()
    }

    /// Multiplications and additions for one frame, in 1e9.
    fn flops(&self) -> f64 {
        let depth = pixels(self.shape.window.size) * self.shape.group_inputs();
        2e-9 * (pixels(self.output()) * depth * self.shape.outputs) as f64
    }

    /// Seconds for one frame.
    fn time<W: Word>(&self) -> f64 {
        let shape = self.shape;
        let depth = pixels(shape.window.size) * shape.group_inputs();
        let of_images = shape.inputs == 3;
        let pack = if of_images {
            Conv::pack_for_images
        } else {
            Conv::pack
        };
        let conv = pack(Level::detect(), shape, &ramp(depth * shape.outputs));
        let size = [1, self.extent, self.extent];
        let map = |size, channels| {
            let grid = Grid::tight(self.frames, size, channels);
            grid.of::<W>().staggered()
        };
        let from = map(size, shape.inputs).padded(&shape.window);
        let to = map(self.output(), shape.outputs);
        let memory = if of_images {
            rows_of_words::<W>(&from)
        } else {
            from
        };
        let source: Vec<W> = ramp(memory.len()).iter().map(|&x| W::of(|_| x)).collect();
        let mut target = vec![W::default(); to.len()];
        let time = shortest(|| {
            let target = (&mut black_box(&mut target)[..], &to);
            conv.apply(Threads::One, (&source, &from), target, Epilogue::default());
        });
        time / self.frames as f64
    }
}

const fn row(
    name: &'static str,
    count: usize,
    (extent, frames): (usize, usize),
    (size, stride): (usize, usize),
    (inputs, outputs, groups): (usize, usize, usize),
) -> Row {
    let window = Window::square(size, stride, size / 2);
    let shape = shape(window, inputs, outputs, groups);
    Row {
        name,
        extent,
        frames,
        shape,
        count,
    }
}

static ROWS: [Row; 24] = [
    row("stem", 1, (224, 1), (7, 2), (3, 64, 1)),
    row("layer1 reduce, first", 1, (56, 1), (1, 1), (64, 128, 1)),
    row("layer1 reduce", 2, (56, 1), (1, 1), (256, 128, 1)),
    row("layer1 grouped", 3, (56, 1), (3, 1), (128, 128, 32)),
    row("layer1 expand", 3, (56, 1), (1, 1), (128, 256, 1)),
    row("layer1 shortcut", 1, (56, 1), (1, 1), (64, 256, 1)),
    row("layer2 reduce, first", 1, (56, 1), (1, 1), (256, 256, 1)),
    row("layer2 reduce", 3, (28, 1), (1, 1), (512, 256, 1)),
    row(
        "layer2 grouped, stride 2",
        1,
        (56, 1),
        (3, 2),
        (256, 256, 32),
    ),
    row("layer2 grouped", 3, (28, 1), (3, 1), (256, 256, 32)),
    row("layer2 expand", 4, (28, 1), (1, 1), (256, 512, 1)),
    row("layer2 shortcut", 1, (56, 1), (1, 2), (256, 512, 1)),
    row("layer3 reduce, first", 1, (28, 4), (1, 1), (512, 512, 1)),
    row("layer3 reduce", 5, (14, 4), (1, 1), (1024, 512, 1)),
    row(
        "layer3 grouped, stride 2",
        1,
        (28, 4),
        (3, 2),
        (512, 512, 32),
    ),
    row("layer3 grouped", 5, (14, 4), (3, 1), (512, 512, 32)),
    row("layer3 expand", 6, (14, 4), (1, 1), (512, 1024, 1)),
    row("layer3 shortcut", 1, (28, 4), (1, 2), (512, 1024, 1)),
    row("layer4 reduce, first", 1, (14, 4), (1, 1), (1024, 1024, 1)),
    row("layer4 reduce", 2, (7, 4), (1, 1), (2048, 1024, 1)),
    row(
        "layer4 grouped, stride 2",
        1,
        (14, 4),
        (3, 2),
        (1024, 1024, 32),
    ),
    row("layer4 grouped", 2, (7, 4), (3, 1), (1024, 1024, 32)),
    row("layer4 expand", 3, (7, 4), (1, 1), (1024, 2048, 1)),
    row("layer4 shortcut", 1, (14, 4), (1, 2), (1024, 2048, 1)),
];

/// A row with its time, its rate and faer's.
struct Measured {
    row: &'static Row,
    seconds: f64,
    rate: f64,
    bf16_seconds: f64,
    faer: Option<f64>,
}

fn measure(row: &'static Row) -> Measured {
    let seconds = row.time::<f32>();
    let rows = row.frames * pixels(row.output());
    let point = pixels(row.shape.window.size) == 1;
    Measured {
        row,
        seconds,
        rate: row.flops() / seconds,
        bf16_seconds: row.time::<Bf16Pair>(),
        faer: point.then(|| faer(rows, row.shape.inputs, row.shape.outputs)),
    }
}

#[test]
#[ignore = "a measurement, not a check"]
fn layers() {
    let all: Vec<Measured> = ROWS.iter().map(measure).collect();
    let rates = all.iter().flat_map(|m| m.faer.into_iter().chain([m.rate]));
    let peak = rates.fold(0.0, f64::max);
    println!("the best product: {peak:.0} GFLOP/s\n");
    println!("| layer | times | ms a frame | GFLOP/s | of peak | faer | bf16 ms | times f32 |");
    println!("|---|---|---|---|---|---|---|---|");
    let (mut time, mut bf16_time, mut flops) = (0.0, 0.0, 0.0);
    for Measured {
        row,
        seconds,
        rate,
        bf16_seconds,
        faer,
    } in &all
    {
        time += seconds * row.count as f64;
        bf16_time += bf16_seconds * row.count as f64;
        flops += row.flops() * row.count as f64;
        let faer = faer.map_or_else(String::new, |rate| format!("{rate:.0}"));
        println!(
            "| {} | {} | {:.2} | {rate:.0} | {:.0} % | {faer} | {:.2} | {:.1} |",
            row.name,
            row.count,
            1e3 * seconds,
            100.0 * rate / peak,
            1e3 * bf16_seconds,
            seconds / bf16_seconds,
        );
    }
    println!(
        "\n{:.1} ms for {flops:.2} GFLOP: {:.0} GFLOP/s, {:.0} % of the peak; bf16 {:.1} ms",
        1e3 * time,
        flops / time,
        100.0 * flops / time / peak,
        1e3 * bf16_time,
    );
}
