//! The judge: what was told is so, what was obeyed was asked of that board, and in the end every
//! output of every board is as its last owner wanted.

use super::*;
use railbus_device::Bank;
use railbus_store::history::Event;

/// The board that a configuration has a name for.
fn seat(config: &Config, module: &str) -> Option<Seat> {
    let module = config.modules.get(module)?;
    Some((layout::port(&module.line), module.setup.address.0))
}

/// How much of the last things is shown.
fn trace_len() -> usize {
    let length = std::env::var("RAILBUS_TRACE").ok();
    length.and_then(|length| length.parse().ok()).unwrap_or(40)
}

impl Soak {
    /// The boards that had a name at some time.
    fn had_name(&self, module: &str, time: Micros) -> Vec<Seat> {
        let named = &self.world.named;
        let until = named.iter().skip(1).map(|(at, _)| *at);
        let until = until.chain([Micros(u64::MAX)]);
        let spans = named.iter().zip(until);
        let then = spans.filter(|((from, _), until)| *from <= time && time <= *until);
        let configs = then.map(|((_, config), _)| config);
        configs.filter_map(|config| seat(config, module)).collect()
    }

    /// Of ends that were reported as dropped nothing is expected; and what a rule does is told.
    pub(super) fn take_events(&mut self) {
        for event in std::mem::take(&mut self.world.events) {
            if event.who.is_some() {
                self.take_act(&event);
                continue;
            }
            let (Some("end_dropped"), Some(line), Some(text)) =
                (event.code.as_deref(), event.line, event.text)
            else {
                continue;
            };
            let numbers = text.split(|c: char| !c.is_ascii_digit());
            let numbers: Vec<u8> = numbers.filter_map(|word| word.parse().ok()).collect();
            let relay = ((layout::port(&line), numbers[0]), numbers[1]);
            let any = Expected::only(false, true).or(true, true);
            self.expected.insert(relay, any);
            self.dropped.push((self.world.now, text));
        }
    }

    /// The rule acts, or has failed at something, or has ended.
    fn take_act(&mut self, event: &Event) {
        let gate = (at("gate", 2), Asked::Write(true));
        let oven = (at("oven", 6), Asked::Write(false));
        match (event.code.as_deref(), &mut self.act) {
            (Some("rule_fired"), act) => {
                assert!(act.is_none(), "it acts twice at once");
                let (_, number, _) = self.begin(vec![gate, oven], false);
                self.orders -= 1;
                self.commands[number].who = event.who.clone().unwrap();
                self.act = Some((number, BTreeMap::new()));
            }
            (Some("rule_failed"), Some((_, failed))) if event.text.as_deref() != Some("busy") => {
                let acted = ["no_reply", "unknown", "not_verified", "not_taken_over"];
                let told = match acted.contains(&event.end.as_deref().unwrap()) {
                    true => Told::Perhaps,
                    false => Told::AsItWas,
                };
                failed.insert(event.what.clone().unwrap(), told);
            }
            (Some("notify"), Some((number, failed))) => {
                let told = |what: &str, is| failed.get(what).copied().unwrap_or(Told::Is(is));
                let ends = vec![told("gate.k2=on", true), told("oven.k6=off", false)];
                self.tolds.lock().unwrap().push((*number, ends));
                (self.act, self.acts) = (None, self.acts + 1);
            }
            _ => {}
        }
    }

    /// Whether an entry of the audit log is of this command. A rule has many with its name, one
    /// after the other.
    fn is_of(&self, number: usize, entry: &Logged) -> bool {
        let Command {
            who, began, ended, ..
        } = &self.commands[number];
        entry.who == *who && *began <= entry.began && ended.is_none_or(|end| entry.began < end)
    }

    pub(super) fn expected(&self, relay: &Relay) -> Expected {
        let known = self.expected.get(relay).copied();
        known.unwrap_or(Expected::only(false, false))
    }

    /// The outputs that a part of a command was for: of the board that it was asked of, or of that
    /// which had the name when its step began.
    pub(super) fn relays_of(&self, number: usize, place: &Place) -> BTreeSet<Relay> {
        let command = &self.commands[number];
        let asked = command.asked.iter().find(|(at, ..)| at == place);
        let asked = asked.map(|(_, seat, _)| seat.clone());
        let output = place.point.index + 1;
        let obeyed = self.obeyed(number, place);
        let seats: BTreeSet<Seat> = match obeyed.is_empty() || command.is_single {
            true => asked.into_iter().collect(),
            false => obeyed.into_iter().map(|(seat, _)| seat).collect(),
        };
        seats.into_iter().map(|seat| (seat, output)).collect()
    }

    /// The frames of a part of a command that were obeyed, the newest first.
    fn obeyed(&self, number: usize, place: &Place) -> Vec<(Seat, bool)> {
        let entries = self.world.log.iter().rev().take(400);
        let entries: Vec<_> = entries.filter(|e| self.is_of(number, e)).collect();
        let mask = bit(place.point.index + 1);
        let obeyed = self.world.acted.iter().rev().take(400).filter(|acted| {
            let is_of = acted.module == place.module && acted.set.mask & mask != 0;
            is_of
                && entries.iter().any(|entry| {
                    let end = entry.ended.map_or(self.world.now, |(at, _)| at);
                    entry.module == acted.module
                        && names(entry, place.point.index + 1)
                        && entry.began < acted.at
                        && acted.at <= end
                })
        });
        let obeyed = obeyed.map(|acted| (acted.seat.clone(), acted.set.on & mask != 0));
        obeyed.collect()
    }

    /// Takes in what was told, in the order in which it was.
    pub(super) fn hear(&mut self) -> Result<(), String> {
        let now = self.world.now;
        let tolds = std::mem::take(&mut *self.tolds.lock().unwrap());
        for (number, ends) in tolds {
            self.commands[number].ended = Some(now);
            let asked = self.commands[number].asked.clone();
            for ((place, _, asked), told) in asked.into_iter().zip(ends) {
                self.judge_end(number, &place, told)?;
                if matches!(told, Told::AsItWas | Told::Undone) {
                    continue;
                }
                // A part of a batch ends before the batch, and another command may come between.
                let at = self.ended(number, &place).unwrap_or(now);
                for relay in self.relays_of(number, &place) {
                    let (owner, is_sure) = self.owner_at.entry(relay.clone()).or_default();
                    if *owner <= at {
                        (*owner, *is_sure) = (at, told != Told::Perhaps);
                        self.expect(&relay, asked, told);
                    } else if !*is_sure {
                        // What came after it may have done nothing.
                        let expected = self.expected(&relay);
                        let expected = match (told, asked) {
                            (Told::Is(state), _) | (Told::Perhaps, Asked::Write(state)) => {
                                expected.or(state, false)
                            }
                            (Told::Perhaps, _) => expected.or(true, false).or(false, false),
                            _ => expected,
                        };
                        self.expected.insert(relay, expected);
                    }
                }
            }
        }
        Ok(())
    }

    /// When the last command to an output ended that was a part of this one, if it was one of
    /// several.
    fn ended(&self, number: usize, place: &Place) -> Option<Micros> {
        let command = &self.commands[number];
        if command.holds_all {
            return None;
        }
        let entries = self.world.log.iter().rev().take(400);
        let output = place.point.index + 1;
        let entries = entries.filter(|e| self.is_of(number, e) && e.module == place.module);
        let entries = entries.filter(|entry| names(entry, output));
        // The log may have its end only after the caller.
        let ends = entries.map(|entry| entry.ended.map_or(self.world.now, |(at, _)| at));
        ends.max()
    }

    fn expect(&mut self, relay: &Relay, asked: Asked, told: Told) {
        let before = self.expected(relay);
        let expected = match (told, asked) {
            (Told::AsItWas | Told::Undone, _) => return,
            (Told::Is(state), _) => Expected::only(state, false),
            (Told::Goes(state), _) => Expected::only(state, true),
            (Told::Perhaps, Asked::Write(on)) => before.or(on, false),
            (Told::Perhaps, Asked::Jog(on)) => before.or(!on, false),
            // Where nothing else is to be done to it, it is released all the same.
            (Told::Perhaps, Asked::Timed(on)) if !before.is_timed => Expected::only(!on, true),
            (Told::Perhaps, Asked::Timed(on)) => before.or(!on, true),
            (Told::Perhaps, Asked::Toggle) => before.or(true, false).or(false, false),
            (Told::Perhaps, Asked::EndLease) => before.or(true, true).or(false, true),
        };
        self.expected.insert(relay.clone(), expected);
    }

    /// What happened last, for whoever looks for the fault.
    pub(super) fn trace(&self) -> String {
        let mut lines = Vec::new();
        for entry in self.world.log.iter().rev().take(trace_len()) {
            lines.push((entry.began, format!("{entry:?}")));
        }
        for acted in self.world.acted.iter().rev().take(trace_len()) {
            lines.push((acted.at, format!("{acted:?}")));
        }
        for command in self.commands.iter().rev().take(trace_len()) {
            let (asked, ended) = (&command.asked, command.ended);
            let line = format!("{} {asked:?} to {ended:?}", command.who);
            lines.push((command.began, line));
        }
        for (at, config) in self.world.named.iter().rev().take(4) {
            let names = config.modules.keys().map(|name| (name, seat(config, name)));
            let names: Vec<_> = names.collect();
            lines.push((*at, format!("names {names:?}")));
        }
        let dropped = self.dropped.iter();
        lines.extend(dropped.map(|(at, text)| (*at, format!("dropped: {text}"))));
        lines.extend(self.killed.iter().map(|at| (*at, "killed".to_owned())));
        lines.sort();
        let lines = lines.into_iter();
        let lines = lines.map(|(at, line)| format!("{:>10} {line}\n", at.0 / 1_000));
        lines.collect()
    }

    /// What was told is so: a frame says it, or none was obeyed.
    fn judge_end(&self, number: usize, place: &Place, told: Told) -> Result<(), String> {
        let command = &self.commands[number];
        let obeyed = self.obeyed(number, place);
        let states: Vec<bool> = obeyed.into_iter().map(|(_, on)| on).collect();
        let is_held = command
            .asked
            .iter()
            .any(|(.., a)| matches!(a, Asked::Timed(_)));
        match told {
            Told::Is(state) if states.first() != Some(&state) => Err(format!(
                "{} was told that {place:?} is {state}, and its frames say {states:?}",
                command.who
            )),
            // Held already, it is not switched again.
            Told::Goes(state)
                if states.first() == Some(&state) || states.is_empty() && !is_held =>
            {
                Err(format!(
                    "{} was told that {place:?} goes {state}: {states:?}",
                    command.who
                ))
            }
            Told::AsItWas if !states.is_empty() => Err(format!(
                "{:?} was told that {place:?} is as it was, and was switched {states:?}",
                command.asked
            )),
            _ => Ok(()),
        }
    }

    /// What the modules obeyed since is written down, allowed, for that board, and not too late.
    pub(super) fn judge_frames(&mut self) -> Result<(), String> {
        let frames = self.world.acted[self.judged..].to_vec();
        self.judged = self.world.acted.len();
        for acted in frames {
            let mask = acted.set.mask;
            let open = |entry: &&Logged| {
                let end = entry.ended.map(|(at, _)| at);
                entry.module == acted.module
                    && entry.began <= acted.at
                    && end.is_none_or(|end| acted.at <= end)
            };
            // One that is tried again and again may have begun long before.
            let still = self.world.open.iter().map(|entry| &self.world.log[*entry]);
            let lately = self.world.log.iter().rev().take(200);
            let entries: Vec<_> = still.chain(lately).filter(open).collect();
            for number in (1..=8).filter(|number| mask & bit(*number) != 0) {
                let Some(entry) = entries.iter().find(|entry| names(entry, number)) else {
                    return Err(format!("nobody asked for {acted:?}"));
                };
                let mut numbers = (0..self.commands.len()).rev();
                let Some(number) = numbers.find(|number| self.is_of(*number, entry)) else {
                    continue;
                };
                let command = &self.commands[number];
                if !self
                    .had_name(&acted.module, entry.began)
                    .contains(&acted.seat)
                {
                    return Err(format!("{entry:?} was not for that board: {acted:?}"));
                }
                let mut seats = command.asked.iter().map(|(_, seat, _)| seat);
                let is_of_board = command.is_single || entry.who == "rule:watch";
                if is_of_board && !seats.any(|seat| *seat == acted.seat) {
                    return Err(format!("{entry:?} was asked of another board: {acted:?}"));
                }
                let late = |expires: Micros| acted.at > expires + ms(100);
                if command.expires.is_some_and(late) {
                    return Err(format!("{entry:?} was obeyed too late: {acted:?}"));
                }
            }
            if acted.module == "oven" {
                self.judge_oven(&acted)?;
            }
        }
        Ok(())
    }

    /// Interlock and pause. What a board was before it became the oven is not looked at.
    fn judge_oven(&mut self, acted: &Acted) -> Result<(), String> {
        let Bank { mask, on } = acted.set;
        let after = acted.before & !mask | on;
        if on & (bit(1) | bit(2)) != 0 && after & bit(1) != 0 && after & bit(2) != 0 {
            return Err(format!("both are on: {acted:?}"));
        }
        let (was, is) = (acted.before & bit(4) != 0, after & bit(4) != 0);
        match (was, is) {
            (true, false) => self.off_at = Some((acted.seat.clone(), acted.at)),
            (false, true) => {
                let off = self.off_at.as_ref();
                let off = off.filter(|(seat, _)| *seat == acted.seat);
                let since = off.map(|(_, off)| acted.at - *off);
                if since.is_some_and(|since| since < ms(5_000)) {
                    return Err(format!("k4 was off for {since:?} only: {acted:?}"));
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// It may have to go on when a lease ends, and must not while another one is.
    fn is_kept_off(&self, place: &Place) -> bool {
        let on = self.world.relays("oven");
        match (&*place.module, place.point.index + 1) {
            ("oven", 1) => on & bit(2) != 0,
            ("oven", 2) => on & bit(1) != 0,
            _ => false,
        }
    }

    /// All is quiet: nothing is left to be done, and every output is as its last owner wanted.
    pub(super) fn judge_rest(&mut self) -> Result<(), String> {
        if let Some(command) = self.commands.iter().find(|c| c.ended.is_none()) {
            return Err(format!("{} never ended", command.who));
        }
        if self.reloads.iter().any(|(_, end)| end.get().is_none()) {
            return Err("a reload never ended".to_owned());
        }
        let config = self.config();
        for line in config.lines.keys() {
            let now = &self.world.state().lines[line];
            if now.fault().is_some() || now.id.is_none() {
                return Err(format!("{line} did not come back: {now:?}"));
            }
        }
        let outputs = self.world.state().outputs().into_iter();
        for place in outputs.filter(|place| place.point.index < 6) {
            let left = self.world.state().left(&place.module, place.point);
            if !self.is_kept_off(&place) && left != crate::Left::default() {
                return Err(format!("{place:?} is never released: {left:?}"));
            }
        }
        let oven = self.world.seat_of("oven").unwrap();
        let named = self.world.named.iter();
        let mut ovens: BTreeSet<Seat> = named.filter_map(|(_, c)| seat(c, "oven")).collect();
        for _ in 0..self.moved.len() {
            for pair in &self.moved {
                if pair.iter().any(|seat| ovens.contains(seat)) {
                    ovens.extend(pair.iter().cloned());
                }
            }
        }
        let expected: Vec<_> = self.expected.iter().map(|(p, e)| (p.clone(), *e)).collect();
        for ((seat, number), expected) in expected {
            if seat == oven && self.is_kept_off(&at("oven", number)) {
                continue;
            }
            let is_on = self.world.relays_at(&seat.0, seat.1) & bit(number) != 0;
            let is_right = match number {
                3 if seat == oven => !is_on,
                // It was an oven's, and its limit or its policy may have switched it off.
                3 | 5 if ovens.contains(&seat) => !is_on || expected.may_be[1],
                _ => expected.may_be[usize::from(is_on)],
            };
            if !is_right {
                return Err(format!(
                    "{seat:?} {number} is {is_on} in the end: {expected:?}"
                ));
            }
        }
        // One that is tried for ever is open until it succeeds.
        let blocked = [1, 2]
            .iter()
            .any(|number| self.is_kept_off(&at("oven", *number)));
        if !blocked && !self.world.open.is_empty() {
            return Err(format!("{} entries are open", self.world.open.len()));
        }
        if !blocked && !self.world.state().is_at_rest() {
            return Err(format!("not at rest: {:?}", self.world.state()));
        }
        let wall = self.world.time().wall;
        // What only says how long something lasts leaves the disk with the next write.
        let is_over = |why: Why, promise: &Promise| match why {
            Why::MinOff => true,
            Why::OwnPulse => promise.at <= wall,
            _ => false,
        };
        let left = self.world.disk.iter();
        let left =
            left.filter(|(key, promise, _)| !is_over(key.1, promise) && !self.is_kept_off(&key.0));
        let left: Vec<_> = left.collect();
        match left.is_empty() {
            true => Ok(()),
            false => Err(format!("the disk still promises {left:?}")),
        }
    }
}
