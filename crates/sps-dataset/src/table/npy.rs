//! One array of NumPy's format (NEP 1): numbers of any real dtype, or texts.
//!
//! The crates that read it take ndarray 0.17 or a whole parser generator for the few words of its
//! header.

use crate::files::integer;

/// An array in C order.
#[derive(Debug, PartialEq)]
pub(super) struct Array {
    pub(super) shape: Vec<usize>,
    pub(super) items: Items,
}

#[derive(Debug, PartialEq)]
pub(super) enum Items {
    Numbers(Vec<f64>),
    Texts(Vec<String>),
}

/// The shape and the numbers, in C order, of an `.npy` file of at most `most` items.
///
/// # Errors
/// What is wrong with the file: no header, fewer bytes than it says, items that are no real numbers.
pub fn read_npy(bytes: &[u8], most: u64) -> Result<(Vec<usize>, Vec<f64>), String> {
    let Array { shape, items } = read(bytes, most)?;
    match items {
        Items::Numbers(numbers) => Ok((shape, numbers)),
        Items::Texts(_) => Err("its items are texts, expected numbers".to_owned()),
    }
}

/// Reads an array of at most `most` items; an error says what is wrong.
pub(super) fn read(bytes: &[u8], most: u64) -> Result<Array, String> {
    let (header, data) = split(bytes).ok_or("it has no whole NumPy header")?;
    let header = std::str::from_utf8(header).map_err(|_| "its header is no text")?;
    let (descr, fortran_order, shape) = parse_header(header)?;
    let item = Item::of(descr)?;
    let mut axes = shape.iter();
    let count = axes.try_fold(1_usize, |all, &axis| all.checked_mul(axis));
    let size = count.and_then(|count| count.checked_mul(item.size()));
    let says = format!("its header says shape {shape:?}");
    let bytes = data.len();
    let data = size.and_then(|size| data.get(..size));
    let data = data.ok_or_else(|| format!("{says} of `{descr}`, but it has {bytes} bytes"))?;
    if count.is_none_or(|count| count as u64 > most) {
        return Err(format!("{says}, more than the limit of {most} items"));
    }
    let items = match item.decode(data) {
        Items::Numbers(numbers) if fortran_order => Items::Numbers(c_order(&numbers, &shape)),
        // Of texts, only those of one axis are taken.
        items => items,
    };
    Ok(Array { shape, items })
}

/// The text of the header, and the bytes after it.
fn split(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let rest = bytes.strip_prefix(b"\x93NUMPY")?;
    let (version, rest) = rest.split_at_checked(2)?;
    let (length, rest) = rest.split_at_checked(if version[0] > 1 { 4 } else { 2 })?;
    rest.split_at_checked(integer(length, false) as usize)
}

/// The dtype, whether it is in Fortran order, and the shape:
/// `{'descr': '<f8', 'fortran_order': False, 'shape': (3, 15), }`
fn parse_header(text: &str) -> Result<(&str, bool, Vec<usize>), String> {
    let wrong = || format!("its header is not one of NumPy's: {}", text.trim_end());
    let after = |key: &str| {
        let (_, rest) = text.split_once(&format!("'{key}':")).ok_or_else(wrong)?;
        Ok::<&str, String>(rest.trim_start())
    };
    let descr = between(after("descr")?, '\'', '\'')
        .ok_or("its items are records of several fields, expected numbers or texts")?;
    let order = after("fortran_order")?;
    let fortran_order = order.starts_with("True");
    if !fortran_order && !order.starts_with("False") {
        return Err(wrong());
    }
    let shape = between(after("shape")?, '(', ')').ok_or_else(wrong)?;
    let axes = shape.split(',').map(str::trim);
    let axes = axes.filter(|axis| !axis.is_empty());
    let shape = axes.map(|axis| axis.parse().map_err(|_| wrong()));
    Ok((descr, fortran_order, shape.collect::<Result<_, _>>()?))
}

/// What stands before the first `end`, behind a `start` at the beginning.
fn between(text: &str, start: char, end: char) -> Option<&str> {
    let (inner, _) = text.strip_prefix(start)?.split_once(end)?;
    Some(inner)
}

/// What an item is and how it is stored.
struct Item {
    kind: u8,
    /// Bytes, or for `U` code points.
    width: usize,
    big_endian: bool,
}

impl Item {
    fn of(descr: &str) -> Result<Self, String> {
        let (order, item) = descr.split_at_checked(1).unwrap_or_default();
        let (kind, width) = item.split_at_checked(1).unwrap_or_default();
        let width = width.parse().unwrap_or(0);
        let known = match kind {
            "i" | "u" => matches!(width, 1 | 2 | 4 | 8),
            "f" => matches!(width, 4 | 8),
            "U" | "S" => (1..=4096).contains(&width),
            _ => false,
        };
        if known && ["<", ">", "=", "|"].contains(&order) {
            let kind = kind.as_bytes()[0];
            let big_endian = order == ">" || (order == "=" && cfg!(target_endian = "big"));
            return Ok(Self {
                kind,
                width,
                big_endian,
            });
        }
        Err(if kind == "O" {
            "its items are pickled Python objects, expected plain numbers: save it again as an array \
             of floats"
                .to_owned()
        } else {
            let expected = "i1 to i8, u1 to u8, f4 or f8, or U or S";
            format!("its items are of dtype `{descr}`, expected {expected}")
        })
    }

    fn size(&self) -> usize {
        if self.kind == b'U' {
            self.width * 4
        } else {
            self.width
        }
    }

    fn decode(&self, data: &[u8]) -> Items {
        let items = data.chunks_exact(self.size());
        match self.kind {
            b'U' => Items::Texts(items.map(|item| self.wide_text(item)).collect()),
            b'S' => Items::Texts(items.map(text).collect()),
            _ => Items::Numbers(items.map(|item| self.number(item)).collect()),
        }
    }

    fn number(&self, item: &[u8]) -> f64 {
        let bits = integer(item, self.big_endian);
        let unused = 64 - 8 * item.len() as u32;
        match (self.kind, item.len()) {
            (b'f', 4) => f64::from(f32::from_bits(bits as u32)),
            (b'f', _) => f64::from_bits(bits),
            (b'i', _) => ((bits << unused) as i64 >> unused) as f64,
            _ => bits as f64,
        }
    }

    fn wide_text(&self, item: &[u8]) -> String {
        let points = item.chunks_exact(4);
        let points = points.map(|point| integer(point, self.big_endian) as u32);
        let points = points.take_while(|&point| point != 0);
        let known = |point| char::from_u32(point).unwrap_or(char::REPLACEMENT_CHARACTER);
        points.map(known).collect()
    }
}

fn text(item: &[u8]) -> String {
    let text = item.split(|&byte| byte == 0).next().unwrap_or_default();
    String::from_utf8_lossy(text).into_owned()
}

/// From the order in which the first axis moves fastest.
fn c_order(items: &[f64], shape: &[usize]) -> Vec<f64> {
    let from = |mut index: usize| {
        // Digits of the C-order index, last axis first, put together the other way round.
        let mut at = 0;
        let mut stride = items.len();
        for &axis in shape.iter().rev() {
            stride /= axis;
            at += index % axis * stride;
            index /= axis;
        }
        items[at]
    };
    (0..items.len()).map(from).collect()
}
