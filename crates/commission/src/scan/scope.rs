//! The scope of a scan, and its order.

use super::ask::{ProbeKind, ScanProbe};
use railbus_device::Family;
use railbus_wire::{Address, Baud, Character, Micros, Protocol, SerialSettings};

/// How far a scan goes by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Depth {
    /// 9600 8N1, addresses 1 to 32.
    #[default]
    Quick,
    /// One speed, all addresses.
    Full,
    /// Five speeds, all addresses.
    Deep,
}

impl Depth {
    /// The name in flags and files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Depth::Quick => "quick",
            Depth::Full => "full",
            Depth::Deep => "deep",
        }
    }

    /// Timeout of the first pass: with a longer one, slower modules are found that give up their
    /// reply when another request is sent.
    const fn silence(self) -> Micros {
        Micros::from_millis(match self {
            Depth::Quick => 30,
            Depth::Full => 40,
            Depth::Deep => 50,
        })
    }
}

/// The speeds that the five families have, likely ones first. A deep scan leaves out the last.
pub const SPEEDS: [Baud; 6] = [
    Baud::B9600,
    Baud::B19200,
    Baud::B4800,
    Baud::B38400,
    Baud::B2400,
    Baud::B1200,
];
/// The highest speed that EDA modules support [EDA §1.4].
const EDA_FASTEST: Baud = Baud::B19200;

/// How many requests the retry after an empty scan may take: at 9600 that is about five seconds.
const FEW: usize = 16;

/// A configured module.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Known {
    /// Its name.
    pub name: String,
    /// Its configured model.
    pub family: Family,
    /// Speed and character format.
    pub settings: SerialSettings,
    /// Its protocol.
    pub protocol: Protocol,
    /// Its address.
    pub address: Address,
    /// Its ASCII frames carry a checksum.
    pub checksum: bool,
}

impl Known {
    /// The request that it should answer.
    pub(super) const fn question(&self) -> ScanProbe {
        let ask = match self.protocol {
            Protocol::R55 => ProbeKind::R55State,
            Protocol::Lc02 => ProbeKind::Lc02Config,
            Protocol::Ascii => ProbeKind::AsciiName(self.checksum),
            Protocol::Rtu => ProbeKind::Coils0,
        };
        ScanProbe {
            settings: self.settings,
            ask,
            address: self.address,
        }
    }
}

/// What the user asked for; the depth provides the rest.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ScanOptions {
    /// How far to go.
    pub depth: Depth,
    /// The line's own speed and format, if not the factory's.
    pub line: Option<SerialSettings>,
    /// Only these addresses.
    pub addresses: Option<Vec<u8>>,
    /// Only these protocols.
    pub protocols: Option<Vec<Protocol>>,
    /// Only these speeds.
    pub bauds: Option<Vec<Baud>>,
    /// These parities; `None` if not given.
    pub characters: Option<Vec<Character>>,
    /// ASCII only with checksum, or only without.
    pub checksum: Option<bool>,
    /// Silence counts as no reply after this long, from the end of a request.
    pub silence: Option<Micros>,
    /// Modules that were found are asked for their identification.
    pub describes: bool,
}

/// The scope: all first requests in their order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Scope {
    /// The configured modules, which are tried before all others.
    pub known: Vec<Known>,
    /// The first requests, each run for all its addresses before the next: so that a late reply to
    /// one does not interfere with the same module's next.
    pub runs: Vec<Run>,
    /// Silence counts as no reply after this long.
    pub(super) silence: Micros,
    /// A lone 0x55 board may be searched for beyond the addresses.
    pub(super) beyond: bool,
    /// A module with factory settings is tried first.
    pub(super) factory: bool,
    /// Modules that were found are asked for their identification, once all were found.
    pub(super) describes: bool,
}

/// One kind of request to a range of addresses.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Run {
    /// Speed and character format.
    pub settings: SerialSettings,
    /// The kind of request.
    pub ask: ProbeKind,
    /// The addresses.
    pub addresses: Vec<u8>,
}

impl Run {
    /// The request to those addresses that a module can have.
    fn of(settings: SerialSettings, ask: ProbeKind, addresses: &[u8]) -> Run {
        let possible = |address: &u8| {
            let address = Address(*address);
            let question = ScanProbe {
                settings,
                ask,
                address,
            };
            question.exchange().is_some()
        };
        Run {
            settings,
            ask,
            addresses: addresses.iter().copied().filter(possible).collect(),
        }
    }

    /// The request to the address at this position of the run.
    pub(super) fn question(&self, place: usize) -> Option<ScanProbe> {
        let address = self.addresses.get(place)?;
        Some(ScanProbe {
            settings: self.settings,
            ask: self.ask,
            address: Address(*address),
        })
    }
}

impl Scope {
    /// The scope for these wishes; no runs if they contradict each other.
    #[must_use]
    pub fn of(wish: &ScanOptions, known: Vec<Known>) -> Scope {
        let own = wish.line.unwrap_or(SerialSettings::FACTORY);
        let quick = wish.depth == Depth::Quick;
        let addresses = wish.addresses.clone().unwrap_or_else(|| match quick {
            true => (1..=32).collect(),
            false => (0..=255).collect(),
        });
        let bauds = wish.bauds.clone().unwrap_or_else(|| match wish.depth {
            Depth::Quick | Depth::Full => vec![own.baud],
            Depth::Deep => SPEEDS
                .into_iter()
                .filter(|baud| *baud != Baud::B1200)
                .collect(),
        });
        let characters = wish.characters.clone();
        let characters = characters.unwrap_or_else(|| vec![own.character]);
        let protocols = wish.protocols.clone();
        let protocols = protocols.unwrap_or_else(|| Protocol::ALL.to_vec());
        let settings = characters.iter().flat_map(|character| {
            let character = *character;
            bauds.iter().map(move |baud| SerialSettings {
                baud: *baud,
                character,
            })
        });
        let wanted = |ask: &ProbeKind, settings: SerialSettings| {
            let fits = match ask {
                ProbeKind::AsciiName(checksum) => {
                    wish.checksum.is_none_or(|only| only == *checksum)
                }
                _ => true,
            };
            fits && protocols.contains(&ask.protocol())
                && is_possible(
                    ask.protocol(),
                    settings,
                    wish.bauds.is_some() || settings == own,
                )
        };
        let runs = settings.flat_map(|settings| {
            let asks = FIRST.into_iter();
            let asks = asks.filter(move |ask| wanted(ask, settings));
            let addresses = &addresses;
            asks.map(move |ask| Run::of(settings, ask, addresses))
        });
        let runs: Vec<Run> = runs.collect();
        let asks_boards = runs.iter().any(|run| run.ask == ProbeKind::R55State);
        Scope {
            known,
            silence: wish.silence.unwrap_or(wish.depth.silence()),
            factory: wish.bauds.is_none() && wish.characters.is_none(),
            beyond: quick && wish.addresses.is_none() && asks_boards,
            describes: wish.describes,
            runs,
        }
    }

    /// The requests that get a long timeout if no module is found: all, if there are only a few,
    /// otherwise those to a module with factory settings.
    pub(super) fn likely(&self) -> Vec<ScanProbe> {
        self.few().unwrap_or_else(|| {
            // A lone 0x55 board always gets a long timeout.
            let mut factory: Vec<ScanProbe> = self.factory().collect();
            factory.retain(|asked| !(self.beyond && asked.ask == ProbeKind::R55State));
            factory
        })
    }

    /// All of the scope, if that is not too much to wait for.
    pub(super) fn few(&self) -> Option<Vec<ScanProbe>> {
        // A Modbus module that gets a long timeout answers or refuses the coils.
        let runs = self
            .runs
            .iter()
            .filter(|run| run.ask != ProbeKind::Registers4);
        // The request with checksum would have to wait for the reply without: it comes later.
        let (with, without): (Vec<&Run>, Vec<&Run>) =
            runs.partition(|run| run.ask == ProbeKind::AsciiName(true));
        let runs = without.into_iter().chain(with);
        let all = runs.flat_map(|run| (0..run.addresses.len()).filter_map(|at| run.question(at)));
        let mut few: Vec<ScanProbe> = self.factory().collect();
        for question in all.filter(|question| question.safe(&[]).is_some()) {
            if !few.contains(&question) {
                few.push(question);
            }
            if few.len() > FEW {
                return None;
            }
        }
        Some(few)
    }

    /// A module with factory settings, in all protocols that are scanned.
    pub(super) fn factory(&self) -> impl Iterator<Item = ScanProbe> {
        let at_factory = |run: &&Run| {
            // The request with checksum would have to wait for the reply without.
            let ask = !matches!(run.ask, ProbeKind::AsciiName(true) | ProbeKind::Registers4);
            let speed = self.factory || run.settings == SerialSettings::FACTORY;
            ask && speed && run.addresses.contains(&1)
        };
        let mut asked = Vec::new();
        let runs = self.runs.iter().filter(at_factory);
        let runs = runs.filter(move |run| {
            let is_new = !asked.contains(&run.ask);
            asked.push(run.ask);
            is_new
        });
        runs.map(|run| ScanProbe {
            settings: SerialSettings::FACTORY,
            ask: run.ask,
            address: Address(1),
        })
    }
}

/// The requests that an unknown module may answer.
const FIRST: [ProbeKind; 6] = [
    ProbeKind::R55State,
    ProbeKind::Lc02Config,
    ProbeKind::AsciiName(false),
    ProbeKind::AsciiName(true),
    ProbeKind::Coils0,
    // Modules that do not answer coils may answer registers, and those drowned out before are
    // received now.
    ProbeKind::Registers4,
];

/// Whether modules of the five families can have these settings. Explicitly given ones are tried
/// anyway, unless no module ever has them.
fn is_possible(protocol: Protocol, settings: SerialSettings, named: bool) -> bool {
    match protocol {
        Protocol::Rtu => true,
        Protocol::R55 => settings == SerialSettings::FACTORY,
        Protocol::Ascii | Protocol::Lc02 => {
            settings.character == Character::N1 && (named || settings.baud <= EDA_FASTEST)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn runs(wish: &ScanOptions) -> Vec<(u32, String, ProbeKind, usize)> {
        let scope = Scope::of(wish, Vec::new());
        let told = |run: &Run| {
            let SerialSettings { baud, character } = run.settings;
            let (rate, format) = (baud.rate(), character.to_string());
            (rate, format, run.ask, run.addresses.len())
        };
        scope.runs.iter().map(told).collect()
    }

    #[test]
    fn a_quick_scan_asks_one_speed_and_thirty_two_addresses() {
        let quick = runs(&ScanOptions::default());
        let asks: Vec<ProbeKind> = quick.iter().map(|(.., ask, _)| *ask).collect();
        assert_eq!(asks, FIRST);
        assert!(quick.iter().all(|run| (run.0, run.3) == (9600, 32)));
    }

    #[test]
    fn a_deep_scan_asks_each_protocol_at_the_speeds_that_it_has() {
        let deep = runs(&ScanOptions {
            depth: Depth::Deep,
            ..ScanOptions::default()
        });
        let at = |protocol: Protocol| {
            let of = deep.iter().filter(|run| run.2.protocol() == protocol);
            let mut bauds: Vec<u32> = of.map(|run| run.0).collect();
            bauds.dedup();
            bauds
        };
        assert_eq!(at(Protocol::Rtu), [9600, 19200, 4800, 38400, 2400]);
        assert_eq!(at(Protocol::Ascii), [9600, 19200, 4800, 2400]);
        assert_eq!(at(Protocol::R55), [9600]);
        assert!(deep.iter().all(|run| run.3 >= 255));
    }

    #[test]
    fn parity_is_for_modbus_alone() {
        let even = runs(&ScanOptions {
            characters: Some(vec![Character::N1, Character::E1]),
            ..ScanOptions::default()
        });
        let of_even: Vec<ProbeKind> = even.iter().filter(|r| r.1 == "8E1").map(|r| r.2).collect();
        assert_eq!(of_even, [ProbeKind::Coils0, ProbeKind::Registers4]);
        let nothing = runs(&ScanOptions {
            characters: Some(vec![Character::E1]),
            protocols: Some(vec![Protocol::R55]),
            ..ScanOptions::default()
        });
        assert_eq!(nothing, []);
    }
}
