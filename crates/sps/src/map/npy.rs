//! Numbers as NumPy reads them.

/// The content of an `.npy` file, version 1.0, of f64 in little-endian order, row by row.
pub(super) fn bytes<'a>(shape: [usize; 3], values: impl Iterator<Item = &'a f64>) -> Vec<u8> {
    let axes = shape.map(|axis| axis.to_string()).join(", ");
    let mut header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({axes}), }}");
    // The numbers begin at a multiple of 64 bytes.
    let length = (10 + header.len() + 1).next_multiple_of(64) - 10;
    header.push_str(&" ".repeat(length - header.len() - 1));
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(values.flat_map(|value| value.to_le_bytes()));
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What `numpy.save` 2.4 writes of `[[[1.0, -2.5]]]`.
    #[test]
    fn is_what_numpy_writes() {
        let found = bytes([1, 1, 2], [1.0, -2.5].iter());
        let mut expected = b"\x93NUMPY\x01\x00v\x00".to_vec();
        let header = "{'descr': '<f8', 'fortran_order': False, 'shape': (1, 1, 2), }";
        expected.extend(format!("{header:<117}\n").bytes());
        expected.extend([0, 0, 0, 0, 0, 0, 0xf0, 0x3f, 0, 0, 0, 0, 0, 0, 4, 0xc0]);
        assert_eq!(found, expected);
    }
}
