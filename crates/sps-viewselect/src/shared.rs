//! The losses of several properties at once, and one that is drawn towards their mean.

use std::fmt;

use crate::error::{SelectError, require};
use crate::loss::{LossError, SetLoss};
use crate::sets::Sets;

/// The losses that a set of M of N views has for P properties: lower is better.
///
/// For losses that cost as much for one property as for all, such as a refit whose decomposition
/// the properties share. [`Pooled`] makes one [`SetLoss`] of them, [`Remembered`](crate::Remembered)
/// computes each set once for all who ask.
///
/// What [`SetLoss`] says of sets and of pure functions holds here as well.
pub trait SharedLoss: Sync {
    /// Views that there are, N.
    fn views(&self) -> usize;

    /// Views in a set, M.
    fn picks(&self) -> usize;

    /// Properties that a set has a loss for, P.
    fn properties(&self) -> usize;

    /// Whether the order of the views in a set matters, so that `[3, 8]` and `[8, 3]` may have
    /// different losses. `true` unless the loss says otherwise.
    fn ordered(&self) -> bool {
        true
    }

    /// Writes the losses of every set, shape `(sets, properties)`, row-major, in the order of the
    /// sets. `losses` has as many elements, and every set holds [`picks`](Self::picks) views below
    /// [`views`](Self::views).
    ///
    /// Called from several threads at once.
    ///
    /// # Errors
    /// Whatever the loss fails with: the selection ends with it.
    fn losses(&self, sets: Sets<'_>, losses: &mut [f64]) -> Result<(), LossError>;
}

/// One property's loss, drawn towards the mean over all P properties:
/// `(1 - amount) * own + amount * pooled`.
///
/// Views that are chosen by the loss of one property on few surfaces are chosen by its noise; the
/// mean over properties has less of it, and knows less of the property. An amount of 0 is each
/// property for itself, an amount of 1 one choice for all.
///
/// The losses of all properties must be in comparable units, or the mean is that of the property
/// with the largest numbers: divide each property's squared error by the variance of the property
/// on the same surfaces, so that a loss is 1 - R².
#[derive(Clone, Copy)]
pub struct Pooled<'a> {
    shared: &'a dyn SharedLoss,
    property: usize,
    amount: f64,
}

impl<'a> Pooled<'a> {
    /// The loss of property `property` of `shared`, counted from 0, drawn by `amount` towards the
    /// mean over all.
    ///
    /// # Errors
    /// [`SelectError::Setting`] unless the property exists and 0 <= `amount` <= 1.
    pub fn new(
        shared: &'a dyn SharedLoss,
        property: usize,
        amount: f64,
    ) -> Result<Self, SelectError> {
        let exists = property < shared.properties();
        require(exists, "property", property, "a property that exists")?;
        let share = (0.0..=1.0).contains(&amount);
        require(share, "amount", amount, "a number from 0 to 1")?;
        Ok(Self {
            shared,
            property,
            amount,
        })
    }

    /// Of a set's losses for all properties.
    fn drawn(&self, losses: &[f64]) -> f64 {
        let own = losses[self.property];
        if self.amount == 0.0 {
            // What other properties lack is none of this one's business.
            return own;
        }
        let pooled = losses.iter().sum::<f64>() / losses.len() as f64;
        (1.0 - self.amount) * own + self.amount * pooled
    }
}

impl fmt::Debug for Pooled<'_> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("Pooled")
            .field("property", &self.property)
            .field("amount", &self.amount)
            .finish_non_exhaustive()
    }
}

impl SetLoss for Pooled<'_> {
    fn views(&self) -> usize {
        self.shared.views()
    }

    fn picks(&self) -> usize {
        self.shared.picks()
    }

    fn losses(&self, sets: Sets<'_>, losses: &mut [f64]) -> Result<(), LossError> {
        let properties = self.shared.properties();
        let mut all = vec![0.0; sets.len() * properties];
        self.shared.losses(sets, &mut all)?;
        for (of_set, loss) in all.chunks_exact(properties).zip(losses) {
            *loss = self.drawn(of_set);
        }
        Ok(())
    }
}
