use std::collections::BTreeSet;

use exr::math::Vec2;
use exr::meta::attribute::SampleType;
use exr::meta::header::Header;

use super::super::FrameErrorKind;
use super::unsupported;

/// Which channels, as indices in their part's list, make the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Picture {
    /// R, G, B.
    Rgb([usize; 3]),
    /// Y alone: grey.
    Luminance(usize),
    /// Y with RY = (R - Y) / Y and BY = (B - Y) / Y, the latter two subsampled alike.
    LuminanceChroma {
        y: usize,
        ry: usize,
        by: usize,
        sampling: Vec2<usize>,
    },
}

/// Where a channel goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Slot {
    /// One of the three of a pixel; luminance is the middle one.
    Colour(usize),
    /// The plane of RY (0) or of BY (1).
    Chroma(usize),
}

impl Picture {
    /// Where the channel of that index goes, if anywhere.
    pub(super) fn slot(&self, channel: usize) -> Option<Slot> {
        let at = |channels: &[usize]| channels.iter().position(|&wanted| wanted == channel);
        match *self {
            Self::Rgb(channels) => at(&channels).map(Slot::Colour),
            Self::Luminance(y) => at(&[y]).map(|_| Slot::Colour(1)),
            Self::LuminanceChroma { y, .. } if y == channel => Some(Slot::Colour(1)),
            Self::LuminanceChroma { ry, by, .. } => at(&[ry, by]).map(Slot::Chroma),
        }
    }

    /// Whether every sample of the picture is a half as it was stored.
    pub(super) fn is_all_half(&self, header: &Header) -> bool {
        let list = &header.channels.list;
        let half = |&channel: &usize| list[channel].sample_type == SampleType::F16;
        match self {
            Self::Rgb(channels) => channels.iter().all(half),
            Self::Luminance(y) => half(y),
            Self::LuminanceChroma { .. } => false,
        }
    }
}

/// A layer that has a picture.
struct Candidate {
    part: usize,
    /// That of its part, what stands before its channels' names, or both.
    name: String,
    /// What stands before the channels' names; empty for the unnamed layer of a part.
    prefix: String,
    picture: Picture,
}

/// Finds the part and the channels to read.
///
/// A layer is a part of that name, the channels `layer.R` and so on, or both as `part.layer`.
/// Where none is asked for, it is the first without a prefix, else the only one.
pub(super) fn choose(
    headers: &[Header],
    layer: Option<&str>,
) -> Result<(usize, Picture), FrameErrorKind> {
    let candidates = candidates(headers)?;
    let is_asked_for = |one: &&Candidate| match layer {
        Some(layer) => one.name == layer || (!layer.is_empty() && one.prefix == layer),
        None => candidates.len() == 1 || one.prefix.is_empty(),
    };
    let chosen = candidates.iter().find(is_asked_for);
    let chosen = chosen.ok_or_else(|| absent(headers, &candidates, layer))?;
    Ok((chosen.part, chosen.picture))
}

fn candidates(headers: &[Header]) -> Result<Vec<Candidate>, FrameErrorKind> {
    let mut candidates = Vec::new();
    for (part, header) in headers.iter().enumerate() {
        let part_name = header.own_attributes.layer_name.as_ref();
        let part_name = part_name.map(ToString::to_string).unwrap_or_default();
        let prefixes = names(header).map(|name| prefix(&name).to_owned());
        for prefix in prefixes.collect::<BTreeSet<_>>() {
            if let Some(picture) = picture(header, &prefix)? {
                let name = match (part_name.as_str(), prefix.as_str()) {
                    ("", name) | (name, "") => name.to_owned(),
                    (part, prefix) => format!("{part}.{prefix}"),
                };
                candidates.push(Candidate {
                    part,
                    name,
                    prefix,
                    picture,
                });
            }
        }
    }
    Ok(candidates)
}

fn names(header: &Header) -> impl Iterator<Item = String> {
    let channels = header.channels.list.iter();
    channels.map(|channel| channel.name.to_string())
}

fn prefix(name: &str) -> &str {
    name.rsplit_once('.').map_or("", |(prefix, _)| prefix)
}

/// The picture that the channels with this prefix make, if any.
fn picture(header: &Header, prefix: &str) -> Result<Option<Picture>, FrameErrorKind> {
    let find = |base: &str| {
        let wanted = if prefix.is_empty() {
            base.to_owned()
        } else {
            format!("{prefix}.{base}")
        };
        names(header).position(|name| name == wanted)
    };
    let sampling = |channel: usize| header.channels.list[channel].sampling;
    let full = |channels: &[usize]| channels.iter().all(|&c| sampling(c) == Vec2(1, 1));
    match (find("R"), find("G"), find("B")) {
        (Some(r), Some(g), Some(b)) if full(&[r, g, b]) => {
            return Ok(Some(Picture::Rgb([r, g, b])));
        }
        (Some(_), Some(_), Some(_)) => return Err(unsupported("subsampled R, G or B")),
        _ => {}
    }
    match (find("Y"), find("RY"), find("BY")) {
        (Some(y), _, _) if !full(&[y]) => Err(unsupported("subsampled luminance")),
        (Some(y), None, None) => Ok(Some(Picture::Luminance(y))),
        (Some(y), Some(ry), Some(by)) => {
            let sampling = sampling(ry);
            let alike = sampling == header.channels.list[by].sampling;
            if !alike || ![Vec2(1, 1), Vec2(2, 2)].contains(&sampling) {
                let reason = "chroma that is subsampled otherwise than 2 x 2";
                return Err(unsupported(reason));
            }
            Ok(Some(Picture::LuminanceChroma {
                y,
                ry,
                by,
                sampling,
            }))
        }
        _ => Ok(None),
    }
}

fn absent(headers: &[Header], candidates: &[Candidate], layer: Option<&str>) -> FrameErrorKind {
    let found: Vec<_> = headers.iter().flat_map(names).collect();
    let layers = candidates.iter().map(|one| format!("`{}`", one.name));
    let layers = layers.collect::<Vec<_>>().join(", ");
    let expected = match layer {
        _ if layers.is_empty() => "R, G and B, or Y, or Y, RY and BY".to_owned(),
        Some(layer) => format!("the layer `{layer}` to be one of {layers}"),
        None => format!("`exr-layer` to say which of {layers}"),
    };
    let found = found.join(", ");
    FrameErrorKind::Invalid(format!("has the channels {found}; expected {expected}"))
}
