//! Tables as aligned plain text.

use super::Table;

impl Table {
    /// Title and cells, without the caption.
    pub(crate) fn terminal(&self) -> String {
        let cells = self.rows.iter().map(|row| {
            let cells = row.cells.iter();
            cells.map(ToString::to_string).collect()
        });
        let lines: Vec<Vec<String>> = [self.columns.clone()].into_iter().chain(cells).collect();
        format!("{}\n{}", self.title, aligned(&lines, |at| self.is_left(at)))
    }
}

/// Lines of cells below one another, two spaces from the left.
pub(crate) fn aligned(lines: &[Vec<String>], is_left: impl Fn(usize) -> bool) -> String {
    let columns = lines.iter().map(Vec::len).max().unwrap_or_default();
    let width = |at: usize| {
        let cells = lines.iter().filter_map(|cells| cells.get(at));
        let widths = cells.map(|cell| cell.chars().count());
        widths.max().unwrap_or_default()
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let line = |cells: &Vec<String>| {
        let cells = cells.iter().zip(&widths).enumerate();
        let cells = cells.map(|(at, (cell, &width))| {
            if is_left(at) {
                format!("  {cell:<width$}")
            } else {
                format!("  {cell:>width$}")
            }
        });
        format!("{}\n", cells.collect::<String>().trim_end())
    };
    lines.iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::super::hard_cases;

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
