//! `railbus fleet serve`: runs the centre.

use super::FleetText;
use crate::commands::context::hub_socket;
use crate::commands::serve::{listen_flags, names, tls_wish};
use clap::{ArgMatches, Command};
use railbus_app::failure::Failure;
use railbus_gateway::hub::{self, HubOptions};
use railbus_words::Lang;

/// The name of the command.
pub(super) const NAME: &str = "serve";

/// Its parser and help.
pub(super) fn define(lang: Lang) -> Command {
    let usage = "railbus fleet serve DIR [--listen ADDR] [--tls auto]";
    let folder = super::required(lang, "DIR", FleetText::Folder);
    let [listen, network @ ..] = listen_flags(lang, FleetText::Listen);
    super::verb(lang, NAME, FleetText::Serve, usage)
        .arg(folder)
        .arg(listen)
        .args(network.map(|flag| flag.requires("listen")))
}

/// Serves until it is stopped.
pub(super) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let options = HubOptions {
        folder: super::path(matches, "DIR"),
        socket: hub_socket(matches),
        listen: matches.get_one("listen").copied(),
        tls: tls_wish(matches),
        names: names(matches),
    };
    hub::run(lang, &options)
}
