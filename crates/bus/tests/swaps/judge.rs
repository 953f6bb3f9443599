//! The judge: what is reported, and whether it is true.

use crate::dice::Dice;
use crate::place::{Place, Who};
use crate::support::Drive;
use crate::tally::Tally;
use crate::wire::{LEVELS, Wire};
use railbus_bus::{Confirmation, Event, Fault, Presence, Ticket};
use railbus_device::{Bank, Observation, Op};
use railbus_wire::{Instant, Micros};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

/// The maximum time that the right module is reported as another model after it came back.
const ACCUSED_MAX: Micros = Micros::from_secs(4);
/// With losses: the maximum time since the last loss of a frame to or from it.
const ACCUSED_UNLOST_MAX: Micros = Micros::from_secs(6);
/// The maximum time that another model is reported online, with values, after it answered and
/// something had failed since the right one was removed. 0031 admits its values while several
/// requests in a row are unanswered, and until the one after that.
const NOTICED_MAX: Micros = Micros::from_millis(2500);
/// The maximum time between two readings of a right module: other silent modules get their turns as
/// well.
const UNREAD_MAX: Micros = Micros::from_secs(8);
/// How fast it has to answer for that. A known limit: a probe of a silent module waits for less
/// than 98 ms, and no longer than was learned from another model that was there first. A later
/// reply brings a module back only if no older request of its was left unanswered: otherwise it is
/// taken for the reply to that, and so is each one after it.
pub(crate) const IN_TIME: Micros = Micros::from_millis(60);
/// A module that was present and reported for this long follows its commands.
const HEALTHY: Micros = Micros::from_secs(1);
/// A line is crowded if it has less than this many milliseconds per command: a command may then
/// expire in the queue, and a module is asked for its model later.
const CROWDED: u64 = 300;

/// A command that has not ended.
#[derive(Debug)]
pub(crate) struct Command {
    pub(crate) place: usize,
    pub(crate) op: Op,
    pub(crate) submitted: Instant,
    /// An engine received a frame of it, and one changed an output.
    pub(crate) heard: bool,
    pub(crate) acted: bool,
    /// The right module received one, and was as commanded after it.
    pub(crate) taken: bool,
}

/// A line, its events, and what may be reported about it.
pub(crate) struct Judge {
    pub(crate) dice: Dice,
    pub(crate) drive: Drive,
    pub(crate) wire: Rc<RefCell<Wire>>,
    pub(crate) places: Vec<Place>,
    pub(crate) commands: BTreeMap<Ticket, Command>,
    /// Requests and replies may be lost.
    pub(crate) lossy: bool,
    /// The mean time between two commands in milliseconds.
    pub(crate) pause: u64,
    pub(crate) shows: bool,
    pub(crate) about: String,
    pub(crate) faults: Vec<String>,
    pub(crate) tally: Tally,
}

impl Judge {
    pub(crate) fn show(&self, what: impl FnOnce() -> String) {
        if self.shows {
            println!("{:>9} {}", self.drive.now.0, what());
        }
    }

    pub(crate) fn fault(&mut self, text: String) {
        self.show(|| format!("!!! {text}"));
        self.faults
            .push(format!("at {} us: {text}", self.drive.now.0));
    }

    /// A command was refused because another model is reported there.
    pub(crate) fn refused(&mut self, index: usize) {
        let stay = self.places[index].stay();
        let age = self.drive.now.since(stay.since);
        if stay.who == Who::Right && !self.lossy && age > ACCUSED_MAX {
            self.fault(format!("place {index}: refused, right for {} us", age.0));
        }
    }

    /// The line reported an event: checks what always holds, and without losses the rest.
    pub(crate) fn told(&mut self, event: Event) {
        self.show(|| format!("told {event:?}"));
        match event {
            Event::Seen {
                module,
                seen: Observation::Channels { outputs, inputs },
                asked,
                heard,
                ..
            } => self.seen(module.0, outputs, inputs, (asked, heard)),
            Event::Presence { module, presence } => {
                self.places[module.0].presence = presence;
                if presence == Presence::OtherModel {
                    self.tally.strangers += 1;
                    let mut stays = self.places[module.0].stays.iter();
                    if stays.all(|stay| stay.who != Who::Other) {
                        self.fault(format!("{module:?}: a stranger where none ever was"));
                    }
                }
            }
            Event::Done { ticket, end, .. } => match self.commands.remove(&ticket) {
                Some(command) => self.ended(&command, end),
                None => self.fault(format!("{ticket:?} ended twice")),
            },
            _ => {}
        }
    }

    /// A value: of the right module, or of another one within the limit.
    fn seen(&mut self, index: usize, outputs: Bank, inputs: Bank, span: (Instant, Instant)) {
        let (asked, heard) = span;
        let place = &mut self.places[index];
        let is_of = |place: &Place, who: Who| {
            place.stood(who, asked, heard)
                && place.were(who, outputs, asked, heard)
                && LEVELS[who as usize] & inputs.mask == inputs.on
        };
        self.tally.values += 1;
        if is_of(place, Who::Right) {
            place.read = heard;
            let stay = place.stays.last_mut().expect("one at least");
            if stay.who == Who::Right {
                stay.told.get_or_insert(heard);
            }
            return;
        }
        if !is_of(place, Who::Other) {
            self.fault(format!("place {index}: nobody's {outputs:?} {inputs:?}"));
            return;
        }
        let stay = place.stay_at(heard);
        let age = heard.since(stay.noticeable().unwrap_or(stay.since));
        // What 0031 lets be reported wrongly: a swap between two exchanges without a miss, until
        // the next miss; and for a short time where several requests in a row were unanswered.
        if place.was_unnoticed(asked, heard) {
            self.tally.unnoticed_values += 1;
        } else if !self.lossy {
            self.tally.foreign_values += 1;
            self.tally.foreign = self.tally.foreign.max(age.0);
            if age > self.noticed_max() {
                self.fault(format!(
                    "place {index}: another model's value, {} us",
                    age.0
                ));
            }
        }
    }

    /// A command ended.
    fn ended(&mut self, command: &Command, end: Result<Confirmation, Fault>) {
        let (now, index) = (self.drive.now, command.place);
        let place = &self.places[index];
        let stay = place.stay();
        let since = command.submitted;
        let is_healthy = stay.told.is_some_and(|told| told + HEALTHY < since)
            && !self.lossy
            && self.pause >= CROWDED;
        let blame = format!("place {index}: {command:?} ended with {end:?}");
        match end {
            Ok(how) => {
                self.tally.done += 1;
                let by_readback = how == Confirmation::Readback;
                let is_new = place
                    .other_since()
                    .is_some_and(|at| at + self.noticed_max() >= now);
                let by_reply = !by_readback && matches!(command.op, Op::Write(_));
                let is_right = match command.op {
                    Op::Write(want) if by_readback => {
                        let was_so = |who| place.were(who, want, place.asked, now);
                        if !place.answered_by(now).is_some_and(was_so) {
                            return self.fault(format!("{blame}: it was not so"));
                        }
                        let was_there = place.stood(Who::Right, since, now);
                        was_there && place.were(Who::Right, want, since, now)
                    }
                    Op::Write(_) => command.taken,
                    // Either module may report its model.
                    Op::Identify => true,
                    _ => place.stood(Who::Right, since, now),
                };
                if is_right || self.lossy {
                } else if place.was_unnoticed(since, now) {
                    self.tally.unnoticed_commands += 1;
                } else if (by_reply && place.came_back(since, now)) || (!by_reply && is_new) {
                    // A known limit. A module that has just given its name is not asked again for
                    // half a second, whatever fails meanwhile, and a reading of another model
                    // within that ends a command. And where another model acknowledged a command,
                    // or one of its frames, a right one that gives its name before the command has
                    // ended is taken for the one that did.
                    self.tally.foreign_commands += 1;
                    self.show(|| format!("!!! let pass: {blame}"));
                } else {
                    self.fault(format!("{blame}: the right module did not do it"));
                }
            }
            Err(fault) => {
                self.tally.not_done += 1;
                let is_refusal = matches!(fault, Fault::Refused(_)) && !command.acted;
                if command.heard && !fault.may_have_acted() && !is_refusal {
                    return self.fault(format!("{blame}: it was heard"));
                }
                if is_healthy {
                    return self.fault(format!("{blame}: nothing was wrong"));
                }
                if let Fault::OtherModel { .. } = fault {
                    self.refused(index);
                }
            }
        }
    }

    /// How long another model may remain undetected.
    fn noticed_max(&self) -> Micros {
        NOTICED_MAX * if self.pause < CROWDED { 2 } else { 1 }
    }

    /// The final state.
    pub(crate) fn look(&mut self) {
        let now = self.drive.now;
        let (mut faults, noticed_max) = (Vec::new(), self.noticed_max());
        for (index, place) in self.places.iter().enumerate() {
            let (stay, tally) = (place.stay(), &mut self.tally);
            let age = now.since(stay.since);
            let mut limit = |what: &str, longest: &mut u64, is: u64, most: u64| {
                *longest = is.max(*longest);
                if is > most {
                    faults.push(format!("place {index}: {what} for {is} us"));
                }
            };
            match (stay.who, place.presence) {
                (Who::Right, Presence::OtherModel) if self.lossy => {
                    let unlost = now.since(place.lost.max(stay.since)).0;
                    limit("accused", &mut tally.accused, unlost, ACCUSED_UNLOST_MAX.0);
                }
                (Who::Right, Presence::OtherModel) => {
                    limit("accused", &mut tally.accused, age.0, ACCUSED_MAX.0);
                }
                (Who::Other, Presence::Online)
                    if !self.lossy
                        && let Some(since) = stay.noticeable() =>
                {
                    let age = now.since(since);
                    limit(
                        "taken for the right one",
                        &mut tally.taken_for,
                        age.0,
                        noticed_max.0,
                    );
                }
                _ => {}
            }
            if stay.who == Who::Right && !self.lossy && !place.is_late {
                let unread = now.since(place.read.max(stay.since));
                limit("unread", &mut tally.unread, unread.0, UNREAD_MAX.0);
            }
        }
        for fault in faults {
            self.fault(fault);
        }
    }
}
