//! Runs a rule over the history.

use super::engine::Fact;
use super::replay::{Replay, Tried};
use crate::Config;
use crate::config::{Place, Rule, When};
use jiff::tz::TimeZone;
use railbus_store::history::millis;
use railbus_store::history::{
    Event, EventKind, EventQuery, History, HistoryError, PIECE_MAX, Sample, SampleQuality,
};

/// The maximum number of samples that one run reads.
const SAMPLES_MAX: usize = 1 << 20;
/// How many events are read per page, and the maximum number of pages.
const EVENTS: usize = 500;
const PAGES_MAX: usize = 20;

/// Runs a rule over the history from one moment to another, both in milliseconds since 1970.
///
/// # Errors
/// [`HistoryError`]. A history without anything about the rule's condition is no error.
pub(crate) async fn try_against(
    history: &History,
    config: &Config,
    rule: &Rule,
    (since, until): (i64, i64),
) -> Result<Tried, HistoryError> {
    let replay = Replay::new(rule, TimeZone::system(), since, until);
    match &rule.when {
        When::Clock(_) => Ok(replay.end()),
        When::Switch(place, _) | When::Analog(place, _) => {
            of_samples(history, &config.path(place), place, replay, (since, until)).await
        }
        When::ModuleOffline(module) => {
            let line = config.modules.get(module).map(|module| module.line.clone());
            let line = line.unwrap_or_default();
            of_events(history, rule, (Some(module), &line), (since, until)).await
        }
        When::LineOffline(line) => of_events(history, rule, (None, line), (since, until)).await,
    }
}

async fn of_samples(
    history: &History,
    path: &str,
    place: &Place,
    mut replay: Replay,
    (since, until): (i64, i64),
) -> Result<Tried, HistoryError> {
    match history.in_force(path, since).await {
        Ok(Some(sample)) => replay.take(sample.t, fact(place, &sample)),
        Ok(None) => {}
        Err(HistoryError::NoSuchPoint) => return Ok(replay.end()),
        Err(error) => return Err(error),
    }
    let (mut from, mut seen) = (since, 0);
    while seen < SAMPLES_MAX {
        let samples = history.samples(path, from, until).await?;
        for sample in &samples {
            replay.take(sample.t, fact(place, sample));
        }
        seen += samples.len();
        match samples.last() {
            Some(last) if samples.len() >= PIECE_MAX => from = last.t + 1,
            _ => return Ok(replay.end()),
        }
    }
    Ok(replay.cut(from))
}

fn fact(place: &Place, sample: &Sample) -> Fact {
    use railbus_device::PointKind::{Input, Output};
    match (sample.grade, sample.value) {
        (SampleQuality::Good, Some(value)) if matches!(place.point.kind, Input | Output) => {
            Fact::Is(value != 0.0)
        }
        (SampleQuality::Good, Some(value)) => Fact::Value(value),
        _ => Fact::Unknown,
    }
}

/// Selects events.
type Wanted<'w> = &'w (dyn Fn(&Event) -> bool + Sync);

/// What is known of a module and its line, or of a line alone.
#[derive(Clone, Copy, Default)]
struct Heard {
    /// The module does not answer.
    silent: Option<bool>,
    /// The line has no port.
    down: Option<bool>,
    lent: bool,
}

impl Heard {
    /// At the start of the program only faults are reported, not that all is well.
    const WELL: Heard = Heard {
        silent: Some(false),
        down: Some(false),
        lent: false,
    };

    fn take(&mut self, event: &Event) {
        match event.code.as_deref() {
            Some("started") => *self = Heard::WELL,
            Some("stopped") => *self = Heard::default(),
            Some("module_offline") => self.silent = Some(true),
            Some("module_online") => self.silent = Some(false),
            Some("line_down") => {
                self.lent = event.text.as_deref() == Some("lent");
                self.down = Some(true);
            }
            Some("line_up") => (self.down, self.lent) = (Some(false), false),
            _ => {}
        }
    }

    fn fact(self, of_module: bool) -> Fact {
        match (self.down, self.silent) {
            _ if self.lent => Fact::Unknown,
            (Some(true), _) => Fact::Is(true),
            (_, Some(silent)) if of_module => Fact::Is(silent),
            (Some(false), _) if !of_module => Fact::Is(false),
            _ => Fact::Unknown,
        }
    }
}

async fn of_events(
    history: &History,
    rule: &Rule,
    (module, line): (Option<&String>, &str),
    (since, until): (i64, i64),
) -> Result<Tried, HistoryError> {
    let of_line = |event: &Event| event.line.as_deref() == Some(line);
    let of_program = |event: &Event| matches!(event.code.as_deref(), Some("started" | "stopped"));
    let wanted: [(EventKind, Option<&String>, Wanted<'_>); 3] = [
        (EventKind::System, None, &of_program),
        (EventKind::Line, None, &of_line),
        (EventKind::Module, module, &|_| module.is_some()),
    ];
    let (mut events, mut known_since) = (Vec::new(), since);
    for (kind, module, is_wanted) in wanted {
        let asked = EventQuery {
            kind: Some(kind),
            module: module.cloned(),
            limit: EVENTS,
            before: None,
            ..EventQuery::default()
        };
        let (found, reached) = back_to(history, asked, since, is_wanted).await?;
        events.extend(found);
        known_since = known_since.max(reached);
    }
    events.sort_by(|a, b| a.id.cmp(&b.id));
    let mut replay = Replay::new(rule, TimeZone::system(), known_since, until);
    let mut heard = Heard::default();
    for event in &events {
        heard.take(event);
        replay.take(millis(event.at), heard.fact(module.is_some()));
    }
    Ok(replay.end())
}

/// The wanted events since the last one before a moment, and from when on they are complete.
async fn back_to(
    history: &History,
    mut asked: EventQuery,
    since: i64,
    is_wanted: Wanted<'_>,
) -> Result<(Vec<Event>, i64), HistoryError> {
    let mut found = Vec::new();
    let mut oldest = since;
    for _ in 0..PAGES_MAX {
        let page = history.events(asked.clone()).await?;
        for event in page.events.into_iter().map(|kept| kept.event) {
            oldest = millis(event.at);
            if is_wanted(&event) {
                found.push(event);
                if oldest < since {
                    return Ok((found, since));
                }
            }
        }
        match page.next {
            Some(next) => asked.before = Some(next),
            None => return Ok((found, since)),
        }
    }
    Ok((found, oldest.max(since)))
}
