//! Simulated lines: the modules as they really are, and controls for them. What the site knows of
//! them came over the line, and may differ.

use super::access::Need;
use super::answer;
use super::doc::Doc;
use super::language::spoken;
use super::order::Order;
use super::route::{Answer, Asked, Route};
use super::site::Site;
use axum::extract::{Path, State};
use axum::routing::{delete, get, post, put};
use railbus_api::problem::{Problem, codes};
use railbus_api::sim::{
    SimFaultsRequest, SimInputsRequest, SimLineInfo, SimLineRequest, SimLines, SimModuleInfo,
    SimModuleRequest, SimValue,
};
use railbus_api::types::SCHEMA;
use railbus_app::failure::Failure;
use railbus_plant::remote::{LineRequest, Remote};
use railbus_store::history::{Event, EventKind, Severity};
use railbus_words::Lang;

/// The routes of this file.
pub(super) const ROUTES: &[Route] = &[
    Route::new("GET", "/sim", Need::VIEWER, || get(lines)).doc(
        Doc::new("The simulated lines, and their modules as they really are").answers::<SimLines>(),
    ),
    Route::new("PUT", "/sim/{line}", Need::ENGINEER, || put(plug)).doc(
        Doc::new("Pull the adapter of a simulated line out, or put it back")
            .takes::<SimLineRequest>()
            .answers::<SimLineInfo>(),
    ),
    Route::new("POST", "/sim/{line}/line-faults", Need::ENGINEER, || {
        post(add_line_faults)
    })
    .doc(
        Doc::new("Let something go wrong with a simulated line")
            .takes::<SimFaultsRequest>()
            .answers::<SimLineInfo>(),
    ),
    Route::new("DELETE", "/sim/{line}/line-faults", Need::ENGINEER, || {
        delete(clear_line_faults)
    })
    .doc(
        Doc::new("Let nothing go wrong with it any more")
            .query(&[WHICH])
            .answers::<SimLineInfo>(),
    ),
    Route::new("PUT", "/sim/{line}/{module}", Need::ENGINEER, || {
        put(change_module)
    })
    .doc(
        Doc::new("Switch a simulated module's power, its DIP switch or its INIT* pin")
            .takes::<SimModuleRequest>()
            .answers::<SimModuleInfo>(),
    ),
    Route::new("PUT", "/sim/{line}/{module}/inputs", Need::ENGINEER, || {
        put(inputs)
    })
    .doc(
        Doc::new("Lay something at inputs of a simulated module")
            .takes::<SimInputsRequest>()
            .answers::<SimModuleInfo>(),
    ),
    Route::new(
        "POST",
        "/sim/{line}/{module}/faults",
        Need::ENGINEER,
        || post(add_faults),
    )
    .doc(
        Doc::new("Let something go wrong with a simulated module")
            .takes::<SimFaultsRequest>()
            .answers::<SimModuleInfo>(),
    ),
    Route::new(
        "DELETE",
        "/sim/{line}/{module}/faults",
        Need::ENGINEER,
        || delete(clear_faults),
    )
    .doc(
        Doc::new("Let nothing go wrong with it any more")
            .query(&[WHICH])
            .answers::<SimModuleInfo>(),
    ),
];

const WHICH: (&str, &str) = ("fault", "only this one: its words, or its name");

/// The longest command that its event repeats, in characters.
const TOLD_MAX: usize = 200;

/// A line that is simulated here.
pub(super) fn line<'s>(site: &'s Site, name: &str) -> Result<&'s Remote, Problem> {
    let mut lines = site.simulated.iter();
    lines
        .find(|line| line.name() == name)
        .ok_or_else(|| Problem::new(codes::NOT_SIMULATED).with("name", name))
}

async fn lines(State(site): State<Site>) -> Answer {
    let mut lines = Vec::new();
    for line in site.simulated.iter() {
        lines.extend(line.look().await);
    }
    let schema = SCHEMA;
    answer::json(Ok(SimLines { schema, lines }))
}

async fn plug(Path(name): Path<String>, order: Order) -> Answer {
    let errand = || {
        let SimLineRequest { plugged } = order.read()?;
        let told = if plugged { "plug" } else { "unplug" };
        Ok((Remote::plug(plugged), told.to_owned()))
    };
    answer::json(on_line(&name, &order, |_| errand()).await)
}

async fn add_line_faults(Path(name): Path<String>, order: Order) -> Answer {
    let errand = |line: &Remote| {
        let SimFaultsRequest { faults } = order.read()?;
        let read = line.read_faults(language(&order), &faults);
        Ok((
            read.map_err(not_understood)?,
            format!("fault line {faults}"),
        ))
    };
    answer::json(on_line(&name, &order, errand).await)
}

async fn clear_line_faults(Path(name): Path<String>, asked: Asked, order: Order) -> Answer {
    let which = asked.get("fault").map(String::as_str);
    let told = format!("fault line clear {}", which.unwrap_or_default());
    let errand = (Remote::clear_faults(which), told.trim_end().to_owned());
    answer::json(on_line(&name, &order, |_| Ok(errand)).await)
}

/// Runs commands on a simulated line.
async fn on_line(
    name: &str,
    order: &Order,
    errand: impl FnOnce(&Remote) -> Result<(LineRequest, String), Problem>,
) -> Result<SimLineInfo, Problem> {
    let line = line(&order.site, name)?;
    let (errand, told) = errand(line)?;
    let info = line.order(vec![errand]).await.ok_or_else(ended)?;
    tell(order, name, None, &[told]);
    Ok(info)
}

async fn change_module(Path(place): Path<(String, String)>, order: Order) -> Answer {
    let words = |module: &str| {
        let wish: SimModuleRequest = order.read()?;
        let all = [
            wish.powered
                .map(|power| format!("power {module} {}", on(power))),
            wish.dip.map(|dip| format!("dip {module} {dip}")),
            wish.init.map(|init| format!("init {module} {}", on(init))),
        ];
        Ok(all.into_iter().flatten().collect())
    };
    answer::json(carry_out(&place, &order, words).await)
}

/// As the prompt has it; for an input it means high.
const fn on(on: bool) -> &'static str {
    if on { "on" } else { "off" }
}

async fn inputs(Path(place): Path<(String, String)>, order: Order) -> Answer {
    let words = |module: &str| {
        let wish: SimInputsRequest = order.read()?;
        let word = |(label, value): (&String, &Option<SimValue>)| match value {
            Some(SimValue::Switch(high)) => format!("{module}.{label} = {}", on(*high)),
            Some(SimValue::Number(number)) => format!("{module}.{label} = {number}"),
            None => format!("{module}.{label} = auto"),
        };
        Ok(wish.set.iter().map(word).collect())
    };
    answer::json(carry_out(&place, &order, words).await)
}

async fn add_faults(Path(place): Path<(String, String)>, order: Order) -> Answer {
    let words = |module: &str| {
        let wish: SimFaultsRequest = order.read()?;
        Ok(vec![format!("fault {module} {}", wish.faults)])
    };
    answer::json(carry_out(&place, &order, words).await)
}

async fn clear_faults(Path(place): Path<(String, String)>, asked: Asked, order: Order) -> Answer {
    let which = asked.get("fault").map_or("", String::as_str);
    let words = |module: &str| {
        let text = format!("fault {module} clear {which}");
        Ok(vec![text.trim_end().to_owned()])
    };
    answer::json(carry_out(&place, &order, words).await)
}

/// Runs all commands, or none if one of them can't be parsed.
async fn carry_out(
    (name, module): &(String, String),
    order: &Order,
    words: impl FnOnce(&str) -> Result<Vec<String>, Problem>,
) -> Result<SimModuleInfo, Problem> {
    let line = line(&order.site, name)?;
    let unknown = || Problem::new(codes::NO_SIM_MODULE).with("name", module.as_str());
    if !line.has(module) {
        return Err(unknown());
    }
    let words = words(module)?;
    let lang = language(order);
    let read = words.iter().map(|text| line.read(lang, text));
    let errands: Vec<Option<LineRequest>> =
        read.collect::<Result<_, _>>().map_err(not_understood)?;
    let info = line.order(errands.into_iter().flatten().collect()).await;
    let info = info.ok_or_else(ended)?;
    tell(order, name, Some(module), &words);
    let mut modules = info.modules.into_iter();
    modules
        .find(|one| one.module == *module)
        .ok_or_else(unknown)
}

fn language(order: &Order) -> Lang {
    spoken(&order.headers, order.site.lang)
}

fn not_understood(failure: Failure) -> Problem {
    Problem::new(codes::SIM_ORDER).with("reason", failure.message())
}

/// The simulated line has ended, as it does with the daemon.
fn ended() -> Problem {
    Problem::new(codes::INTERNAL).with("reason", "the simulated line has ended")
}

/// Records an event, so that the history shows later who caused a module to fall silent.
fn tell(order: &Order, line: &str, module: Option<&str>, words: &[String]) {
    if words.is_empty() {
        return;
    }
    let what: String = words.join(", ").chars().take(TOLD_MAX).collect();
    let event = Event::new(EventKind::System, Severity::Info, "sim_order");
    let event = event.line(line).by(&order.who.origin()).what(&what);
    let event = match module {
        Some(module) => event.module(module),
        None => event,
    };
    order.site.service.tell_event(event);
}
