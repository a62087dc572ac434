//! What passes may take, and how a batch is shared by threads.

use std::time::Duration;

use crate::ops::bands::SPIN;

/// Multiply-adds of a layer that are worth one more thread: of one that is awake, and of one that sleeps.
const WORTH: [u64; 2] = [1 << 18, 1 << 23];

/// What passes may take of the rayon pool that they run in, and of memory. No embedding depends on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Resources {
    /// The most threads of a pass. Default: all of the pool.
    pub threads: usize,
    /// How long a thread stays awake that has nothing to do during a pass; then it sleeps, and is woken for what
    /// there is. [`Duration::ZERO`]: no thread stays awake, and small frames have one thread each. Default:
    /// 2 ms.
    pub spin: Duration,
    /// Bytes that are kept for passes to come: a pass that leaves more gives its memory back to the system. Default:
    /// no bound, so that each thread keeps what the largest image took until
    /// [`shrink`](super::Inference::shrink).
    pub memory: usize,
}

impl Default for Resources {
    fn default() -> Self {
        Self {
            threads: usize::MAX,
            spin: SPIN,
            memory: usize::MAX,
        }
    }
}

impl Resources {
    /// The threads of a pass on the pool that the caller is in.
    pub(super) fn of_pool(&self) -> usize {
        rayon::current_num_threads().min(self.threads).max(1)
    }

    /// The most threads that are worth sharing a frame, whose layers have so many multiply-adds each.
    pub(super) fn worth(&self, multiply_adds: u64) -> usize {
        let more = multiply_adds / WORTH[usize::from(self.spin.is_zero())];
        1 + usize::try_from(more).unwrap_or(usize::MAX - 1)
    }
}

/// Frames of a batch, and how many threads share the rows of each of their maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Share {
    pub(super) frames: usize,
    pub(super) threads: usize,
}

/// Shares a batch: what is worked on at once at first, and what then. `worth` is the most threads of a frame.
///
/// Every thread takes as many whole frames as all can. Those left over go to as many teams as have them done
/// soonest, where each thread more costs the others of its team 4 %, by estimate.
pub(super) fn shares(frames: usize, threads: usize, worth: usize) -> [Vec<Share>; 2] {
    let (each, left) = (frames / threads, frames % threads);
    let part = |whole: usize, parts: usize, i: usize| (i + 1) * whole / parts - i * whole / parts;
    let time = |&teams: &usize| {
        let threads = (threads / teams).min(worth);
        left.div_ceil(teams) * (24 + threads) * 1000 / threads
    };
    let teams = (1..=left).min_by_key(time).unwrap_or(0);
    let shares = |count, share: &dyn Fn(usize) -> Share| -> Vec<Share> {
        let shares = (0..count).map(share);
        shares.filter(|share| share.frames > 0).collect()
    };
    let alone = teams > 0 && (threads / teams).min(worth) == 1;
    let whole = shares(threads, &|i| Share {
        frames: each + usize::from(alone && i < left),
        threads: 1,
    });
    let together = shares(if alone { 0 } else { teams }, &|i| Share {
        frames: part(left, teams, i),
        threads: part(threads, teams, i).min(worth),
    });
    [whole, together]
}
