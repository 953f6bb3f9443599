//! The loop around the engine, common to all boards.

use crate::{Heard, Sensed, What};
use railbus_device::{Eeprom, Effect, Engine, Input, Output, SetupError};
use railbus_nvm::Record;
use railbus_wire::{Instant, Micros, SerialSettings};

/// Inputs are read when a frame begins, unless that was done less than this ago: they are only
/// needed for answers, so a silent line costs nothing.
const SENSED_FOR: Micros = Micros::from_millis(5);

/// How much longer than its characters take a reply may take to send. After that the transmitter
/// has stalled, and the line is released.
const STALL: Micros = Micros::from_millis(200);

/// What a board provides for its module.
pub trait Board {
    /// The time since start-up. It never goes back.
    fn now(&self) -> Instant;
    /// Takes the oldest character received.
    fn hear(&mut self) -> Option<Heard>;
    /// When the oldest character that [`Board::hear`] holds back will have ended. Boards whose UART
    /// has the pace of the line hold none back.
    fn heard_at(&self) -> Option<Instant> {
        None
    }
    /// Takes the line and sends these bytes.
    fn transmit(&mut self, bytes: &[u8]);
    /// When the last byte to send went into the shift register; nothing before that.
    fn drained(&self) -> Option<Instant>;
    /// Releases the line and listens. Unsent bytes are dropped.
    fn listen(&mut self);
    /// Uses this speed and format from now on.
    fn retune(&mut self, serial: SerialSettings);
    /// Lights the LED, or not.
    fn light(&mut self, lit: bool);
    /// Sets the outputs: bit n = output n is on.
    fn drive(&mut self, outputs: u32);
    /// Reads the inputs.
    fn sense(&mut self) -> Sensed;
    /// Stores the settings. The reply that confirms them is sent after this.
    fn save(&mut self, settings: &Eeprom);
}

/// Counters since start-up; they wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Characters received.
    pub heard: u32,
    /// Of these, characters with a wrong stop bit or parity.
    pub bad: u32,
    /// Characters lost, as they were not taken in time.
    pub lost: u32,
    /// Replies sent.
    pub replies: u32,
    /// Replies given up because the transmitter did not send.
    pub stalled: u32,
}

/// Who may send on the line.
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
    /// The latest time that was passed to the engine.
    told: Instant,
    sensed: Option<Instant>,
    counts: Counts,
}

impl Module {
    /// A module that is powered up now, with these settings.
    ///
    /// # Errors
    /// If no module can have them.
    // Frees the stack that creating one needs before the module runs.
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

    /// Initializes the board: outputs off, inputs read, listening as the settings say.
    pub fn start(&mut self, board: &mut impl Board) {
        board.drive(self.engine.outputs());
        board.retune(self.engine.active().serial);
        board.listen();
        self.sense(self.told, board);
        self.drain(board);
    }

    /// Does everything that is due. Returns when to call again, unless something happens before.
    pub fn step(&mut self, board: &mut impl Board) -> Option<Instant> {
        // Read before the characters are: everything received until now is passed on first, so that
        // no silence is assumed during which there was traffic.
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

    /// Reads the inputs for the engine. What a board can't read stays as it was.
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

    /// Releases the line when the last stop bit has left, or when the transmitter has stalled.
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
