//! Paths of points (`pump.do0`) and their selectors.

/// Module and label of a point's path.
#[must_use]
pub fn split(path: &str) -> Option<(&str, &str)> {
    path.split_once('.')
}

/// Whether a selector matches a point: its path, its module's name, or either with `*` for any
/// characters and `?` for one. Without selectors, all points match.
#[must_use]
pub fn selects(selectors: &[String], module: &str, label: &str) -> bool {
    selectors.is_empty()
        || selectors.iter().any(|selector| match split(selector) {
            Some((of_module, of_label)) => {
                matches(of_module.as_bytes(), module.as_bytes())
                    && matches(of_label.as_bytes(), label.as_bytes())
            }
            None => matches(selector.as_bytes(), module.as_bytes()),
        })
}

/// Whether the pattern matches the text. Backtracking is limited to the last `*`, so the time is at
/// most the product of both lengths.
pub fn matches(pattern: &[u8], text: &[u8]) -> bool {
    let (mut at, mut read) = (0, 0);
    let mut star = None;
    while let Some(letter) = text.get(read) {
        match pattern.get(at) {
            Some(b'*') => {
                star = Some((at, read));
                at += 1;
            }
            Some(wanted) if *wanted == b'?' || wanted == letter => {
                at += 1;
                read += 1;
            }
            _ => {
                let Some((star_at, taken)) = star else {
                    return false;
                };
                star = Some((star_at, taken + 1));
                (at, read) = (star_at + 1, taken + 1);
            }
        }
    }
    pattern.iter().skip(at).all(|letter| *letter == b'*')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn selectors_name_modules_and_points() {
        let one = |selector: &str| selects(&[selector.to_owned()], "pump", "do0");
        for named in [
            "pump", "pump.do0", "*.do*", "p?mp.*", "*", "pump.*0", "*p.d*0",
        ] {
            assert!(one(named), "{named}");
        }
        for other in ["oven", "pump.do1", "*.di*", "pum", "pumpp", "", "pump.do"] {
            assert!(!one(other), "{other}");
        }
        assert!(selects(&[], "pump", "do0"));
        assert!(selects(
            &["oven".to_owned(), "pump".to_owned()],
            "pump",
            "do0"
        ));
    }

    #[test]
    fn many_stars_take_no_time() {
        let pattern = "*a".repeat(32);
        assert!(!matches(pattern.as_bytes(), "a".repeat(31).as_bytes()));
    }
}
