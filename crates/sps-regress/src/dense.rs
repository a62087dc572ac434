//! Dense products and decompositions by faer, sequential, so that no setting elsewhere changes a bit;
//! the vector registers are left clean.
//!
//! faer's products are assembly that returns with the upper halves of the registers in use. Compiled
//! code that knows of 128 bits alone (libm's `exp`, every plain loop) is held up by that on some processors until
//! someone clears them: a million exponentials took 4.7 ms before a product and 170 to 207 ms after it (Intel Xeon,
//! AVX-512).

use faer::linalg::matmul::matmul;
use faer::traits::RealField;
use faer::{Accum, Mat, MatMut, MatRef, Par};

/// `left right`, written to `product` or added to it.
pub fn multiply<T: RealField>(
    product: MatMut<'_, T>,
    accumulate: Accum,
    left: MatRef<'_, T>,
    right: MatRef<'_, T>,
) {
    cleanly(|| matmul(product, accumulate, left, right, T::one_impl(), Par::Seq));
}

/// `left right`.
pub(crate) fn product(left: MatRef<'_, f64>, right: &Mat<f64>) -> Mat<f64> {
    let mut product = Mat::zeros(left.nrows(), right.ncols());
    multiply(product.as_mut(), Accum::Replace, left, right.as_ref());
    product
}

/// What `work` gives, which may leave registers in use.
pub fn cleanly<R>(work: impl FnOnce() -> R) -> R {
    let result = work();
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = pulp::x86::V3::try_new() {
        simd.avx._mm256_zeroupper();
    }
    result
}
