//! Tables as aligned plain text.

use sps_experiment::text::aligned;

use super::Table;

impl Table {
    /// Title and cells, without the caption.
    pub fn terminal(&self) -> String {
        let cells = self.rows.iter().map(|row| {
            let cells = row.cells.iter();
            cells.map(ToString::to_string).collect()
        });
        let lines: Vec<Vec<String>> = [self.columns.clone()].into_iter().chain(cells).collect();
        format!("{}\n{}", self.title, aligned(&lines, |at| self.is_left(at)))
    }
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
