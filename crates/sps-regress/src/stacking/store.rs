//! Fitted stacks as safetensors: member `i` is there as `i`, u8, the file that it has by itself;
//! the metadata hold the rest as JSON.

use serde::{Deserialize, Serialize};

use super::{MOST_MEMBERS, TrainedStack, TrainedStacks};
use crate::archive::{Archive, Content, Contents};
use crate::error::Result;
use crate::plan::Trial;
use crate::regressor::{FittedRegressor, OtherKind, STACKS, check_finite, fitted_within};

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

impl TrainedStacks {
    /// The file's content, safetensors; the same stacks give the same bytes.
    ///
    /// # Errors
    ///
    /// A number that is not finite; members of a kind that is not kept; stacks that hold others
    /// more than 8 deep.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        for TrainedStack { mean, weights, .. } in &self.stacks {
            check_finite(FILE.what, weights.iter().copied().chain([*mean]))?;
        }
        let mut metadata = Metadata {
            format: FILE.format,
            depth: 1,
            members: Vec::with_capacity(self.members.len()),
            stacks: self.stacks.clone(),
        };
        let mut contents = Vec::with_capacity(self.members.len());
        for (at, member) in self.members.iter().enumerate() {
            let bytes = member.to_bytes()?;
            if member.kind() == STACKS {
                let (inner, _) = FILE.read::<Metadata>(&bytes)?;
                metadata.depth = metadata.depth.max(inner.depth + 1);
            }
            metadata.members.push(member.kind().to_owned());
            contents.push(Content::bytes(at.to_string(), bytes));
        }
        check_depth(metadata.depth, MOST_DEPTH)?;
        FILE.write(&metadata, &contents)
    }

    /// Reads what [`TrainedStacks::to_bytes`] gave; members may be of `others` too.
    ///
    /// # Errors
    ///
    /// Bytes that are not fitted stacks of this format, or members that are not what the file says.
    pub fn from_bytes(bytes: &[u8], others: &[OtherKind]) -> Result<Self> {
        Self::from_bytes_within(MOST_DEPTH, bytes, others)
    }

    /// The same, of stacks that hold others at most so deep, themselves included.
    pub(crate) fn from_bytes_within(
        depth: usize,
        bytes: &[u8],
        others: &[OtherKind],
    ) -> Result<Self> {
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
    let weighted = metadata
        .stacks
        .iter()
        .filter(|stack| stack.weights[at] > 0.0);
    let expected: Vec<&Trial> = weighted.map(TrainedStack::trial).collect();
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
