//! What passes take of a pool and of memory.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use super::resources::{Share, shares};
use super::{Inference, Resources};
use crate::images::{Images, Normalisation, Order};
use crate::networks::squeezenet1_1;
use crate::ops::simd::Level;
use crate::ops::tests::by;
use crate::precision::Precision;

/// Frames and threads of each share, what is done first and what then.
fn shared(frames: usize, threads: usize, worth: usize) -> [Vec<(usize, usize)>; 2] {
    let pair = |share: Share| (share.frames, share.threads);
    shares(frames, threads, worth).map(|shares| shares.into_iter().map(pair).collect())
}

#[test]
fn frames_are_shared_by_what_the_pool_has() {
    let many = usize::MAX;
    let whole = |frames: usize, threads: usize| vec![(frames, 1); threads];
    assert_eq!(shared(1, 16, many), [vec![], vec![(1, 16)]]);
    assert_eq!(shared(15, 16, many), [whole(1, 15), vec![]]);
    assert_eq!(shared(16, 16, many), [whole(1, 16), vec![]]);
    assert_eq!(shared(17, 16, many), [whole(1, 16), vec![(1, 16)]]);
    let uneven = |most| [whole(2, most), whole(1, 1)].concat();
    assert_eq!(shared(31, 16, many), [uneven(15), vec![]]);
    assert_eq!(shared(255, 128, many)[0], uneven(127));
    assert_eq!(shared(4, 16, many), [vec![], vec![(1, 4); 4]]);
    let thirds = vec![(1, 5), (1, 5), (1, 6)];
    assert_eq!(shared(3, 16, many), [vec![], thirds]);
    // Three threads that work and one that does not take longer than four that share rows.
    assert_eq!(shared(3, 4, many), [vec![], vec![(3, 4)]]);
    assert_eq!(shared(9, 2, many), [whole(4, 2), vec![(1, 2)]]);
    // Frames that are too small to be shared.
    assert_eq!(shared(1, 16, 1), [whole(1, 1), vec![]]);
    assert_eq!(shared(1, 16, 3), [vec![], vec![(1, 3)]]);
    assert_eq!(shared(0, 16, many), [vec![], vec![]]);
}

#[test]
fn every_frame_is_shared_once() {
    for (threads, worth) in [(1, 9), (2, 1), (3, 2), (16, 4), (16, 99), (128, 99)] {
        for frames in 0..4 * threads {
            let all = shares(frames, threads, worth);
            let sum = |f: fn(&Share) -> usize, some: &[Share]| some.iter().map(f).sum::<usize>();
            assert_eq!(sum(|s| s.frames, &all.concat()), frames);
            for some in &all {
                assert!(sum(|s| s.threads, some) <= threads);
            }
        }
    }
}

fn squeezenet() -> Inference {
    let network = squeezenet1_1("squeezenet1-1");
    let specs = network.specs().into_iter();
    let tensors: BTreeMap<String, Vec<f32>> = specs
        .map(|spec| (spec.name, vec![0.01; spec.shape.iter().product()]))
        .collect();
    let level = Level::detect();
    Inference::new(&network, &tensors, Precision::F32, None, level).unwrap()
}

fn embed(inference: &Inference, frames: usize, [height, width]: [usize; 2]) -> Vec<f32> {
    let image = vec![0.5; 3 * height * width];
    let images = vec![&image[..]; frames];
    let size = [1, height, width];
    let images = Images::new(&images, Order::Pixels, size, Normalisation::NONE);
    inference.embed(&images.unwrap()).unwrap()
}

/// What passes may take, but so long for spinning.
fn spinning(spin: Duration) -> Resources {
    Resources {
        spin,
        ..Resources::default()
    }
}

#[test]
fn no_embedding_depends_on_resources() {
    let inference = squeezenet();
    let expected = by(1, || embed(&inference, 1, [64, 64]));
    for (threads, spin, memory) in [(16, 0, 0), (16, 2, usize::MAX), (3, 0, 1 << 20)] {
        let mut resources = spinning(Duration::from_millis(spin));
        (resources.threads, resources.memory) = (threads, memory);
        let inference = inference.clone().with_resources(resources);
        for frames in [1, 3, 15, 17] {
            let found = by(16, || embed(&inference, frames, [64, 64]));
            assert!(found == expected.repeat(frames));
        }
    }
}

#[test]
fn many_callers_leave_one_workspace_for_each_thread() {
    let inference = squeezenet();
    embed(&inference, 1, [64, 64]);
    let one = inference.idle_bytes();
    std::thread::scope(|scope| {
        for _ in 0..64 {
            scope.spawn(|| (0..10).for_each(|_| drop(embed(&inference, 1, [64, 64]))));
        }
    });
    let most = rayon::current_num_threads() * one;
    assert!((one..=most).contains(&inference.idle_bytes()));
}

#[test]
fn memory_is_given_back() {
    let inference = squeezenet();
    embed(&inference, 1, [300, 400]);
    assert!(inference.idle_bytes() > 0);
    inference.shrink();
    assert_eq!(inference.idle_bytes(), 0);
    let memory = 1 << 20;
    let inference = inference.with_resources(Resources {
        memory,
        ..Resources::default()
    });
    embed(&inference, 1, [300, 400]);
    assert_eq!(inference.idle_bytes(), 0);
    embed(&inference, 1, [32, 32]);
    assert!((1..=memory).contains(&inference.idle_bytes()));
}

/// Ticks of processor time and pages of memory of this process.
fn used() -> [f64; 2] {
    let read = |file: &str| std::fs::read_to_string(file).unwrap();
    let number = |text: &str, at: usize| -> f64 {
        text.split_whitespace().nth(at).unwrap().parse().unwrap()
    };
    let stat = read("/proc/self/stat");
    let stat = stat.rsplit(')').next().unwrap();
    let pages = number(&read("/proc/self/statm"), 1);
    [number(stat, 11) + number(stat, 12), pages]
}

#[test]
#[ignore = "measures the process: by itself, on Linux"]
fn a_small_frame_takes_one_core_and_shrink_gives_memory_back() {
    let inference = squeezenet();
    for spin in [Resources::default().spin, Duration::ZERO] {
        let inference = inference.clone().with_resources(spinning(spin));
        let ratio = by(16, || {
            let ([before, _], start) = (used(), Instant::now());
            while start.elapsed() < Duration::from_secs(3) {
                embed(&inference, 1, [64, 64]);
            }
            (used()[0] - before) / 100.0 / start.elapsed().as_secs_f64()
        });
        println!("spinning for {spin:?}: processor time over time {ratio:.2}");
        assert!(!spin.is_zero() || ratio <= 1.2);
    }
    let at = |when: &str| {
        let (idle, pages) = (inference.idle_bytes() >> 20, used()[1]);
        let resident = pages / 256.0;
        println!("{when}: {idle} MiB idle, {resident:.0} MiB resident");
        pages
    };
    let before = at("before");
    embed(&inference, 1, [3000, 4000]);
    at("after an image of 12 megapixels");
    inference.shrink();
    assert!(at("after shrink") < before + 64.0 * 256.0);
}
