//! `railbus token`: tokens with which programs use the daemon over HTTP.

use super::accounts_client::{AccountRequest, fleet, send};
use super::user::{UserText, points, points_of, role};
use super::{Context, accounts_table};
use crate::args;
use crate::texts::Text;
use clap::{Arg, ArgMatches, Command};
use railbus_app::failure::Failure;
use railbus_app::render::{Format, out, records};
use railbus_words::Lang;
use serde_json::json;

/// The name of the command.
pub(crate) const NAME: &str = "token";

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let verb = |name, about, usage| {
        let examples = args::examples(lang, UserText::TokenExamples);
        let verb = args::verb(lang, name, about, usage).before_help(examples);
        verb.arg(fleet(lang, UserText::Fleet))
    };
    let name = || {
        let help = lang.get(UserText::TokenName);
        Arg::new("NAME").required(true).help(help)
    };
    let usage = "railbus token create NAME --role ROLE [--points PATTERN] [--expires 90d]";
    let create = verb("create", UserText::TokenCreate, usage)
        .arg(name())
        .arg(role(lang))
        .arg(points(lang))
        .arg(
            args::flag(lang, "expires", UserText::TokenExpires)
                .value_name("DAYS")
                .value_parser(days),
        );
    args::verb(lang, NAME, UserText::TokenAbout, "railbus token COMMAND")
        .before_help(args::examples(lang, UserText::TokenExamples))
        .subcommand_required(true)
        .subcommand_help_heading(lang.get(Text::Commands))
        .subcommand(create)
        .subcommand(verb("list", UserText::TokenList, "railbus token list"))
        .subcommand(verb("revoke", UserText::TokenRevoke, "railbus token revoke NAME").arg(name()))
}

/// `90d`.
fn days(text: &str) -> Result<u32, String> {
    let days = text.strip_suffix('d').and_then(|days| days.parse().ok());
    days.filter(|days| (1..=3_650).contains(days))
        .ok_or_else(String::new)
}

/// Runs a command of the group.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    // The parser accepts no arguments without a known command.
    let Some((verb, matches)) = matches.subcommand() else {
        return Ok(());
    };
    let context = Context::of(lang, matches)?;
    let named = matches.try_get_one::<String>("NAME").ok().flatten();
    let name = named.map(String::as_str).unwrap_or_default();
    match verb {
        "create" => create(&context, name, matches),
        "list" => {
            let told = send(&context, matches, &AccountRequest::Tokens)?;
            let records = accounts_table::tokens(lang, &told);
            out::result(lang, &records.render(context.format))
        }
        _ => {
            let told = send(&context, matches, &AccountRequest::RevokeToken(name))?;
            let text = match context.format {
                Format::Table => lang.fill(UserText::TokenRevoked, &[("name", &name)]) + "\n",
                _ => records::line(told),
            };
            out::result(lang, &text)
        }
    }
}

fn create(context: &Context, name: &str, matches: &ArgMatches) -> Result<(), Failure> {
    let lang = context.lang;
    let request = json!({
        "name": name,
        "role": matches.get_one::<String>("role"),
        "points": points_of(matches),
        "expires_days": matches.get_one::<u32>("expires").copied().unwrap_or(90),
    });
    let told = send(context, matches, &AccountRequest::AddToken(request))?;
    if matches!(context.format, Format::Json | Format::Ndjson) {
        return out::result(lang, &records::line(told));
    }
    let until = accounts_table::day(&told, "expires");
    let role = accounts_table::text(&told, "role");
    let values: &[(&str, &dyn std::fmt::Display)] =
        &[("name", &name), ("role", &role), ("until", &until)];
    context.note(&lang.fill(UserText::TokenMade, values));
    let token = accounts_table::text(&told, "token");
    out::result(lang, &format!("{token}\n"))
}
