//! CSV rows of the API and the commands.

/// A row with its line ending [RFC 4180]. A cell that a spreadsheet would take for a formula is
/// written as text.
pub fn csv(cells: &[&str]) -> String {
    let mut row = String::new();
    for (index, cell) in cells.iter().enumerate() {
        if index > 0 {
            row.push(',');
        }
        let number = cell.parse::<f64>().is_ok();
        let formula = !number && cell.starts_with(['=', '+', '-', '@', '\t', '\r']);
        let mark = if formula { "'" } else { "" };
        if cell.contains([',', '"', '\n', '\r']) {
            row += &format!("\"{mark}{}\"", cell.replace('"', "\"\""));
        } else {
            row += mark;
            row += cell;
        }
    }
    row.push_str("\r\n");
    row
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_stay_what_they_are() {
        assert_eq!(csv(&["a", "b,c", "d\"e"]), "a,\"b,c\",\"d\"\"e\"\r\n");
        assert_eq!(csv(&["-1.5", "=1+1", "-x"]), "-1.5,'=1+1,'-x\r\n");
    }
}
