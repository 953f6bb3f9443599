//! Tables in Markdown, aligned to be readable as text.

use std::fmt;

/// A table.
pub struct Table {
    columns: usize,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// An empty one with these columns.
    pub fn new(columns: &[&str]) -> Table {
        let mut table = Table {
            columns: columns.len(),
            rows: Vec::new(),
        };
        table.row(columns);
        table.row(&vec!["---"; columns.len()]);
        table
    }

    /// Adds a row.
    pub fn row(&mut self, cells: &[&str]) {
        debug_assert_eq!(cells.len(), self.columns);
        self.rows
            .push(cells.iter().map(|cell| (*cell).to_owned()).collect());
    }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for row in &self.rows {
            writeln!(f, "| {} |", row.join(" | "))?;
        }
        Ok(())
    }
}

/// The median of these numbers, of which there must be at least one.
pub fn median(numbers: &mut [f64]) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers[numbers.len() / 2]
}

/// The percentile of these numbers, of which there must be at least one.
pub fn percentile(numbers: &mut [f64], of_100: usize) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers[(numbers.len() * of_100).div_ceil(100).max(1) - 1]
}
