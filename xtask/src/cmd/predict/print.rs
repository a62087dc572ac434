//! Answers as a table, as JSON or as CSV.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::PathBuf;

use anyhow::Result;
use serde::Serialize;
use sps_estimator::{Answer, Estimate, Estimator};

use super::Surface;

/// What is printed in place of a table.
#[derive(clap::Args)]
pub(super) struct Format {
    /// Print a line of JSON for each surface
    #[arg(long, conflicts_with = "csv")]
    pub json: bool,
    /// Print CSV: a line for each surface and property
    #[arg(long)]
    pub csv: bool,
}

/// Prints answers as they come.
pub(super) struct Printer<'a> {
    format: &'a Format,
    unfamiliar: f64,
    level: f64,
    no_interval: BTreeMap<&'a str, &'a str>,
    csv: Option<csv::Writer<io::Stdout>>,
}

/// A line of JSON.
#[derive(Serialize)]
struct Line<'a> {
    surface: &'a str,
    images: &'a [PathBuf],
    level: f64,
    #[serde(flatten)]
    answer: &'a Answer,
    unfamiliar: bool,
    no_interval: &'a BTreeMap<&'a str, &'a str>,
}

impl<'a> Printer<'a> {
    pub(super) fn new(format: &'a Format, unfamiliar: f64, model: &'a Estimator) -> Result<Self> {
        let mut printer = Self {
            format,
            unfamiliar,
            level: model.fitted().level().get(),
            no_interval: model.no_interval(),
            csv: format.csv.then(|| csv::Writer::from_writer(io::stdout())),
        };
        if let Some(csv) = &mut printer.csv {
            csv.write_record(["surface", "property", "value", "low", "high", "familiar"])?;
        } else if !format.json {
            let share = 100.0 * printer.level;
            println!(
                "{:<4}  {:<26} {:>7}   {share:.0} % interval",
                "", "property", "value"
            );
        }
        Ok(printer)
    }

    pub(super) fn print(&mut self, surface: &Surface, answer: &Answer) -> Result<()> {
        let unfamiliar = answer.familiar.is_some_and(|p| p <= self.unfamiliar);
        if self.format.json {
            let line = Line {
                surface: &surface.name,
                images: &surface.images,
                level: self.level,
                answer,
                unfamiliar,
                no_interval: &self.no_interval,
            };
            println!("{}", serde_json::to_string(&line)?);
        } else if let Some(csv) = &mut self.csv {
            let text =
                |value: Option<f64>| value.map(|value| value.to_string()).unwrap_or_default();
            for one in &answer.estimates {
                let value = one.value.to_string();
                let numbers = [value, text(one.low), text(one.high), text(answer.familiar)];
                let [value, low, high, familiar] = &numbers;
                csv.write_record([&surface.name, &one.property, value, low, high, familiar])?;
            }
            csv.flush()?;
        } else {
            println!("{}", surface.name);
            answer.estimates.iter().for_each(print_estimate);
            if let Some(p) = answer.familiar.filter(|_| unfamiliar) {
                println!(
                    "      unlike what the model was fitted on (p = {p:.3}): intervals promise nothing here"
                );
            }
        }
        io::stdout().flush()?;
        Ok(())
    }

    pub(super) fn end(&self) {
        if !self.format.json && !self.format.csv {
            for (property, reason) in &self.no_interval {
                println!("{property}: no interval, {reason}");
            }
        }
    }
}

fn print_estimate(estimate: &Estimate) {
    let interval = match estimate.low.zip(estimate.high) {
        Some((low, high)) => format!("{low:.1} to {high:.1}"),
        None => "none".to_owned(),
    };
    let Estimate {
        property,
        name,
        value,
        ..
    } = estimate;
    println!("{property:<4}  {name:<26} {value:>7.1}   {interval}");
}
