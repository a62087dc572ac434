//! The formulas of motifs: each a value, about -1 to 1, at a place in features.

use super::motif::{Form, Joined, Profile, Seen, Shape};
use super::noise::{Metric, from_point, gradient, hash, nearest, octaves, reseed, unit, within};

/// A wave of period 1, from -1 to 1.
pub(super) fn wave(x: f32) -> f32 {
    libm::sinf(std::f32::consts::TAU * (x - x.floor()))
}

fn turned([x, y]: [f32; 2], angle: f32) -> [f32; 2] {
    let (sine, cosine) = (libm::sinf(angle), libm::cosf(angle));
    [cosine * x - sine * y, sine * x + cosine * y]
}

impl Form {
    pub(super) fn of(self, v: f32) -> f32 {
        match self {
            Self::Smooth => v,
            Self::Billows => 2.5 * v.abs() - 1.0,
            Self::Ridges => 1.0 - 2.5 * v.abs(),
        }
    }
}

impl Profile {
    fn of(self, x: f32) -> f32 {
        let within_period = x - x.floor();
        match self {
            Self::Wave => wave(x),
            Self::Saw => 2.0 * within_period - 1.0,
            Self::Pulse(share) => {
                let middle = (within_period - 0.5).abs();
                2.0 * within(0.5 * share, 0.03, middle) - 1.0
            }
        }
    }
}

pub(super) fn stripes(
    place: [f32; 2],
    seed: u32,
    angles: &[f32],
    profile: Profile,
    waver: f32,
    joined: Joined,
) -> f32 {
    let values = (0u32..).zip(angles).map(|(number, &angle)| {
        let [along, mut across] = turned(place, angle);
        if waver > 0.0 {
            let slow = [0.35 * along, 0.35 * across];
            across += waver * octaves(slow, reseed(seed, number), 2, 0.5, |v| v);
        }
        profile.of(across)
    });
    match joined {
        Joined::Highest => values.fold(-1.0, f32::max),
        Joined::Sum => values.sum::<f32>() / (angles.len() as f32).sqrt(),
        Joined::Product => values.product(),
    }
}

impl Seen {
    pub(super) fn of(self, place: [f32; 2], seed: u32, jitter: f32, metric: Metric) -> f32 {
        let cell = nearest(place, seed, jitter, metric);
        match self {
            Self::Level => 2.0 * unit(reseed(cell.bits, 1)) - 1.0,
            Self::Cone => 1.0 - 2.0 * cell.first,
            Self::Edge(width) => 1.0 - 2.0 * within(width, 0.5 * width, cell.second - cell.first),
            Self::Bump(radius) => {
                let share = cell.first / radius;
                2.0 * (1.0 - share * share).max(0.0) - 1.0
            }
            Self::Ring(radius) => 2.0 * within(0.08, 0.04, (cell.first - radius).abs()) - 1.0,
        }
    }
}

/// The height of the strip on top.
pub(super) fn weave(place: [f32; 2], over: i32, width: f32, round: f32) -> f32 {
    let [x, y] = place;
    let (column, row) = (x.floor(), y.floor());
    let period = 2 * over;
    let across = |offset: f32| {
        let share = 2.0 * (offset - 0.5).abs() / width;
        (share < 1.0).then_some(1.0 - round * share * share)
    };
    let above = (column as i32 + row as i32).rem_euclid(period) < over;
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
}

/// Plaits side by side, each of strands that swing from side to side.
pub(super) fn braid(place: [f32; 2], strands: f32, pitch: f32, round: f32) -> f32 {
    let [x, y] = place;
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
}

pub(super) fn web(place: [f32; 2], seed: u32, rays: f32, sag: f32, thread: f32) -> f32 {
    let place = [place[0] / 6.0, place[1] / 6.0];
    let cell = nearest(place, seed, 1.0, Metric::Euclid);
    let [x, y] = cell.offset;
    let turns = libm::atan2f(y, x) / std::f32::consts::TAU;
    let jitter = gradient([rays * turns, 7.3], cell.bits);
    let ray = rays * turns + 0.25 * jitter;
    let between = ray - ray.floor() - 0.5;
    let radius = 6.0 * cell.first;
    // Threads across hang towards the centre, or away from it.
    let across = radius * (1.0 + sag * (0.25 - between * between) * 4.0);
    let ring = (across - across.floor() - 0.5).abs();
    let spoke = (0.5 - between.abs()) * std::f32::consts::TAU * radius / rays;
    let distance = (0.5 - ring).min(spoke);
    2.0 * within(thread, 0.5 * thread, distance) - 1.0
}

pub(super) fn strokes(
    place: [f32; 2],
    seed: u32,
    [length, width, spread]: [f32; 3],
    each: u32,
) -> f32 {
    let (column, row) = (place[0].floor() as i32, place[1].floor() as i32);
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
}

pub(super) fn leaves(place: [f32; 2], seed: u32, shape: Shape, layers: u32, gain: f32) -> f32 {
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
                let angle = std::f32::consts::TAU * unit(reseed(bits, 1));
                let size = 0.2 + 0.5 * unit(reseed(bits, 3));
                if shape.covers(turned(offset, angle), size) {
                    return 2.0 * unit(reseed(bits, 2)) - 1.0;
                }
            }
        }
        scale *= gain;
    }
    -1.0
}

impl Shape {
    fn covers(self, [x, y]: [f32; 2], size: f32) -> bool {
        match self {
            Self::Disc => x * x + y * y < size * size,
            Self::Square => x.abs().max(y.abs()) < 0.8 * size,
            Self::Long(ratio) => x * x + ratio * ratio * y * y < size * size,
        }
    }
}

pub(super) fn courses(place: [f32; 2], seed: u32, shift: f32, ratio: f32, round: f32) -> f32 {
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
}

/// Where a place lies in the sector of its tile that all others mirror.
pub(super) fn mirrored(place: [f32; 2], folds: u32) -> [f32; 2] {
    let place = place.map(|v| 0.5 * v);
    let mut inside = place.map(|v| 2.0 * (v - v.floor()) - 1.0);
    if folds < 4 {
        inside = inside.map(f32::abs);
        if folds == 3 && inside[1] > inside[0] {
            inside.swap(0, 1);
        }
    }
    inside
}

/// Steps after which a place is taken not to escape.
const ESCAPE_STEPS: u32 = 32;

pub(super) fn julia(place: [f32; 2], [cx, cy]: [f32; 2]) -> f32 {
    let [mut x, mut y] = place.map(|v| {
        // Mirrored, so that it goes on for ever.
        let tile = 0.25 * v;
        4.0 * (tile - tile.floor() - 0.5).abs() - 1.0
    });
    for step in 0..ESCAPE_STEPS {
        let square = x * x + y * y;
        if square > 16.0 {
            let smooth = step as f32 - libm::log2f(0.5 * libm::log2f(square));
            return wave(0.12 * smooth);
        }
        (x, y) = (x * x - y * y + cx, 2.0 * x * y + cy);
    }
    -1.0
}
