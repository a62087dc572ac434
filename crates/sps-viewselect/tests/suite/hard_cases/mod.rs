//! What breaks the usual forms.

mod logits;
mod losses;
mod settings;
mod sizes;
