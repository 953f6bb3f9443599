//! Several outputs at once: in as few frames as possible, and all or nothing on request.

use super::context::Context;
use super::state::State;
use super::turns::Turn;
use super::within::Within;
use crate::config::{Config, Place};
use crate::rights::Who;
use crate::{CommandError, WriteDone, WriteTerms};
use railbus_device::{Bank, Module, Point};
use railbus_host::{Confirmation, Fault};
use railbus_wire::Micros;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// The terms of a batch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BatchTerms {
    /// Read the outputs back and compare, where the module can.
    pub verify: bool,
    /// The caller confirms outputs that require it.
    pub confirm: bool,
    /// If one fails, what was done is undone.
    pub all_or_nothing: bool,
    /// All of it must be sent within this time; of a scene each step, from when it comes. It may be
    /// undone later.
    pub within: Within,
}

impl Default for BatchTerms {
    fn default() -> BatchTerms {
        BatchTerms {
            verify: true,
            confirm: false,
            all_or_nothing: false,
            within: Within::DEFAULT,
        }
    }
}

/// One output of a batch, and its result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Part {
    /// Which output.
    pub place: Place,
    /// The requested state.
    pub wanted: bool,
    /// How it ended.
    pub end: Result<PartDone, CommandError>,
}

/// How one output of a batch was switched.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PartDone {
    /// The state now; none if it is unknown.
    pub value: Option<bool>,
    /// The state before, if it was known.
    pub before: Option<bool>,
    /// How far that is certain.
    pub confirmed: Confirmation,
    /// From submitting the command to the last byte of its own reply.
    pub took: Micros,
    /// The number of its audit entry.
    pub audit: String,
}

/// The result of a batch.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BatchDone {
    /// Each of them, in the order of the request.
    pub parts: Vec<Part>,
    /// One failed, and everything that was done was undone.
    pub undone: bool,
}

impl BatchDone {
    /// A result for outputs whose outcome is unknown.
    pub(crate) fn unknown(set: &[(Place, bool)]) -> BatchDone {
        BatchDone {
            parts: parts(set, |_, _| Err(Fault::Unknown.into())),
            undone: false,
        }
    }

    fn has_failed(&self) -> bool {
        self.parts.iter().any(|part| part.end.is_err())
    }
}

/// The terms of a batch that was begun.
#[derive(Clone, Copy, Debug)]
struct Bound {
    terms: BatchTerms,
    /// Nothing is sent from this time of the site on.
    expires: Micros,
}

/// The new state of a group.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GroupState {
    /// All of it on, or all of it off.
    Set(bool),
    /// Off if any of it is on or may be, otherwise on.
    Toggle,
}

/// What outputs are; those of which nothing is known are not in it.
type States = BTreeMap<Place, bool>;

/// An output of a batch and its number there.
type Item = (usize, Place, bool);

/// Who holds the turn while a batch is switched.
#[derive(Clone, Debug)]
enum Held {
    /// Each command waits for a turn of its own, with the boards of this configuration.
    Not(Arc<Config>),
    /// What was decided holds for all of them. The outputs of a command are given back with its
    /// end.
    Each(Arc<Turn>),
    /// Until all of it has ended.
    Kept(Arc<Turn>),
    /// The same: what was done may have to be undone.
    All(Arc<Turn>),
}

impl Context {
    fn bound(&self, terms: BatchTerms) -> Bound {
        let expires = self.expires(terms.within);
        Bound { terms, expires }
    }

    /// Switches outputs of any modules. Those of one module are joined; if some of them are
    /// interlocked, what goes off precedes what goes on. With all or nothing, nobody else commands
    /// the outputs meanwhile.
    pub(crate) async fn batch(
        &self,
        who: &Who,
        set: &[(Place, bool)],
        terms: BatchTerms,
    ) -> BatchDone {
        let since = self.config();
        let bound = self.bound(terms);
        let (mut done, items) = self.with(|state| state.checked(who, set, terms));
        if !terms.all_or_nothing || items.is_empty() {
            if !self.with(|state| state.exclude_each_other(&items)) {
                self.switch_at_once(who, &mut done, &items, bound, &Held::Not(since))
                    .await;
                return done;
            }
            return self
                .batch_in_steps(who, set, (done, items), bound, &since)
                .await;
        }
        let places: Vec<Place> = items.iter().map(|item| item.1.clone()).collect();
        // Before the turn: nobody has to wait while a silent module is read.
        self.ask_unknown(&places, bound.expires).await;
        match self.turn_since(&since, places, bound.expires).await {
            Ok(turn) => {
                // Meanwhile the configuration may have changed, or the site may be closing.
                let (done, items) = self.with(|state| state.checked(who, set, terms));
                if items.is_empty() {
                    return done;
                }
                let places: Vec<Place> = items.iter().map(|item| item.1.clone()).collect();
                let asked = self.now();
                let before = self.read_in_turn(&places, bound.expires).await;
                self.all_or_nothing(who, done, &items, bound, (turn, asked, before))
                    .await
            }
            Err(fault) => BatchDone {
                parts: parts(set, |_, _| Err(fault.into())),
                undone: false,
            },
        }
    }

    /// Switches outputs that exclude each other: what goes on waits for what goes off. Its turn is
    /// taken with that of the others, so that a command that comes meanwhile is the later one.
    async fn batch_in_steps(
        &self,
        who: &Who,
        set: &[(Place, bool)],
        (mut done, items): (BatchDone, Vec<Item>),
        bound: Bound,
        since: &Config,
    ) -> BatchDone {
        let places: Vec<Place> = items.iter().map(|item| item.1.clone()).collect();
        match self.turn_since(since, places, bound.expires).await {
            Ok(turn) => {
                // Meanwhile the configuration may have changed. What was refused before has no
                // turn.
                let (now, may) = self.with(|state| state.checked(who, set, bound.terms));
                for (number, ..) in &items {
                    let ends = done.parts.get_mut(*number).zip(now.parts.get(*number));
                    if let Some((part, now)) = ends {
                        part.end.clone_from(&now.end);
                    }
                }
                let has_turn = |item: &Item| items.iter().any(|had| had.0 == item.0);
                let may: Vec<Item> = may.into_iter().filter(has_turn).collect();
                turn.give_back(|place| !may.iter().any(|item| item.1 == *place));
                let held = Held::Kept(Arc::new(turn));
                self.switch_in_turn(who, &mut done, &may, bound, &held)
                    .await;
            }
            Err(fault) => {
                for (number, ..) in items {
                    if let Some(part) = done.parts.get_mut(number) {
                        part.end = Err(fault.into());
                    }
                }
            }
        }
        done
    }

    async fn all_or_nothing(
        &self,
        who: &Who,
        mut done: BatchDone,
        items: &[Item],
        bound: Bound,
        (turn, asked, mut before): (Turn, Micros, States),
    ) -> BatchDone {
        let held = Held::All(Arc::new(turn));
        // A pulse of the module's own is over with the first command, and is not begun again: the
        // output goes where it would have gone. One that ended since the outputs were asked for was
        // read before its end.
        for (place, end) in self.with(|state| state.own_pulses_of(items, asked)) {
            match end {
                Some(end) => _ = before.insert(place, end),
                None => _ = before.remove(&place),
            }
        }
        let cut = self.with(|state| state.own_pulses_of(items, state.now.site));
        self.switch_in_turn(who, &mut done, items, bound, &held)
            .await;
        if done.has_failed() {
            // Once undone, the outputs are as before, with their pulses and leases.
            self.undo(who, &mut done, items, &before, &held).await;
            for part in done.parts.iter_mut().filter(|p| cut.contains_key(&p.place)) {
                match &part.end {
                    Err(CommandError::Undone) => {
                        (part.end, done.undone) = (Err(CommandError::NotUndone), false);
                    }
                    // The command failed and may still have ended the pulse.
                    Err(failure) if failure.may_have_acted() => done.undone = false,
                    _ => {}
                }
            }
            return done;
        }
        let places: Vec<Place> = items.iter().map(|item| item.1.clone()).collect();
        if let Err(why) = self.hand_outputs_over(&places, None).await {
            for part in &mut done.parts {
                part.end = Err(CommandError::NotTakenOver(why));
            }
        }
        done
    }

    /// Switches a group.
    ///
    /// # Errors
    /// [`CommandError::NoSuchGroup`]; for a toggle also those of [`Service::write`] while others
    /// command it.
    pub(crate) async fn set_group(
        &self,
        who: &Who,
        group: &str,
        to: GroupState,
        terms: BatchTerms,
    ) -> Result<BatchDone, CommandError> {
        let since = self.config();
        let group = since.groups.get(group).ok_or(CommandError::NoSuchGroup)?;
        let members = group.members.clone();
        match to {
            GroupState::Set(on) => {
                let set: Vec<_> = members.into_iter().map(|member| (member, on)).collect();
                Ok(self.batch(who, &set, terms).await)
            }
            GroupState::Toggle => self.toggle_group(&since, who, members, terms).await,
        }
    }

    /// Its new state is decided while holding the turn of all its outputs: of two toggles at once,
    /// the later one sees the result of the first.
    async fn toggle_group(
        &self,
        since: &Config,
        who: &Who,
        members: Vec<Place>,
        terms: BatchTerms,
    ) -> Result<BatchDone, CommandError> {
        // Before the turn: nobody has to wait while a silent module is read.
        let bound = self.bound(terms);
        self.ask_unknown(&members, bound.expires).await;
        let turn = self.turn_since(since, members.clone(), bound.expires);
        let turn = turn.await?;
        let asked = self.now();
        let before = self.read_in_turn(&members, bound.expires).await;
        // If nothing is known, any of it may be on.
        let are_off = members.iter().all(|at| before.get(at) == Some(&false));
        let set: Vec<_> = members.into_iter().map(|at| (at, are_off)).collect();
        let (mut done, items) = self.with(|state| state.checked(who, &set, terms));
        if terms.all_or_nothing && !items.is_empty() {
            let all = self.all_or_nothing(who, done, &items, bound, (turn, asked, before));
            return Ok(all.await);
        }
        turn.give_back(|place| !items.iter().any(|item| item.1 == *place));
        let held = Held::Each(Arc::new(turn));
        self.switch_in_turn(who, &mut done, &items, bound, &held)
            .await;
        Ok(done)
    }

    /// Reads the modules of outputs whose state is unknown.
    async fn ask_unknown(&self, places: &[Place], expires: Micros) {
        let modules: BTreeSet<String> = self.with(|state| {
            let unknown = places.iter().filter(|place| state.known(place).is_none());
            unknown.map(|place| place.module.clone()).collect()
        });
        for module in modules {
            // What could not be read stays unknown.
            let _ = self.read_all(&module, expires).await;
        }
    }

    /// The states of outputs, read in their turn: cached ones may have been acknowledged and not
    /// read, or changed by hand. Modules of which nothing is known are not waited for.
    async fn read_in_turn(&self, places: &[Place], expires: Micros) -> States {
        let mut modules: BTreeMap<&str, bool> = BTreeMap::new();
        self.with(|state| {
            for place in places {
                *modules.entry(&place.module).or_insert(true) &= state.can_be_read(place);
            }
        });
        let answering = modules.into_iter().filter(|(_, answers)| *answers);
        let reading = answering.map(|(module, _)| async move {
            let read = self.read_all(module, expires).await;
            read.is_ok().then_some(module)
        });
        let read = self.all(reading.collect::<Vec<_>>()).await;
        let read: BTreeSet<&str> = read.into_iter().flatten().collect();
        self.with(|state| {
            let of_read = places.iter().filter(|place| read.contains(&*place.module));
            of_read
                .filter_map(|place| Some((place.clone(), state.known(place)?)))
                .collect()
        })
    }

    /// Switches them, in two steps if they are interlocked. With all or nothing, a failure in the
    /// first prevents the second.
    async fn switch_in_turn(
        &self,
        who: &Who,
        done: &mut BatchDone,
        items: &[Item],
        bound: Bound,
        held: &Held,
    ) {
        if !self.with(|state| state.exclude_each_other(items)) {
            return self.switch_at_once(who, done, items, bound, held).await;
        }
        for wanted in [false, true] {
            let turn: Vec<Item> = items.iter().filter(|i| i.2 == wanted).cloned().collect();
            self.switch_at_once(who, done, &turn, bound, held).await;
            let failed = turn.iter().filter_map(|item| done.parts.get(item.0));
            if bound.terms.all_or_nothing && failed.into_iter().any(|part| part.end.is_err()) {
                return;
            }
        }
    }

    /// Switches the outputs of all modules in parallel.
    async fn switch_at_once(
        &self,
        who: &Who,
        done: &mut BatchDone,
        items: &[Item],
        bound: Bound,
        held: &Held,
    ) {
        let mut by_module: BTreeMap<String, Vec<Item>> = BTreeMap::new();
        for item in items {
            let of_module = by_module.entry(item.1.module.clone()).or_default();
            of_module.push(item.clone());
        }
        let each = by_module.iter().map(|(module, items)| async move {
            let ends = self.switch_module(who, module, items, bound, held).await;
            (items, ends)
        });
        for (items, ends) in self.all(each.collect::<Vec<_>>()).await {
            for (item, end) in items.iter().zip(ends) {
                if let Some(part) = done.parts.get_mut(item.0) {
                    part.end = end;
                }
            }
        }
    }

    /// Switches outputs of one module with one command. If one of them is refused, the others are
    /// still switched, unless it is all or nothing.
    async fn switch_module(
        &self,
        who: &Who,
        module: &str,
        items: &[Item],
        bound: Bound,
        held: &Held,
    ) -> Vec<Result<PartDone, CommandError>> {
        let set: Vec<(Point, bool)> = items.iter().map(|(_, at, on)| (at.point, *on)).collect();
        let own;
        let (turn, takes_over): (&Turn, bool) = match held {
            Held::All(turn) => (turn, false),
            Held::Each(turn) | Held::Kept(turn) => (turn, true),
            // One turn for all tries: a command that came later stays the later one.
            Held::Not(since) => match self.turn_of_module(since, who, module, &set, bound).await {
                Ok(turn) => {
                    own = turn;
                    (&own, true)
                }
                Err(failure) => return failed(&set, &failure),
            },
        };
        let switch = async |set: &[(Point, bool)]| {
            let done = self.switch_points(who, turn, module, set, bound).await;
            let done = match done {
                Ok(done) if takes_over => {
                    let points: Vec<Point> = set.iter().map(|(point, _)| *point).collect();
                    self.take_over(module, &points, done).await
                }
                done => done,
            };
            match done {
                Ok(done) => parts_of(&done).into_iter().map(Ok).collect(),
                Err(failure) => failed(set, &failure),
            }
        };
        let mut ends = switch(&set).await;
        let one_must_not = matches!(
            ends.first(),
            Some(Err(
                CommandError::Interlock { .. } | CommandError::MinOff { .. }
            ))
        );
        if one_must_not && !bound.terms.all_or_nothing && set.len() > 1 {
            ends.clear();
            for one in set {
                ends.extend(switch(&[one]).await);
            }
        }
        if let Held::Each(turn) = held {
            turn.give_back(|place| items.iter().any(|item| item.1 == *place));
        }
        ends
    }

    /// The turn with these outputs, for the boards of an earlier configuration.
    async fn turn_of_module(
        &self,
        since: &Config,
        who: &Who,
        module: &str,
        set: &[(Point, bool)],
        Bound { terms, expires }: Bound,
    ) -> Result<Turn, CommandError> {
        let points: Vec<Point> = set.iter().map(|(point, _)| *point).collect();
        let until = (terms.confirm, expires);
        let turn = self.turn_to_command(since, who, module, &points, until);
        let turn = turn.await?;
        let on = set.iter().filter(|(_, on)| *on).map(|(point, _)| *point);
        self.with(|state| state.watched(module, on))?;
        Ok(turn)
    }

    /// With one command.
    async fn switch_points(
        &self,
        who: &Who,
        turn: &Turn,
        module: &str,
        set: &[(Point, bool)],
        Bound { terms, expires }: Bound,
    ) -> Result<WriteDone, CommandError> {
        // The site may have begun to close since: its own policies take precedence.
        if self.with(|state| state.schedule.is_stopping) {
            return Err(Fault::Closed.into());
        }
        let terms = WriteTerms {
            verify: terms.verify,
            confirm: terms.confirm,
            ..WriteTerms::default()
        };
        self.write_in_turn(who, turn, module, set, terms, expires)
            .await
    }

    /// Undoes what was done, and what may have been.
    async fn undo(
        &self,
        who: &Who,
        done: &mut BatchDone,
        items: &[Item],
        before: &States,
        held: &Held,
    ) {
        let touched = |end: &Result<PartDone, CommandError>| match end {
            Ok(_) => true,
            Err(failure) => failure.may_have_acted(),
        };
        let mut back = Vec::new();
        let mut lost = Vec::new();
        for (number, place, _) in items {
            let part = done.parts.get(*number);
            match (
                part.is_some_and(|part| touched(&part.end)),
                before.get(place),
            ) {
                (false, _) => {}
                // What gives pulses by itself can't be brought back into one: that begins another.
                (true, Some(true)) if self.gives_pulses(place).await => lost.push(*number),
                (true, Some(before)) => back.push((back.len(), place.clone(), *before, *number)),
                (true, None) => lost.push(*number),
            }
        }
        let parts = back.iter().map(|(_, place, wanted, _)| Part {
            place: place.clone(),
            wanted: *wanted,
            end: Err(CommandError::NotTried),
        });
        let mut undone = BatchDone {
            parts: parts.collect(),
            undone: false,
        };
        let again: Vec<Item> = back.iter().map(|b| (b.0, b.1.clone(), b.2)).collect();
        // However late it is.
        let bound = self.bound(BatchTerms::default());
        self.switch_in_turn(who, &mut undone, &again, bound, held)
            .await;
        done.undone = lost.is_empty() && !undone.has_failed();
        let ends = undone.parts.iter().zip(&back);
        let failed = ends.map(|(part, back)| (back.3, part.end.is_err()));
        for (number, failed) in failed.chain(lost.iter().map(|number| (*number, true))) {
            if let Some(part) = done.parts.get_mut(number)
                && part.end.is_ok()
            {
                part.end = Err(if failed {
                    CommandError::NotUndone
                } else {
                    CommandError::Undone
                });
            }
        }
    }
}

impl State {
    /// The outputs that are refused, with the reason, and those that can be tried. With all or
    /// nothing, one refusal refuses all.
    fn checked(
        &self,
        who: &Who,
        set: &[(Place, bool)],
        terms: BatchTerms,
    ) -> (BatchDone, Vec<Item>) {
        let may = |place: &Place, on| self.may_switch(who, place, on, terms.confirm);
        let checked =
            |place: &Place, on| Err(may(place, on).err().unwrap_or(CommandError::NotTried));
        let done = BatchDone {
            parts: parts(set, checked),
            undone: false,
        };
        let refused = |part: &Part| part.end != Err(CommandError::NotTried);
        if terms.all_or_nothing && done.parts.iter().any(refused) {
            return (done, Vec::new());
        }
        let numbered = done.parts.iter().enumerate();
        let items = numbered
            .filter(|(_, part)| !refused(part))
            .map(|(number, part)| (number, part.place.clone(), part.wanted));
        let items = items.collect();
        (done, items)
    }

    fn may_switch(
        &self,
        who: &Who,
        place: &Place,
        on: bool,
        confirm: bool,
    ) -> Result<(), CommandError> {
        let points = [place.point];
        self.may_command(who, &place.module, &points, confirm)?;
        let rising = points.into_iter().filter(|_| on);
        self.watched(&place.module, rising)
    }

    /// The pulses of these that their modules time and that end later than this, and the states
    /// after them; none where that is not known.
    fn own_pulses_of(&self, items: &[Item], than: Micros) -> BTreeMap<Place, Option<bool>> {
        let pulses = items.iter().filter_map(|(_, place, _)| {
            let pulse = self.own_pulse(place)?;
            (pulse.until > than).then(|| (place.clone(), pulse.end))
        });
        pulses.collect()
    }

    fn exclude_each_other(&self, items: &[Item]) -> bool {
        let config = self.site.config();
        let excluded = items.iter().filter_map(|item| config.safety(&item.1));
        let mut excluded = excluded.flat_map(|safety| &safety.interlock);
        excluded.any(|other| items.iter().any(|item| item.1 == *other))
    }

    /// The number of frames in which these outputs can be switched to one state.
    pub(crate) fn frames_of(&self, outputs: &[Place]) -> usize {
        let mut masks: BTreeMap<&str, u32> = BTreeMap::new();
        for place in outputs {
            if let Some(bit) = 1_u32.checked_shl(u32::from(place.point.index)) {
                *masks.entry(&place.module).or_default() |= bit;
            }
        }
        let frames = masks.into_iter().map(|(module, mask)| {
            let described = self.described(module).ok();
            let module = described.and_then(|described| Module::new(described.setup).ok());
            module.map_or(0, |module| frames_of(&module, mask))
        });
        frames.sum()
    }
}

/// Outputs with the end of each.
fn parts(
    set: &[(Place, bool)],
    end: impl Fn(&Place, bool) -> Result<PartDone, CommandError>,
) -> Vec<Part> {
    let parts = set.iter().map(|(place, on)| Part {
        place: place.clone(),
        wanted: *on,
        end: end(place, *on),
    });
    parts.collect()
}

/// The same end for each output of a command.
fn failed(set: &[(Point, bool)], failure: &CommandError) -> Vec<Result<PartDone, CommandError>> {
    set.iter().map(|_| Err(failure.clone())).collect()
}

/// Each output that a command has switched.
pub(super) fn parts_of(done: &WriteDone) -> Vec<PartDone> {
    let each = done.outputs.iter().map(|(_, value, before)| PartDone {
        value: *value,
        before: *before,
        confirmed: done.confirmed,
        took: done.took,
        audit: done.audit.clone(),
    });
    each.collect()
}

fn frames_of(module: &Module, mask: u32) -> usize {
    let mut left = Bank::new(mask, mask);
    let mut frames = 0;
    while left.mask != 0 {
        let carried = module.group(left).mask & left.mask;
        if carried == 0 {
            break;
        }
        left = Bank::new(left.mask & !carried, left.on & !carried);
        frames += 1;
    }
    frames
}
