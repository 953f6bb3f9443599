//! Lines and the boards on them: who hears a frame is decided by port and address, whatever the
//! names are.

use super::*;
use railbus_device::Observation;
use railbus_host::{Confirmation, Done, Event as BusEvent, Evidence, Presence};
use railbus_wire::Instant;

/// Where a board is: port and address.
pub(in super::super) type Seat = (String, u8);

#[derive(Default)]
pub(super) struct Board {
    pub(super) relays: u32,
    is_dead: bool,
    welded: u32,
    /// Outputs that give pulses of a second.
    gives: u8,
    /// Counts what it has obeyed.
    obeyed: u64,
    /// When each output was written last, counted so.
    written: BTreeMap<u32, u64>,
}

/// An open line.
pub(super) struct Wire {
    name: String,
    port: String,
    slots: Vec<Option<Slot>>,
    /// Until when it is busy.
    busy: Micros,
    began: Micros,
    is_up: bool,
    is_closing: bool,
}

/// A module on its line.
struct Slot {
    name: String,
    address: u8,
    is_silent: bool,
}

/// Commands in progress get so long when a line is closed.
const CLOSING_MAX: Micros = ms(1_000);
/// A frame whose reply is lost is obeyed so long after it was sent.
const OBEYED_AFTER: Micros = ms(10);

impl World {
    /// A line is there, and has not looked for its port yet.
    pub(super) fn plug(&mut self, line: &str, id: LineId, config: &Config) {
        let slots = config.modules_of(line).map(|(name, module)| {
            Some(Slot {
                name: name.clone(),
                address: module.setup.address.0,
                is_silent: true,
            })
        });
        let wire = Wire {
            name: line.to_owned(),
            port: config.lines[line].port.clone(),
            slots: slots.collect(),
            busy: Micros::ZERO,
            began: self.now,
            is_up: false,
            is_closing: false,
        };
        let wires = self.lines.values();
        let mut same = wires.filter(|other| other.port == wire.port);
        assert!(same.next().is_none(), "{} is open already", wire.port);
        self.lines.insert(id, wire);
    }

    pub(super) fn opens(&mut self, line: &str, id: LineId, config: &Config) {
        if self.refuses_lines {
            let (now, refused) = (self.time(), Err(PortError::Refused));
            let core = self.core.as_mut().unwrap();
            return core.handle(now, Input::Opened(line, id, refused));
        }
        self.plug(line, id, config);
        let after = ms(self.dice.between(1, 20));
        self.add(after, Due::Finds(id));
        let now = self.time();
        let core = self.core.as_mut().unwrap();
        core.handle(now, Input::Opened(line, id, Ok(now.site)));
    }

    pub(super) fn finds(&mut self, line: LineId) {
        let Some(wire) = self.lines.get(&line) else {
            return;
        };
        match self.down.contains(&wire.port) {
            true => self.line_is(line, gone()),
            false => self.line_is(line, LineState::Up),
        }
    }

    /// A line takes no more commands. Its port is free once those in progress have ended.
    pub(super) fn closes(&mut self, id: LineId) {
        let Some(wire) = self.lines.get_mut(&id) else {
            return self.add(Micros::ZERO, Due::Closed(id));
        };
        wire.is_closing = true;
        let ends = self.now + CLOSING_MAX;
        let is_of = |due: &Due| matches!(due, Due::Ran(_, at, ..) if at.line == id);
        let running = self.due.iter().filter(|(_, due)| is_of(due));
        let last = running.map(|((at, _), _)| *at).max().unwrap_or(self.now);
        let after = last.min(ends) - self.now;
        self.add(after + ms(2) + self.port_hangs, Due::Closed(id));
    }

    pub(super) fn has_closed(&mut self, id: LineId) {
        self.cut(|at| at.line == id);
        if self.lines.contains_key(&id) {
            self.line_is(id, LineState::Closed);
            self.lines.remove(&id);
        }
        self.tell(Input::Closed(id));
    }

    pub(super) fn has_changed(&mut self, request: RequestId, id: LineId, change: ModuleChanges) {
        self.cut(|at| at.line == id && change.leave.contains(&at.module));
        let line = self.lines.get(&id).map(|wire| wire.name.clone());
        let line = line.unwrap_or_default();
        let names = self.state().lines.get(&line).map(|now| now.modules.clone());
        let names = names.unwrap_or_default();
        if let Some(wire) = self.lines.get_mut(&id) {
            for module in change.leave {
                wire.slots[module.0] = None;
            }
            for (module, _) in change.join {
                let name = names.get(wire.slots.len()).cloned().unwrap_or_default();
                wire.slots.push(Some(Slot {
                    name,
                    address: module.setup().address.0,
                    is_silent: true,
                }));
            }
        }
        self.tell(Input::Done(request, Reply::Changed));
    }

    /// What is under way to these is cut short: it may have been sent.
    fn cut(&mut self, of: impl Fn(At) -> bool) {
        let is_of = |_: &(Micros, u64), due: &mut Due| match due {
            Due::Ran(_, at, ..) | Due::Obeys(at, _) => of(*at),
            _ => false,
        };
        let cut: Vec<_> = self.due.extract_if(.., is_of).collect();
        for ((ends, _), due) in cut {
            let (at, op, request, may_act) = match due {
                Due::Ran(request, at, op, end, took) => {
                    // One whose reply is lost was sent, and may have been obeyed before.
                    let is_refused = matches!(end, Err(Fault::Closed | Fault::Expired));
                    let was_sent = !is_refused && ends - took < self.now;
                    (at, op, Some((request, was_sent)), was_sent && end.is_ok())
                }
                Due::Obeys(at, op) => (at, op, None, ends - OBEYED_AFTER < self.now),
                _ => continue,
            };
            if may_act && self.dice.one_in(2) {
                self.obey(at, &op);
            }
            if let Some((request, was_sent)) = request {
                let fault = match was_sent {
                    true => Fault::Unknown,
                    false => Fault::Closed,
                };
                self.tell(Input::Done(request, Reply::Ran(Err(fault))));
            }
        }
    }

    /// A line does one thing after the other.
    pub(super) fn run(&mut self, request: RequestId, at: At, op: Op, expires: Micros) {
        let now = self.now;
        let is_here = self.seat(at).is_some();
        let wire = self.lines.get(&at.line);
        let wire = wire.filter(|w| is_here && w.is_up && !w.is_closing);
        let Some(wire) = wire else {
            let end = Err(Fault::Closed);
            return self.add(ms(0), Due::Ran(request, at, op, end, ms(0)));
        };
        let free = wire.busy.max(now);
        if free > expires {
            let end = Err(Fault::Expired);
            return self.add(free - now, Due::Ran(request, at, op, end, ms(0)));
        }
        let is_dead = self.board_at(at).is_some_and(|board| board.is_dead);
        let lost = Fault::NoReply(Evidence::default());
        let (mut end, took) = match &op {
            _ if is_dead || self.dice.one_in(self.faults.request_lost) => (Err(lost), 100),
            _ if self.dice.one_in(self.faults.refused) => {
                (Err(Fault::Refused(railbus_host::Refusal::Invalid)), 20)
            }
            _ => (Ok(()), self.dice.between(20, 60)),
        };
        let acts = matches!(op, Op::Write(_) | Op::Jog { .. });
        if acts && end.is_ok() && self.dice.one_in(self.faults.reply_lost) {
            // It is obeyed all the same.
            self.add(free - now + OBEYED_AFTER, Due::Obeys(at, op));
            end = Err(lost);
        }
        let ends = free + ms(took);
        if let Some(wire) = self.lines.get_mut(&at.line) {
            wire.busy = ends;
        }
        self.add(ends - now, Due::Ran(request, at, op, end, ms(took)));
    }

    fn slot(&self, at: At) -> Option<&Slot> {
        let wire = self.lines.get(&at.line)?;
        wire.slots.get(at.module.0)?.as_ref()
    }

    fn seat(&self, at: At) -> Option<Seat> {
        let wire = self.lines.get(&at.line)?;
        Some((wire.port.clone(), self.slot(at)?.address))
    }

    fn board_at(&mut self, at: At) -> Option<&mut Board> {
        let seat = self.seat(at)?;
        Some(self.board(seat))
    }

    /// The board with an address on a port; there is one at each.
    pub(super) fn board(&mut self, seat: Seat) -> &mut Board {
        self.boards.entry(seat).or_default()
    }

    /// Where the board is that has this name by the configuration in force.
    pub(in super::super) fn seat_of(&self, module: &str) -> Option<Seat> {
        let config = match &self.core {
            Some(core) => Arc::clone(core.state.site.config()),
            None => Arc::new(lock(&self.file).clone()),
        };
        let module = config.modules.get(module)?;
        let port = config.lines[&module.line].port.clone();
        Some((port, module.setup.address.0))
    }

    fn board_of(&mut self, module: &str) -> &mut Board {
        let seat = self.seat_of(module).unwrap();
        self.board(seat)
    }

    pub(super) fn obey(&mut self, at: At, op: &Op) {
        let (now, seat) = (self.now, self.seat(at));
        let name = self.slot(at).map(|slot| slot.name.clone());
        let (bank, millis) = match op {
            Op::Write(bank) | Op::WriteSilent(bank) => (*bank, None),
            Op::Jog {
                channel,
                close,
                millis,
            } => (Bank::one(*channel, *close), Some(millis.get())),
            _ => return,
        };
        let (Some(seat), Some(module)) = (seat, name) else {
            return;
        };
        let board = self.board(seat.clone());
        board.obeyed += 1;
        let since = board.obeyed;
        for bit in (0..8)
            .map(|bit| 1 << bit)
            .filter(|bit| bank.mask & bit != 0)
        {
            board.written.insert(bit, since);
        }
        let before = board.relays;
        let moves = bank.mask & !board.welded;
        board.relays = before & !moves | bank.on & moves;
        let gives = u32::from(board.gives) & moves & bank.on;
        self.acted.push(Acted {
            at: now,
            module,
            seat: seat.clone(),
            set: bank,
            before,
        });
        for bit in (0..8).map(|bit| 1 << bit).filter(|bit| gives & bit != 0) {
            let ends = Due::Jogged(seat.clone(), bit, false, since);
            self.add(ms(1_000), ends);
        }
        if let Some(millis) = millis {
            let ends = Due::Jogged(seat, bank.mask, bank.on == 0, since);
            self.add(ms(u64::from(millis)), ends);
        }
    }

    pub(super) fn has_jogged(&mut self, seat: Seat, mask: u32, on: bool, since: u64) {
        let board = self.board(seat);
        if board.written.get(&mask) == Some(&since) {
            board.relays = board.relays & !mask | if on { mask } else { 0 };
        }
    }

    pub(super) fn ran(
        &mut self,
        request: RequestId,
        at: At,
        op: Op,
        end: Result<(), Fault>,
        took: Micros,
    ) {
        let end = end.and_then(|()| {
            self.obey(at, &op);
            let board = self.board_at(at).ok_or(Fault::Closed)?;
            let (relays, gives) = (board.relays, board.gives);
            let unread = match op {
                Op::WriteSilent(_) => Some(Confirmation::Sent),
                Op::Write(_) if self.only_acknowledged => Some(Confirmation::Reply),
                _ => None,
            };
            if let Some(confirmed) = unread {
                let seen = None;
                return Ok(Done {
                    confirmed,
                    took,
                    seen,
                });
            }
            let seen = match op {
                Op::ReadPulse => Observation::Pulse {
                    mask: gives,
                    width: railbus_wire::PulseWidth::DEFAULT,
                },
                _ => seen(relays),
            };
            self.saw(at, &op, seen);
            let confirmed = match op {
                Op::Write(bank) if relays & bank.mask != bank.on => return Err(Fault::NotVerified),
                _ => Confirmation::Readback,
            };
            Ok(Done {
                confirmed,
                took,
                seen: Some(seen),
            })
        });
        self.tell(Input::Done(request, Reply::Ran(end)));
    }

    /// A reading comes in that began then.
    pub(in super::super) fn reads(&mut self, module: &str, relays: u32, asked: Micros) {
        let at = self.state().at(module).unwrap();
        self.saw_since(at, &Op::ReadOutputs, seen(relays), asked);
    }

    pub(in super::super) fn saw(&mut self, at: At, op: &Op, seen: Observation) {
        self.saw_since(at, op, seen, self.now);
    }

    pub(in super::super) fn saw_since(
        &mut self,
        at: At,
        op: &Op,
        seen: Observation,
        asked: Micros,
    ) {
        let began = self.lines[&at.line].began;
        let time = |at: Micros| Instant(0) + (at - began);
        let event = LineEvent::Bus(BusEvent::Seen {
            module: at.module,
            op: *op,
            seen,
            asked: time(asked),
            heard: time(self.now),
        });
        self.line(at, &event);
    }

    pub(in super::super) fn line(&mut self, at: At, event: &LineEvent) {
        let line = self.lines[&at.line].name.clone();
        self.tell(Input::Line(at.line, &line, event));
    }

    /// Every module says how it is, if it can.
    pub(super) fn poll(&mut self) {
        let wires = self.lines.iter().filter(|(_, wire)| !wire.is_closing);
        let places = wires.flat_map(|(line, wire)| {
            (0..wire.slots.len()).map(|number| At {
                line: *line,
                module: ModuleId(number),
            })
        });
        for at in places.collect::<Vec<_>>() {
            let Some(seat) = self.seat(at) else {
                continue;
            };
            if self.down.contains(&seat.0) {
                continue;
            }
            let board = self.board(seat);
            let (relays, is_dead) = (board.relays, board.is_dead);
            let wire = self.lines.get_mut(&at.line);
            let slot = wire.and_then(|wire| wire.slots[at.module.0].as_mut());
            if slot.is_some_and(|slot| std::mem::replace(&mut slot.is_silent, is_dead) != is_dead) {
                let presence = match is_dead {
                    true => Presence::Silent,
                    false => Presence::Online,
                };
                let module = at.module;
                self.line(at, &LineEvent::Bus(BusEvent::Presence { module, presence }));
            }
            if !is_dead {
                self.saw(at, &Op::ReadOutputs, seen(relays));
            }
        }
    }

    /// The relays of a module, bit by bit.
    pub(in super::super) fn relays(&self, module: &str) -> u32 {
        let (port, address) = self.seat_of(module).unwrap();
        self.relays_at(&port, address)
    }

    /// The relays of a board, whatever its name is.
    pub(in super::super) fn relays_at(&self, port: &str, address: u8) -> u32 {
        let board = self.boards.get(&(port.to_owned(), address));
        board.map_or(0, |board| board.relays)
    }

    /// A port goes, or comes back. What is under way is cut short.
    pub(in super::super) fn unplug(&mut self, port: &str, is_gone: bool) {
        let wires = self.lines.iter();
        let of_port = wires.filter(|(_, wire)| wire.port == port && !wire.is_closing);
        let lines: Vec<LineId> = of_port.map(|(line, _)| *line).collect();
        if is_gone {
            self.down.insert(port.to_owned());
        } else {
            self.down.remove(port);
        }
        for line in lines {
            if is_gone {
                self.cut(|at| at.line == line);
            }
            self.finds(line);
        }
    }

    pub(super) fn line_is(&mut self, line: LineId, state: LineState) {
        if let Some(wire) = self.lines.get_mut(&line) {
            wire.is_up = state == LineState::Up;
        }
        let module = ModuleId(0);
        self.line(At { line, module }, &LineEvent::State(state));
    }

    /// The lines are busy for so long.
    pub(in super::super) fn hold_line(&mut self, time: Micros) {
        for wire in self.lines.values_mut() {
            wire.busy = self.now + time;
        }
    }

    /// The same of one port.
    pub(in super::super) fn hold_port(&mut self, port: &str, time: Micros) {
        let now = self.now;
        for wire in self.lines.values_mut().filter(|wire| wire.port == port) {
            wire.busy = now + time;
        }
    }

    /// Moves relays by hand.
    pub(in super::super) fn move_by_hand(&mut self, module: &str, relays: u32) {
        self.board_of(module).relays = relays;
    }

    /// Switches a module off its line, or on again.
    pub(in super::super) fn dead(&mut self, module: &str, is_dead: bool) {
        self.board_of(module).is_dead = is_dead;
    }

    /// The same of a board, whatever its name is.
    pub(in super::super) fn dead_at(&mut self, seat: &Seat, is_dead: bool) {
        self.board(seat.clone()).is_dead = is_dead;
    }

    /// Two boards of a line have each other's address from now on.
    pub(in super::super) fn move_board(&mut self, from: &Seat, to: &Seat) {
        let moved = std::mem::take(self.board(from.clone()));
        let other = std::mem::replace(self.board(to.clone()), moved);
        *self.board(from.clone()) = other;
    }

    /// Sets outputs to give pulses of a second.
    pub(in super::super) fn give_pulses(&mut self, module: &str, outputs: u8) {
        self.board_of(module).gives = outputs;
    }

    /// Welds relays as they are.
    pub(in super::super) fn weld(&mut self, module: &str, relays: u32) {
        self.board_of(module).welded = relays;
    }
}

fn gone() -> LineState {
    LineState::Absent(Arc::new(PortError::Gone))
}

fn seen(relays: u32) -> Observation {
    Observation::Channels {
        outputs: Bank::new(0xFF, relays),
        inputs: Bank::default(),
    }
}
