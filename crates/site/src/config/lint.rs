//! What is valid in a configuration but unwise: each with a stable code. What is invalid is a
//! [`Problem`](super::Problem).

use super::{Config, LineConfig, ModuleConfig};
use railbus_device::{Module, Op};
use railbus_wire::{Address, Frame, Micros, Protocol, SerialSettings, lc02, r55};

/// A warning and what it is about.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Warning {
    /// The table and key, as `module.pump.address` or `line.main`.
    pub path: String,
    /// What is unwise.
    pub kind: Unwise,
}

/// What is unwise.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Unwise {
    /// This Modbus address is a start character of another protocol on the line: modules of that
    /// protocol begin to read this module's frames.
    FirstByte(Address, Protocol),
    /// An address that Modbus reserves, 248 to 255 [MODBUS §1.8].
    ReservedAddress(Address),
    /// In Modbus, address 0 is the broadcast address: a module switched to Modbus could not be
    /// reached there.
    AddressZero,
    /// The polls need more than the line's time: at least this percentage of it, and this time for
    /// one round, even if all modules answer at once.
    Overloaded {
        /// Of the line's time.
        percent: u32,
        /// One round of all modules.
        round: Micros,
    },
    /// One round of all modules takes longer than this module's maximum age.
    GoesStale {
        /// At least one round.
        round: Micros,
        /// The module's own limit.
        max_age: Micros,
    },
    /// This many modules have another speed than their line's.
    TwoSpeeds(u32),
    /// This many modules have another character format than their line's.
    TwoFormats(u32),
    /// ASCII modules with and without checksum share a line: to those without, a frame that lost a
    /// byte may still be valid.
    TwoChecksums,
    /// The port's name depends on the order in which adapters are plugged in; the stable name, if
    /// the machine has one.
    UnstablePort(Option<String>),
}

impl Unwise {
    /// The stable code.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Unwise::FirstByte(..) => "L001",
            Unwise::ReservedAddress(_) => "L002",
            Unwise::AddressZero => "L003",
            Unwise::Overloaded { .. } => "L010",
            Unwise::GoesStale { .. } => "L011",
            Unwise::TwoSpeeds(_) => "L012",
            Unwise::TwoFormats(_) => "L013",
            Unwise::TwoChecksums => "L014",
            Unwise::UnstablePort(_) => "L020",
        }
    }
}

/// All warnings, line by line. `stable` returns the stable name of a port, if it has one.
#[must_use]
pub fn lint(config: &Config, stable: impl Fn(&str) -> Option<String>) -> Vec<Warning> {
    let mut warnings = Vec::new();
    for (name, line) in &config.lines {
        let path = format!("line.{name}");
        if is_unstable(&line.port) {
            let kind = Unwise::UnstablePort(stable(&line.port));
            warnings.push(warning(format!("{path}.port"), kind));
        }
        let modules: Vec<_> = config.modules_of(name).collect();
        for (module, about) in &modules {
            addresses(module, about, &modules, &mut warnings);
        }
        settings(&path, line, &modules, &mut warnings);
        load(&path, &modules, &mut warnings);
    }
    warnings
}

type Named<'c> = (&'c String, &'c ModuleConfig);

const fn warning(path: String, kind: Unwise) -> Warning {
    Warning { path, kind }
}

/// The kernel numbers adapters in the order in which they are plugged in.
fn is_unstable(port: &str) -> bool {
    ["/dev/ttyUSB", "/dev/ttyACM"]
        .iter()
        .any(|kind| port.starts_with(kind))
}

fn addresses(name: &str, about: &ModuleConfig, others: &[Named<'_>], warnings: &mut Vec<Warning>) {
    let (address, protocol) = (about.setup.address, about.setup.protocol);
    let path = || format!("module.{name}.address");
    if protocol != Protocol::Rtu {
        if address.0 == 0
            && about
                .setup
                .family
                .profile()
                .protocols
                .contains(&Protocol::Rtu)
        {
            warnings.push(warning(path(), Unwise::AddressZero));
        }
        return;
    }
    if address.0 >= 248 {
        warnings.push(warning(path(), Unwise::ReservedAddress(address)));
    }
    let spoken = |wanted: &Protocol| others.iter().any(|(_, o)| o.setup.protocol == *wanted);
    for other in Protocol::ALL.into_iter().filter(spoken) {
        if first_bytes(other).contains(&address.0) {
            warnings.push(warning(path(), Unwise::FirstByte(address, other)));
        }
    }
}

/// The start characters of a protocol's requests and replies; Modbus frames can start with any
/// address.
const fn first_bytes(protocol: Protocol) -> &'static [u8] {
    match protocol {
        Protocol::Rtu => &[],
        // [EDA §2.1, ADAM §2.1]
        Protocol::Ascii => b"$%#@~!>?",
        Protocol::Lc02 => &[
            lc02::envelope::REQUEST_START[0],
            lc02::envelope::RESPONSE_START[0],
        ],
        Protocol::R55 => &[r55::REQUEST_START, r55::RESPONSE_START],
    }
}

fn settings(path: &str, line: &LineConfig, modules: &[Named<'_>], warnings: &mut Vec<Warning>) {
    let serials = || modules.iter().map(|(_, module)| module.setup.serial);
    // If no module has the line's own settings, those of its first module count.
    let own = serials().find(|serial| *serial == line.serial);
    let own = own.or_else(|| serials().next()).unwrap_or(line.serial);
    let differing = |differs: &dyn Fn(&SerialSettings) -> bool| {
        let count = serials().filter(differs).count();
        u32::try_from(count).unwrap_or(u32::MAX)
    };
    let speeds = differing(&|serial| serial.baud != own.baud);
    let formats = differing(&|serial| serial.character != own.character);
    if speeds > 0 {
        warnings.push(warning(path.to_owned(), Unwise::TwoSpeeds(speeds)));
    }
    if formats > 0 {
        warnings.push(warning(path.to_owned(), Unwise::TwoFormats(formats)));
    }
    let ascii = modules.iter().map(|(_, module)| module.setup);
    let ascii = || {
        ascii
            .clone()
            .filter(|setup| setup.protocol == Protocol::Ascii)
    };
    if ascii().any(|setup| setup.checksum) && ascii().any(|setup| !setup.checksum) {
        warnings.push(warning(path.to_owned(), Unwise::TwoChecksums));
    }
}

/// Compares the time that the polls need with what the line has.
fn load(path: &str, modules: &[Named<'_>], warnings: &mut Vec<Warning>) {
    let round = modules.iter().map(|(_, module)| poll_time(module).0).sum();
    let percent = load_percent(modules.iter().map(|(_, module)| *module));
    let round = Micros(round);
    if percent > 100 {
        let kind = Unwise::Overloaded { percent, round };
        warnings.push(warning(path.to_owned(), kind));
    }
    for (name, module) in modules {
        let max_age = module.plan.max_age;
        if module.plan.enabled && round > max_age {
            let kind = Unwise::GoesStale { round, max_age };
            warnings.push(warning(format!("module.{name}.max_age"), kind));
        }
    }
}

/// The share of a line's time that polling its modules takes at least, in percent, if they answer
/// at once.
pub fn load_percent<'c>(modules: impl Iterator<Item = &'c ModuleConfig>) -> u32 {
    let shares = modules.map(|module| {
        let every = module.plan.interval.0.max(1);
        poll_time(module).0.saturating_mul(10_000) / every
    });
    u32::try_from(shares.sum::<u64>().div_ceil(100)).unwrap_or(u32::MAX)
}

/// The minimum time on the wire of reading a module once.
fn poll_time(about: &ModuleConfig) -> Micros {
    let Ok(module) = Module::new(about.setup) else {
        return Micros::ZERO;
    };
    if !about.plan.enabled {
        return Micros::ZERO;
    }
    let times = module.full_poll().filter_map(|op| wire_time(&module, &op));
    times.fold(Micros::ZERO, |sum, time| sum + time)
}

/// How long an op occupies the line if the module answers at once: the silence before the request,
/// the request, the silence that ends a frame for a Modbus module, and the longest reply. `None` if
/// the model has no frame for the op.
#[must_use]
pub fn wire_time(module: &Module, op: &Op) -> Option<Micros> {
    let exchange = module.exchange(op).ok()?;
    let setup = module.setup();
    let silence = match setup.protocol {
        Protocol::Rtu => setup.serial.t3_5(),
        _ => Micros::ZERO,
    };
    let mut frame = Frame::new();
    exchange.encode(&mut frame);
    let bytes = frame.bytes().len() + exchange.response_len_max();
    Some(setup.request_gap() + setup.serial.frame_time(bytes) + silence)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A configuration of one line, given the modules' names and keys.
    fn codes(port: &str, modules: &[(&str, &str)]) -> Vec<(String, &'static str)> {
        let mut text = format!("[line.main]\nport = \"{port}\"\n");
        for (name, about) in modules {
            text += &format!("[module.{name}]\nline = \"main\"\n{about}\n");
        }
        let config = Config::parse(&text).unwrap();
        let warnings = lint(&config, |_| Some("/dev/serial/by-id/x".to_owned()));
        warnings
            .into_iter()
            .map(|w| (w.path, w.kind.code()))
            .collect()
    }

    const SLOWLY: &str = "poll = \"2s\"\nmax_age = \"10s\"";

    #[test]
    fn a_usual_line_gives_no_warning() {
        let found = codes(
            "tcp:10.0.0.5:4001",
            &[
                ("oven", "model = \"erc8\"\naddress = 3"),
                ("yard", "model = \"r55\"\noutputs = 8\naddress = 4"),
            ],
        );
        assert_eq!(found, []);
    }

    #[test]
    fn addresses_that_begin_frames_of_another_protocol_are_told() {
        let eda = |address: u8| {
            format!("model = \"eda9060a\"\nprotocol = \"rtu\"\naddress = {address}\n{SLOWLY}")
        };
        let r55 = format!("model = \"r55\"\naddress = 4\n{SLOWLY}");
        let ascii = format!("model = \"eda9060a\"\naddress = 7\n{SLOWLY}");
        let lc02 = format!("model = \"eda9050\"\nprotocol = \"lc02\"\naddress = 8\n{SLOWLY}");
        for (other, address) in [
            (&r55, 0x55),
            (&r55, 0x22),
            (&ascii, 0x24),
            (&ascii, 0x3E),
            (&lc02, 0x4C),
            (&lc02, 0x6C),
        ] {
            let one = eda(address);
            let found = codes("pty:/tmp/x", &[("a", one.as_str()), ("b", other.as_str())]);
            assert_eq!(
                found,
                [("module.a.address".to_owned(), "L001")],
                "{address}"
            );
        }
        let alone = eda(0x55);
        assert_eq!(
            codes(
                "pty:/tmp/x",
                &[("a", alone.as_str()), ("b", ascii.as_str())]
            ),
            []
        );
        let reserved = eda(250);
        let found = codes("pty:/tmp/x", &[("a", reserved.as_str())]);
        assert_eq!(found, [("module.a.address".to_owned(), "L002")]);
        let zero = format!("model = \"eda9050\"\naddress = 0\n{SLOWLY}");
        let found = codes("pty:/tmp/x", &[("a", zero.as_str())]);
        assert_eq!(found, [("module.a.address".to_owned(), "L003")]);
    }

    #[test]
    fn different_settings_on_one_line_are_told() {
        let fast = format!("model = \"eda9060a\"\nbaud = 19200\naddress = 1\n{SLOWLY}");
        let slow = format!("model = \"eda9060a\"\naddress = 2\n{SLOWLY}");
        let summed = format!("model = \"eda9060a\"\naddress = 3\nchecksum = true\n{SLOWLY}");
        let even = format!("model = \"emd2a2q\"\naddress = 4\nformat = \"8E1\"\n{SLOWLY}");
        let line = |code| ("line.main".to_owned(), code);
        assert_eq!(
            codes("pty:/tmp/x", &[("a", &fast), ("b", &slow)]),
            [line("L012")]
        );
        assert_eq!(
            codes("pty:/tmp/x", &[("a", &even), ("b", &slow)]),
            [line("L013")]
        );
        assert_eq!(
            codes("pty:/tmp/x", &[("a", &summed), ("b", &slow)]),
            [line("L014")]
        );
        // If all modules have the same speed, that is one speed, even if it is not the line's.
        assert_eq!(codes("pty:/tmp/x", &[("a", &fast)]), []);
    }

    #[test]
    fn a_port_that_changes_its_name_is_told() {
        let found = codes("/dev/ttyUSB0", &[]);
        assert_eq!(found, [("line.main.port".to_owned(), "L020")]);
        assert_eq!(codes("/dev/serial/by-id/x", &[]), []);
    }

    #[test]
    fn a_load_above_what_the_line_carries_is_told_with_its_percentage() {
        let text = |poll: &str| {
            format!(
                "[line.main]\nport = \"pty:/tmp/x\"\n[module.oven]\nline = \"main\"\n\
                 model = \"erc8\"\naddress = 3\n{poll}\n"
            )
        };
        let of = |poll: &str| Config::parse(&text(poll)).unwrap();
        // The silence before the request, 8 and 6 characters of 10 bits at 9600, and 3.5
        // characters between them.
        let config = of("poll = \"100ms\"");
        let one = poll_time(&config.modules["oven"]);
        let gap = config.modules["oven"].setup.request_gap();
        assert_eq!(one, gap + Micros(14_584 + 3_646));
        let percent = load_percent(config.modules.values());
        assert_eq!(u64::from(percent), one.0.div_ceil(1_000));
        let found = lint(&of("poll = \"20ms\""), |_| None);
        assert_eq!(found.len(), 1);
        match found[0].kind {
            Unwise::Overloaded { percent, round } => {
                assert_eq!((u64::from(percent), round), (one.0.div_ceil(200), one));
            }
            ref other => panic!("{other:?}"),
        }
        let found = lint(&of("poll = \"1s\"\nmax_age = \"20ms\""), |_| None);
        let kind = Unwise::GoesStale {
            round: one,
            max_age: Micros(20_000),
        };
        assert_eq!(
            found,
            [Warning {
                path: "module.oven.max_age".to_owned(),
                kind
            }]
        );
        assert_eq!(lint(&of("poll = \"never\""), |_| None), []);
    }
}
