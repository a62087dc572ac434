//! Tables as text: Markdown, and aligned for a terminal.

use sps_experiment::text::aligned;

use super::{Cell, Row, Table};

impl Table {
    /// Without title and caption.
    pub fn markdown(&self) -> String {
        let rule = "---:|".repeat(self.columns.len().saturating_sub(1));
        let mut lines = vec![line(&self.columns), format!("|---|{rule}")];
        let texts = |row: &Row| row.texts(Cell::to_string, |text| format!("*{text}*"));
        lines.extend(self.rows.iter().map(|row| line(&texts(row))));
        lines.join("\n")
    }

    /// Title and cells, without the caption.
    pub fn terminal(&self) -> String {
        let cells = |row: &Row| row.cells.iter().map(ToString::to_string).collect();
        let mut lines: Vec<Vec<String>> = vec![self.columns.clone()];
        lines.extend(self.rows.iter().map(cells));
        format!("{}\n{}", self.title, aligned(&lines, |at| self.is_left(at)))
    }
}

fn line(cells: &[String]) -> String {
    let cells: Vec<String> = cells.iter().map(|cell| cell.replace('|', "\\|")).collect();
    format!("| {} |", cells.join(" | "))
}

#[cfg(test)]
mod tests {
    use super::super::hard_cases;

    #[test]
    fn a_bar_in_a_name_ends_no_cell() {
        let text = hard_cases().markdown();
        assert!(text.contains("| [a] \\| b | – | 0.5 |"), "{text}");
        assert!(text.ends_with("| *Ceiling* | *0.33* |  |"), "{text}");
        assert!(text.starts_with("| Method | R² | paper |\n|---|---:|---:|\n"));
    }

    #[test]
    fn numbers_stand_below_one_another() {
        assert_eq!(
            hard_cases().terminal(),
            concat!(
                "50 % of R² & more\n",
                "  Method                                  R²  paper\n",
                "  Ridge_1 & 5 %, \"wide\"  -0.25 [-0.50, 0.75]      –\n",
                "  [a] | b                                  –    0.5\n",
                "  Ceiling                               0.33\n",
            )
        );
    }
}
