//! The demo's modules as they behave: what is written can be read back, and inputs move.

use crate::responder::Modules;
use crate::scene::{Step, ask};
use railbus_device::{Eeprom, Module, Options, Setup};
use railbus_sim::{Act, Input, SlotId, VirtualLine, VirtualLineConfig, demo};
use railbus_wire::{Frame, Instant};
use std::collections::BTreeMap;
use std::time::Duration;

/// As in the demo: from the end of a request to the reply.
const TURNAROUND: Duration = Duration::from_millis(5);
/// The shortest interval between changes of inputs, and a variation of it that avoids beats.
const MOVES_EVERY: Duration = Duration::from_millis(400);
const MOVES_LATER: u32 = 97;

/// What one exchange was about.
#[derive(Clone, Copy, Debug)]
pub struct Said {
    /// The module.
    pub module: usize,
    /// One of the regular polls.
    pub is_poll: bool,
    /// The reply differed from the previous one to the same request.
    pub changed: bool,
}

/// One module, alone on a line in virtual time.
struct Member {
    setup: Setup,
    line: VirtualLine,
    id: SlotId,
    polls: Vec<Vec<u8>>,
    levels: u32,
}

/// The demo's modules.
pub struct Live {
    members: Vec<Member>,
    now: Instant,
    step: Step,
    replies: BTreeMap<Vec<u8>, Vec<u8>>,
    /// When the next input changes, and how many have; none if they do not change.
    moves: Option<(std::time::Instant, u32)>,
    /// What each answered exchange was about.
    pub said: Vec<Said>,
}

impl Live {
    /// All of them, powered up; inputs may move by themselves, one after the other.
    pub fn new(moving: bool) -> Result<Live, String> {
        let members = demo::modules().map(|(name, setup)| Member::new(name, setup));
        Ok(Live {
            members: members.into_iter().collect::<Result<_, _>>()?,
            now: Instant(1_000_000),
            step: Step {
                request: Vec::new(),
                reply: Vec::new(),
                gap: railbus_wire::Micros::ZERO,
            },
            replies: BTreeMap::new(),
            moves: moving.then(|| (std::time::Instant::now(), 0)),
            said: Vec::new(),
        })
    }

    /// Changes an input of one of the modules that have any, when it is due.
    fn move_inputs(&mut self) {
        let Some((at, count)) = &mut self.moves else {
            return;
        };
        if std::time::Instant::now() < *at {
            return;
        }
        *at += MOVES_EVERY + Duration::from_millis(u64::from(*count % MOVES_LATER));
        *count += 1;
        let mut able: Vec<_> = self
            .members
            .iter_mut()
            .filter(|m| m.setup.inputs > 0)
            .collect();
        let chosen = *count as usize % able.len().max(1);
        if let Some(member) = able.get_mut(chosen) {
            member.levels ^= 1;
            let act = Act::Levels(member.levels);
            member.line.handle(self.now, Input::Act(member.id, act));
        }
    }
}

impl Member {
    fn new(name: &str, setup: Setup) -> Result<Member, String> {
        let mut line = VirtualLine::new(VirtualLineConfig::default());
        let (eeprom, options) = (Eeprom::of(&setup), Options::default());
        let id = line.add(Instant(0), name, &setup, eeprom, options);
        let module = Module::new(setup).map_err(|why| why.to_string())?;
        let request = |op| {
            let mut frame = Frame::new();
            module.exchange(&op).ok()?.encode(&mut frame);
            Some(frame.bytes().to_vec())
        };
        Ok(Member {
            setup,
            line,
            id: id.map_err(|why| why.to_string())?,
            polls: module.full_poll().filter_map(request).collect(),
            levels: 0,
        })
    }
}

impl Modules for &mut Live {
    fn turnaround(&self) -> Duration {
        TURNAROUND
    }

    fn answer(&mut self, request: &[u8]) -> Option<&Step> {
        self.move_inputs();
        let mut answered = None;
        for (number, member) in self.members.iter_mut().enumerate() {
            let mut now = self.now;
            let reply = ask(&mut member.line, &mut now, request);
            if !reply.is_empty() {
                answered = Some((number, reply));
            }
        }
        self.now = self.now + railbus_wire::Micros::from_secs(1);
        let (module, reply) = answered?;
        let member = self.members.get(module)?;
        let before = self.replies.insert(request.to_vec(), reply.clone());
        self.said.push(Said {
            module,
            is_poll: member.polls.iter().any(|poll| poll == request),
            changed: before.is_some_and(|before| before != reply),
        });
        self.step = Step {
            request: request.to_vec(),
            reply,
            gap: member.setup.request_gap(),
        };
        Some(&self.step)
    }
}
