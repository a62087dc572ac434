//! The way back through an activation, against its definition.

use super::*;
use crate::ops::activated::activation_gradient;

const CHANNELS: usize = 34;

/// A map of as many channels as it has, with a border, that holds what an activation leaves: some at its limits.
fn activated<W: Real>(grid: &Grid, activation: Activation) -> Vec<W> {
    let [least, most] = activation.limits().map(f64::from);
    let values = noise(grid.frames * pixels(grid.size) * grid.channels, 1);
    let values = values.iter().map(|x| (9.0 * x).clamp(least, most));
    laid_out(&values.collect::<Vec<_>>(), grid, 0.0)
}

fn check<W: Real>(level: Level, activation: Activation) {
    // Channels of a wider map, from the second word on.
    let whole = Grid::tight(2, [2, 5, 4], CHANNELS + 2 * W::NUMBERS).of::<W>();
    let whole = whole.padded(&Window::square(3, 1, 1));
    let to = Grid::tight(2, [2, 5, 4], CHANNELS).of::<W>();
    let to = to.padded(&Window::square(5, 1, 2));
    let numbers = activated::<W>(&whole, activation);
    let gradient = noise(whole.bare().len() * W::NUMBERS, 2);
    let gradient = gradient.chunks_exact(W::NUMBERS);
    let gradient: Vec<W> = gradient.map(|g| W::of(|i| g[i] as f32)).collect();
    let border = W::of(|_| 7.0);
    let run = || {
        let mut target = vec![border; to.len()];
        let ends = ((&numbers[1..], &whole), (&mut target[..], &to));
        let sums = activation_gradient(level, activation, ends.0, &gradient[1..], ends.1);
        (target, sums)
    };
    let (target, sums) = run();
    let mut expected = (vec![border; to.len()], vec![0.0; CHANNELS]);
    let [least, most] = activation.limits();
    let places = whole.places().into_iter().zip(to.places()).enumerate();
    for (pixel, (from, place)) in places {
        for channel in 0..CHANNELS {
            let y = W::widened(W::each(&numbers[from + 1..])[channel]);
            let g = W::each(&gradient[pixel * whole.pitch + 1..])[channel];
            let passes = least < y && y < most;
            let g = if passes { W::widened(g) } else { 0.0 };
            W::each_mut(&mut expected.0[place..])[channel] = W::narrowed(g);
            expected.1[channel] += f64::from(g);
        }
    }
    let [found, wanted] = [&target, &expected.0].map(|map| bytemuck::cast_slice::<W, u8>(map));
    assert_eq!(found, wanted);
    for (sum, expected) in sums.iter().zip(&expected.1) {
        assert!((sum - expected).abs() < 1e-6, "{sum} for {expected}");
    }
    for threads in [1, 3] {
        assert_eq!(by(threads, run).1, sums);
    }
}

#[test]
fn what_did_not_pass_has_no_gradient() {
    Level::on_each(|level| {
        for activation in [Activation::Identity, Activation::Relu, Activation::Relu6] {
            check::<f32>(level, activation);
            check::<Bf16Pair>(level, activation);
        }
    });
}
