//! The events of a line, for all its subscribers.

use crate::line::{Done, RunId};
use crate::{Granted, PortError};
use railbus_bus::{Event, Fault};
use std::fmt;
use std::sync::Arc;
use tokio::sync::{broadcast, watch};

/// How many events wait for a receiver before the oldest are dropped.
const EVENTS_MAX: usize = 256;

/// The state of a line's port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LineState {
    /// It is being opened for the first time.
    Opening,
    /// It is open.
    Up,
    /// It can't be opened, or was lost. The line keeps trying to open it.
    Absent(Arc<PortError>),
    /// The line was closed for good.
    Closed,
}

/// Something that happened on a line, or to its port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LineEvent {
    /// Its port changed.
    State(LineState),
    /// An event of its state machine.
    Bus(Event),
    /// An op handed in by [`crate::Line::submit`] ended; only the observer gets this.
    Ended(RunId, Result<Done, Fault>),
    /// This receiver was too slow and lost this many events before the next one.
    Lagged(u64),
}

/// Called in the line's task with all events of a wake-up at once, in their order, before receivers
/// get them and before a caller gets its result: what it stores is in place when a command ends. It
/// must not block.
pub type Observer = Box<dyn FnMut(&[LineEvent]) + Send>;

/// A receiver of a line's events from its creation on.
#[derive(Debug)]
pub struct LineEvents(Option<broadcast::Receiver<LineEvent>>);

impl LineEvents {
    pub(crate) fn of(line: &broadcast::WeakSender<LineEvent>) -> LineEvents {
        LineEvents(line.upgrade().map(|sender| sender.subscribe()))
    }

    /// The next event; none after the line was closed.
    pub async fn next(&mut self) -> Option<LineEvent> {
        match self.0.as_mut()?.recv().await {
            Ok(event) => Some(event),
            Err(broadcast::error::RecvError::Lagged(count)) => Some(LineEvent::Lagged(count)),
            Err(broadcast::error::RecvError::Closed) => None,
        }
    }
}

/// The sending side: publishes events and state.
pub(crate) struct Publisher {
    observer: Option<Observer>,
    /// Those of this wake-up that the observer does not have yet.
    waiting: Vec<LineEvent>,
    events: broadcast::Sender<LineEvent>,
    state: watch::Sender<LineState>,
    granted: watch::Sender<Option<Granted>>,
}

impl Publisher {
    pub(crate) fn new(observer: Option<Observer>) -> Publisher {
        Publisher {
            observer,
            waiting: Vec::new(),
            events: broadcast::Sender::new(EVENTS_MAX),
            state: watch::Sender::new(LineState::Opening),
            granted: watch::Sender::new(None),
        }
    }

    pub(crate) fn events(&self) -> broadcast::WeakSender<LineEvent> {
        self.events.downgrade()
    }

    pub(crate) fn state(&self) -> watch::Receiver<LineState> {
        self.state.subscribe()
    }

    pub(crate) fn granted(&self) -> watch::Receiver<Option<Granted>> {
        self.granted.subscribe()
    }

    /// Sets what the port's driver granted.
    pub(crate) fn set_granted(&self, granted: Option<Granted>) {
        self.granted.send_replace(granted);
    }

    /// Adds an event to those of this wake-up.
    #[inline]
    pub(crate) fn publish(&mut self, event: &Event) {
        if self.observer.is_some() || self.events.receiver_count() > 0 {
            self.waiting.push(LineEvent::Bus(*event));
        }
    }

    /// The same of the end of the observer's own op.
    pub(crate) fn ended(&mut self, run: RunId, end: Result<Done, Fault>) {
        if self.observer.is_some() {
            self.waiting.push(LineEvent::Ended(run, end));
        }
    }

    /// Publishes a state if it differs from the current one.
    pub(crate) fn set_state(&mut self, state: LineState) {
        if *self.state.borrow() != state {
            self.waiting.push(LineEvent::State(state.clone()));
            self.flush();
            self.state.send_replace(state);
        }
    }

    /// Passes on what this wake-up has brought.
    pub(crate) fn flush(&mut self) {
        if self.waiting.is_empty() {
            return;
        }
        if let Some(observer) = &mut self.observer {
            observer(&self.waiting);
        }
        if self.events.receiver_count() == 0 {
            self.waiting.clear();
        } else {
            self.pass_on();
        }
    }

    // On its own, because most lines are only observed.
    #[inline(never)]
    fn pass_on(&mut self) {
        for event in self.waiting.drain(..) {
            if !matches!(event, LineEvent::Ended(..)) {
                // Fails if the last receiver has just gone.
                let _ = self.events.send(event);
            }
        }
    }
}

impl fmt::Debug for Publisher {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Publisher")
            .field("state", &self.state)
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_slow_receiver_is_told_how_much_it_lost() {
        let mut publisher = Publisher::new(None);
        let mut events = LineEvents::of(&publisher.events());
        for _ in 0..EVENTS_MAX + 3 {
            publisher.publish(&Event::Babble);
            publisher.flush();
        }
        assert_eq!(events.next().await, Some(LineEvent::Lagged(3)));
        assert_eq!(events.next().await, Some(LineEvent::Bus(Event::Babble)));
        let line = publisher.events();
        drop(publisher);
        while let Some(event) = events.next().await {
            assert_eq!(event, LineEvent::Bus(Event::Babble));
        }
        assert_eq!(LineEvents::of(&line).next().await, None);
    }

    #[tokio::test]
    async fn a_state_is_told_once_and_to_the_observer_first() {
        let seen = Arc::new(std::sync::Mutex::new(Vec::new()));
        let writer = Arc::clone(&seen);
        let observer = move |events: &[LineEvent]| writer.lock().unwrap().extend_from_slice(events);
        let mut publisher = Publisher::new(Some(Box::new(observer)));
        let missing = LineState::Absent(Arc::new(PortError::Missing));
        for state in [&LineState::Opening, &missing, &missing, &LineState::Up] {
            publisher.set_state(state.clone());
        }
        let told = [missing, LineState::Up].map(LineEvent::State);
        assert_eq!(*seen.lock().unwrap(), told);
    }
}
