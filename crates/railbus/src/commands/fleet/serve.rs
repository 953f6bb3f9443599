//! `railbus fleet serve`: runs the centre.

use super::FleetText;
use crate::commands::context::hub_socket;
use clap::{ArgMatches, Command};
use railbus_app::failure::Failure;
use railbus_gateway::hub::{self, HubOptions};
use railbus_words::Lang;

/// The name of the command.
pub(super) const NAME: &str = "serve";

/// Its parser and help.
pub(super) fn define(lang: Lang) -> Command {
    super::verb(lang, NAME, FleetText::Serve, "railbus fleet serve DIR").arg(super::required(
        lang,
        "DIR",
        FleetText::Folder,
    ))
}

/// Serves until it is stopped.
pub(super) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let options = HubOptions {
        folder: super::path(matches, "DIR"),
        socket: hub_socket(matches),
    };
    hub::run(lang, &options)
}
