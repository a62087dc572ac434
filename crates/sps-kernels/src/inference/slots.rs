//! Where feature maps lie in memory.

use crate::network::{IMAGE, Map, Network};

/// A map of this share of the image's height is large: frames meet where maps become smaller.
const LARGE: usize = 8;

/// The slots of maps: a map that has been read leaves its own to others, to one like it where there is one, which
/// finds its border filled.
#[derive(Debug)]
pub(super) struct Slots {
    /// The slot of each map.
    pub(super) of: Vec<usize>,
    /// The first of the maps that each map shares its memory with, one after the other.
    pub(super) host: Vec<Map>,
    pub(super) count: usize,
    /// The map that frames of a group, having come so far one by one, go on from together.
    pub(super) meeting: Map,
}

impl Slots {
    pub(super) fn new(network: &Network) -> Self {
        let last_readers = network.last_readers();
        let strides = network.strides();
        let alike = |map: Map, other: Map| {
            (network.channels[map], strides[map]) == (network.channels[other], strides[other])
        };
        let (mut of, mut host) = (vec![0], vec![IMAGE]);
        // Maps whose slots are free.
        let (mut free, mut count) = (Vec::<Map>::new(), 1);
        for (number, layer) in network.layers.iter().enumerate() {
            // A branch is added where its shortcut lies.
            let (map, shortcut) = (number + 1, layer.shortcut());
            let freed = || match free.iter().rposition(|&other| alike(map, other)) {
                Some(like) => Some(free.remove(like)),
                None => free.pop(),
            };
            let slot = shortcut.or_else(freed).map(|map| of[map]);
            of.push(slot.unwrap_or_else(|| {
                count += 1;
                count - 1
            }));
            host.push(shortcut.map_or(map, |map| host[map]));
            let mut read: Vec<Map> = layer.inputs().collect();
            read.sort_unstable();
            read.dedup();
            read.retain(|&map| last_readers[map] == number && Some(map) != shortcut);
            free.extend(read);
        }
        Self {
            of,
            host,
            count,
            meeting: meeting(network),
        }
    }
}

/// The last map before maps are no longer large that is alone: all before it have been read.
fn meeting(network: &Network) -> Map {
    let strides = network.strides();
    let small = strides.iter().position(|&stride| stride > LARGE);
    let before = small.unwrap_or(strides.len());
    let mut alone = network.alone();
    alone.rfind(|&map| map < before).unwrap_or(IMAGE)
}
