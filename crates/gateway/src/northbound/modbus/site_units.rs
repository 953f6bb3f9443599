//! The units of a site, which all clients of an outlet share on its one thread.

use super::image::UnitImage;
use super::request::{UnitWrite, Units, WriteEnd, note_end};
use super::units;
use crate::northbound::outlet::{Outlet, Report};
use railbus_api::problem::{Problem, codes};
use railbus_app::api::failures;
use railbus_host::Presence;
use railbus_site::config::Invalid;
use railbus_site::config::change::Keys;
use railbus_site::{Config, News, PointStatus, Service, Within, WriteTerms};
use railbus_wire::Micros;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::Arc;
use tokio::sync::{mpsc, oneshot};

/// How many writes may wait for what they changed at a time; more wait before that.
const SYNCS_MAX: usize = 32;

/// The units of a site: what is known of them, and what carries their writes out.
pub(crate) struct SiteUnits {
    service: Service,
    site: Arc<str>,
    /// How the outlet does.
    pub(crate) report: Report,
    settings: Keys,
    state: RefCell<State>,
    sync: mpsc::Sender<Sync>,
    within: Within,
}

/// Told once everything that has happened by now is in the images.
pub(crate) type Sync = oneshot::Sender<()>;

struct State {
    /// The configuration that the units are of.
    config: Arc<Config>,
    images: BTreeMap<u8, UnitImage>,
    /// Modules that are no unit by that configuration; none where all are.
    problem: Option<Problem>,
}

impl SiteUnits {
    /// The units of an outlet with the settings `modules`, `units`, `map` and `within_ms`; none
    /// until [`SiteUnits::take`] gets the first picture. Its caller answers each [`Sync`] that it
    /// receives here once it has passed on all news by then.
    pub(crate) fn new(outlet: &Outlet) -> (SiteUnits, mpsc::Receiver<Sync>) {
        let (sync, syncs) = mpsc::channel(SYNCS_MAX);
        let within = Micros::from_millis(outlet.number("within_ms").unsigned_abs());
        let units = SiteUnits {
            service: outlet.service.clone(),
            site: Arc::clone(&outlet.site),
            report: outlet.report.clone(),
            settings: outlet.settings.borrow().clone(),
            state: RefCell::new(State {
                config: Arc::default(),
                images: BTreeMap::new(),
                problem: None,
            }),
            sync,
            within: Within::new(within).unwrap_or_default(),
        };
        (units, syncs)
    }

    /// Whether every module that is to be one is a unit.
    pub(crate) fn are_all(&self) -> bool {
        self.state.borrow().problem.is_none()
    }

    /// Reports how it does as far as its units go, after something else has failed and works.
    pub(crate) fn tell(&self) {
        let problem = self.state.borrow().problem.clone();
        match problem {
            Some(problem) => self.report.failed(problem, 1, None),
            None => self.report.worked(),
        }
    }

    /// Takes over what happened at the site.
    pub(crate) fn take(&self, news: &News) {
        match news {
            News::Picture(picture) => self.apply(&picture.config, picture.points.iter()),
            News::Batch(batch) => {
                let points = batch.points.iter().map(|reading| &reading.status);
                self.apply(&batch.config, points);
            }
        }
    }

    /// Points of the units of this configuration.
    fn apply<'p>(&self, config: &Arc<Config>, points: impl Iterator<Item = &'p PointStatus>) {
        let state = &mut *self.state.borrow_mut();
        if !Arc::ptr_eq(config, &state.config) {
            self.reconfigure(state, config);
        }
        for point in points {
            let mut units = state.images.values_mut();
            if let Some(unit) = units.find(|unit| *unit.module == *point.module) {
                unit.apply(point);
            }
        }
    }

    /// Builds the units of another configuration. Their points are unknown until the stream
    /// reports them.
    fn reconfigure(&self, state: &mut State, config: &Arc<Config>) {
        let is_uniform = units::is_uniform(&self.settings);
        let names = units::units(&self.settings, config);
        let images = names.by_unit.into_iter().filter_map(|(unit, name)| {
            let module = config.modules.get(&name)?;
            let mut image = UnitImage::new(&name, &module.line, module.setup, is_uniform);
            if let Some(before) = state.images.get(&unit) {
                image.goes_on_from(before);
            }
            Some((unit, image))
        });
        state.images = images.collect();
        state.config = Arc::clone(config);
        // A configuration in which a module has moved comes into force without being asked.
        let problem = names.problems.first().map(|problem| match problem {
            Invalid::UnitTaken(unit, modules) => Problem::new(codes::UNIT_TAKEN)
                .with("reason", format!("{}: {unit}", modules.join(", "))),
            Invalid::NeedsUnit(module) => {
                Problem::new(codes::NOT_A_UNIT).with("reason", module.as_str())
            }
            // A module in `units` or `modules` that is gone.
            _ => Problem::new(codes::NOT_A_UNIT).with("reason", "units"),
        });
        let was_wrong = std::mem::replace(&mut state.problem, problem).is_some();
        match &state.problem {
            Some(problem) => self.report.failed(problem.clone(), 1, None),
            None if was_wrong => self.report.worked(),
            None => {}
        }
    }

    /// Answers what a connection received.
    pub(crate) fn with_units<T>(&self, work: impl FnOnce(&mut Units<'_>) -> T) -> T {
        let look = |module: &str| look(&self.service, module);
        let state = &mut *self.state.borrow_mut();
        work(&mut Units {
            images: &mut state.images,
            look: &look,
            site: &self.site,
            config: &state.config,
        })
    }

    /// Carries a write out, for a client of this name. When this returns, its effect is in the
    /// images, and its unit says how it ended.
    pub(crate) async fn carry_out(&self, service: &Service, write: &UnitWrite) -> WriteEnd {
        let terms = WriteTerms {
            within: self.within,
            ..WriteTerms::default()
        };
        // At the board that was the unit when it was asked.
        let end = service.write_since(&write.asked_by, &write.module, &write.set, terms);
        let end = match end.await {
            Ok(done) => Ok(done.confirmed),
            Err(failure) => {
                let point = write.set.first().map(|(point, _)| *point);
                let problem = failures::problem(service, &write.module, point, &failure);
                let digits = problem.code.trim_start_matches('E').parse();
                Err((failure, digits.unwrap_or_default()))
            }
        };
        let (done, synced) = oneshot::channel();
        if self.sync.send(done).await.is_ok() {
            // Fails if the outlet stops.
            let _ = synced.await;
        }
        note_end(&mut self.state.borrow_mut().images, write, &end);
        end
    }
}

/// Age, presence and round trip of a module, as they stand in its registers.
fn look(service: &Service, module: &str) -> [u16; 3] {
    let (_, points) = service.points_now(module);
    let ages: Option<Vec<Micros>> = points.iter().map(|point| point.age).collect();
    let oldest = ages.and_then(|ages| ages.into_iter().max());
    let tenths = oldest.and_then(|age| u16::try_from(age.0 / 100_000).ok());
    let status = service.module(module);
    let presence = match status.as_ref().map(|status| status.presence) {
        None | Some(Presence::Unheard) => 0,
        Some(Presence::Online) => 1,
        Some(Presence::Silent) => 2,
        Some(Presence::OtherModel) => 3,
    };
    let rtt = status.and_then(|status| status.rtt);
    let rtt = rtt.map_or(0, |rtt| u16::try_from(rtt.0 / 1_000).unwrap_or(u16::MAX));
    [tenths.unwrap_or(u16::MAX), presence, rtt]
}
