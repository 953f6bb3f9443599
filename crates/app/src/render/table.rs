//! Tables without borders, with columns as wide as their content.

use railbus_words::width;

/// A table for people.
#[derive(Clone, Debug, Default)]
pub struct Table {
    head: Vec<String>,
    rows: Vec<Vec<String>>,
    spare: &'static [usize],
    names: Option<usize>,
}

impl Table {
    /// A table with these headings.
    pub fn new<'a>(head: impl IntoIterator<Item = &'a str>) -> Table {
        Table {
            head: head.into_iter().map(str::to_owned).collect(),
            rows: Vec::new(),
            spare: &[],
            names: None,
        }
    }

    /// Which column is the display name, by its index: if no row has one, the column is left out.
    pub const fn names(mut self, column: usize) -> Table {
        self.names = Some(column);
        self
    }

    /// Which columns can be left out on a narrow terminal, by their index, the first to go first.
    pub const fn spare(mut self, columns: &'static [usize]) -> Table {
        self.spare = columns;
        self
    }

    /// A table without headings.
    pub fn bare() -> Table {
        Table::default()
    }

    /// Adds a row.
    pub fn add(&mut self, row: impl IntoIterator<Item = String>) {
        self.rows.push(row.into_iter().collect());
    }

    /// The whole table within this many columns, if they are limited. A wider table leaves out its
    /// optional columns one by one. If it still is too wide, it is printed row by row, since tables
    /// wrapped by the terminal are unreadable.
    pub fn render_within(&self, columns: Option<usize>) -> String {
        let Some(columns) = columns else {
            return self.render();
        };
        let fits = |text: &String| text.lines().all(|line| width::of(line) <= columns);
        let mut narrower = (0..=self.spare.len()).map(|gone| self.without(gone).aligned());
        match narrower.find(fits) {
            Some(text) => text,
            None if self.head.is_empty() => self.without(self.spare.len()).aligned(),
            None => self.stacked(),
        }
    }

    /// The table without this many of its optional columns, and without names if there are none.
    fn without(&self, gone: usize) -> Table {
        let (gone, _) = self.spare.split_at(gone.min(self.spare.len()));
        let nameless = self.names.filter(|names| {
            let cells = self.rows.iter().filter_map(|row| row.get(*names));
            cells.into_iter().all(String::is_empty)
        });
        let kept = |row: &Vec<String>| {
            let cells = row.iter().enumerate();
            let cells =
                cells.filter(|(column, _)| !gone.contains(column) && nameless != Some(*column));
            cells.map(|(_, cell)| cell.clone()).collect()
        };
        Table {
            head: kept(&self.head),
            rows: self.rows.iter().map(kept).collect(),
            ..Table::default()
        }
    }

    /// Each row as a block of lines, one for each cell with its heading.
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

    /// The whole table, each line with its newline.
    pub fn render(&self) -> String {
        self.without(0).aligned()
    }

    /// Each cell below its heading.
    fn aligned(&self) -> String {
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
    fn a_narrow_table_does_without_what_it_can_spare() {
        let mut table = Table::new(["NAME", "LINE", "STATE"]).spare(&[1]);
        table.add(["pump".to_owned(), "main".to_owned(), "online".to_owned()]);
        let whole = "NAME  LINE  STATE\npump  main  online\n";
        assert_eq!(table.render_within(Some(18)), whole);
        let narrow = "NAME  STATE\npump  online\n";
        assert_eq!(table.render_within(Some(17)), narrow);
        assert_eq!(table.render_within(Some(12)), narrow);
        assert!(
            table
                .render_within(Some(11))
                .starts_with("NAME   pump\nLINE")
        );
        let mut bare = Table::bare().spare(&[1]);
        bare.add(["pump.do0".to_owned(), "Pump".to_owned(), "on".to_owned()]);
        assert_eq!(bare.render_within(Some(4)), "pump.do0  on\n");
    }

    #[test]
    fn a_column_of_names_is_there_where_something_has_one() {
        let mut table = Table::new(["LINE", "NAME", "STATE"]).spare(&[2]).names(1);
        table.add(["main".to_owned(), String::new(), "up".to_owned()]);
        assert_eq!(table.render(), "LINE  STATE\nmain  up\n");
        assert_eq!(table.render_within(Some(8)), "LINE\nmain\n");
        table.add(["b".to_owned(), "车间".to_owned(), "up".to_owned()]);
        assert_eq!(
            table.render(),
            "LINE  NAME  STATE\nmain        up\nb     车间  up\n"
        );
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
