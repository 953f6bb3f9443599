//! `railbus fleet set`: one command to many sites.

pub(super) mod texts;

use super::FleetText;
use super::commands::bulk_result;
use super::get::{quality, value};
use crate::args;
use crate::commands::context::hub_socket;
use crate::commands::set::orders::State;
use crate::commands::stop::{self, Stop};
use crate::commands::{Context, ls, random_id};
use crate::texts::Text;
use clap::{Arg, ArgAction, ArgMatches, Command, value_parser};
use railbus_api::fleet::{
    FleetBulkPreview, FleetBulkSites, FleetBulkState, FleetBulkTarget, FleetPresence, GiveBulk,
    PreviewBulk,
};
use railbus_api::problem::{Problem, codes};
use railbus_api::types::Quality;
use railbus_app::failure::Failure;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_app::render::{Format, out};
use railbus_client::{HubClient, api_path};
use railbus_words::{Code, Lang, width};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufRead, IsTerminal, Write};
use std::pin::pin;
use std::time::Duration;
use texts::BulkText;

/// The name of the command.
pub(super) const NAME: &str = "set";

/// From so many sites on, their number is to be said.
const SAID_FROM: usize = 10;
/// How often it is asked how far they are.
const ASK: Duration = Duration::from_millis(300);

/// Its parser and help.
pub(super) fn define(lang: Lang) -> Command {
    let usage = "railbus fleet set TARGET STATE SITE…|--group NAME|--search WORDS|--all";
    args::verb(lang, NAME, BulkText::About, usage)
        .before_help(args::examples(lang, BulkText::Examples))
        .arg(super::required(lang, "TARGET", BulkText::Target))
        .arg(super::required(lang, "STATE", BulkText::NewState))
        .arg(
            Arg::new("SITE")
                .help(lang.get(BulkText::Sites))
                .num_args(0..)
                .conflicts_with_all(["group", "search", "all"]),
        )
        .arg(args::flag(lang, "group", BulkText::OfGroup).value_name("NAME"))
        .arg(args::flag(lang, "search", BulkText::Found).value_name("WORDS"))
        .arg(
            args::flag(lang, "all", BulkText::AllSites)
                .action(ArgAction::SetTrue)
                .conflicts_with_all(["group", "search"]),
        )
        .arg(
            args::flag(lang, "dry-run", BulkText::Preview)
                .short('n')
                .action(ArgAction::SetTrue),
        )
        .arg(
            args::flag(lang, "count", BulkText::Count)
                .value_name("N")
                .value_parser(value_parser!(usize)),
        )
        .arg(args::flag(lang, "yes", Text::MeantYes).action(ArgAction::SetTrue))
}

/// The request to the API of each site.
struct SiteOrder {
    method: &'static str,
    path: String,
    body: Value,
}

/// Shows the sites, or commands them and prints what came of each.
pub(super) fn run(context: &Context, matches: &ArgMatches) -> Result<(), Failure> {
    let lang = context.lang;
    let order = order(lang, matches)?;
    // An empty one, as a script may have by mistake, names no sites.
    let has = |name| {
        let texts = matches.get_many::<String>(name).into_iter().flatten();
        texts.into_iter().any(|text| !text.trim().is_empty())
    };
    if !(has("SITE") || has("group") || has("search") || matches.get_flag("all")) {
        let failure = Failure::new(Code::Usage, lang.get(BulkText::WhichSites).to_owned());
        return Err(failure.with_try("railbus fleet set oven.k1 on --group north"));
    }
    let select = ["group", "search"].into_iter().filter_map(|key| {
        let text = matches.get_one::<String>(key)?;
        Some((key.to_owned(), text.clone()))
    });
    let wanted = PreviewBulk {
        select: select.collect(),
        method: order.method.to_owned(),
        path: order.path.clone(),
        body: order.body.clone(),
    };
    let preview = super::ask(context, matches, async |hub| hub.preview(&wanted).await)?;
    let preview = named(context, matches, preview)?;
    if preview.sites.is_empty() {
        let message = lang.get(BulkText::NoSites).to_owned();
        let failure = Failure::new(Code::NoSite, message);
        return Err(failure.with_try("railbus fleet ls"));
    }
    if matches.get_flag("dry-run") {
        out::result(lang, &shown(lang, &preview).render(context.format))?;
        context.note(&counted(lang, &preview));
        return Ok(());
    }
    agreed(context, matches, &preview)?;
    let sites = preview.sites.into_iter().map(|target| target.site);
    let wanted = GiveBulk {
        sites: sites.collect(),
        method: wanted.method,
        path: wanted.path,
        body: wanted.body,
    };
    let named = hub_socket(matches);
    // It is known by this, also where its answer is lost.
    let id = random_id().map_err(|error| Failure::of(lang, Code::System).because(error))?;
    if wanted.sites.len() >= SAID_FROM {
        context.note(&lang.fill(BulkText::Named, &[("id", &id)]));
    }
    let (told, stopped) = context.block(async {
        let hub = HubClient::find(named.as_deref()).await;
        let hub = hub.map_err(|problem| context.failure(&problem))?;
        let stop = Stop::new(context)?;
        let mut giving = Giving {
            context,
            hub,
            id: &id,
            stop,
            stopped: false,
        };
        let told = giving.carry_out(&wanted).await?;
        Ok((told, giving.stopped))
    })?;
    tell(context, &told)?;
    conclude(context, &told, stopped)
}

/// What is to be done at each site.
fn order(lang: Lang, matches: &ArgMatches) -> Result<SiteOrder, Failure> {
    let (target, word) = (
        super::text(matches, "TARGET"),
        super::text(matches, "STATE"),
    );
    let confirm = matches.get_flag("yes");
    let bad = |word: &str| {
        let why = lang.fill(Text::BadOrder, &[("word", &word)]);
        let failure = Failure::of(lang, Code::Usage).because(why);
        failure.with_try("railbus fleet set oven.k1 on --group north")
    };
    let state = State::from_word(word).ok_or_else(|| bad(word))?;
    if let Some(group) = target.strip_prefix('@').filter(|group| !group.is_empty()) {
        let value = match state {
            State::On => json!(true),
            State::Off => json!(false),
            State::Toggle => json!("toggle"),
        };
        return Ok(SiteOrder {
            method: "POST",
            path: api_path(&["groups", group, "set"]),
            body: json!({ "value": value, "confirm": confirm }),
        });
    }
    let point = target.split_once('.');
    let point = point.filter(|(module, label)| !module.is_empty() && !label.is_empty());
    // What each pattern means would be another thing at each site.
    let (module, label) = point
        .filter(|_| !target.contains(['*', ',', '/']))
        .ok_or_else(|| {
            let why = lang.fill(BulkText::BadTarget, &[("word", &target)]);
            let failure = Failure::of(lang, Code::Usage).because(why);
            failure.with_try("railbus fleet set oven.k1 on --group north")
        })?;
    Ok(match state {
        State::Toggle => SiteOrder {
            method: "POST",
            path: api_path(&["points", module, label, "toggle"]),
            body: json!({ "confirm": confirm }),
        },
        _ => SiteOrder {
            method: "PUT",
            path: api_path(&["points", module, label]),
            body: json!({ "value": state == State::On, "confirm": confirm }),
        },
    })
}

/// Those of the sites that are named, if some are.
fn named(
    context: &Context,
    matches: &ArgMatches,
    mut preview: FleetBulkPreview,
) -> Result<FleetBulkPreview, Failure> {
    let names = matches.get_many::<String>("SITE").into_iter().flatten();
    let names: BTreeSet<&String> = names.collect();
    if names.is_empty() {
        return Ok(preview);
    }
    let known: BTreeSet<&String> = preview.sites.iter().map(|target| &target.site).collect();
    if let Some(missing) = names.difference(&known).next() {
        let problem = Problem::new(codes::NO_SUCH_SITE).with("name", missing.as_str());
        return Err(context.failure(&problem));
    }
    preview.sites.retain(|target| names.contains(&target.site));
    let is_there = |target: &&FleetBulkTarget| target.presence == FleetPresence::Online;
    preview.sendable = preview.sites.iter().filter(is_there).count();
    Ok(preview)
}

/// Whether the number of many sites was said, or is said now.
fn agreed(
    context: &Context,
    matches: &ArgMatches,
    preview: &FleetBulkPreview,
) -> Result<(), Failure> {
    let (lang, count) = (context.lang, preview.sites.len());
    let other = |said: &dyn std::fmt::Display| {
        let values: &[(&str, &dyn std::fmt::Display)] = &[("count", &count), ("said", said)];
        Failure::new(Code::Usage, lang.fill(BulkText::OtherCount, values))
    };
    match matches.get_one::<usize>("count") {
        Some(said) if *said == count => return Ok(()),
        Some(said) => return Err(other(said)),
        None if count < SAID_FROM => return Ok(()),
        None => {}
    }
    if !std::io::stdin().is_terminal() {
        let message = lang.fill(BulkText::SayCount, &[("count", &count)]);
        return Err(Failure::new(Code::Usage, message));
    }
    let table = shown(lang, preview).table.render_within(width::terminal());
    let values: &[(&str, &dyn std::fmt::Display)] = &[("count", &count)];
    // If stderr is closed, the user does not see the question either.
    let _ = write!(
        std::io::stderr(),
        "{table}{}\n{} ",
        counted(lang, preview),
        lang.fill(BulkText::TypeCount, values)
    );
    let mut answer = String::new();
    let read = std::io::stdin().lock().read_line(&mut answer);
    read.map_err(|error| Failure::of(lang, Code::System).because(error))?;
    match answer.trim() == count.to_string() {
        true => Ok(()),
        false => Err(other(&format!("\"{}\"", answer.trim()))),
    }
}

/// How many sites it would be sent to.
fn counted(lang: Lang, preview: &FleetBulkPreview) -> String {
    let (count, sendable) = (preview.sites.len(), preview.sendable);
    let values: &[(&str, &dyn std::fmt::Display)] = &[("count", &count), ("sendable", &sendable)];
    lang.fill(BulkText::Sendable, values)
}

/// The sites before it is given.
fn shown(lang: Lang, preview: &FleetBulkPreview) -> Records {
    let mut table = Table::new(lang.get(BulkText::PreviewHead).split('|'));
    for target in &preview.sites {
        let presence = match target.presence {
            FleetPresence::Online => FleetText::Online,
            FleetPresence::Offline => FleetText::Away,
            FleetPresence::Unknown => FleetText::Unknown,
        };
        let point = target.point.as_ref();
        let now = point.map_or_else(String::new, |point| {
            let now = value(lang, point.value.as_ref());
            match point.quality {
                Quality::Good => now,
                _ => format!("{now} ({})", quality(lang, point)),
            }
        });
        let code = target.code.as_deref().and_then(Code::from_name);
        let note = match target.presence {
            FleetPresence::Online => code.map_or("", |code| code.page().title(lang)),
            _ => lang.get(BulkText::WouldNot),
        };
        let presence = lang.get(presence).to_owned();
        table.add([target.site.clone(), presence, now, note.to_owned()]);
    }
    Records {
        key: "sites",
        rows: ls::json_of(&preview.sites),
        columns: &["site", "presence", "code"],
        value: "site",
        table,
    }
}

/// A command that is being given.
struct Giving<'c> {
    context: &'c Context,
    hub: HubClient,
    id: &'c str,
    stop: Stop,
    /// It was stopped here.
    stopped: bool,
}

impl Giving<'_> {
    /// Gives it, and waits until all was sent that will be.
    async fn carry_out(&mut self, wanted: &GiveBulk) -> Result<FleetBulkSites, Failure> {
        let (hub, id) = (self.hub.clone(), self.id.to_owned());
        let given = self.or_stopped(hub.give_bulk(&id, wanted)).await?;
        given.map_err(|problem| match problem.may_have_acted {
            true => self.lost(&problem),
            false => self.context.failure(&problem),
        })?;
        let is_shown = !self.context.quiet && std::io::stderr().is_terminal();
        loop {
            let told = self.or_stopped(hub.bulk(&id, false)).await?;
            let told = told.map_err(|problem| self.lost(&problem))?;
            if is_shown {
                self.show(&told);
            }
            if told.bulk.ended_at.is_some() {
                break;
            }
            self.or_stopped(tokio::time::sleep(ASK)).await?;
        }
        if is_shown {
            let _ = write!(std::io::stderr(), "\r\x1b[K");
        }
        let told = self.or_stopped(hub.bulk(&id, true)).await?;
        told.map_err(|problem| self.lost(&problem))
    }

    /// The result of this; the first Ctrl-C meanwhile stops the command, the second one ends the
    /// wait.
    async fn or_stopped<T>(&mut self, work: impl Future<Output = T>) -> Result<T, Failure> {
        let mut work = pin!(work);
        if let Some(done) = self.stop.or(&mut work).await {
            return Ok(done);
        }
        if self.stopped {
            return Err(self.left(stop::interrupted(self.context)));
        }
        self.stopped = true;
        self.context.note(self.context.lang.get(BulkText::Stopping));
        let both = async {
            let stopped = self.hub.stop_bulk(self.id).await;
            (work.await, stopped)
        };
        match self.stop.or(both).await {
            Some((done, Ok(_))) => Ok(done),
            // There is none: it was not recorded, or not yet.
            Some((_, Err(problem))) => Err(self.lost(&problem)),
            None => Err(self.left(stop::interrupted(self.context))),
        }
    }

    fn show(&self, told: &FleetBulkSites) {
        let counts = told.bulk.counts;
        let ended = counts.all - counts.waiting - counts.sent;
        let values: &[(&str, &dyn std::fmt::Display)] =
            &[("ended", &ended), ("count", &counts.all)];
        let line = self.context.lang.fill(BulkText::SoFar, values);
        let _ = write!(std::io::stderr(), "\r\x1b[K{line}");
    }

    /// Nobody waits for it any more.
    fn left(&self, failure: Failure) -> Failure {
        let values: &[(&str, &dyn std::fmt::Display)] = &[("id", &self.id)];
        let failure = failure.perhaps_acted(true);
        failure.because(self.context.lang.fill(BulkText::GoesOn, values))
    }

    fn lost(&self, problem: &Problem) -> Failure {
        self.left(self.context.failure(problem))
    }
}

/// Prints what came of each site.
pub(super) fn tell(context: &Context, told: &FleetBulkSites) -> Result<(), Failure> {
    let lang = context.lang;
    let mut table = Table::bare();
    for site in &told.sites {
        table.add([site.site.clone(), bulk_result(lang, site)]);
    }
    let records = Records {
        key: "sites",
        rows: ls::json_of(&told.sites),
        columns: &["site", "state", "code", "confirmed", "reason", "end_at"],
        value: "state",
        table,
    };
    if context.quiet && context.format == Format::Table {
        return Ok(());
    }
    out::result(lang, &records.render(context.format))
}

/// The failure that follows from the results.
fn conclude(context: &Context, told: &FleetBulkSites, stopped: bool) -> Result<(), Failure> {
    let lang = context.lang;
    let counts = told.bulk.counts;
    let is_open = |state| matches!(state, FleetBulkState::Sent | FleetBulkState::Unknown);
    let open = told.sites.iter().filter(|site| is_open(site.state));
    let open: Vec<String> = open.map(|site| site.site.clone()).collect();
    if stopped {
        return Err(stop::interrupted(context).perhaps_acted_on(open));
    }
    let failed = counts.all - counts.done - counts.unconfirmed;
    if failed == 0 {
        return Ok(());
    }
    let values: &[(&str, &dyn std::fmt::Display)] = &[("failed", &failed), ("count", &counts.all)];
    let mut why = BTreeMap::<&str, usize>::new();
    for code in told
        .sites
        .iter()
        .filter_map(|site| site.end.code.as_deref())
    {
        *why.entry(code).or_default() += 1;
    }
    let mut failure = Failure::new(Code::Partial, lang.fill(BulkText::SomeFailed, values));
    for (code, count) in why {
        let title = Code::from_name(code).map_or("", |code| code.page().title(lang));
        failure = failure.because(format!("{code} {title} ({count})"));
    }
    Err(failure
        .with_fact("id", told.bulk.id.as_str())
        .with_fact("failed", failed)
        .with_fact("count", counts.all)
        .perhaps_acted_on(open))
}
