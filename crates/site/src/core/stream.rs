//! The stream: how everything is, and then what changes, made once for all who follow.
//!
//! A follower first gets a [`Picture`], then a [`Batch`] for what changed: the first change at
//! once, and then no more than 20 batches a second. What changes in between comes together, every
//! change of it in its order. Nothing is made while nobody follows.

use super::{Output, State};
use crate::config::{Config, Place};
use crate::service::{LineStatus, ModuleStatus, PointStatus, Update};
use railbus_host::{Evidence, Presence};
use railbus_wire::Micros;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::SystemTime;

/// After a batch the next one waits for so long: 20 Hz.
const PACE: Micros = Micros::from_millis(50);
/// How often the figures of modules are compared: round trips and counters change all the time.
const FIGURES_EVERY: Micros = Micros::from_secs(1);
/// A batch with so many readings does not wait any longer.
const READINGS_MAX: usize = 1_024;

/// What a follower gets.
#[derive(Clone, Debug)]
pub enum News {
    /// How everything is: at the beginning, with another configuration, and after a gap.
    Picture(Arc<Picture>),
    /// What changed since.
    Batch(Arc<Batch>),
}

impl News {
    /// Its number in the stream.
    #[must_use]
    pub fn seq(&self) -> u64 {
        match self {
            News::Picture(picture) => picture.seq,
            News::Batch(batch) => batch.seq,
        }
    }

    /// How many changes were told up to and with this.
    #[must_use]
    pub fn changes(&self) -> u64 {
        match self {
            News::Picture(picture) => picture.changes,
            News::Batch(batch) => batch.changes,
        }
    }
}

/// How everything is at one moment.
#[derive(Debug)]
pub struct Picture {
    /// The number of the newest batch that is in it.
    pub seq: u64,
    /// How many changes were told before it.
    pub changes: u64,
    /// When it was made, by the clock on the wall.
    pub at: SystemTime,
    /// The configuration whose names it has.
    pub config: Arc<Config>,
    /// All points, by module, outputs first.
    pub points: Box<[PointStatus]>,
    /// All modules, by name.
    pub modules: Box<[ModuleStatus]>,
    /// All lines, by name.
    pub lines: Box<[LineStatus]>,
}

/// What changed since the batch or picture before.
#[derive(Debug)]
pub struct Batch {
    /// One more than that of the batch or picture before.
    pub seq: u64,
    /// How many changes were told up to and with it.
    pub changes: u64,
    /// When it was made, by the clock on the wall.
    pub at: SystemTime,
    /// The configuration in force at that time. After a reload the first batch carries the new one;
    /// a picture follows when its lines and modules are ready.
    pub config: Arc<Config>,
    /// Points that have another value, another quality, or another end of a pulse, lease or
    /// longest time; in the order in which that happened, and as they were then.
    pub points: Box<[PointReading]>,
    /// Modules that are heard, or no longer, or are another model, in the order in which that
    /// happened.
    pub modules: Box<[ModuleStatus]>,
    /// Modules whose round trip or counters are other ones. They are compared once a second.
    pub figures: Box<[ModuleStatus]>,
    /// Lines whose port changed, or on which a babble began or ended, in that order, too.
    pub lines: Box<[LineStatus]>,
}

/// A point as it was at some moment.
#[derive(Clone, Debug, PartialEq)]
pub struct PointReading {
    /// When it became so, by the clock on the wall. When its value was read is
    /// [`PointStatus::time`].
    pub at: SystemTime,
    /// How it was then.
    pub status: PointStatus,
}

/// What of a module changes without being told.
#[derive(Debug, PartialEq)]
struct Figures {
    presence: Presence,
    /// In tenths of a millisecond.
    rtt: Option<u64>,
    errors: u32,
    late: u32,
    lost: Evidence,
}

impl Figures {
    fn of(status: &ModuleStatus) -> Figures {
        Figures {
            presence: status.presence,
            rtt: status.rtt.map(|rtt| (rtt.0 + 50) / 100),
            errors: status.errors,
            late: status.late,
            lost: status.lost,
        }
    }
}

/// What is about to be told.
#[derive(Debug, Default)]
pub(super) struct Stream {
    /// Somebody may follow.
    is_followed: bool,
    seq: u64,
    changes: u64,
    points: Vec<PointReading>,
    modules: Vec<ModuleStatus>,
    lines: Vec<LineStatus>,
    /// Modules and lines of which something was told in the step that ends.
    told_modules: BTreeSet<String>,
    told_lines: BTreeSet<String>,
    /// There is another configuration.
    is_reloaded: bool,
    /// When a batch may be told again.
    next: Micros,
    figures: BTreeMap<String, Figures>,
    /// When those are compared again.
    figures_at: Micros,
    /// The newest picture, and when it was made.
    picture: Option<(Micros, Arc<Picture>)>,
}

impl Stream {
    /// When [`State::stream_out`] is to be called at the latest.
    pub(super) fn deadline(&self) -> Option<Micros> {
        let batch = (!self.is_empty()).then_some(self.next);
        let figures = self.is_followed.then_some(self.figures_at);
        [batch, figures].into_iter().flatten().min()
    }

    fn is_empty(&self) -> bool {
        self.points.is_empty() && self.modules.is_empty() && self.lines.is_empty()
    }

    /// Takes note of what is told to whoever subscribes. Points are compared after every step.
    pub(super) fn take(&mut self, update: &Update) {
        if !self.is_followed {
            return;
        }
        match update {
            Update::Module(module) => _ = self.told_modules.insert(module.clone()),
            Update::Line(line) => {
                self.told_lines.insert(line.clone());
                // Whether its modules are heard depends on it.
                self.figures_at = Micros::ZERO;
            }
            Update::Reloaded => self.is_reloaded = true,
            Update::Point(_) | Update::Quality(_) | Update::Gap(_) => {}
        }
    }

    /// Nobody follows any more.
    pub(super) fn end(&mut self) {
        let (seq, changes) = (self.seq, self.changes);
        *self = Stream {
            seq,
            changes,
            ..Stream::default()
        };
    }
}

impl State {
    /// A point is not as it was.
    pub(super) fn stream_point(&mut self, place: &Place) {
        if self.stream.is_followed
            && let Some(status) = self.point_of(&place.module, place.point)
        {
            let at = self.now.wall;
            self.stream.points.push(PointReading { at, status });
        }
    }

    /// Tells what is to be told by now.
    pub(super) fn stream_out(&mut self) {
        if !self.stream.is_followed {
            return;
        }
        for name in std::mem::take(&mut self.stream.told_modules) {
            let status = self.module(&name);
            self.stream.modules.extend(status);
        }
        for name in std::mem::take(&mut self.stream.told_lines) {
            let status = self.line(&name);
            self.stream.lines.extend(status);
        }
        let figures = match self.stream.figures_at <= self.now.site {
            true => self.compare_figures(),
            false => Vec::new(),
        };
        let is_due = self.stream.next <= self.now.site || self.stream.is_reloaded;
        let is_full = self.stream.points.len() >= READINGS_MAX;
        if !figures.is_empty() || (!self.stream.is_empty() && (is_due || is_full)) {
            self.tell_batch(figures);
        }
        if std::mem::take(&mut self.stream.is_reloaded) {
            (self.stream.seq, self.stream.changes) = (self.stream.seq + 1, self.stream.changes + 1);
            let picture = self.picture();
            self.runs
                .outputs
                .push_back(Output::News(News::Picture(picture)));
        }
    }

    /// Tells what waits for its time: the site ends.
    pub(super) fn stream_rest(&mut self) {
        if !self.stream.is_empty() {
            self.tell_batch(Vec::new());
        }
    }

    /// How everything is, for somebody who follows from now on: what is told later comes after it.
    pub(super) fn begin_to_follow(&mut self) -> Arc<Picture> {
        if !self.stream.is_followed {
            self.stream.is_followed = true;
            self.compare_figures();
        }
        self.stream_rest();
        self.picture()
    }

    fn tell_batch(&mut self, figures: Vec<ModuleStatus>) {
        let points = std::mem::take(&mut self.stream.points);
        let modules = std::mem::take(&mut self.stream.modules);
        let lines = std::mem::take(&mut self.stream.lines);
        if !(points.is_empty() && modules.is_empty() && lines.is_empty()) {
            // Figures alone keep no change waiting.
            self.stream.next = self.now.site + PACE;
        }
        let changes = points.len() + modules.len() + figures.len() + lines.len();
        self.stream.seq += 1;
        self.stream.changes += u64::try_from(changes).unwrap_or(u64::MAX);
        let batch = Batch {
            seq: self.stream.seq,
            changes: self.stream.changes,
            at: self.now.wall,
            config: Arc::clone(self.site.config()),
            points: points.into(),
            modules: modules.into(),
            figures: figures.into(),
            lines: lines.into(),
        };
        let news = News::Batch(Arc::new(batch));
        self.runs.outputs.push_back(Output::News(news));
    }

    /// The modules whose figures are not as they were.
    fn compare_figures(&mut self) -> Vec<ModuleStatus> {
        self.stream.figures_at = self.now.site + FIGURES_EVERY;
        let mut before = std::mem::take(&mut self.stream.figures);
        let names: Vec<String> = self.site.config().modules.keys().cloned().collect();
        let mut changed = Vec::new();
        for status in names
            .iter()
            .filter_map(|name| self.module(name))
            .collect::<Vec<_>>()
        {
            let figures = Figures::of(&status);
            let name = status.name.clone();
            if before.remove(&name).as_ref() != Some(&figures) {
                changed.push(status);
            }
            self.stream.figures.insert(name, figures);
        }
        changed
    }

    /// How everything is. Those who come at the same time get the same.
    fn picture(&mut self) -> Arc<Picture> {
        if let Some((made, picture)) = &self.stream.picture
            && picture.seq == self.stream.seq
            && Arc::ptr_eq(&picture.config, self.site.config())
            && self.now.site - *made < PACE
        {
            return Arc::clone(picture);
        }
        let config = Arc::clone(self.site.config());
        let points = config.modules.iter().flat_map(|(module, described)| {
            let points = described.setup.points();
            points.filter_map(|point| self.point_of(module, point))
        });
        let points = points.collect();
        let modules = config.modules.keys();
        let modules = modules.filter_map(|name| self.module(name)).collect();
        let lines = config.lines.keys();
        let lines = lines.filter_map(|name| self.line(name)).collect();
        let picture = Arc::new(Picture {
            seq: self.stream.seq,
            changes: self.stream.changes,
            at: self.now.wall,
            config: Arc::clone(&config),
            points,
            modules,
            lines,
        });
        self.stream.picture = Some((self.now.site, Arc::clone(&picture)));
        picture
    }
}
