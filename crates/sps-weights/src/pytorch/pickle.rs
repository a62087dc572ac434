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

/// Runs the pickle that `bytes` begin with; returns what it leaves and its length.
///
/// Texts are ranges of `bytes`, tensors lie in `heap`.
pub(super) fn run(bytes: &[u8], heap: &mut Heap) -> Result<(Value, usize), WeightsErrorKind> {
    let mut machine = Machine {
        bytes: &bytes[..bytes.len().min(LONGEST)],
        at: 0,
        stack: Vec::new(),
        memo: BTreeMap::new(),
        heap,
    };
    loop {
        let start = machine.at;
        let step = machine.step().and_then(|last| {
            let held = machine.stack.len() + machine.memo.len() + machine.heap.values();
            let few = held <= MOST_VALUES;
            few.then_some(last)
                .ok_or_else(|| format!("more than {MOST_VALUES} values"))
        });
        let refused = |found| WeightsErrorKind::Pickle {
            offset: start,
            found,
        };
        if let Some(value) = step.map_err(refused)? {
            return Ok((value, machine.at));
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

impl Machine<'_> {
    /// One instruction; the result, when it was the last.
    fn step(&mut self) -> Parsed<Option<Value>> {
        let opcode = self.byte()?;
        match opcode {
            b'.' => return self.pop().map(Some),
            0x80 => self.protocol()?,
            // The length of what follows: a hint.
            0x95 => self.skip(8)?,
            b'(' => self.stack.push(Value::Mark),
            b'N' => self.stack.push(Value::None),
            0x88 => self.stack.push(Value::Bool(true)),
            0x89 => self.stack.push(Value::Bool(false)),
            b'J' | b'K' | b'M' | 0x8a => self.integer(opcode)?,
            b'X' | b'U' | 0x8c => self.text(opcode)?,
            b')' | b't' | 0x85..=0x87 => self.tuple(opcode)?,
            b'}' => self.dictionary(),
            b']' => self.list(),
            b'a' | b'e' => self.append(opcode)?,
            b's' | b'u' => self.set(opcode)?,
            b'q' | b'r' | 0x94 => self.remember(opcode)?,
            b'h' | b'j' => self.recall(opcode)?,
            b'c' | 0x93 => self.global(opcode)?,
            b'Q' => self.persistent()?,
            b'R' => self.reduce()?,
            b'b' => self.build()?,
            other => return Err(unknown(other)),
        }
        Ok(None)
    }

    fn take(&mut self, len: usize) -> Parsed<std::ops::Range<usize>> {
        let end = self.at.checked_add(len);
        let Some(end) = end.filter(|&end| end <= self.bytes.len()) else {
            return Err(format!(
                "{len} bytes where {} are left",
                self.bytes.len() - self.at
            ));
        };
        let range = self.at..end;
        self.at = end;
        Ok(range)
    }

    fn skip(&mut self, len: usize) -> Parsed<()> {
        self.take(len).map(|_| ())
    }

    fn byte(&mut self) -> Parsed<u8> {
        let range = self.take(1)?;
        Ok(self.bytes[range.start])
    }

    /// A little-endian number of one to four bytes.
    fn unsigned(&mut self, len: usize) -> Parsed<u32> {
        let range = self.take(len)?;
        let bytes = self.bytes[range].iter().rev();
        Ok(bytes.fold(0, |value, byte| value << 8 | u32::from(*byte)))
    }

    fn pop(&mut self) -> Parsed<Value> {
        match self.stack.pop() {
            Some(Value::Mark) | None => Err("a value where the stack holds none".to_owned()),
            Some(value) => Ok(value),
        }
    }

    /// What lies above the last mark, which goes too.
    fn pop_to_mark(&mut self) -> Parsed<Vec<Value>> {
        let mark = self.stack.iter().rposition(|value| *value == Value::Mark);
        let mark = mark.ok_or("the end of a part that has no beginning")?;
        let values = self.stack.split_off(mark + 1);
        self.stack.pop();
        Ok(values)
    }

    fn protocol(&mut self) -> Parsed<()> {
        match self.byte()? {
            2..=5 => Ok(()),
            other => Err(format!("protocol {other}, expected 2 to 5")),
        }
    }

    fn integer(&mut self, opcode: u8) -> Parsed<()> {
        let value = match opcode {
            b'J' => i128::from(self.unsigned(4)?.cast_signed()),
            b'K' => i128::from(self.unsigned(1)?),
            b'M' => i128::from(self.unsigned(2)?),
            _ => self.long()?,
        };
        self.stack.push(Value::Int(value));
        Ok(())
    }

    fn long(&mut self) -> Parsed<i128> {
        let len = self.byte()?;
        if len > 16 {
            return Err(format!("an integer of {len} bytes"));
        }
        let range = self.take(usize::from(len))?;
        let bytes = &self.bytes[range];
        let sign = bytes.last().map_or(0, |last| (*last).cast_signed() >> 7);
        let start = i128::from(sign);
        Ok(bytes
            .iter()
            .rev()
            .fold(start, |value, byte| value << 8 | i128::from(*byte)))
    }

    fn text(&mut self, opcode: u8) -> Parsed<()> {
        let len = self.unsigned(if opcode == b'X' { 4 } else { 1 })?;
        let range = self.take(len as usize)?;
        let text = std::str::from_utf8(&self.bytes[range]);
        let text = text.map_err(|_| "a text that is not UTF-8")?;
        let value = self.heap.text(text);
        self.stack.push(value);
        Ok(())
    }

    fn tuple(&mut self, opcode: u8) -> Parsed<()> {
        let items = match opcode {
            b')' => Vec::new(),
            b't' => self.pop_to_mark()?,
            sized => {
                let mut items = Vec::new();
                for _ in 0x85..=sized {
                    items.push(self.pop()?);
                }
                items.reverse();
                items
            }
        };
        let value = self.heap.tuple(items);
        self.stack.push(value);
        Ok(())
    }

    fn dictionary(&mut self) {
        let value = self.heap.dictionary();
        self.stack.push(value);
    }

    fn list(&mut self) {
        let value = self.heap.list();
        self.stack.push(value);
    }

    fn append(&mut self, opcode: u8) -> Parsed<()> {
        let items = if opcode == b'e' {
            self.pop_to_mark()?
        } else {
            vec![self.pop()?]
        };
        match self.stack.last() {
            Some(&Value::List(list)) => self.heap.extend(list, items),
            _ => return Err("items for what is no list".to_owned()),
        }
        Ok(())
    }

    fn set(&mut self, opcode: u8) -> Parsed<()> {
        let items = if opcode == b'u' {
            self.pop_to_mark()?
        } else {
            let value = self.pop()?;
            vec![self.pop()?, value]
        };
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

    fn remember(&mut self, opcode: u8) -> Parsed<()> {
        let key = match opcode {
            b'q' => self.unsigned(1)?,
            b'r' => self.unsigned(4)?,
            _ => self.memo.len() as u32,
        };
        let value = self.pop()?;
        self.stack.push(value);
        self.memo.insert(key, value);
        Ok(())
    }

    fn recall(&mut self, opcode: u8) -> Parsed<()> {
        let key = self.unsigned(if opcode == b'h' { 1 } else { 4 })?;
        let value = self.memo.get(&key);
        let value = value.ok_or_else(|| format!("memo {key}, which holds nothing"))?;
        self.stack.push(*value);
        Ok(())
    }

    fn global(&mut self, opcode: u8) -> Parsed<()> {
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
        self.stack.push(Value::Global(global));
        Ok(())
    }

    fn line(&mut self) -> Parsed<String> {
        let rest = &self.bytes[self.at..];
        let len = rest.iter().position(|byte| *byte == b'\n');
        let len = len.ok_or("a line that does not end")?;
        let line = String::from_utf8_lossy(&rest[..len]).into_owned();
        self.at += len + 1;
        Ok(line)
    }

    fn persistent(&mut self) -> Parsed<()> {
        let id = self.pop()?;
        let value = self.heap.storage(id)?;
        self.stack.push(value);
        Ok(())
    }

    fn reduce(&mut self) -> Parsed<()> {
        let (arguments, callable) = (self.pop()?, self.pop()?);
        let Value::Global(global) = callable else {
            return Err("a call of what is no global".to_owned());
        };
        let Value::Tuple(arguments) = arguments else {
            return Err("a call without a tuple of arguments".to_owned());
        };
        let value = self.heap.call(global, arguments)?;
        self.stack.push(value);
        Ok(())
    }

    /// PyTorch notes versions beside the dictionary; they are not used.
    fn build(&mut self) -> Parsed<()> {
        match (self.pop()?, self.stack.last()) {
            (Value::Dictionary(_), Some(Value::Dictionary(_))) => Ok(()),
            _ => Err("a state for what is no dictionary".to_owned()),
        }
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
