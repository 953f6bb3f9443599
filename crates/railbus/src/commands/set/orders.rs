//! The arguments of `set`: `pump.do0 on`, `yard 1,3=on`, `oven k1=on k2=off k5=toggle`, `oven
//! all=off`.

use railbus_api::types::PointInfo;

/// The new state of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::commands) enum State {
    On,
    Off,
    Toggle,
}

impl State {
    /// Parses the name of a state, in either language.
    pub(in crate::commands) fn from_word(word: &str) -> Option<State> {
        Some(match word.to_ascii_lowercase().as_str() {
            "on" | "1" | "true" | "接通" | "吸合" | "合" => State::On,
            "off" | "0" | "false" | "断开" | "分" => State::Off,
            "toggle" | "翻转" => State::Toggle,
            _ => return None,
        })
    }
}

/// One or several outputs of a module, and their new state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::commands) struct Order {
    /// The module; may contain wildcards.
    pub(in crate::commands) module: String,
    /// The point's label, its number as printed, a wildcard pattern, or `all`.
    pub(in crate::commands) point: String,
    pub(in crate::commands) state: State,
}

/// Parses the arguments, or returns the one that can't be parsed.
pub(super) fn parse(words: &[String]) -> Result<Vec<Order>, String> {
    let mut orders = Vec::new();
    let mut module: Option<&str> = None;
    let mut rest = words.iter().map(String::as_str).peekable();
    while let Some(word) = rest.next() {
        let (target, state) = match word.split_once('=') {
            Some((target, state)) => {
                let state = State::from_word(state).ok_or_else(|| word.to_owned())?;
                (target, state)
            }
            None => match rest.peek().copied().and_then(State::from_word) {
                Some(state) => {
                    rest.next();
                    (word, state)
                }
                None if rest.peek().is_some() => {
                    module = Some(word);
                    continue;
                }
                None => return Err(word.to_owned()),
            },
        };
        let (module, points) = match (target.split_once('.'), module) {
            (Some((module, points)), _) => (module, points),
            // A state for a whole module, as in `set oven off`, is not accepted: it is `all=off`.
            (None, Some(module)) => (module, target),
            (None, None) => return Err(word.to_owned()),
        };
        for point in points.split(',') {
            let each = numbered(point).ok_or_else(|| word.to_owned())?;
            if module.is_empty() || point.is_empty() {
                return Err(word.to_owned());
            }
            orders.extend(each.into_iter().map(|point| Order {
                module: module.to_owned(),
                point,
                state,
            }));
        }
    }
    if orders.is_empty() {
        return Err(words.join(" "));
    }
    Ok(orders)
}

/// The most outputs that a module has.
const OUTPUTS_MAX: u8 = 32;

/// Expands a range: `1-3` to `1`, `2` and `3`, `k1-k3` and `k1-3` to `k1` and so on; anything else
/// stays as it is. None for an invalid range.
fn numbered(point: &str) -> Option<Vec<String>> {
    let Some((first, last)) = point.split_once('-') else {
        return Some(vec![point.to_owned()]);
    };
    let parted = |text: &str| {
        let digits = text.trim_start_matches(|c: char| c.is_ascii_alphabetic());
        let (letters, _) = text.split_at(text.len() - digits.len());
        let number: u8 = digits.parse().ok()?;
        Some((letters.to_owned(), number))
    };
    let ((letters, low), (other, high)) = (parted(first)?, parted(last)?);
    let fits = low <= high && high <= OUTPUTS_MAX && (other.is_empty() || other == letters);
    fits.then(|| {
        (low..=high)
            .map(|number| format!("{letters}{number}"))
            .collect()
    })
}

impl Order {
    /// The command for the output with this path.
    pub(in crate::commands) fn to(path: &str, state: State) -> Option<Order> {
        let (module, point) = path.split_once('.')?;
        Some(Order {
            module: module.to_owned(),
            point: point.to_owned(),
            state,
        })
    }

    /// `pump.do0`.
    pub(in crate::commands) fn path(&self) -> String {
        format!("{}.{}", self.module, self.point)
    }

    /// The selector to resolve, unless the path is that of a single output already.
    pub(super) fn needs(&self) -> Option<String> {
        let number = self.point.bytes().all(|byte| byte.is_ascii_digit());
        if number || self.point == "all" {
            Some(format!("{}.*", self.module))
        } else {
            let path = self.path();
            path.contains(['*', '?', '[']).then_some(path)
        }
    }

    /// The command for an existing output, if it is selected.
    pub(super) fn of(&self, output: &PointInfo) -> Option<Order> {
        let label = output
            .label
            .trim_start_matches(|c: char| c.is_ascii_alphabetic());
        let is_number = self.point.bytes().all(|byte| byte.is_ascii_digit());
        let meant = !is_number || label == self.point;
        meant.then(|| Order {
            module: output.module.clone(),
            point: output.label.clone(),
            state: self.state,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(line: &str) -> Result<String, String> {
        let words: Vec<String> = line.split(' ').map(str::to_owned).collect();
        let orders = parse(&words)?;
        let each = orders
            .iter()
            .map(|order| format!("{} {:?}", order.path(), order.state));
        Ok(each.collect::<Vec<_>>().join(", "))
    }

    #[test]
    fn all_forms_are_understood() {
        for (line, meaning) in [
            ("pump.do0 on", "pump.do0 On"),
            ("pump.do0=off", "pump.do0 Off"),
            ("pump.do0 吸合", "pump.do0 On"),
            ("yard 1,3=on", "yard.1 On, yard.3 On"),
            ("yard.k1,k3 off", "yard.k1 Off, yard.k3 Off"),
            ("yard 1-3=ON", "yard.1 On, yard.2 On, yard.3 On"),
            ("yard.k7-k8,k1 Off", "yard.k7 Off, yard.k8 Off, yard.k1 Off"),
            ("pump do0-1=on", "pump.do0 On, pump.do1 On"),
            (
                "oven k1=on k2=off k5=toggle",
                "oven.k1 On, oven.k2 Off, oven.k5 Toggle",
            ),
            ("oven all=off", "oven.all Off"),
            ("oven k1=on yard k2=off", "oven.k1 On, yard.k2 Off"),
            ("*.do* off", "*.do* Off"),
        ] {
            assert_eq!(told(line).as_deref(), Ok(meaning), "{line}");
        }
    }

    #[test]
    fn what_makes_no_sense_is_named() {
        for (line, word) in [
            ("pump.do0", "pump.do0"),
            ("pump.do0=maybe", "pump.do0=maybe"),
            ("oven off", "oven"),
            ("k1=on", "k1=on"),
            ("oven k1,=on", "k1,=on"),
            ("pump do0", "do0"),
            ("yard 3-1=on", "3-1=on"),
            ("yard 1-99=on", "1-99=on"),
            ("yard k1-do3=on", "k1-do3=on"),
            ("yard 1-=on", "1-=on"),
        ] {
            assert_eq!(told(line), Err(word.to_owned()), "{line}");
        }
    }
}
