//! What breaks the usual forms.

mod losses;
mod settings;
mod sizes;
