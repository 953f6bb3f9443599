//! The options of a scan.

use super::texts::ScanText;
use crate::args;
use crate::commands::place::Place;
use crate::commands::{Context, context};
use clap::{Arg, ArgAction, ArgGroup, ArgMatches, Command, value_parser};
use railbus_app::scan::{addresses, ranges};
use railbus_commission::scan::{Depth, SLOW_TIMEOUT, SPEEDS, ScanOptions};
use railbus_device::Family;
use railbus_host::LineName;
use railbus_wire::{Baud, Character, Micros, Protocol};
use railbus_words::Lang;

const PARITIES: [(&str, Character); 3] = [
    ("n", Character::N1),
    ("e", Character::E1),
    ("o", Character::O1),
];

/// Adds the flags.
pub(super) fn define(lang: Lang, command: Command) -> Command {
    let switch = |name, text| args::flag(lang, name, text).action(ArgAction::SetTrue);
    let list = |name, text, value: &'static str, names: Vec<&'static str>| -> Arg {
        args::flag(lang, name, text)
            .value_name(value)
            .value_delimiter(',')
            .value_parser(names)
            .hide_possible_values(true)
    };
    let one = |name, text, value: &'static str| args::flag(lang, name, text).value_name(value);
    command
        .arg(switch("quick", ScanText::Quick))
        .arg(switch("full", ScanText::Full))
        .arg(switch("deep", ScanText::Deep))
        .group(ArgGroup::new("depth").args(["quick", "full", "deep"]))
        .arg(
            one("addr", ScanText::Addr, "RANGE")
                .value_parser(|text: &str| addresses(text).map(Addresses)),
        )
        .arg(list(
            "proto",
            ScanText::Proto,
            "P,…",
            Protocol::ALL.map(Protocol::name).to_vec(),
        ))
        .arg(list("baud", ScanText::Baud, "N,…", Baud::NAMES.to_vec()))
        .arg(switch("all-bauds", ScanText::AllBauds).conflicts_with("baud"))
        .arg(list(
            "parity",
            ScanText::Parity,
            "P,…",
            PARITIES.map(|(name, _)| name).to_vec(),
        ))
        .arg(
            one("checksum", ScanText::Checksum, "WHEN")
                .value_parser(["auto", "on", "off"])
                .hide_possible_values(true),
        )
        .arg(switch("describe", ScanText::Describe))
        .arg(switch("follow", ScanText::Follow))
        .arg(switch("add", ScanText::Add))
        .arg(switch("yes", ScanText::Yes).requires("add"))
        .arg(
            one("outputs", ScanText::Outputs, "N")
                .value_parser(value_parser!(u8).range(1..=32))
                .requires("add"),
        )
        .arg(switch("resume", ScanText::Resume))
        .arg(one("max-time", ScanText::MaxTime, "TIME").value_parser(context::duration))
}

/// The options of a scan.
#[derive(Debug)]
pub(super) struct Options {
    pub(super) wish: ScanOptions,
    pub(super) follow: bool,
    pub(super) add: bool,
    pub(super) yes: bool,
    /// The model to assume where a module's replies fit several.
    pub(super) model: Option<Family>,
    /// The number of outputs of boards that don't report it.
    pub(super) outputs: Option<u8>,
    pub(super) resume: bool,
    pub(super) max_time: Option<Micros>,
}

impl Options {
    pub(super) fn of(context: &Context, matches: &ArgMatches) -> Options {
        let flag = |name: &str| matches.get_flag(name);
        let named = |name: &str| -> Option<Vec<&String>> {
            let given = matches.get_many::<String>(name);
            given.map(Iterator::collect)
        };
        let depth = match (flag("full"), flag("deep")) {
            (true, _) => Depth::Full,
            (_, true) => Depth::Deep,
            _ => Depth::Quick,
        };
        let bauds = match flag("all-bauds") {
            true => Some(SPEEDS.to_vec()),
            false => named("baud").map(|names| {
                let rates = names.iter().filter_map(|name| name.parse().ok());
                in_order(rates.filter_map(Baud::from_rate))
            }),
        };
        let protocols = named("proto").map(|names| {
            let wanted = |protocol: &Protocol| names.iter().any(|name| *name == protocol.name());
            Protocol::ALL.into_iter().filter(wanted).collect()
        });
        let characters = named("parity").map(|names| {
            let of = |name: &&String| PARITIES.into_iter().find(|(known, _)| known == *name);
            in_order(names.iter().filter_map(of).map(|(_, character)| character))
        });
        let addresses: Option<&Addresses> = matches.get_one("addr");
        let checksum = matches.get_one::<String>("checksum").map(String::as_str);
        Options {
            wish: ScanOptions {
                depth,
                line: None,
                addresses: addresses.map(|chosen| chosen.0.clone()),
                protocols,
                bauds,
                characters,
                checksum: match checksum {
                    Some("on") => Some(true),
                    Some("off") => Some(false),
                    _ => None,
                },
                silence: context.timeout,
                describes: flag("describe"),
            },
            follow: flag("follow"),
            add: flag("add"),
            yes: flag("yes"),
            model: matches
                .get_one::<String>("model")
                .and_then(|name| Family::from_name(name)),
            outputs: matches.get_one("outputs").copied(),
            resume: flag("resume"),
            max_time: matches.get_one("max-time").copied(),
        }
    }

    /// The same for a line with a speed of its own; over Modbus TCP nothing else is possible.
    pub(super) fn on(mut self, place: &Place) -> Options {
        self.wish.line = Some(place.settings);
        if let LineName::ModbusTcp { .. } = place.port {
            self.wish.protocols.get_or_insert(vec![Protocol::Rtu]);
        }
        self
    }
}

/// The command for the same scan with long timeouts, for slow modules.
pub(super) fn with_patience(context: &Context, wish: &ScanOptions) -> String {
    let ad_hoc = context.options.ad_hoc.as_ref();
    let line = ad_hoc.map(|named| &named.port).or(context.line.as_ref());
    let line = line.map(|line| format!("-l {line}"));
    let format = ad_hoc.and_then(|named| named.format);
    let format = format.map(|format| format!("--format {}", format.name()));
    let depth = (wish.depth != Depth::Quick).then(|| format!("--{}", wish.depth.name()));
    let told = |names: Vec<String>| names.join(",");
    let addresses = wish.addresses.as_ref();
    let addresses = addresses.map(|all| format!("--addr {}", ranges(all)));
    let protocols = wish.protocols.as_ref().map(|all| {
        let names = all.iter().map(|protocol| protocol.name().to_owned());
        format!("--proto {}", told(names.collect()))
    });
    let bauds = wish.bauds.as_ref().map(|all| {
        let rates = all.iter().map(|baud| baud.rate().to_string());
        format!("--baud {}", told(rates.collect()))
    });
    let parities = wish.characters.as_ref().map(|all| {
        let known = PARITIES.iter().filter(|(_, known)| all.contains(known));
        format!(
            "--parity {}",
            told(known.map(|(name, _)| (*name).to_owned()).collect())
        )
    });
    let checksum = wish.checksum.map(|on| match on {
        true => "--checksum on".to_owned(),
        false => "--checksum off".to_owned(),
    });
    let describe = wish.describes.then(|| "--describe".to_owned());
    let timeout = format!("--timeout {}ms", SLOW_TIMEOUT.0 / 1_000);
    let flags = [
        line, format, depth, addresses, protocols, bauds, parities, checksum, describe,
    ];
    let flags = flags.into_iter().flatten().chain([timeout]);
    format!("railbus scan {}", flags.collect::<Vec<_>>().join(" "))
}

/// Removes duplicates, keeping the order in which they were named.
fn in_order<T: PartialEq>(named: impl Iterator<Item = T>) -> Vec<T> {
    let mut all = Vec::new();
    for one in named {
        if !all.contains(&one) {
            all.push(one);
        }
    }
    all
}

/// Addresses as flags name them.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Addresses(Vec<u8>);
