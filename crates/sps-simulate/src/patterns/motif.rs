//! What a pattern repeats: families of formulas, each with parameters of its own.

use std::f32::consts::TAU;

use super::noise::{
    Metric, from_point, gradient, hash, nearest, octaves, reseed, turned, unit, wave, within,
};
use crate::stream::Stream;

/// A function of a place and a seed, about -1 to 1, with features of about unit length.
pub(super) type Motif = Box<dyn Fn([f32; 2], u32) -> f32>;

const FAMILIES: [fn(&mut Stream) -> Motif; 12] = [
    cloud, contours, stripes, cells, weave, braid, web, strokes, leaves, courses, mirrored, julia,
];

/// A motif of one of the families.
pub(super) fn draw(stream: &mut Stream) -> Motif {
    let family = stream.between32(0.0, FAMILIES.len() as f64) as usize;
    FAMILIES[family](stream)
}

/// Noise of many scales.
fn cloud(stream: &mut Stream) -> Motif {
    let count = stream.between32(1.0, 7.0) as u32;
    let gain = stream.between32(0.35, 0.8);
    let form: fn(f32) -> f32 = match stream.between32(0.0, 3.0) as u32 {
        0 => |v| v,
        // Billows.
        1 => |v| 2.5 * v.abs() - 1.0,
        // Ridges.
        _ => |v| 1.0 - 2.5 * v.abs(),
    };
    let stretch = stream.between32(0.0, 3.0).max(1.0).powi(2);
    Box::new(move |[x, y], seed| octaves([x / stretch, y], seed, count, gain, form))
}

/// Level lines of noise: marble, timber, zebras, labyrinths.
fn contours(stream: &mut Stream) -> Motif {
    let lines = stream.between32(0.7, 4.0);
    let count = stream.between32(1.0, 4.0) as u32;
    let soft = stream.between32(0.02, 0.8);
    Box::new(move |place, seed| {
        let height = octaves(place.map(|v| 0.5 * v), seed, count, 0.5, |v| v);
        (wave(lines * height) / soft).clamp(-1.0, 1.0)
    })
}

/// One to three families of stripes.
fn stripes(stream: &mut Stream) -> Motif {
    let count = stream.between32(1.0, 4.0) as usize;
    let spread = stream.between32(0.4, 1.6);
    let across: Box<dyn Fn(f32) -> f32> = match stream.between32(0.0, 3.0) as u32 {
        0 => Box::new(wave),
        1 => Box::new(|x| 2.0 * (x - x.floor()) - 1.0),
        _ => {
            // Bright over such a share of the period.
            let share = stream.between32(0.15, 0.7);
            Box::new(move |x| 2.0 * within(0.5 * share, 0.03, (x - x.floor() - 0.5).abs()) - 1.0)
        }
    };
    let waver = stream.between32(-0.15, 0.5).max(0.0);
    let joined = stream.between32(0.0, 3.0) as u32;
    Box::new(move |place, seed| {
        let values = (0..count).map(|number| {
            let [x, mut y] = turned(place, spread * number as f32);
            if waver > 0.0 {
                let slow = [0.35 * x, 0.35 * y];
                y += waver * octaves(slow, reseed(seed, number as u32), 2, 0.5, |v| v);
            }
            across(y)
        });
        match joined {
            0 => values.fold(-1.0, f32::max),
            1 => values.sum::<f32>() / (count as f32).sqrt(),
            _ => values.product(),
        }
    })
}

/// Cells about the points of a lattice: what is seen of each.
fn cells(stream: &mut Stream) -> Motif {
    let jitter = stream.between32(0.0, 1.2).min(1.0);
    let metric = match stream.between32(0.0, 4.0) as u32 {
        0 => Metric::Blocks,
        1 => Metric::Chess,
        _ => Metric::Euclid,
    };
    let at = move |place, seed| nearest(place, seed, jitter, metric);
    match stream.between32(0.0, 6.0) as u32 {
        // A value of its own.
        0 => Box::new(move |place, seed| 2.0 * unit(reseed(at(place, seed).bits, 1)) - 1.0),
        // The distance to its point.
        1 => Box::new(move |place, seed| 1.0 - 2.0 * at(place, seed).first),
        // Its edge.
        2 => {
            let width = stream.between32(0.03, 0.2);
            Box::new(move |place, seed| {
                let cell = at(place, seed);
                1.0 - 2.0 * within(width, 0.5 * width, cell.second - cell.first)
            })
        }
        // A ring about its point.
        3 => {
            let radius = stream.between32(0.2, 0.45);
            Box::new(move |place, seed| {
                let distance = (at(place, seed).first - radius).abs();
                2.0 * within(0.08, 0.04, distance) - 1.0
            })
        }
        // A bump, or a hole.
        _ => {
            let radius = stream.between32(0.2, 0.5);
            Box::new(move |place, seed| {
                let share = at(place, seed).first / radius;
                2.0 * (1.0 - share * share).max(0.0) - 1.0
            })
        }
    }
}

/// Strips that pass over and under each other, `over` at a time: the height of the one on top.
fn weave(stream: &mut Stream) -> Motif {
    let over = stream.between32(1.0, 4.0) as i32;
    let (width, round) = (stream.between32(0.6, 1.0), stream.between32(0.0, 1.0));
    Box::new(move |[x, y], _| {
        let (column, row) = (x.floor(), y.floor());
        let across = |offset: f32| {
            let share = 2.0 * (offset - 0.5).abs() / width;
            (share < 1.0).then_some(1.0 - round * share * share)
        };
        let above = (column as i32 + row as i32).rem_euclid(2 * over) < over;
        let (upright, level) = (across(x - column), across(y - row));
        // A strip is lower where the other passes over it.
        let upright = upright.map(|height| height - if above { 0.0 } else { 1.0 });
        let level = level.map(|height| height - if above { 1.0 } else { 0.0 });
        let top = upright.into_iter().chain(level).fold(-1.0, f32::max);
        // Seen more easily where the two differ.
        if top > -1.0 && level == Some(top) {
            top - 0.15
        } else {
            top
        }
    })
}

/// Plaits side by side, each of strands that swing from side to side.
fn braid(stream: &mut Stream) -> Motif {
    let strands = stream.between32(2.0, 5.0).floor();
    let (pitch, round) = (stream.between32(0.6, 2.0), stream.between32(0.3, 1.0));
    Box::new(move |[x, y], _| {
        let x = 0.5 * x;
        let within_plait = 2.0 * (x - x.floor()) - 1.0;
        let mut top: f32 = -1.0;
        for strand in 0..strands as u32 {
            let phase = y * pitch * 0.5 + strand as f32 / strands;
            let middle = 0.55 * wave(phase);
            let share = (within_plait - middle) / 0.42;
            if share.abs() < 1.0 {
                let depth = 0.5 * wave(2.0 * phase + 0.25);
                top = top.max(0.5 * depth + 0.9 * (1.0 - round * share * share) - 0.2);
            }
        }
        top
    })
}

/// Threads from a centre, and threads across them.
fn web(stream: &mut Stream) -> Motif {
    let rays = stream.between32(6.0, 25.0).floor();
    let (sag, thread) = (stream.between32(-0.3, 0.3), stream.between32(0.02, 0.12));
    Box::new(move |place, seed| {
        let cell = nearest(place.map(|v| v / 6.0), seed, 1.0, Metric::Euclid);
        let [x, y] = cell.offset;
        let turns = libm::atan2f(y, x) / TAU;
        let jitter = gradient([rays * turns, 7.3], cell.bits);
        let ray = rays * turns + 0.25 * jitter;
        let between = ray - ray.floor() - 0.5;
        let radius = 6.0 * cell.first;
        // Threads across hang towards the centre, or away from it.
        let across = radius * (1.0 + sag * (0.25 - between * between) * 4.0);
        let ring = (across - across.floor() - 0.5).abs();
        let spoke = (0.5 - between.abs()) * TAU * radius / rays;
        let distance = (0.5 - ring).min(spoke);
        2.0 * within(thread, 0.5 * thread, distance) - 1.0
    })
}

/// Hairs, scratches, straw.
fn strokes(stream: &mut Stream) -> Motif {
    let (length, width) = (stream.between32(0.4, 1.4), stream.between32(0.015, 0.1));
    let spread = stream.between32(0.0, 1.6);
    let each = stream.between32(1.0, 4.0) as u32;
    Box::new(move |place, seed| {
        let [column, row] = place.map(|v| v.floor() as i32);
        let mut highest: f32 = -1.0;
        for layer in 0..each {
            let seed = reseed(seed, layer);
            for y in row - 1..=row + 1 {
                for x in column - 1..=column + 1 {
                    let bits = hash(x, y, seed);
                    let angle = spread * (2.0 * unit(reseed(bits, 1)) - 1.0);
                    let [along, across] = turned(from_point(place, [x, y], bits, 1.0), angle);
                    let beyond = (along.abs() - 0.5 * length).max(0.0);
                    let distance = (beyond * beyond + across * across).sqrt();
                    if distance < 1.5 * width {
                        let height = 0.4 + 0.6 * unit(reseed(bits, 2));
                        let edge = within(width, 0.5 * width, distance);
                        highest = highest.max((1.0 + height) * edge - 1.0);
                    }
                }
            }
        }
        highest
    })
}

/// Leaves that lie on each other (Lee, Mumford and Huang, IJCV 2001).
fn leaves(stream: &mut Stream) -> Motif {
    // Whether a leaf of a size covers a place.
    let covers: Box<dyn Fn([f32; 2], f32) -> bool> = match stream.between32(0.0, 3.0) as u32 {
        0 => Box::new(|[x, y], size| x * x + y * y < size * size),
        1 => Box::new(|[x, y], size| x.abs().max(y.abs()) < 0.8 * size),
        _ => {
            let ratio = stream.between32(1.5, 5.0);
            Box::new(move |[x, y], size| x * x + ratio * ratio * y * y < size * size)
        }
    };
    let layers = stream.between32(3.0, 8.0) as u32;
    let gain = stream.between32(1.1, 1.5);
    Box::new(move |place, seed| {
        let mut scale = 1.0;
        // From the uppermost, which are the smallest, down.
        for layer in 0..layers {
            let seed = reseed(seed, layer);
            let [x, y] = [place[0] / scale + 0.37 * layer as f32, place[1] / scale];
            let (column, row) = ((x - 0.5).floor() as i32, (y - 0.5).floor() as i32);
            for j in row..=row + 1 {
                for i in column..=column + 1 {
                    let bits = hash(i, j, seed);
                    let offset = from_point([x, y], [i, j], bits, 0.5);
                    let angle = TAU * unit(reseed(bits, 1));
                    let size = 0.2 + 0.5 * unit(reseed(bits, 3));
                    if covers(turned(offset, angle), size) {
                        return 2.0 * unit(reseed(bits, 2)) - 1.0;
                    }
                }
            }
            scale *= gain;
        }
        -1.0
    })
}

/// Rows of equal pieces: bricks, scales, shingles.
fn courses(stream: &mut Stream) -> Motif {
    let shift = stream.between32(0.0, 0.75).min(0.5);
    let (ratio, round) = (stream.between32(0.5, 3.0), stream.between32(0.0, 1.0));
    Box::new(move |place, seed| {
        let row = place[1].floor();
        let x = place[0] / ratio + shift * row;
        let column = x.floor();
        let (across, down) = (2.0 * (x - column) - 1.0, 2.0 * (place[1] - row) - 1.0);
        let own = unit(hash(column as i32, row as i32, seed));
        let gap = (1.0 - across.abs()) * ratio.min(1.0) * 0.5;
        let gap = gap.min(0.5 * (1.0 - down.abs()));
        let joint = within(0.06, 0.03, gap);
        let dome = 1.0 - round * 0.5 * (across * across + down * down);
        (0.3 + 0.7 * own) * dome * (1.0 - joint) * 2.0 - 1.0
    })
}

/// Noise in a sector of a tile, which all others mirror.
fn mirrored(stream: &mut Stream) -> Motif {
    let folds = stream.between32(2.0, 5.0) as u32;
    let count = stream.between32(1.0, 4.0) as u32;
    let lines = stream.between32(0.0, 3.0);
    Box::new(move |place, seed| {
        let place = place.map(|v| 0.5 * v);
        let mut inside = place.map(|v| 2.0 * (v - v.floor()) - 1.0);
        if folds < 4 {
            inside = inside.map(f32::abs);
            if folds == 3 && inside[1] > inside[0] {
                inside.swap(0, 1);
            }
        }
        let value = octaves(inside, seed, count, 0.6, |v| v);
        if lines < 1.0 {
            value
        } else {
            wave(lines * value)
        }
    })
}

/// The escape times of a Julia set.
fn julia(stream: &mut Stream) -> Motif {
    /// Steps after which a place is taken not to escape.
    const STEPS: u32 = 32;
    let radius = stream.between32(0.6, 0.9);
    let angle = stream.between32(0.0, std::f64::consts::TAU);
    let (cx, cy) = (radius * libm::cosf(angle), radius * libm::sinf(angle));
    Box::new(move |place, _| {
        let [mut x, mut y] = place.map(|v| {
            // Mirrored, so that it goes on for ever.
            let tile = 0.25 * v;
            4.0 * (tile - tile.floor() - 0.5).abs() - 1.0
        });
        for step in 0..STEPS {
            let square = x * x + y * y;
            if square > 16.0 {
                let smooth = step as f32 - libm::log2f(0.5 * libm::log2f(square));
                return wave(0.12 * smooth);
            }
            (x, y) = (x * x - y * y + cx, 2.0 * x * y + cy);
        }
        -1.0
    })
}
