//! The loop around the engine: what boards do alike.

use crate::{Heard, Sensed, What};
use railbus_device::{Eeprom, Effect, Engine, Input, Output, SetupError};
use railbus_nvm::Record;
use railbus_wire::{Instant, Micros, Settings};

/// Inputs are read when a frame begins, unless they were so lately: they are only ever looked
/// at to answer somebody, so that a silent line costs nothing.
const SENSED_FOR: Micros = Micros::from_millis(5);

/// How much longer than its characters take a reply may be under way. Then the transmitter has
/// stalled, and the line belongs to the others again.
const STALL: Micros = Micros::from_millis(200);

/// What a board does for the module on it.
pub trait Board {
    /// The time since it was started. It never runs backwards.
    fn now(&self) -> Instant;
    /// The oldest character heard and not taken yet.
    fn hear(&mut self) -> Option<Heard>;
    /// When the oldest one will have ended that [`Board::hear`] holds back until then. Boards
    /// whose UART has the pace of the line hold none back.
    fn heard_at(&self) -> Option<Instant> {
        None
    }
    /// Takes the line and sends these bytes.
    fn transmit(&mut self, bytes: &[u8]);
    /// When the last byte to send went into the shift register; nothing before that.
    fn drained(&self) -> Option<Instant>;
    /// Lets go of the line and listens. What was not sent is forgotten.
    fn listen(&mut self);
    /// Talks and listens this way from now on.
    fn retune(&mut self, serial: Settings);
    /// Lights the LED, or not.
    fn light(&mut self, lit: bool);
    /// Brings the outputs into these states: bit n = output n is on.
    fn drive(&mut self, outputs: u32);
    /// What lies at the inputs now.
    fn sense(&mut self) -> Sensed;
    /// Keeps the settings. The reply that says so leaves after this.
    fn save(&mut self, settings: &Eeprom);
}

/// What happened since the start; each number begins anew after the last there is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Characters heard.
    pub heard: u32,
    /// Of these, characters with a wrong stop bit or parity.
    pub bad: u32,
    /// Characters lost, as nobody took them in time.
    pub lost: u32,
    /// Replies sent.
    pub replies: u32,
    /// Replies given up, since the transmitter did not send.
    pub stalled: u32,
}

/// Whose turn it is on the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Turn {
    /// The others'.
    Others,
    /// Ours, until then at the latest.
    Ours { give_up: Instant },
    /// Ours for as long as the last character takes.
    Ending { at: Instant },
}

/// A module on its board.
#[derive(Debug)]
pub struct Module {
    engine: Engine,
    deadline: Option<Instant>,
    turn: Turn,
    /// The latest time that the engine was told.
    told: Instant,
    sensed: Option<Instant>,
    counts: Counts,
}

impl Module {
    /// A module that is powered up now and keeps this.
    ///
    /// # Errors
    /// Where no module can be as described.
    // What it takes of the stack to make one is given back before the module runs.
    #[inline(never)]
    pub fn new(kept: &Record, now: Instant) -> Result<Module, SetupError> {
        Ok(Module {
            engine: Engine::new(kept.setup(), kept.eeprom(), kept.options(), now)?,
            deadline: None,
            turn: Turn::Others,
            told: now,
            sensed: None,
            counts: Counts::default(),
        })
    }

    /// Takes the board into use: outputs off, inputs read, listening as the settings say.
    pub fn start(&mut self, board: &mut impl Board) {
        board.drive(self.engine.outputs());
        board.retune(self.engine.active().serial);
        board.listen();
        self.sense(self.told, board);
        self.drain(board);
    }

    /// Does all that is to be done now. When to come again, unless something happens before.
    pub fn step(&mut self, board: &mut impl Board) -> Option<Instant> {
        // Read before the characters are: what was heard until now is told first, so that no
        // silence is believed in which somebody spoke.
        let now = board.now();
        while self.turn == Turn::Others
            && let Some(heard) = board.hear()
        {
            self.hear(heard, board);
        }
        self.take_turns(now, board);
        if self.deadline.is_some_and(|at| at <= now) {
            self.tell(now, Input::Timeout, board);
        }
        let turn = match self.turn {
            Turn::Others => board.heard_at(),
            Turn::Ours { give_up: at } | Turn::Ending { at } => Some(at),
        };
        Instant::earliest(&[turn, self.deadline])
    }

    /// The module itself.
    #[must_use]
    pub const fn engine(&self) -> &Engine {
        &self.engine
    }

    /// What happened since the start.
    #[must_use]
    pub const fn counts(&self) -> Counts {
        self.counts
    }

    fn hear(&mut self, heard: Heard, board: &mut impl Board) {
        count(&mut self.counts.heard);
        if self
            .sensed
            .is_none_or(|at| heard.at.since(at) >= SENSED_FOR)
        {
            self.sense(heard.at, board);
        }
        match heard.what {
            What::Byte(byte) => self.tell(heard.at, Input::Bytes(&[byte]), board),
            What::Bad => {
                count(&mut self.counts.bad);
                self.tell(heard.at, Input::BadByte, board);
            }
            What::Lost => {
                count(&mut self.counts.lost);
                self.tell(heard.at, Input::Overrun, board);
            }
        }
    }

    /// Reads the inputs and tells the engine. What a board does not know stays as it was.
    fn sense(&mut self, at: Instant, board: &mut impl Board) {
        let sensed = board.sense();
        self.sensed = Some(at);
        self.engine.handle(at, Input::Stuck(sensed.stuck));
        if let Some(panel) = sensed.panel {
            self.engine.handle(at, Input::Levels(panel.levels));
            self.engine.handle(at, Input::Init(panel.init_grounded));
            self.engine.handle(at, Input::Dip(panel.dip));
        }
        for (channel, value) in (0..).zip(sensed.analogs) {
            if let Some(value) = value {
                self.engine.handle(at, Input::Analog(channel, value));
            }
        }
    }

    /// Lets go of the line when the last stop bit has left, or when nothing leaves.
    fn take_turns(&mut self, now: Instant, board: &mut impl Board) {
        if let Turn::Ours { give_up } = self.turn {
            if let Some(drained) = board.drained() {
                let at = drained + self.engine.active().serial.frame_time(1);
                self.turn = Turn::Ending { at };
            } else if give_up <= now {
                count(&mut self.counts.stalled);
                self.turn = Turn::Ending { at: now };
            }
        }
        if let Turn::Ending { at } = self.turn
            && at <= now
        {
            self.turn = Turn::Others;
            board.listen();
            self.tell(now, Input::Sent, board);
        }
    }

    fn tell(&mut self, at: Instant, input: Input<'_>, board: &mut impl Board) {
        self.told = self.told.max(at);
        self.engine.handle(self.told, input);
        self.drain(board);
    }

    fn drain(&mut self, board: &mut impl Board) {
        loop {
            match self.engine.poll() {
                Output::Effect(Effect::Output { .. }) => board.drive(self.engine.outputs()),
                Output::Effect(Effect::Led(lit)) => board.light(lit),
                Output::Effect(Effect::Serial(serial)) => board.retune(serial),
                Output::Effect(Effect::Save(settings)) => {
                    board.save(&settings);
                }
                Output::Transmit(bytes) => {
                    let characters = bytes.len();
                    board.transmit(bytes);
                    let takes = self.engine.active().serial.frame_time(characters);
                    let give_up = board.now() + takes + takes + STALL;
                    self.turn = Turn::Ours { give_up };
                    count(&mut self.counts.replies);
                }
                Output::Wait(deadline) => {
                    self.deadline = deadline;
                    return;
                }
            }
        }
    }
}

const fn count(counter: &mut u32) {
    *counter = counter.wrapping_add(1);
}
