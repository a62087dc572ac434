//! Answers as a table, as JSON or as CSV.

use std::collections::BTreeSet;
use std::io::{self, Write};

use anyhow::Result;
use sps_estimator::{Answer, Estimate, Estimator};
use sps_experiment::text::{decimals, number};

use super::Surface;
use crate::answer::{Line, Said};

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
    model: &'a Estimator,
    unfamiliar: f64,
    /// The codes of the properties in their order, and how many decimals their values are shown with.
    properties: Vec<(&'a str, usize)>,
    /// The properties, by their places, that had no interval for some surface, and why.
    no_interval: BTreeSet<(usize, String)>,
    /// Whether the table has its heading.
    headed: bool,
    csv: Option<csv::Writer<io::Stdout>>,
}

impl<'a> Printer<'a> {
    pub(super) fn new(format: &'a Format, unfamiliar: f64, model: &'a Estimator) -> Result<Self> {
        let fitted = model.fitted();
        let decimals = fitted.deviations().map(decimals);
        let mut printer = Self {
            format,
            model,
            unfamiliar,
            properties: fitted.properties().zip(decimals).collect(),
            no_interval: BTreeSet::new(),
            headed: false,
            csv: format.csv.then(|| csv::Writer::from_writer(io::stdout())),
        };
        if let Some(csv) = &mut printer.csv {
            csv.write_record(["surface", "property", "value", "low", "high", "familiar"])?;
        }
        Ok(printer)
    }

    pub(super) fn print(&mut self, surface: &Surface, answer: &Answer) -> Result<()> {
        let said = Said::new(self.model, answer, self.unfamiliar);
        if self.format.json {
            let line = Line {
                surface: &surface.name,
                images: &surface.images,
                said,
            };
            println!("{}", serde_json::to_string(&line)?);
        } else if let Some(csv) = &mut self.csv {
            for one in &answer.estimates {
                let numbers = [Some(one.value), one.low, one.high, answer.familiar];
                let text = |value: f64| value.to_string();
                let numbers = numbers.map(|value| value.map_or_else(String::new, text));
                csv.write_field(&surface.name)?;
                csv.write_field(&one.property)?;
                csv.write_record(&numbers)?;
            }
            csv.flush()?;
        } else {
            for (at, one) in answer.estimates.iter().enumerate() {
                let reason = answer.no_interval.get(&one.property);
                self.no_interval
                    .extend(reason.map(|reason| (at, reason.clone())));
            }
            self.print_table(surface, answer);
            if let Some(p) = answer.familiar.filter(|_| said.unfamiliar) {
                println!(
                    "      unlike what the model was fitted on (p = {p:.3}): intervals promise nothing here"
                );
            }
        }
        io::stdout().flush()?;
        Ok(())
    }

    fn print_table(&mut self, surface: &Surface, answer: &Answer) {
        let codes = self.properties.iter().map(|(code, _)| code.chars().count());
        let code = codes.max().unwrap_or_default();
        let label = |one: &Estimate| {
            let (property, name) = (&one.property, &one.name);
            let name = if name == property { "" } else { name };
            let unit = match one.unit.as_str() {
                "" => String::new(),
                unit => format!(" [{unit}]"),
            };
            format!("{property:<code$}  {name}{unit}")
        };
        let labels: Vec<String> = answer.estimates.iter().map(label).collect();
        let widths = labels.iter().map(|label| label.chars().count());
        let width = widths.chain(["property".len()]).max().unwrap_or_default();
        if !std::mem::replace(&mut self.headed, true) {
            let share = 100.0 * self.model.fitted().level().get();
            let (property, value) = ("property", "value");
            println!("{property:<width$} {value:>9}   {share:.0} % interval");
        }
        println!("{}", surface.name);
        let rows = labels.iter().zip(&answer.estimates).zip(&self.properties);
        for ((label, one), &(_, decimals)) in rows {
            let shown = |value: f64| number(Some(value), decimals);
            let interval = match one.low.zip(one.high) {
                Some((low, high)) => format!("{} to {}", shown(low), shown(high)),
                None => "none".to_owned(),
            };
            println!("{label:<width$} {:>9}   {interval}", shown(one.value));
        }
    }

    pub(super) fn end(&self) {
        if self.format.json || self.format.csv {
            return;
        }
        for (at, reason) in &self.no_interval {
            println!("{}: no interval, {reason}", self.properties[*at].0);
        }
        if let Some(reason) = self.model.fitted().no_familiar() {
            println!("no p-value of \"like what the model was fitted on\": {reason}");
        }
    }
}
