//! A pickle reader that can only build tensors.
//!
//! A pickle is a program; this is the part of its language that a saved dictionary of tensors
//! uses. Every other instruction, and every name that is not in [`Global`], is refused where it
//! stands. Nothing is ever called, and what the program builds lies flat in lists and is counted, so
//! that neither depth nor a claimed size costs more than the program's own bytes.

use std::collections::BTreeMap;

use super::value::{Global, Heap, Value};
use crate::WeightsErrorKind;

/// The longest pickle that is read, in bytes: a network of ten thousand tensors takes one.
const LONGEST: usize = 4 << 20;

/// The most values that are held at once, on the stack, in the memo and within others: each takes up to
/// fifty times its bytes in the file.
const MOST_VALUES: usize = 2_100_000;

/// Runs the pickle that begins at `at`, which is moved to its end; returns what it leaves. What has parts
/// lies in `heap`.
pub(super) fn run(
    bytes: &[u8],
    at: &mut usize,
    heap: &mut Heap,
) -> Result<Value, WeightsErrorKind> {
    let mut machine = Machine {
        bytes: &bytes[..bytes.len().min(*at + LONGEST)],
        at: *at,
        stack: Vec::new(),
        memo: BTreeMap::new(),
        heap,
    };
    loop {
        let offset = machine.at;
        let step = machine.step().and_then(|last| {
            let held = machine.stack.len() + machine.memo.len() + machine.heap.values();
            let many = || format!("more than {MOST_VALUES} values");
            (held <= MOST_VALUES).then_some(last).ok_or_else(many)
        });
        let refused = |found| WeightsErrorKind::Pickle { offset, found };
        if let Some(value) = step.map_err(refused)? {
            *at = machine.at;
            return Ok(value);
        }
    }
}

/// What was read, or what is refused, in words.
type Parsed<T> = Result<T, String>;

struct Machine<'a> {
    bytes: &'a [u8],
    at: usize,
    stack: Vec<Value>,
    memo: BTreeMap<u32, Value>,
    heap: &'a mut Heap,
}

impl<'a> Machine<'a> {
    /// One instruction; the result, when it was the last.
    fn step(&mut self) -> Parsed<Option<Value>> {
        let opcode = self.byte()?;
        let value = match opcode {
            b'.' => return self.pop().map(Some),
            b'(' => Value::Mark,
            b'N' => Value::None,
            0x88 | 0x89 => Value::Bool(opcode == 0x88),
            b'J' => Value::Int(self.unsigned(4)?.cast_signed().into()),
            b'K' => Value::Int(self.unsigned(1)?.into()),
            b'M' => Value::Int(self.unsigned(2)?.into()),
            0x8a => self.long()?,
            b'X' => self.text(4)?,
            b'U' | 0x8c => self.text(1)?,
            b')' => self.heap.tuple(Vec::new()),
            b't' => {
                let items = self.pop_to_mark()?;
                self.heap.tuple(items)
            }
            0x85..=0x87 => {
                let items = self.pop_last(usize::from(opcode - 0x84))?;
                self.heap.tuple(items)
            }
            b'}' => self.heap.dictionary(),
            b']' => self.heap.list(),
            b'h' => self.recall(1)?,
            b'j' => self.recall(4)?,
            b'c' | 0x93 => self.global(opcode)?,
            b'Q' => {
                let id = self.pop()?;
                self.heap.storage(id)?
            }
            b'R' => self.reduce()?,
            other => return self.change(other).map(|()| None),
        };
        self.stack.push(value);
        Ok(None)
    }

    /// One instruction that adds no value to the stack.
    fn change(&mut self, opcode: u8) -> Parsed<()> {
        match opcode {
            0x80 => match self.byte()? {
                2..=5 => {}
                other => return Err(format!("protocol {other}, expected 2 to 5")),
            },
            // The length of what follows: a hint.
            0x95 => {
                self.take(8)?;
            }
            b'a' | b'e' => {
                let items = self.items(opcode == b'e', 1)?;
                let Some(&Value::List(list)) = self.stack.last() else {
                    return Err("items for what is no list".to_owned());
                };
                self.heap.extend(list, items);
            }
            b's' | b'u' => self.set(opcode == b'u')?,
            b'q' | b'r' | 0x94 => {
                let key = match opcode {
                    b'q' => self.unsigned(1)?,
                    b'r' => self.unsigned(4)?,
                    _ => self.memo.len() as u32,
                };
                let value = self.pop()?;
                self.stack.push(value);
                self.memo.insert(key, value);
            }
            // PyTorch notes versions beside the dictionary; they are not used.
            b'b' => match (self.pop()?, self.stack.last()) {
                (Value::Dictionary(_), Some(Value::Dictionary(_))) => {}
                _ => return Err("a state for what is no dictionary".to_owned()),
            },
            other => return Err(unknown(other)),
        }
        Ok(())
    }

    fn take(&mut self, len: usize) -> Parsed<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        let beyond = || format!("{len} bytes where {} are left", rest.len());
        let taken = rest.get(..len).ok_or_else(beyond)?;
        self.at += len;
        Ok(taken)
    }

    fn byte(&mut self) -> Parsed<u8> {
        Ok(self.take(1)?[0])
    }

    /// A little-endian number of one to four bytes.
    fn unsigned(&mut self, len: usize) -> Parsed<u32> {
        let bytes = self.take(len)?.iter().rev();
        Ok(bytes.fold(0, |value, byte| value << 8 | u32::from(*byte)))
    }

    fn pop(&mut self) -> Parsed<Value> {
        match self.stack.pop() {
            Some(Value::Mark) | None => Err("a value where the stack holds none".to_owned()),
            Some(value) => Ok(value),
        }
    }

    /// The last values, in the order they were pushed.
    fn pop_last(&mut self, count: usize) -> Parsed<Vec<Value>> {
        let mut values: Vec<Value> = (0..count).map(|_| self.pop()).collect::<Parsed<_>>()?;
        values.reverse();
        Ok(values)
    }

    /// What lies above the last mark, which goes too.
    fn pop_to_mark(&mut self) -> Parsed<Vec<Value>> {
        let mark = self.stack.iter().rposition(|value| *value == Value::Mark);
        let mark = mark.ok_or("the end of a part that has no beginning")?;
        let values = self.stack.split_off(mark + 1);
        self.stack.pop();
        Ok(values)
    }

    /// What lies above the last mark, or so many values.
    fn items(&mut self, marked: bool, count: usize) -> Parsed<Vec<Value>> {
        if marked {
            return self.pop_to_mark();
        }
        self.pop_last(count)
    }

    fn long(&mut self) -> Parsed<Value> {
        let len = self.byte()?;
        if len > 16 {
            return Err(format!("an integer of {len} bytes"));
        }
        let bytes = self.take(usize::from(len))?;
        let sign = bytes.last().map_or(0, |last| last.cast_signed() >> 7);
        let shift = |value, byte: &u8| value << 8 | i128::from(*byte);
        Ok(Value::Int(bytes.iter().rev().fold(sign.into(), shift)))
    }

    /// A text whose length takes so many bytes.
    fn text(&mut self, bytes: usize) -> Parsed<Value> {
        let len = self.unsigned(bytes)?;
        let text = std::str::from_utf8(self.take(len as usize)?);
        let text = text.map_err(|_| "a text that is not UTF-8")?;
        Ok(self.heap.text(text))
    }

    fn set(&mut self, marked: bool) -> Parsed<()> {
        let items = self.items(marked, 2)?;
        let Some(&Value::Dictionary(dictionary)) = self.stack.last() else {
            return Err("items for what is no dictionary".to_owned());
        };
        let (pairs, []) = items.as_chunks::<2>() else {
            return Err("a key without a value".to_owned());
        };
        for [key, value] in pairs {
            self.heap.insert(dictionary, *key, *value)?;
        }
        Ok(())
    }

    /// A value of the memo, whose key takes so many bytes.
    fn recall(&mut self, bytes: usize) -> Parsed<Value> {
        let key = self.unsigned(bytes)?;
        let value = self.memo.get(&key).copied();
        value.ok_or_else(|| format!("memo {key}, which holds nothing"))
    }

    fn global(&mut self, opcode: u8) -> Parsed<Value> {
        let global = if opcode == b'c' {
            let (module, name) = (self.line()?, self.line()?);
            Global::find(&module, &name)?
        } else {
            let (name, module) = (self.pop()?, self.pop()?);
            let (Some(module), Some(name)) = (self.heap.as_text(module), self.heap.as_text(name))
            else {
                return Err("a global whose name is no text".to_owned());
            };
            Global::find(module, name)?
        };
        Ok(Value::Global(global))
    }

    fn line(&mut self) -> Parsed<String> {
        let rest = &self.bytes[self.at..];
        let len = rest.iter().position(|byte| *byte == b'\n');
        let len = len.ok_or("a line that does not end")?;
        self.at += len + 1;
        Ok(String::from_utf8_lossy(&rest[..len]).into_owned())
    }

    fn reduce(&mut self) -> Parsed<Value> {
        let (arguments, callable) = (self.pop()?, self.pop()?);
        let Value::Global(global) = callable else {
            return Err("a call of what is no global".to_owned());
        };
        let Value::Tuple(arguments) = arguments else {
            return Err("a call without a tuple of arguments".to_owned());
        };
        self.heap.call(global, arguments)
    }
}

/// An instruction that builds no tensor.
fn unknown(opcode: u8) -> String {
    let name = match opcode {
        b'i' => "INST",
        b'o' => "OBJ",
        0x81 => "NEWOBJ",
        0x92 => "NEWOBJ_EX",
        0x82..=0x84 => "EXT",
        b'P' => "PERSID",
        b'0' => "POP",
        b'1' => "POP_MARK",
        b'2' => "DUP",
        b'F' | b'G' => "FLOAT",
        b'I' | b'L' | 0x8b => "LONG",
        b'S' | b'T' => "STRING",
        b'V' | 0x8d => "UNICODE",
        b'B' | b'C' | 0x8e | 0x96 => "BYTES",
        b'd' => "DICT",
        b'l' => "LIST",
        b'p' => "PUT",
        b'g' => "GET",
        0x8f..=0x91 => "SET",
        0x97 | 0x98 => "BUFFER",
        _ => "unknown",
    };
    format!("opcode {name} ({opcode:#04x})")
}
