//! Tables without lines, their columns as wide as what stands in them.

use super::width;

/// A table for people.
#[derive(Clone, Debug, Default)]
pub(crate) struct Table {
    head: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// A table with these headings.
    pub(crate) fn new<'a>(head: impl IntoIterator<Item = &'a str>) -> Table {
        Table {
            head: head.into_iter().map(str::to_owned).collect(),
            rows: Vec::new(),
        }
    }

    /// A table without headings.
    pub(crate) fn bare() -> Table {
        Table::default()
    }

    pub(crate) fn add(&mut self, row: impl IntoIterator<Item = String>) {
        self.rows.push(row.into_iter().collect());
    }

    /// All of it within so many columns, if they are limited: a table that is wider is told one
    /// row after the other, since lines that the terminal breaks can't be read.
    pub(crate) fn render_within(&self, columns: Option<usize>) -> String {
        let text = self.render();
        let widest = text.lines().map(width::of).max().unwrap_or_default();
        match columns {
            Some(columns) if widest > columns && !self.head.is_empty() => self.stacked(),
            _ => text,
        }
    }

    /// Each row as a block of lines, one for each cell under its heading.
    fn stacked(&self) -> String {
        let labels = self.head.iter().map(|head| width::of(head));
        let label = labels.max().unwrap_or_default();
        let block = |row: &Vec<String>| {
            let cells = self
                .head
                .iter()
                .zip(row)
                .filter(|(_, cell)| !cell.is_empty());
            let lines = cells.map(|(head, cell)| format!("{}  {cell}\n", width::pad(head, label)));
            lines.collect::<String>()
        };
        let blocks: Vec<String> = self.rows.iter().map(block).collect();
        blocks.join("\n")
    }

    /// All of it, each line ended.
    pub(crate) fn render(&self) -> String {
        let lines = || std::iter::once(&self.head).chain(&self.rows);
        let columns = lines().map(Vec::len).max().unwrap_or_default();
        let widths: Vec<usize> = (0..columns)
            .map(|column| {
                let cells = lines().filter_map(|row| row.get(column));
                cells.map(|cell| width::of(cell)).max().unwrap_or_default()
            })
            .collect();
        let mut text = String::new();
        for row in lines().filter(|row| !row.is_empty()) {
            let cells = row.iter().zip(&widths);
            let cells: Vec<String> = cells
                .map(|(cell, width)| width::pad(cell, *width))
                .collect();
            text += cells.join("  ").trim_end();
            text.push('\n');
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_stand_below_each_other_in_both_scripts() {
        let mut table = Table::new(["模块", "STATE"]);
        table.add(["pump".to_owned(), "在线".to_owned()]);
        table.add(["a".to_owned(), String::new()]);
        assert_eq!(table.render(), "模块  STATE\npump  在线\na\n");
        assert_eq!(Table::bare().render(), "");
    }

    #[test]
    fn a_table_too_wide_for_the_terminal_is_told_row_by_row() {
        let mut table = Table::new(["模块", "STATE"]);
        table.add(["pump".to_owned(), "在线".to_owned()]);
        table.add(["oven".to_owned(), String::new()]);
        let wide = table.render();
        assert_eq!(table.render_within(None), wide);
        assert_eq!(table.render_within(Some(11)), wide);
        assert_eq!(
            table.render_within(Some(10)),
            "模块   pump\nSTATE  在线\n\n模块   oven\n"
        );
    }
}
