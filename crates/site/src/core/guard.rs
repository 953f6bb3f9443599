//! Protection of outputs, whoever commands them: interlocks and minimum off times. All of it is
//! decided in one step of the core, so that of two simultaneous commands the second one sees what
//! the first one is about to do.

use super::state::State;
use crate::config::Place;
use crate::{CommandError, PointChange, PointQuality, PointValue};
use railbus_wire::{Instant, Micros};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

/// What is known of outputs besides their values.
#[derive(Debug, Default)]
pub(super) struct Guard {
    outputs: BTreeMap<Place, Output>,
    /// The site polls, so an output that was never seen going off went off before the start.
    polls: bool,
}

#[derive(Debug, Default)]
struct Output {
    /// Commands in progress that may switch it on.
    rising: u32,
    /// Only a reading that began at this time of its line, or later, counts.
    doubt: Option<Instant>,
    /// When it may be switched on, in the time of the site; none if it is on, or was never seen
    /// going off.
    free_at: Option<Micros>,
}

impl State {
    /// Registers a command that is about to switch these outputs on, or refuses it if that is not
    /// safe. Ends with [`Guard::ended`].
    pub(super) fn rise(&mut self, rising: &[Place]) -> Result<(), CommandError> {
        for place in rising {
            self.check_interlock(place, rising)?;
            self.check_min_off(place)?;
        }
        for place in rising {
            self.guard.rises(place);
        }
        Ok(())
    }

    /// No output that this one excludes is on, or may be.
    fn check_interlock(&self, place: &Place, rising: &[Place]) -> Result<(), CommandError> {
        let config = self.site.config();
        let excluded = config.safety(place).map(|safety| &safety.interlock);
        let on = excluded
            .into_iter()
            .flatten()
            .find(|other| rising.contains(other) || self.may_be_on(other));
        match on {
            None => Ok(()),
            Some(other) => Err(CommandError::Interlock {
                point: place.point,
                by: config.path(other),
            }),
        }
    }

    /// It has been off for long enough, or is on.
    fn check_min_off(&self, place: &Place) -> Result<(), CommandError> {
        let safety = self.site.config().safety(place);
        let Some(min_off) = safety.and_then(|safety| safety.min_off) else {
            return Ok(());
        };
        if self.is(place, true) {
            return Ok(());
        }
        let known = self.guard.outputs.get(place);
        let free_at = known.and_then(|output| output.free_at);
        let free_at = free_at.or(self.guard.polls.then_some(min_off));
        match free_at.map(|free_at| free_at - self.now.site) {
            None | Some(Micros::ZERO) => Ok(()),
            Some(left) => Err(CommandError::MinOff {
                point: place.point,
                left,
            }),
        }
    }

    /// Whether an output may be on. Only a good reading of off, from after everything that was done
    /// to it, proves that it is not.
    fn may_be_on(&self, place: &Place) -> bool {
        let rising = self.guard.outputs.get(place).map_or(0, |out| out.rising);
        rising > 0 || !self.is(place, false)
    }

    /// Whether an output is certainly in this state.
    fn is(&self, place: &Place, wanted: bool) -> bool {
        let at = self.line_time(&place.module);
        let (known, quality) = self.site.point(&place.module, place.point, at);
        if self.changes_by_itself(place) {
            // A reading does not prove that it stays as it is.
            return false;
        }
        let output = self.guard.outputs.get(place);
        let doubt = output.and_then(|output| output.doubt);
        known.is_some_and(|known| {
            let after = doubt.is_none_or(|doubt| known.read >= doubt);
            quality == PointQuality::Good && after && known.value == PointValue::Bool(wanted)
        })
    }

    /// Takes a reading into account.
    pub(super) fn watch_off(&mut self, change: &PointChange) {
        let place = Place::new(&change.module, change.point);
        match (change.value, change.before) {
            (PointValue::Bool(true), _) => {
                if let Some(output) = self.guard.outputs.get_mut(&place) {
                    output.free_at = None;
                }
            }
            // First seen: what is known from before the start goes on.
            (PointValue::Bool(false), None) => {
                let known = self.guard.outputs.get(&place);
                let free_at = known.and_then(|output| output.free_at);
                if free_at.is_none() && self.guard.polls {
                    self.went_off(&place, self.now.site);
                }
            }
            (PointValue::Bool(false), Some(_)) => self.went_off(&place, self.now.site),
            (PointValue::Analog(..) | PointValue::Number(_), _) => {}
        }
    }

    /// An output goes off at this time of the site.
    pub(super) fn went_off(&mut self, place: &Place, at: Micros) {
        let safety = self.site.config().safety(place);
        if let Some(min_off) = safety.and_then(|safety| safety.min_off) {
            self.guard.free_at(place, at + min_off);
        }
    }

    /// Nobody was reading: outputs of these modules that are off may have gone off just now. If
    /// they are on, a reading will show it.
    pub(super) fn may_have_gone_off(&mut self, of: impl Fn(&str) -> bool, at: Micros) {
        let modules = self.site.config().modules.iter();
        let modules = modules.filter(|(name, _)| of(name));
        let places = modules.flat_map(|(name, module)| {
            let points = module.points.keys();
            points.map(|point| Place::new(name, *point))
        });
        for place in places.collect::<Vec<_>>() {
            self.went_off(&place, at);
        }
    }

    /// The remaining off time of each output that was seen going off, and that nothing may have
    /// switched on since.
    pub(super) fn must_stay_off(&self) -> Vec<(Place, Duration)> {
        let outputs = self.guard.outputs.iter();
        let off = outputs.filter(|(place, _)| !self.may_be_on(place));
        let left = off.filter_map(|(place, output)| {
            let left = output.free_at? - self.now.site;
            Some((place.clone(), Duration::from_micros(left.0)))
        });
        left.collect()
    }

    /// The modules that have to be read before it is known whether these outputs may be switched
    /// on.
    pub(super) fn to_be_asked(&self, rising: &[Place]) -> BTreeSet<String> {
        let safety = rising
            .iter()
            .filter_map(|place| self.site.config().safety(place));
        let excluded = safety.flat_map(|safety| &safety.interlock);
        let unsure = |place: &&Place| !self.is(place, true) && !self.is(place, false);
        excluded
            .filter(unsure)
            .map(|place| place.module.clone())
            .collect()
    }

    /// Those of these outputs that are certainly off, with no command in progress to switch them
    /// on.
    pub(super) fn surely_off(&self, places: &[Place]) -> Vec<Place> {
        let off = places.iter().filter(|place| !self.may_be_on(place));
        off.cloned().collect()
    }

    /// Those of these outputs that are not certainly off.
    pub(super) fn not_off(&self, places: Vec<Place>) -> Vec<Place> {
        let off = |place: &Place| self.is(place, false);
        places.into_iter().filter(|place| !off(place)).collect()
    }
}

impl Guard {
    pub(super) fn new(polls: bool) -> Guard {
        Guard {
            outputs: BTreeMap::new(),
            polls,
        }
    }

    fn output(&mut self, place: &Place) -> &mut Output {
        self.outputs.entry(place.clone()).or_default()
    }

    /// Something is about to be sent that may switch an output on.
    pub(super) fn rises(&mut self, place: &Place) {
        self.output(place).rising += 1;
    }

    /// A command that may have switched an output on has ended. If its outcome is unknown, only a
    /// reading from `doubt` on proves that the output is off.
    pub(super) fn ended(&mut self, place: &Place, doubt: Option<Instant>) {
        let output = self.output(place);
        output.rising = output.rising.saturating_sub(1);
        self.doubt(place, doubt);
    }

    /// Only a reading from then on says how an output is.
    pub(super) fn doubt(&mut self, place: &Place, from: Option<Instant>) {
        let output = self.output(place);
        output.doubt = output.doubt.max(from);
    }

    /// An output must not be switched on before this time of the site.
    pub(super) fn free_at(&mut self, place: &Place, at: Micros) {
        let output = self.output(place);
        output.free_at = output.free_at.max(Some(at));
    }

    /// The clocks of these modules' lines start anew, and nothing is known of their outputs; what
    /// the modules do by themselves goes on.
    pub(super) fn forget_doubts(&mut self, of: impl Fn(&str) -> bool) {
        for (_, output) in self.outputs.iter_mut().filter(|(at, _)| of(&at.module)) {
            output.doubt = None;
        }
    }

    #[cfg(test)]
    pub(super) fn is_at_rest(&self) -> bool {
        self.outputs.values().all(|output| output.rising == 0)
    }

    /// Drops what is no output any more and has nothing in progress.
    pub(super) fn retain(&mut self, there: impl Fn(&Place) -> bool) {
        self.outputs
            .retain(|place, output| output.rising > 0 || there(place));
    }
}

#[cfg(test)]
mod tests {
    use super::super::promises::boards;
    use super::*;
    use crate::Config;
    use railbus_device::{Bank, Observation, Point, PointKind};
    use railbus_host::Presence;
    use std::time::SystemTime;

    /// A board lets go of a relay for an hour, and pulls it in again by itself.
    #[test]
    fn what_a_module_does_by_itself_goes_on_while_its_line_is_lent() {
        let text = "[line.main]\nport = \"/dev/ttyUSB0\"\n[module.gate]\nline = \"main\"\n\
                    model = \"r55\"\naddress = 4\n\
                    [module.gate.point.k1]\ninterlock = [\"gate.k2\"]\n";
        let mut state = State::new(Config::parse(text).unwrap(), true);
        let kind = PointKind::Output;
        let place = |index| Place::new("gate", Point { kind, index });
        let hour = Micros::from_secs(3_600);
        state.guard.rises(&place(0));
        state.guard.ended(&place(0), Some(Instant(7)));
        let board = boards(state.site.config())["gate"].clone();
        state.schedule.boards = boards(state.site.config());
        let pulses = &mut state.schedule.own_pulses;
        pulses.may_have_begun(&board, place(0).point, hour, Micros::ZERO);
        state.site.forget(|_| true);
        state.guard.forget_doubts(|_| true);
        let off = Observation::Channels {
            outputs: Bank::new(0xF, 0),
            inputs: Bank::default(),
        };
        state.site.heard("gate", Presence::Online);
        state
            .site
            .saw("gate", &off, Instant(0), SystemTime::UNIX_EPOCH);
        state.lines.get_mut("main").unwrap().began = Micros::from_secs(9);
        state.now.site = Micros::from_secs(9);
        let refused = state.rise(&[place(1)]);
        assert!(matches!(refused, Err(CommandError::Interlock { .. })));
        state.lines.get_mut("main").unwrap().began = hour;
        state.now.site = hour;
        assert_eq!(state.rise(&[place(1)]), Ok(()));
    }
}
