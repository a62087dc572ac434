//! An outlook for the terminal.

use std::fmt;
use std::iter;

use super::{OfEncoder, OfMethod, Outlook};
use crate::report::table::{aligned, counted};

/// Numbers of shards for which it is said how long they would take.
const SHARDS: [usize; 6] = [2, 4, 8, 16, 32, 64];

/// Where something is missing of which nothing was measured.
const UNMEASURED: &str = "not measured";

impl fmt::Display for Outlook {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shard = self.shard.map(|shard| format!(", shard {shard}"));
        let shard = shard.unwrap_or_default();
        writeln!(f, "{} in {}{shard}", self.experiment, self.folder.display())?;
        f.write_str(&below_one_another(&self.method_lines()))?;
        f.write_str(&below_one_another(&self.encoder_lines()))?;
        match self.seconds() {
            Some(0.0)
                if self
                    .methods
                    .iter()
                    .all(|one| one.counts().trials_missing() == 0) =>
            {
                writeln!(
                    f,
                    "nothing is missing; costs are measured and the report written anew"
                )
            }
            Some(seconds) => {
                let time = duration(seconds);
                writeln!(f, "missing: {time}, by what was measured in this folder")?;
                self.shards(f)
            }
            None => writeln!(
                f,
                "how long what is missing will take is not known: some of it was never measured in \
                 this folder"
            ),
        }
    }
}

impl Outlook {
    fn method_lines(&self) -> Vec<Vec<String>> {
        let selects = self.methods.iter().any(|one| one.counts().selections > 0);
        let mut head = vec!["method", "done", "missing"];
        if selects {
            head.extend(["views selected", "missing"]);
        }
        head.push("time");
        let head = head.into_iter().map(str::to_owned).collect();
        let lines = self.methods.iter().map(|one| one.cells(selects));
        iter::once(head).chain(lines).collect()
    }

    fn encoder_lines(&self) -> Vec<Vec<String>> {
        let lines = self.encoders.iter().filter_map(OfEncoder::cells);
        lines.collect()
    }

    fn shards(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.shard.is_some() {
            return Ok(());
        }
        for of in SHARDS {
            if let Some(seconds) = self.seconds_in_shards(of) {
                let time = duration(seconds);
                writeln!(f, "  in {of} shards on machines like this one: {time}")?;
            }
        }
        Ok(())
    }
}

impl OfMethod {
    /// With what was selected where any method `selects`.
    fn cells(&self, selects: bool) -> Vec<String> {
        let counts = self.counts();
        let of_selections = |count: usize| match counts.selections {
            0 => String::new(),
            _ => count.to_string(),
        };
        let mut cells = vec![
            self.id.clone(),
            counts.trials_done.to_string(),
            counts.trials_missing().to_string(),
        ];
        if selects {
            let [done, missing] = [counts.selections_done, counts.selections_missing()];
            cells.extend([done, missing].map(of_selections));
        }
        cells.push(time(self.seconds(counts)));
        cells
    }
}

impl OfEncoder {
    /// Nothing where nothing is missing.
    fn cells(&self) -> Option<Vec<String>> {
        let frames =
            (self.frames > 0).then(|| format!("{} to encode", counted(self.frames, "frame")));
        let trainings = (!self.untrained.is_empty()).then(|| {
            format!(
                "to be trained on {}",
                counted(self.untrained.len(), "split")
            )
        });
        let missing: Vec<String> = frames.into_iter().chain(trainings).collect();
        (!missing.is_empty())
            .then(|| vec![self.name.clone(), missing.join(", "), time(self.seconds())])
    }
}

fn below_one_another(lines: &[Vec<String>]) -> String {
    aligned(lines, |at| at == 0)
}

fn time(seconds: Option<f64>) -> String {
    seconds.map_or_else(|| UNMEASURED.to_owned(), duration)
}

/// In the two largest units.
fn duration(seconds: f64) -> String {
    if seconds == 0.0 {
        return "0 s".to_owned();
    }
    if seconds < 9.95 {
        return format!("{seconds:.1} s");
    }
    let seconds = seconds.round() as u64;
    let (hours, minutes) = (seconds / 3600, seconds / 60 % 60);
    match (hours, minutes) {
        (0, 0) => format!("{seconds} s"),
        (0, _) => format!("{minutes} min {} s", seconds % 60),
        _ => format!("{hours} h {minutes} min"),
    }
}

#[cfg(test)]
mod tests {
    use super::duration;

    #[test]
    fn times_are_said_in_two_units() {
        let said = [0.0, 0.04, 9.94, 9.96, 59.6, 90.0, 3599.9, 7260.0].map(duration);
        let expected = [
            "0 s",
            "0.0 s",
            "9.9 s",
            "10 s",
            "1 min 0 s",
            "1 min 30 s",
            "1 h 0 min",
            "2 h 1 min",
        ];
        assert_eq!(said, expected);
    }
}
