//! Lists the tensors of weights files, with their shapes and sizes.

use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let mut numbers = 0;
    for path in std::env::args().skip(1) {
        let bytes = std::fs::read(&path).map_err(|error| format!("{path}: {error}"))?;
        let tensors = sps_weights::read(&bytes).map_err(|error| format!("{path}: {error}"))?;
        for (name, tensor) in tensors {
            println!("{name} {:?}", tensor.shape);
            numbers += tensor.values.len();
        }
    }
    println!("{numbers} numbers");
    Ok(())
}
