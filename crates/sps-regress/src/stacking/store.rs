//! Fitted stacks as safetensors: member `i` is there as `i`, u8, the file that it has by itself;
//! the metadata hold the rest as JSON.

use serde::{Deserialize, Serialize};

use super::{KIND, MOST_MEMBERS, TrainedStack, TrainedStacks};
use crate::archive::{Archive, Content, Contents};
use crate::error::Result;
use crate::plan::Trial;
use crate::regressor::{FittedRegressor, OtherKind, check_finite, fitted_within};

/// How deep stacks may hold others, themselves included: reading goes down as deep.
pub(crate) const MOST_DEPTH: usize = 8;

static FILE: Archive = Archive {
    what: "stacks",
    key: "sps-stacks",
    format: 1,
};

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Metadata {
    format: u32,
    /// How deep they hold others, themselves included.
    depth: usize,
    /// The kind of each member.
    members: Vec<String>,
    stacks: Vec<TrainedStack>,
}

/// The file's content, safetensors; stacks that hold others more than 8 deep are refused.
pub(super) fn to_bytes(stacks: &TrainedStacks) -> Result<Vec<u8>> {
    for TrainedStack { mean, weights, .. } in &stacks.stacks {
        check_finite(FILE.what, weights.iter().copied().chain([*mean]))?;
    }
    let mut metadata = Metadata {
        format: FILE.format,
        depth: 1,
        members: Vec::with_capacity(stacks.members.len()),
        stacks: stacks.stacks.clone(),
    };
    let mut contents = Vec::with_capacity(stacks.members.len());
    for (at, member) in stacks.members.iter().enumerate() {
        let bytes = member.to_bytes()?;
        if member.kind() == KIND {
            let (inner, _) = FILE.read::<Metadata>(&bytes)?;
            metadata.depth = metadata.depth.max(inner.depth + 1);
        }
        metadata.members.push(member.kind().to_owned());
        contents.push(Content::bytes(at.to_string(), bytes));
    }
    check_depth(metadata.depth, MOST_DEPTH)?;
    FILE.write(&metadata, &contents)
}

impl TrainedStacks {
    /// Reads what [`FittedRegressor::to_bytes`] gave of stacks that hold others at most so deep, themselves
    /// included; members may be of `others` too.
    pub(crate) fn from_bytes(depth: usize, bytes: &[u8], others: &[OtherKind]) -> Result<Self> {
        let (metadata, contents) = FILE.read::<Metadata>(bytes)?;
        check_depth(metadata.depth, depth)?;
        let count = metadata.members.len();
        if count == 0 || count > MOST_MEMBERS {
            let found = format_args!("{count} members");
            return Err(FILE.refused(found, format_args!("1 to {MOST_MEMBERS}")));
        }
        contents.check_count(count)?;
        for TrainedStack { mean, weights, .. } in &metadata.stacks {
            check_finite(FILE.what, [*mean])?;
            if weights.len() != count || weights.iter().any(|w| !(w.is_finite() && *w >= 0.0)) {
                let expected = format_args!("{count}, none below 0");
                return Err(FILE.refused(format_args!("weights {weights:?}"), expected));
            }
        }
        let mut members = Vec::with_capacity(count);
        for at in 0..count {
            members.push(read_member(&metadata, &contents, at, others)?);
        }
        Ok(Self {
            stacks: metadata.stacks,
            members,
        })
    }
}

/// A member, when it has a model for just those trials in which it has a weight.
fn read_member(
    metadata: &Metadata,
    contents: &Contents<'_>,
    at: usize,
    others: &[OtherKind],
) -> Result<Box<dyn FittedRegressor>> {
    let name = format!("member {at}");
    let bytes = contents.bytes(&at.to_string())?;
    let kind = &metadata.members[at];
    let member = fitted_within(metadata.depth - 1, kind, &name, bytes, others)?;
    let weighted = metadata.stacks.iter();
    let weighted = weighted.filter(|stack| stack.weights[at] > 0.0);
    let expected: Vec<&Trial> = weighted.map(|stack| &stack.trial).collect();
    let found = member.trials();
    if found != expected {
        return Err(FILE.refused(
            format_args!("{name} of {} trials", found.len()),
            format_args!("one of the {} in which it has a weight", expected.len()),
        ));
    }
    Ok(member)
}

/// Refuses a depth of 0, and one that is more than there may be.
fn check_depth(depth: usize, most: usize) -> Result<()> {
    if (1..=most).contains(&depth) {
        return Ok(());
    }
    Err(FILE.refused(
        format_args!("stacks {depth} deep"),
        format_args!("1 to {most} deep"),
    ))
}
