//! `railbus fleet init`: the keys and servers of a new fleet.

use super::FleetText;
use crate::args;
use crate::commands::Context;
use clap::{ArgAction, ArgMatches, Command};
use railbus_app::failure::Failure;
use railbus_app::render::out;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_fleet::founding::{FoundedFile, FoundingError, NodeAddress, found};
use railbus_store::durable;
use railbus_words::{Code, Lang};
use serde_json::json;
use std::fs::DirBuilder;
use std::io::ErrorKind;
use std::os::unix::fs::DirBuilderExt as _;
use std::path::{Path, PathBuf};

/// The name of the command.
pub(super) const NAME: &str = "init";

/// Its parser and help.
pub(super) fn define(lang: Lang) -> Command {
    let usage = "railbus fleet init DIR --nats HOST[:PORT],...";
    let nats = args::flag(lang, "nats", FleetText::Nats)
        .value_name("HOST[:PORT]")
        .value_delimiter(',')
        .value_parser(node)
        .action(ArgAction::Append)
        .required(true);
    super::verb(lang, NAME, FleetText::Init, usage)
        .arg(super::required(lang, "DIR", FleetText::NewFolder))
        .arg(nats)
}

fn node(text: &str) -> Result<NodeAddress, String> {
    // The parser names the flag and the word.
    NodeAddress::parse(text).ok_or_else(String::new)
}

/// Writes the files of a new fleet.
pub(super) fn run(context: &Context, matches: &ArgMatches) -> Result<(), Failure> {
    let lang = context.lang;
    let given = super::path(matches, "DIR");
    let absolute = std::path::absolute(&given);
    let absolute = absolute.map_err(|error| super::unusable(lang, &given, &error))?;
    // `acme/` is `acme`, and `.` has a name, too.
    let folder: PathBuf = absolute.components().collect();
    let nodes = matches.get_many::<NodeAddress>("nats");
    let nodes: Vec<NodeAddress> = nodes.into_iter().flatten().cloned().collect();
    let files = found(&nodes, super::now())
        .map_err(|error| Failure::new(Code::Usage, not_founded(lang, &error)))?;
    write(lang, &folder, &files)?;
    // `.` is another folder than before by now.
    let shown = match given.file_name() {
        Some(_) => given.components().collect(),
        None => folder,
    };
    out::result(lang, &folders(lang, &shown, &nodes).render(context.format))?;
    context.note(lang.get(FleetText::Offline));
    Ok(())
}

fn not_founded(lang: Lang, error: &FoundingError) -> String {
    match error {
        FoundingError::Count(count) => lang.fill(FleetText::BadCount, &[("count", count)]),
        FoundingError::Twice(server) => lang.fill(FleetText::NamedTwice, &[("server", server)]),
        FoundingError::Key(why) => lang.fill(FleetText::NoKey, &[("why", why)]),
    }
}

/// Writes them into a folder beside, which then becomes the one of the fleet: whole or not at all,
/// and never into one that has something in it.
pub(super) fn write(lang: Lang, folder: &Path, files: &[FoundedFile]) -> Result<(), Failure> {
    let failed = |error: &dyn std::fmt::Display| super::unusable(lang, folder, error);
    if std::fs::read_dir(folder).is_ok_and(|mut found| found.next().is_some()) {
        return Err(failed(&lang.get(FleetText::NotEmpty)));
    }
    let draft = durable::beside(folder, &format!("{}.new", std::process::id()));
    begin(&draft).map_err(|error| failed(&error))?;
    let done = try_write(&draft, files).and_then(|()| std::fs::rename(&draft, folder));
    done.map_err(|error| {
        // What is left of it has keys in it.
        let _ = std::fs::remove_dir_all(&draft);
        match error.kind() {
            ErrorKind::DirectoryNotEmpty => failed(&lang.get(FleetText::NotEmpty)),
            _ => failed(&error),
        }
    })
}

/// Makes a new folder: keys don't go where somebody else made room for them.
fn begin(draft: &Path) -> std::io::Result<()> {
    if let Some(parent) = draft.parent() {
        durable::folder(parent)?;
    }
    DirBuilder::new().mode(0o700).create(draft)
}

fn try_write(draft: &Path, files: &[FoundedFile]) -> std::io::Result<()> {
    for file in files {
        let path = draft.join(&file.path);
        if let Some(parent) = path.parent() {
            durable::folder(parent)?;
        }
        let mode = if file.is_secret { 0o600 } else { 0o644 };
        durable::replace(&path, file.text.as_bytes(), Some(mode))?;
    }
    Ok(())
}

/// What is in which folder.
fn folders(lang: Lang, folder: &Path, nodes: &[NodeAddress]) -> Records {
    let server = |(at, node): (usize, &NodeAddress)| {
        let name = format!("server{}", at + 1);
        (name, "server", Some(node.to_string()))
    };
    let fixed = [("hub", "hub"), ("offline", "offline")];
    let fixed = fixed.map(|(name, role)| (name.to_owned(), role, None));
    let all = fixed
        .into_iter()
        .chain(nodes.iter().enumerate().map(server));
    let mut table = Table::new(lang.get(FleetText::Head).split('|'));
    let mut rows = Vec::new();
    for (name, role, node) in all {
        let path: PathBuf = folder.join(name);
        let path = path.display().to_string();
        rows.push(json!({ "folder": path, "for": role, "server": node }));
        let what = match role {
            "hub" => FleetText::ForHub,
            "offline" => FleetText::ForOffline,
            _ => FleetText::ForServer,
        };
        let server = node.unwrap_or_default();
        table.add([path, lang.fill(what, &[("server", &server)])]);
    }
    Records {
        key: "folders",
        rows,
        columns: &["folder", "for", "server"],
        value: "folder",
        table,
    }
}
