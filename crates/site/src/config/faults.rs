//! Faults of a simulation, as they are written: `drop 5%, delay 200ms±50`.
//!
//! A simulated plant's file, `--fault` and the prompt use the same syntax.

use railbus_device::{PointKind, Setup};
use railbus_wire::Micros;
use std::mem::discriminant;

/// The maximum number of faults in one list.
const FAULTS_MAX: usize = 32;

/// The maximum number of replies that a fault can be limited to.
const TIMES_MAX: u32 = 1_000_000;

/// The shortest interval of something that repeats.
const OFTENEST: Micros = Micros::from_millis(1);

/// A probability in millionths: 1 to 1 000 000.
pub type Millionths = u32;

/// Every time.
const ALWAYS: Millionths = 1_000_000;

/// A fault of a module, or of a line and all its modules.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InjectedFault {
    /// It receives and executes requests, and never answers.
    Mute,
    /// It receives nothing.
    Deaf,
    /// It has no power.
    Dead,
    /// The adapter echoes what it sends. Lines only.
    Echo,
    /// Per request: it is not received; per reply: it is not sent.
    Drop(Millionths),
    /// Per character: one bit is inverted.
    Flip(Millionths),
    /// Per character: it is lost.
    Skip(Millionths),
    /// One to three random characters while the line is idle. Lines only.
    Noise(Noise),
    /// Per reply: a 00 comes before it, or an FF after it.
    Glitch(Millionths),
    /// Each reply is delayed by a time between these two.
    Delay(Micros, Micros),
    /// Per reply: it is sent twice.
    Duplicate(Millionths),
    /// Per reply: it comes in pieces, with pauses of this length.
    Split(Millionths, Micros),
    /// Garbage: all the time, or with this probability in place of a reply.
    Babble(Option<Millionths>),
    /// The power fails once in this time on average, and is off for the second time.
    Cuts(Micros, Micros),
    /// It has this address, as if it had been set so on site. Modules only.
    DupAddress(u8),
    /// The last character of each reply is replaced by one that no protocol accepts.
    Bad,
    /// This output, by its index, no longer follows its commands. Modules only.
    Stuck(u8),
}

impl InjectedFault {
    /// Whether a module has only one of the two at a time: the later replaces the earlier.
    #[must_use]
    pub fn excludes(self, other: InjectedFault) -> bool {
        match (self, other) {
            (InjectedFault::Stuck(one), InjectedFault::Stuck(other)) => one == other,
            _ => discriminant(&self) == discriminant(&other),
        }
    }

    /// Whether it affects replies, and can therefore be limited to a number of them.
    const fn is_of_replies(self) -> bool {
        match self {
            InjectedFault::Mute
            | InjectedFault::Flip(_)
            | InjectedFault::Skip(_)
            | InjectedFault::Glitch(_)
            | InjectedFault::Delay(..)
            | InjectedFault::Duplicate(_)
            | InjectedFault::Split(..)
            | InjectedFault::Babble(Some(_))
            | InjectedFault::Bad => true,
            InjectedFault::Deaf
            | InjectedFault::Dead
            | InjectedFault::Echo
            | InjectedFault::Drop(_)
            | InjectedFault::Noise(_)
            | InjectedFault::Babble(None)
            | InjectedFault::Cuts(..)
            | InjectedFault::DupAddress(_)
            | InjectedFault::Stuck(_) => false,
        }
    }
}

/// How often there is noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Noise {
    /// Probability per character time.
    Chance(Millionths),
    /// The mean interval.
    Every(Micros),
}

/// A fault, its duration, and the words it was written in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FaultOrder {
    /// The fault.
    pub fault: InjectedFault,
    /// Its duration; if `None`, until it is cleared.
    pub lasts: Option<Micros>,
    /// The number of the module's replies it is limited to; unlimited if `None`.
    pub times: Option<u32>,
    /// The words.
    pub words: String,
}

/// Why a fault could not be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FaultError {
    /// There is no such fault.
    Unknown(String),
    /// What its arguments should look like, such as `drop 5%`.
    Form(&'static str),
    /// Only a line can have it.
    LinesOnly(&'static str),
    /// Only a module can have it.
    ModulesOnly(&'static str),
    /// It can't be limited to a number of replies.
    Uncounted(&'static str),
    /// More than a list may have.
    TooMany(usize),
}

/// What faults apply to.
#[derive(Clone, Copy, Debug)]
pub enum FaultsOf<'s> {
    /// A line and all its modules.
    Line,
    /// A module with this setup.
    Module(&'s Setup),
}

/// Every fault by name, and its syntax.
pub const FAULTS: [(&str, &str); 17] = [
    ("mute", "mute"),
    ("deaf", "deaf"),
    ("dead", "dead"),
    ("echo", "echo"),
    ("drop", "drop 5%"),
    ("flip", "flip 1e-4"),
    ("skip", "skip 1e-4"),
    ("noise", "noise 1e-4, or noise 2s"),
    ("glitch", "glitch 10%"),
    ("delay", "delay 200ms, or delay 200ms±50"),
    ("duplicate", "duplicate 10%"),
    ("split", "split 20% 30ms"),
    ("babble", "babble, or babble 5%"),
    ("cuts", "cuts 10m 2s"),
    ("dup-address", "dup-address 6"),
    ("bad", "bad, or bad once, or bad 3x"),
    ("stuck", "stuck k1"),
];

/// Reads a comma-separated list of faults.
///
/// # Errors
/// The first that can't be read.
pub fn parse_faults(text: &str, of: FaultsOf<'_>) -> Result<Vec<FaultOrder>, FaultError> {
    let orders: Vec<FaultOrder> = text
        .split([',', '，'])
        .map(|one| parse_fault(one, of))
        .collect::<Result<_, _>>()?;
    if orders.len() > FAULTS_MAX {
        return Err(FaultError::TooMany(FAULTS_MAX));
    }
    Ok(orders)
}

fn parse_fault(text: &str, of: FaultsOf<'_>) -> Result<FaultOrder, FaultError> {
    let mut words = text.split_whitespace().peekable();
    let name = words.next().unwrap_or_default();
    let known = FAULTS.iter().find(|(known, _)| *known == name);
    let (name, form) = *known.ok_or_else(|| FaultError::Unknown(name.to_owned()))?;
    match (name, of) {
        ("echo" | "noise", FaultsOf::Module(_)) => return Err(FaultError::LinesOnly(name)),
        ("dup-address" | "stuck", FaultsOf::Line) => return Err(FaultError::ModulesOnly(name)),
        _ => {}
    }
    let fault = read(name, &mut words, of).ok_or(FaultError::Form(form))?;
    words.next_if_eq(&"for");
    let end = words.next();
    let times = end.and_then(times);
    let lasts = match end.filter(|_| times.is_none()) {
        None => None,
        Some(word) => Some(Micros::parse(word).ok_or(FaultError::Form(form))?),
    };
    if words.next().is_some() {
        return Err(FaultError::Form(form));
    }
    let counts = fault.is_of_replies() && matches!(of, FaultsOf::Module(_));
    if times.is_some() && !counts {
        return Err(FaultError::Uncounted(name));
    }
    Ok(FaultOrder {
        fault,
        lasts,
        times,
        words: text.split_whitespace().collect::<Vec<_>>().join(" "),
    })
}

/// The fault of this name with its arguments; `None` if these are missing or wrong.
fn read<'t>(
    name: &str,
    words: &mut std::iter::Peekable<impl Iterator<Item = &'t str>>,
    of: FaultsOf<'_>,
) -> Option<InjectedFault> {
    let fault = match name {
        "mute" => InjectedFault::Mute,
        "deaf" => InjectedFault::Deaf,
        "dead" => InjectedFault::Dead,
        "echo" => InjectedFault::Echo,
        "drop" => InjectedFault::Drop(chance(words.next()?)?),
        "flip" => InjectedFault::Flip(chance(words.next()?)?),
        "skip" => InjectedFault::Skip(chance(words.next()?)?),
        "glitch" => InjectedFault::Glitch(chance(words.next()?)?),
        "duplicate" => InjectedFault::Duplicate(chance(words.next()?)?),
        "noise" => {
            let word = words.next()?;
            let every = often(word).map(Noise::Every);
            InjectedFault::Noise(every.or_else(|| chance(word).map(Noise::Chance))?)
        }
        "delay" => {
            let (from, to) = spread(words.next()?)?;
            InjectedFault::Delay(from, to)
        }
        "split" => InjectedFault::Split(chance(words.next()?)?, positive(words.next()?)?),
        "cuts" => InjectedFault::Cuts(often(words.next()?)?, often(words.next()?)?),
        "babble" => {
            let of_replies = words.peek().and_then(|word| chance(word));
            if of_replies.is_some() {
                words.next();
            }
            InjectedFault::Babble(of_replies)
        }
        "bad" => InjectedFault::Bad,
        "stuck" => InjectedFault::Stuck(output(words.next()?, of)?),
        _ => InjectedFault::DupAddress(words.next()?.parse().ok()?),
    };
    Some(fault)
}

/// An output's label, such as `k1`.
fn output(label: &str, of: FaultsOf<'_>) -> Option<u8> {
    let FaultsOf::Module(setup) = of else {
        return None;
    };
    let point = setup.point(label)?;
    (point.kind == PointKind::Output).then_some(point.index)
}

/// `once`, or `3x`.
fn times(word: &str) -> Option<u32> {
    let times = match word {
        "once" => 1,
        _ => word.strip_suffix('x')?.parse().ok()?,
    };
    (1..=TIMES_MAX).contains(&times).then_some(times)
}

/// `5%`, `0.05` and `5e-2` are all accepted.
fn chance(word: &str) -> Option<Millionths> {
    let (number, whole) = match word.strip_suffix('%') {
        Some(number) => (number, 100.0),
        None => (word, 1.0),
    };
    let part: f64 = number.parse().ok()?;
    let millionths = (part / whole * f64::from(ALWAYS)).round();
    (1.0..=f64::from(ALWAYS))
        .contains(&millionths)
        .then_some(millionths as Millionths)
}

fn positive(word: &str) -> Option<Micros> {
    Micros::parse(word).filter(|time| *time > Micros::ZERO)
}

/// A repetition interval, no shorter than the minimum: nothing else would ever happen.
fn often(word: &str) -> Option<Micros> {
    Micros::parse(word).filter(|time| *time >= OFTENEST)
}

/// `200ms`, or `200ms±50` (also `+-`); the spread has the same unit if it names none.
fn spread(word: &str) -> Option<(Micros, Micros)> {
    let parts = word.split_once('±').or_else(|| word.split_once("+-"));
    let Some((middle, spread)) = parts else {
        return positive(word).map(|time| (time, time));
    };
    let unit = middle.trim_start_matches(|c: char| c.is_ascii_digit() || c == '.');
    let middle = positive(middle)?;
    let spread = Micros::parse(spread).or_else(|| Micros::parse(&format!("{spread}{unit}")))?;
    Some((middle - spread, middle + spread))
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_device::Family;
    use railbus_wire::Address;

    fn oven() -> Setup {
        Setup::new(Family::Erc8, Address(1))
    }

    fn one(text: &str) -> Result<(InjectedFault, Option<Micros>), FaultError> {
        let oven = oven();
        let of_line = ["echo", "noise"].iter().any(|name| text.starts_with(name));
        let of = match of_line {
            true => FaultsOf::Line,
            false => FaultsOf::Module(&oven),
        };
        let mut all = parse_faults(text, of)?;
        let order = all.pop().ok_or(FaultError::TooMany(0))?;
        Ok((order.fault, order.lasts))
    }

    #[test]
    fn every_fault_is_read_as_it_is_documented() {
        for (name, forms) in FAULTS {
            for form in forms.split(", or ") {
                assert!(one(form).is_ok(), "{form}");
                assert!(form.starts_with(name));
                if form.ends_with("once") || form.ends_with("3x") {
                    continue;
                }
                let Ok((_, lasts)) = one(&format!("{form} 10s")) else {
                    panic!("{form} 10s");
                };
                assert_eq!(lasts, Some(Micros::from_secs(10)), "{form}");
                assert_eq!(one(&format!("{form} for 10s")), one(&format!("{form} 10s")));
            }
        }
    }

    #[test]
    fn chances_and_times_are_read() {
        let millis = Micros::from_millis;
        for text in ["drop 5%", "drop 0.05", "drop 5e-2"] {
            assert_eq!(one(text), Ok((InjectedFault::Drop(50_000), None)), "{text}");
        }
        for text in ["delay 200ms±50", "delay 200ms+-50ms"] {
            let expected = InjectedFault::Delay(millis(150), millis(250));
            assert_eq!(one(text), Ok((expected, None)), "{text}");
        }
        let noise = |noise| Ok((InjectedFault::Noise(noise), None));
        assert_eq!(one("noise 1e-4"), noise(Noise::Chance(100)));
        assert_eq!(one("noise 2s"), noise(Noise::Every(millis(2_000))));
    }

    #[test]
    fn what_is_no_fault_is_told() {
        for wrong in [
            "drop",
            "drop 0",
            "drop 101%",
            "drop nan",
            "delay 200",
            "mute 5%",
            "cuts 1m",
            "cuts 1us 1s",
            "noise 999us",
        ] {
            assert!(matches!(one(wrong), Err(FaultError::Form(_))), "{wrong}");
        }
        for wrong in ["", "drpo 5%", "mute,", "drop 5%,, mute"] {
            assert!(matches!(one(wrong), Err(FaultError::Unknown(_))), "{wrong}");
        }
        let oven = oven();
        let of_oven = FaultsOf::Module(&oven);
        assert_eq!(
            parse_faults("echo", of_oven),
            Err(FaultError::LinesOnly("echo"))
        );
        for (text, name) in [("dup-address 6", "dup-address"), ("stuck k1", "stuck")] {
            let of_line = parse_faults(text, FaultsOf::Line);
            assert_eq!(of_line, Err(FaultError::ModulesOnly(name)));
        }
        for wrong in ["stuck", "stuck k9", "stuck di1", "stuck k0"] {
            assert!(matches!(one(wrong), Err(FaultError::Form(_))), "{wrong}");
        }
        for (wrong, name) in [("deaf once", "deaf"), ("cuts 10m 2s 3x", "cuts")] {
            assert_eq!(one(wrong), Err(FaultError::Uncounted(name)), "{wrong}");
        }
        let of_line = parse_faults("bad once", FaultsOf::Line);
        assert_eq!(of_line, Err(FaultError::Uncounted("bad")));
        let many = ["mute"; FAULTS_MAX + 1].join(",");
        assert_eq!(
            parse_faults(&many, of_oven),
            Err(FaultError::TooMany(FAULTS_MAX))
        );
    }

    #[test]
    fn a_fault_may_be_for_so_many_replies() {
        let oven = oven();
        let counted = |text: &str| {
            let all = parse_faults(text, FaultsOf::Module(&oven));
            all.map(|all| (all[0].fault, all[0].times, all[0].lasts))
        };
        assert_eq!(counted("bad once"), Ok((InjectedFault::Bad, Some(1), None)));
        assert_eq!(
            counted("mute for 3x"),
            Ok((InjectedFault::Mute, Some(3), None))
        );
        assert_eq!(
            counted("stuck k3"),
            Ok((InjectedFault::Stuck(2), None, None))
        );
        assert!(counted("bad 0x").is_err() && counted("bad 1000001x").is_err());
    }
}
