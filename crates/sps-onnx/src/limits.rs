//! What is checked of a file before rten reads it. That takes memory by the lengths that a file says, calls
//! itself for each graph within a graph, and computes with whatever sizes the file has.

use std::collections::BTreeMap;

/// Fields of all messages together; the networks that people use have some thousands.
const MOST_FIELDS: usize = 4 << 20;
/// The largest whole number in a network: an extent, a count of places.
const LARGEST: u64 = 1 << 14;
/// Operators whose numbers may be larger: none makes more of what it is given.
const NOT_ENLARGING: [&[u8]; 3] = [b"Slice", b"Reshape", b"Gather"];

/// The messages of `onnx.proto` that rten reads.
#[derive(Clone, Copy, PartialEq)]
enum Message {
    Model,
    Graph,
    Node,
    Attribute,
    Tensor,
    Value,
    Type,
    TensorType,
    Shape,
    /// One without messages in it.
    Last,
}

impl Message {
    /// The message in a field.
    fn inside(self, field: u64) -> Result<Option<Self>, String> {
        Ok(Some(match (self, field) {
            (Self::Model, 7) => Self::Graph,
            (Self::Graph, 1) => Self::Node,
            (Self::Graph | Self::Attribute, 5) => Self::Tensor,
            (Self::Graph, 11..=13) => Self::Value,
            (Self::Node, 5) => Self::Attribute,
            (Self::Value, 2) => Self::Type,
            (Self::Type, 1) => Self::TensorType,
            (Self::TensorType, 2) => Self::Shape,
            (Self::Model, 14) | (Self::Tensor, 13) | (Self::Shape, 1) => Self::Last,
            (Self::Attribute, 6) => {
                let expected = "expected none (If, Loop and Scan have one)";
                return Err(format!("found a graph within a graph, {expected}"));
            }
            (Self::Type, 4) => return Err("found a sequence, expected tensors alone".to_owned()),
            _ => return Ok(None),
        }))
    }
}

/// Refuses a file that is no ONNX model, in which a length goes beyond what it is in, that has more or deeper
/// parts than a network needs, or larger whole numbers.
pub(crate) fn check(bytes: &[u8]) -> Result<(), String> {
    let mut walk = Walk::default();
    walk.message(Message::Model, bytes)?;
    if walk.nodes.is_empty() {
        return Err("not an ONNX file: found no operator".to_owned());
    }
    let nodes = walk.nodes.iter();
    for node in nodes.filter(|node| !NOT_ENLARGING.contains(&node.name)) {
        let large = node.inputs.iter().filter_map(|input| walk.large.get(input));
        let largest = large.fold(node.largest, |largest, number| largest.max(*number));
        if largest > LARGEST {
            let operator = String::from_utf8_lossy(node.name);
            return Err(format!(
                "{operator}: found the number {largest}, expected at most {LARGEST}"
            ));
        }
    }
    Ok(())
}

#[derive(Default)]
struct Walk<'a> {
    fields: usize,
    nodes: Vec<Part<'a>>,
    /// The constants with too large a whole number.
    large: BTreeMap<&'a [u8], u64>,
}

impl<'a> Walk<'a> {
    fn message(&mut self, message: Message, mut bytes: &'a [u8]) -> Result<Part<'a>, String> {
        let mut part = Part::default();
        while !bytes.is_empty() {
            self.fields += 1;
            if self.fields > MOST_FIELDS {
                return Err(format!("found more than {MOST_FIELDS} parts"));
            }
            let field = Field::read(&mut bytes)?;
            part.take(message, &field)?;
            let inside = message.inside(field.number)?;
            let Some(inside) = inside.filter(|_| field.value.is_none()) else {
                continue;
            };
            let found = self.message(inside, field.content)?;
            match inside {
                Message::Node if found.name == b"Constant" => {
                    self.know(found.output, found.largest);
                }
                Message::Node => self.nodes.push(found),
                Message::Tensor if message == Message::Graph => {
                    self.know(found.name, found.largest);
                }
                _ => part.largest = part.largest.max(found.largest),
            }
        }
        part.add_raw();
        Ok(part)
    }

    /// Remembers a constant with a large number.
    fn know(&mut self, name: &'a [u8], largest: u64) {
        if largest > LARGEST {
            self.large.insert(name, largest);
        }
    }
}

/// A field of a message.
struct Field<'a> {
    number: u64,
    /// Of one that is a number.
    value: Option<u64>,
    /// Of any other.
    content: &'a [u8],
}

impl<'a> Field<'a> {
    fn read(bytes: &mut &'a [u8]) -> Result<Self, String> {
        let tag = varint(bytes)?;
        let (value, length) = match tag & 7 {
            0 => (Some(varint(bytes)?), 0),
            1 => (None, 8),
            2 => (None, varint(bytes)?),
            5 => (None, 4),
            other => return Err(format!("not an ONNX file: found a field of type {other}")),
        };
        let length = usize::try_from(length).ok();
        let content = length.and_then(|length| bytes.split_off(..length));
        Ok(Self {
            number: tag >> 3,
            value,
            content: content.ok_or_else(cut)?,
        })
    }
}

/// What is kept of an operator, an attribute or a tensor.
#[derive(Default)]
struct Part<'a> {
    /// The tensor's, or that of the operator's kind.
    name: &'a [u8],
    inputs: Vec<&'a [u8]>,
    output: &'a [u8],
    /// The type of a tensor's numbers, and their bytes.
    kind: u64,
    raw: &'a [u8],
    /// The largest of its whole numbers.
    largest: u64,
}

impl<'a> Part<'a> {
    fn take(&mut self, message: Message, field: &Field<'a>) -> Result<(), String> {
        let content = field.content;
        match (message, field.number) {
            (Message::Tensor, 2) => self.kind = field.value.unwrap_or(0),
            (Message::Tensor, 9) => self.raw = content,
            (Message::Tensor, 14) if field.value == Some(1) => {
                let expected = "expected them in it: export with `external_data=False`";
                return Err(format!(
                    "found weights that lie in another file, {expected}"
                ));
            }
            (Message::Tensor, 8) | (Message::Node, 4) => self.name = content,
            (Message::Node, 1) => self.inputs.push(content),
            (Message::Node, 2) => self.output = content,
            (Message::Tensor, 5 | 7) | (Message::Attribute, 3 | 8) => {
                let mut packed = content;
                self.add(field.value.unwrap_or(0) as i64);
                while !packed.is_empty() {
                    self.add(varint(&mut packed)? as i64);
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Adds the numbers of a tensor of i32 or i64.
    fn add_raw(&mut self) {
        match self.kind {
            6 => {
                for word in self.raw.as_chunks::<4>().0 {
                    self.add(i32::from_le_bytes(*word).into());
                }
            }
            7 => {
                for word in self.raw.as_chunks::<8>().0 {
                    self.add(i64::from_le_bytes(*word));
                }
            }
            _ => {}
        }
    }

    fn add(&mut self, number: i64) {
        self.largest = self.largest.max(number.unsigned_abs());
    }
}

/// A number of Protocol Buffers: seven bits a byte, the lowest first.
fn varint(bytes: &mut &[u8]) -> Result<u64, String> {
    let mut value = 0;
    for shift in (0..64).step_by(7) {
        let byte = *bytes.split_off_first().ok_or_else(cut)?;
        value |= u64::from(byte & 0x7f) << shift;
        if byte < 0x80 {
            return Ok(value);
        }
    }
    Err("not an ONNX file: found a number of more than 64 bits".to_owned())
}

fn cut() -> String {
    "not an ONNX file, or one that is cut off".to_owned()
}
