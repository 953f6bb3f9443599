//! More events at once than a line keeps: what was lost is published again.

mod support;

use railbus_host::{
    Event, Family, Line, LineEvent, LineState, Medium, ModuleId, Plan, Port, PortError, Presence,
    Protocol, SerialSettings,
};
use railbus_wire::{Micros, crc16};
use std::io;
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll, Waker};
use support::{module, setup, soon};
use tokio::sync::mpsc;

/// More than the events that a line keeps for its driver.
const MODULES: usize = 600;

/// A port with modules that answer at once that all is off, until it is unplugged.
#[derive(Clone, Default)]
struct Crowd(Arc<Mutex<State>>);

#[derive(Default)]
struct State {
    reply: Vec<u8>,
    reader: Option<Waker>,
    is_due: bool,
    is_gone: bool,
}

impl Crowd {
    fn unplug(&self) {
        let mut state = self.0.lock().expect("a lock");
        state.is_gone = true;
        if let Some(reader) = state.reader.take() {
            reader.wake();
        }
    }
}

impl Port for Crowd {
    fn name(&self) -> String {
        "crowd".to_owned()
    }

    fn medium(&self) -> Medium {
        Medium::Buffered
    }

    async fn open(&mut self) -> Result<(), PortError> {
        let is_gone = self.0.lock().expect("a lock").is_gone;
        if is_gone {
            Err(PortError::Missing)
        } else {
            Ok(())
        }
    }

    fn poll_read(&mut self, cx: &mut Context<'_>, buffer: &mut [u8]) -> Poll<io::Result<usize>> {
        let mut state = self.0.lock().expect("a lock");
        if state.is_gone {
            return Poll::Ready(Err(io::ErrorKind::UnexpectedEof.into()));
        }
        if state.reply.is_empty() {
            state.reader = Some(cx.waker().clone());
            return Poll::Pending;
        }
        // Others have their turn before each reply.
        state.is_due = !state.is_due;
        if state.is_due {
            cx.waker().wake_by_ref();
            return Poll::Pending;
        }
        let reply = std::mem::take(&mut state.reply);
        buffer[..reply.len()].copy_from_slice(&reply);
        Poll::Ready(Ok(reply.len()))
    }

    fn send(&mut self, bytes: &[u8], _: SerialSettings) -> io::Result<()> {
        let count = bytes[5].div_ceil(8);
        let mut reply = vec![bytes[0], bytes[1], count];
        reply.extend(std::iter::repeat_n(0, count.into()));
        reply.extend(crc16(&reply).to_le_bytes());
        let mut state = self.0.lock().expect("a lock");
        state.reply = reply;
        if let Some(reader) = state.reader.take() {
            reader.wake();
        }
        Ok(())
    }

    fn close(&mut self) {}
}

#[tokio::test]
async fn presence_lost_in_an_overflow_is_published_again() {
    let port = Crowd::default();
    let plan = Plan {
        interval: Micros::ZERO,
        ..Plan::default()
    };
    let modules = (0..MODULES).map(|number| {
        let mut board = setup(Family::Erc8, (number % 32) as u8 + 1, Protocol::Rtu);
        board.gap = Some(Micros::ZERO);
        (module(&board), plan)
    });
    let bus = railbus_host::Config {
        settle: Micros::ZERO,
        echo: railbus_host::EchoMode::Off,
        probation: 0,
        fences: false,
        identify: false,
        ..railbus_host::Config::default()
    };
    let (events, mut published) = mpsc::unbounded_channel();
    let observer = move |all: &[LineEvent]| {
        for event in all {
            let _ = events.send(event.clone());
        }
    };
    let line = Line::over(
        port.clone(),
        bus,
        modules.collect(),
        Some(Box::new(observer)),
    );
    let line = line.expect("a line");

    let mut presence = vec![Presence::Unheard; MODULES];
    let mut note = |event: &LineEvent| {
        if let LineEvent::Bus(Event::Presence {
            module,
            presence: is,
        }) = event
        {
            presence[module.0] = *is;
        }
        presence
            .iter()
            .filter(|is| **is == Presence::Online)
            .count()
    };
    soon(async { while note(&published.recv().await.expect("an event")) < MODULES {} }).await;
    port.unplug();
    let mut lost = 0;
    soon(async {
        loop {
            let event = published.recv().await.expect("an event");
            note(&event);
            match event {
                LineEvent::Bus(Event::Overflow { lost: count }) => lost += count,
                LineEvent::State(LineState::Absent(_)) => break,
                _ => {}
            }
        }
    })
    .await;
    assert!(lost > 0, "nothing was lost");
    let silent = |id: usize| presence[id] == Presence::Silent;
    let missed: Vec<ModuleId> = (0..MODULES)
        .filter(|id| !silent(*id))
        .map(ModuleId)
        .collect();
    assert!(missed.is_empty(), "still online: {missed:?}");
    soon(line.close()).await;
}
