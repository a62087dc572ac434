//! What a pattern repeats: families of formulas, each with parameters of its own.

use super::formulas::{
    braid, courses, julia, leaves, mirrored, stripes, strokes, wave, weave, web,
};
use super::noise::{Metric, octaves};
use crate::stream::Stream;

/// A function of the plane, about -1 to 1, with features of about unit length.
#[derive(Debug, Clone)]
pub(super) enum Motif {
    /// Noise of many scales.
    Cloud {
        octaves: u32,
        gain: f32,
        form: Form,
        stretch: f32,
    },
    /// Level lines of noise: marble, timber, zebras, labyrinths.
    Contours { lines: f32, octaves: u32, soft: f32 },
    /// One to three families of stripes.
    Stripes {
        angles: Vec<f32>,
        profile: Profile,
        waver: f32,
        joined: Joined,
    },
    /// Cells about the points of a lattice.
    Cells {
        jitter: f32,
        metric: Metric,
        seen: Seen,
    },
    /// Strips that pass over and under each other, `over` at a time.
    Weave { over: i32, width: f32, round: f32 },
    /// Strands about each other.
    Braid {
        strands: f32,
        pitch: f32,
        round: f32,
    },
    /// Threads from a centre, and threads across them.
    Web { rays: f32, sag: f32, thread: f32 },
    /// Hairs, scratches, straw.
    Strokes {
        length: f32,
        width: f32,
        spread: f32,
        each: u32,
    },
    /// Leaves that lie on each other (Lee, Mumford and Huang, IJCV 2001).
    Leaves {
        shape: Shape,
        layers: u32,
        gain: f32,
    },
    /// Rows of equal pieces: bricks, scales, shingles.
    Courses { shift: f32, ratio: f32, round: f32 },
    /// Noise in a cell, mirrored into its neighbours.
    Mirrored {
        folds: u32,
        octaves: u32,
        lines: f32,
    },
    /// The escape times of a Julia set.
    Julia { constant: [f32; 2] },
}

/// What is done to each octave of noise.
#[derive(Debug, Clone, Copy)]
pub(super) enum Form {
    Smooth,
    Billows,
    Ridges,
}

/// Across a stripe.
#[derive(Debug, Clone, Copy)]
pub(super) enum Profile {
    Wave,
    Saw,
    /// Bright over such a share of the period.
    Pulse(f32),
}

/// How several families of stripes are one.
#[derive(Debug, Clone, Copy)]
pub(super) enum Joined {
    Highest,
    Sum,
    Product,
}

/// What is seen of a cell.
#[derive(Debug, Clone, Copy)]
pub(super) enum Seen {
    /// A value of its own.
    Level,
    /// The distance to its point.
    Cone,
    /// Its edge.
    Edge(f32),
    /// A bump of such a radius, or a hole.
    Bump(f32),
    Ring(f32),
}

/// The outline of a leaf.
#[derive(Debug, Clone, Copy)]
pub(super) enum Shape {
    Disc,
    Square,
    /// An ellipse so many times as long as wide.
    Long(f32),
}

/// How many families there are.
const FAMILIES: usize = 12;

impl Motif {
    pub(super) fn draw(stream: &mut Stream) -> Self {
        let mut between = |lo: f64, hi: f64| stream.between(lo, hi) as f32;
        match between(0.0, FAMILIES as f64) as usize {
            0 => Self::Cloud {
                octaves: between(1.0, 7.0) as u32,
                gain: between(0.35, 0.8),
                form: match between(0.0, 3.0) as u32 {
                    0 => Form::Smooth,
                    1 => Form::Billows,
                    _ => Form::Ridges,
                },
                stretch: between(0.0, 3.0).max(1.0).powi(2),
            },
            1 => Self::Contours {
                lines: between(0.7, 4.0),
                octaves: between(1.0, 4.0) as u32,
                soft: between(0.02, 0.8),
            },
            2 => Self::Stripes {
                angles: {
                    let count = between(1.0, 4.0) as usize;
                    let spread = between(0.4, 1.6);
                    (0..count).map(|i| spread * i as f32).collect()
                },
                profile: match between(0.0, 3.0) as u32 {
                    0 => Profile::Wave,
                    1 => Profile::Saw,
                    _ => Profile::Pulse(between(0.15, 0.7)),
                },
                waver: between(-0.15, 0.5).max(0.0),
                joined: match between(0.0, 3.0) as u32 {
                    0 => Joined::Highest,
                    1 => Joined::Sum,
                    _ => Joined::Product,
                },
            },
            3 => Self::Cells {
                jitter: between(0.0, 1.2).min(1.0),
                metric: match between(0.0, 4.0) as u32 {
                    0 => Metric::Blocks,
                    1 => Metric::Chess,
                    _ => Metric::Euclid,
                },
                seen: match between(0.0, 6.0) as u32 {
                    0 => Seen::Level,
                    1 => Seen::Cone,
                    2 => Seen::Edge(between(0.03, 0.2)),
                    3 => Seen::Ring(between(0.2, 0.45)),
                    _ => Seen::Bump(between(0.2, 0.5)),
                },
            },
            4 => Self::Weave {
                over: between(1.0, 4.0) as i32,
                width: between(0.6, 1.0),
                round: between(0.0, 1.0),
            },
            5 => Self::Braid {
                strands: between(2.0, 5.0).floor(),
                pitch: between(0.6, 2.0),
                round: between(0.3, 1.0),
            },
            6 => Self::Web {
                rays: between(6.0, 25.0).floor(),
                sag: between(-0.3, 0.3),
                thread: between(0.02, 0.12),
            },
            7 => Self::Strokes {
                length: between(0.4, 1.4),
                width: between(0.015, 0.1),
                spread: between(0.0, 1.6),
                each: between(1.0, 4.0) as u32,
            },
            8 => Self::Leaves {
                shape: match between(0.0, 3.0) as u32 {
                    0 => Shape::Disc,
                    1 => Shape::Square,
                    _ => Shape::Long(between(1.5, 5.0)),
                },
                layers: between(3.0, 8.0) as u32,
                gain: between(1.1, 1.5),
            },
            9 => Self::Courses {
                shift: between(0.0, 0.75).min(0.5),
                ratio: between(0.5, 3.0),
                round: between(0.0, 1.0),
            },
            10 => Self::Mirrored {
                folds: between(2.0, 5.0) as u32,
                octaves: between(1.0, 4.0) as u32,
                lines: between(0.0, 3.0),
            },
            _ => Self::Julia {
                constant: {
                    let (radius, angle) = (between(0.6, 0.9), between(0.0, std::f64::consts::TAU));
                    [radius * libm::cosf(angle), radius * libm::sinf(angle)]
                },
            },
        }
    }

    /// The value at a place, of the pattern that such a seed makes.
    pub(super) fn at(&self, place: [f32; 2], seed: u32) -> f32 {
        match *self {
            Self::Cloud {
                octaves: count,
                gain,
                form,
                stretch,
            } => {
                let place = [place[0] / stretch, place[1]];
                octaves(place, seed, count, gain, |v| form.of(v))
            }
            Self::Contours {
                lines,
                octaves: count,
                soft,
            } => {
                let height = octaves([0.5 * place[0], 0.5 * place[1]], seed, count, 0.5, |v| v);
                let wave = wave(lines * height);
                (wave / soft).clamp(-1.0, 1.0)
            }
            Self::Stripes {
                ref angles,
                profile,
                waver,
                joined,
            } => stripes(place, seed, angles, profile, waver, joined),
            Self::Cells {
                jitter,
                metric,
                seen,
            } => seen.of(place, seed, jitter, metric),
            Self::Weave { over, width, round } => weave(place, over, width, round),
            Self::Braid {
                strands,
                pitch,
                round,
            } => braid(place, strands, pitch, round),
            Self::Web { rays, sag, thread } => web(place, seed, rays, sag, thread),
            Self::Strokes {
                length,
                width,
                spread,
                each,
            } => strokes(place, seed, [length, width, spread], each),
            Self::Leaves {
                shape,
                layers,
                gain,
            } => leaves(place, seed, shape, layers, gain),
            Self::Courses {
                shift,
                ratio,
                round,
            } => courses(place, seed, shift, ratio, round),
            Self::Mirrored {
                folds,
                octaves: count,
                lines,
            } => {
                let value = octaves(mirrored(place, folds), seed, count, 0.6, |v| v);
                if lines < 1.0 {
                    value
                } else {
                    wave(lines * value)
                }
            }
            Self::Julia { constant } => julia(place, constant),
        }
    }
}
