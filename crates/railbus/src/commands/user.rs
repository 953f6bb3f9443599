//! `railbus user`: who may log in, and what each may do.

mod prompt;
mod texts;

use super::accounts_client::{AccountRequest, fleet, send};
use super::{Context, accounts_table};
use crate::args;
use crate::texts::Text;
use clap::{Arg, ArgMatches, Command, value_parser};
use railbus_app::failure::Failure;
use railbus_app::render::{Format, out, records};
use railbus_site::Role;
use railbus_words::Lang;
use serde_json::{Value, json};
use std::path::PathBuf;
pub(super) use texts::UserText;

/// The name of the command.
pub(crate) const NAME: &str = "user";

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let verb = |name, about, usage| {
        let examples = args::examples(lang, UserText::Examples);
        let verb = args::verb(lang, name, about, usage).before_help(examples);
        verb.arg(fleet(lang, UserText::Fleet))
    };
    let add = verb("add", UserText::Add, "railbus user add NAME --role ROLE")
        .arg(name(lang))
        .arg(role(lang))
        .arg(points(lang))
        .arg(password_file(lang));
    let passwd = verb("passwd", UserText::Passwd, "railbus user passwd NAME")
        .arg(name(lang))
        .arg(password_file(lang));
    args::verb(lang, NAME, UserText::About, "railbus user COMMAND")
        .before_help(args::examples(lang, UserText::Examples))
        .subcommand_required(true)
        .subcommand_help_heading(lang.get(Text::Commands))
        .subcommand(add)
        .subcommand(verb("list", UserText::List, "railbus user list"))
        .subcommand(passwd)
        .subcommand(verb("lock", UserText::Lock, "railbus user lock NAME").arg(name(lang)))
        .subcommand(verb("unlock", UserText::Unlock, "railbus user unlock NAME").arg(name(lang)))
        .subcommand(verb("remove", UserText::Remove, "railbus user remove NAME").arg(name(lang)))
        .subcommand(verb(
            "setup-link",
            UserText::SetupLink,
            "railbus user setup-link",
        ))
}

fn name(lang: Lang) -> Arg {
    let help = lang.get(UserText::Name);
    Arg::new("NAME").required(true).help(help)
}

/// `--role`.
pub(super) fn role(lang: Lang) -> Arg {
    args::flag(lang, "role", UserText::Role)
        .value_name("ROLE")
        .value_parser(Role::NAMES)
        .hide_possible_values(true)
        .required(true)
}

/// `--points`.
pub(super) fn points(lang: Lang) -> Arg {
    args::flag(lang, "points", UserText::Points)
        .value_name("PATTERN")
        .value_delimiter(',')
        .num_args(1)
        .action(clap::ArgAction::Append)
}

fn password_file(lang: Lang) -> Arg {
    args::flag(lang, "password-file", UserText::PasswordFile)
        .value_name("FILE")
        .value_parser(value_parser!(PathBuf))
}

/// The patterns that `--points` names.
pub(super) fn points_of(matches: &ArgMatches) -> Vec<String> {
    let points = matches.get_many::<String>("points");
    points.into_iter().flatten().cloned().collect()
}

/// Runs a command of the group.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    // The parser accepts no arguments without a known command.
    let Some((verb, matches)) = matches.subcommand() else {
        return Ok(());
    };
    let context = Context::of(lang, matches)?;
    let name = || {
        let name = matches.try_get_one::<String>("NAME").ok().flatten();
        name.map(String::as_str).unwrap_or_default()
    };
    let password = || {
        let file = matches.get_one::<PathBuf>("password-file");
        let role = matches.try_get_one::<String>("role").ok().flatten();
        let role = role.map(|role| format!(" --role {role}"));
        let command = format!("railbus user {verb} {}{}", name(), role.unwrap_or_default());
        prompt::password(lang, (name(), &command), file.map(PathBuf::as_path))
    };
    let locked = |locked: bool| AccountRequest::ChangeUser(name(), json!({ "locked": locked }));
    let (request, done) = match verb {
        "list" => return list(&context, matches),
        "setup-link" => return setup_link(&context, matches),
        "add" => {
            let user = json!({
                "name": name(),
                "role": matches.get_one::<String>("role"),
                "points": points_of(matches),
                "password": password()?.expose(),
            });
            (AccountRequest::AddUser(user), UserText::Added)
        }
        "passwd" => {
            let change = json!({ "password": password()?.expose() });
            (
                AccountRequest::ChangeUser(name(), change),
                UserText::HasPassword,
            )
        }
        "lock" => (locked(true), UserText::Locked),
        "unlock" => (locked(false), UserText::Unlocked),
        _ => (AccountRequest::RemoveUser(name()), UserText::Removed),
    };
    let told = send(&context, matches, &request)?;
    let text = match context.format {
        Format::Table => lang.fill(done, &[("name", &name())]) + "\n",
        _ => records::line(told),
    };
    out::result(lang, &text)
}

fn list(context: &Context, matches: &ArgMatches) -> Result<(), Failure> {
    let told = send(context, matches, &AccountRequest::Users)?;
    let records = accounts_table::users(context.lang, &told);
    out::result(context.lang, &records.render(context.format))
}

fn setup_link(context: &Context, matches: &ArgMatches) -> Result<(), Failure> {
    let told = send(context, matches, &AccountRequest::SetupLink)?;
    let link = told.get("setup_link").and_then(Value::as_str);
    let text = match context.format {
        Format::Json | Format::Ndjson => records::line(told),
        _ => format!("{}\n", link.unwrap_or_default()),
    };
    out::result(context.lang, &text)
}
