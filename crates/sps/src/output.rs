//! What a command prints: text for people, or JSON for programs.

use anyhow::Result;
use serde::Serialize;

/// Whether JSON is asked for.
#[derive(Clone, Copy, clap::Args)]
pub(crate) struct Output {
    /// Print JSON; what is for people then goes to standard error
    #[arg(long)]
    json: bool,
}

impl Output {
    /// Tells people: on standard output, or on standard error where JSON has that.
    pub(crate) fn say(self, text: &str) {
        if self.json {
            eprintln!("{text}");
        } else {
            println!("{text}");
        }
    }

    /// Prints what a command did where JSON is asked for.
    pub(crate) fn json(self, done: &impl Serialize) -> Result<()> {
        if self.json {
            print_json(done)?;
        }
        Ok(())
    }
}

/// Prints JSON.
pub(crate) fn print_json(value: &impl Serialize) -> Result<()> {
    println!("{}", serde_json::to_string_pretty(value)?);
    Ok(())
}
