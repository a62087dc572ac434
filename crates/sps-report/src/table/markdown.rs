//! Tables as Markdown.

use super::{Row, Table};

impl Table {
    /// Without title and caption.
    pub fn markdown(&self) -> String {
        let rule = "---:|".repeat(self.columns.len().saturating_sub(1));
        let mut lines = vec![line(&self.columns), format!("|---|{rule}")];
        lines.extend(self.rows.iter().map(|row| line(&cells(row))));
        lines.join("\n")
    }
}

fn line(cells: &[String]) -> String {
    let cells: Vec<String> = cells.iter().map(|cell| cell.replace('|', "\\|")).collect();
    format!("| {} |", cells.join(" | "))
}

fn cells(row: &Row) -> Vec<String> {
    let italic = |text: String| {
        if row.reference {
            format!("*{text}*")
        } else {
            text
        }
    };
    let cells = row.cells.iter();
    cells.map(|cell| italic(cell.to_string())).collect()
}

#[cfg(test)]
mod tests {
    use super::super::hard_cases;

    #[test]
    fn a_bar_in_a_name_ends_no_cell() {
        let text = hard_cases().markdown();
        assert!(text.contains("| [a] \\| b | – | 0.5 |"), "{text}");
        assert!(text.starts_with("| Method | R² | paper |\n|---|---:|---:|\n"));
    }
}
