//! What happens to a line: swaps, commands, requests and replies.

use crate::dice::Dice;
use crate::judge::{Command, IN_TIME, Judge};
use crate::place::{Place, Stay, Who};
use crate::support::{Drive, Happening, millis};
use crate::tally::Tally;
use crate::wire::{MARK, Wire, engine};
use railbus_bus::{Bus, Config, EchoMode, Fault, Input, ModuleId, Plan, Presence, Terms};
use railbus_device::{Bank, Family, Module, Op, Setup};
use railbus_wire::{Address, Instant, Micros, Protocol};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

/// Each line is played for this long, and then left alone until every command has ended.
const PLAYED: Micros = Micros::from_secs(60);
const LEFT_ALONE: Micros = Micros::from_secs(20);
/// Nothing is swapped until each module has answered and its fence was tried.
const SETTLED: Micros = Micros::from_secs(3);

impl Judge {
    pub(crate) fn new(seed: u64, lossy: bool, shows: bool) -> Judge {
        let mut dice = Dice(seed);
        let protocol = dice.pick(&[Protocol::Ascii, Protocol::Lc02, Protocol::Rtu]);
        let interval = dice.pick(&[50, 200, 200, 1000]);
        let loss = if lossy {
            dice.pick(&[10, 50, 100, 200])
        } else {
            0
        };
        let mut bus = Bus::new(Config {
            echo: dice.pick(&[EchoMode::Auto, EchoMode::Off]),
            ..Config::default()
        });
        let mut places = Vec::new();
        let mut engines = Vec::new();
        for nth in 0..dice.between(1, 3) as u8 {
            let address = nth + 1;
            let (right, other) = match protocol {
                Protocol::Rtu => (Family::Eda9060a, Family::Eda9060a),
                _ if dice.chance(300) => (Family::Eda9050, Family::Eda9060a),
                _ => (Family::Eda9060a, Family::Eda9050),
            };
            let setup = |family| Setup {
                protocol,
                ..Setup::new(family, Address(address))
            };
            let module = Module::new(setup(right)).expect("a possible module");
            let plan = Plan {
                interval: millis(interval),
                ..Plan::default()
            };
            bus.add(module.clone(), plan);
            let turnarounds = [(); 2].map(|()| millis(dice.pick(&[2, 5, 20, 60, 150])));
            for (family, who) in [(right, Who::Right), (other, Who::Other)] {
                let turnaround = turnarounds[who as usize];
                engines.push(engine(&setup(family), who, turnaround));
            }
            let is_swapped = nth == 0 || dice.chance(300);
            let who = if is_swapped && dice.chance(200) {
                Who::Other
            } else {
                Who::Right
            };
            places.push(Place {
                address,
                module,
                stays: vec![Stay {
                    who,
                    since: Instant(0),
                    missed: Some(Instant(0)),
                    first: None,
                    told: None,
                }],
                outputs: [vec![(Instant(0), MARK)], vec![(Instant(0), 0)]],
                asked: Instant(0),
                reached: Instant(0),
                unanswered: false,
                replies: Vec::new(),
                lost: Instant(0),
                presence: Presence::Unheard,
                is_late: turnarounds[0] > IN_TIME
                    || who == Who::Other && turnarounds[0] > turnarounds[1],
                read: Instant(0),
                swap_at: is_swapped.then(|| Instant(0) + SETTLED + dice.millis(0, 5000)),
            });
        }
        let pause = dice.pick(&[100, 300, 1500, 5000]);
        let wire = Rc::new(RefCell::new(Wire {
            dice: Dice(dice.next()),
            loss,
            in_place: places.iter().map(|place| place.stay().who).collect(),
            renames: protocol == Protocol::Rtu,
            heard: Vec::new(),
            lost: Vec::new(),
            spoilt: 0,
        }));
        let mut drive = Drive::new(bus);
        for engine in engines {
            drive.play(engine);
        }
        let of_drive = Rc::clone(&wire);
        drive.way = Some(Box::new(move |player, end, bytes| {
            of_drive.borrow_mut().carry(player, end, bytes)
        }));
        let about = format!(
            "{} modules, {protocol:?}, every {interval} ms, {loss} of 1000 lost",
            places.len()
        );
        Judge {
            dice,
            drive,
            wire,
            places,
            commands: BTreeMap::new(),
            lossy,
            pause,
            shows,
            about,
            faults: Vec::new(),
            tally: Tally::default(),
        }
    }

    /// Plays the line to its end.
    pub(crate) fn play(&mut self) {
        self.drive.input(Input::Opened);
        let end = Instant(0) + PLAYED;
        let mut command_at = Instant(0) + SETTLED;
        while self.drive.now < end && self.faults.is_empty() {
            let swaps = self.places.iter().filter_map(|place| place.swap_at);
            let next = swaps.chain([command_at, end]).min().unwrap_or(end);
            self.step_to(next);
            for place in 0..self.places.len() {
                if self.places[place].swap_at.is_some_and(|at| at <= next) {
                    self.swap(place);
                }
            }
            if command_at <= next {
                self.submit();
                command_at = self.drive.now + self.dice.millis(1, self.pause * 2);
            }
        }
        self.step_to(self.drive.now + LEFT_ALONE);
        if self.faults.is_empty() && !self.commands.is_empty() {
            let open = format!("never ended: {:?}", self.commands);
            self.fault(open);
        }
    }

    pub(crate) fn step_to(&mut self, until: Instant) {
        while self.faults.is_empty()
            && let Some(happening) = self.drive.step(until)
        {
            self.note_replies();
            self.note_outputs();
            match happening {
                Happening::Frame { bytes, end, .. } => self.request(&bytes, end),
                Happening::Heard(bytes) => self.show(|| format!("heard {}", text(&bytes))),
                Happening::Told(event) => self.told(event),
            }
            self.note_replies();
            self.look();
        }
    }

    /// Records what the wire let through.
    pub(crate) fn note_replies(&mut self) {
        for index in std::mem::take(&mut self.wire.borrow_mut().lost) {
            self.places[index].lost = self.drive.now;
            self.show(|| format!("lost of place {index}"));
        }
        for (player, end) in std::mem::take(&mut self.wire.borrow_mut().heard) {
            let place = &mut self.places[player / 2];
            let who = [Who::Right, Who::Other][player % 2];
            place.unanswered = false;
            place.replies.push((who, end));
            let stay = place.stays.last_mut().expect("one at least");
            stay.first.get_or_insert(end);
        }
    }

    /// Removes one module, or installs the next.
    pub(crate) fn swap(&mut self, index: usize) {
        let now = self.drive.now;
        let (dice, place) = (&mut self.dice, &mut self.places[index]);
        let before = place.stay();
        let (who, lasts) = match before.who {
            Who::Nobody => {
                // With a probability of one third the previous module comes back.
                let other = place.stay_at(Instant(before.since.0 - 1)).who == Who::Right;
                let who = match other != dice.chance(333) {
                    true => Who::Other,
                    false => Who::Right,
                };
                let longest = dice.pick(&[1000, 4000, 15_000]);
                (who, dice.millis(200, longest))
            }
            _ => {
                let longest = dice.pick(&[300, 1000, 5000]);
                (Who::Nobody, dice.millis(100, longest))
            }
        };
        let missed = match (before.who, who) {
            // The right one has not been read yet.
            (_, Who::Right) | (Who::Right, _) => None,
            _ => before.missed,
        };
        if who == Who::Right {
            place.unanswered = false;
        }
        place.stays.push(Stay {
            who,
            since: now,
            missed,
            first: None,
            told: None,
        });
        place.swap_at = Some(now + lasts);
        self.wire.borrow_mut().in_place[index] = who;
        self.tally.swaps += 1;
        self.show(|| format!("### place {index}: {who:?}"));
    }

    pub(crate) fn submit(&mut self) {
        let (now, dice) = (self.drive.now, &mut self.dice);
        let index = dice.between(0, self.places.len() as u64 - 1) as usize;
        let is_write = |command: &Command| matches!(command.op, Op::Write(_));
        // Two identical writes could not be told apart on the wire.
        let writes = self.commands.values().filter(|command| is_write(command));
        let is_free = !writes.into_iter().any(|command| command.place == index);
        let op = match dice.between(0, 7) {
            0 => Op::ReadOutputs,
            1 => Op::Identify,
            _ if !is_free => return,
            _ => Op::Write(Bank::new(
                dice.between(1, 7) as u32,
                dice.between(0, 7) as u32,
            )),
        };
        let terms = Terms {
            verify: dice.chance(600),
            expires: None,
        };
        let taken = self.drive.bus.submit(now, ModuleId(index), op, terms);
        self.drive.touched();
        self.show(|| format!("submit {index} {op:?} {terms:?}: {taken:?}"));
        match taken {
            Ok(ticket) => {
                let command = Command {
                    place: index,
                    op,
                    submitted: now,
                    heard: false,
                    acted: false,
                    taken: false,
                };
                self.commands.insert(ticket, command);
            }
            Err(Fault::OtherModel { .. }) => self.refused(index),
            Err(fault) => self.fault(format!("place {index}: {op:?} not taken: {fault:?}")),
        }
    }

    /// A frame is sent, and reaches the modules present.
    pub(crate) fn request(&mut self, bytes: &[u8], end: Instant) {
        self.show(|| format!("asks {}", text(bytes)));
        let asked = self.drive.now;
        let protocol = self.places[0].module.setup().protocol;
        let address = match protocol {
            Protocol::Ascii => {
                let digits = std::str::from_utf8(&bytes[1..3]).expect("digits");
                u8::from_str_radix(digits, 16).expect("digits")
            }
            Protocol::Lc02 => bytes[2],
            _ => bytes[0],
        };
        let writes = match protocol {
            Protocol::Ascii => bytes[0] == b'#' && bytes.len() > 6,
            Protocol::Lc02 => !matches!(bytes[3], 1 | 3 | 6),
            _ => matches!(bytes[1], 5 | 6 | 15 | 16),
        };
        let found = self
            .places
            .iter()
            .position(|place| place.address == address);
        let index = found.expect("an address of the line");
        let place = &mut self.places[index];
        let is_missed = std::mem::replace(&mut place.unanswered, true);
        place.asked = asked;
        let stay = place.stays.last_mut().expect("one at least");
        if is_missed {
            stay.missed.get_or_insert(asked);
        }
        if stay.who == Who::Nobody {
            return;
        }
        let mut wire = self.wire.borrow_mut();
        if self.dice.chance(wire.loss) {
            wire.lost.push(index);
            return;
        }
        drop(wire);
        let player = index * 2 + stay.who as usize;
        place.reached = end;
        self.drive.ask_player(player, end, bytes);
        let is_right = stay.who == Who::Right;
        let outputs = self.drive.players[player].engine.outputs();
        for command in self.commands.values_mut() {
            if let Op::Write(want) = command.op
                && command.place == index
                && writes
            {
                command.heard = true;
                command.taken |= is_right && outputs & want.mask == want.on;
            }
        }
        self.note_outputs();
    }

    /// Records which outputs have changed: over Modbus they do when silence has ended the request,
    /// some milliseconds after it.
    pub(crate) fn note_outputs(&mut self) {
        for (player, is) in self.drive.players.iter().enumerate() {
            let (index, who) = (player / 2, player % 2);
            let place = &mut self.places[index];
            let outputs = is.engine.outputs();
            let known = &mut place.outputs[who];
            if known.last().is_some_and(|(_, before)| *before == outputs) {
                continue;
            }
            known.push((place.reached, outputs));
            for command in self.commands.values_mut() {
                if let Op::Write(want) = command.op
                    && command.place == index
                {
                    command.acted = true;
                    command.taken |= who == 0 && outputs & want.mask == want.on;
                }
            }
        }
    }
}

fn text(bytes: &[u8]) -> String {
    match bytes.iter().all(u8::is_ascii_graphic) || bytes.ends_with(b"\r") {
        true => format!("{}", bytes.escape_ascii()),
        false => format!("{bytes:02X?}"),
    }
}
