//! A custom port, and how a line handles a slow one.

mod support;

use railbus_host::{
    Bank, Channel, Confirmation, Family, Fault, Line, LineState, Medium, ModuleId, Op, Plan, Port,
    PortError, Protocol, SerialSettings, Terms,
};
use railbus_wire::Micros;
use std::io;
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll};
use std::thread;
use std::time::{Duration, Instant};
use support::{module, setup, soon};

/// How long the task is held up between its decision to send and the sending.
const HELD_UP: Duration = Duration::from_millis(30);

/// A port without modules. It records when each frame begins and ends to be handed over.
#[derive(Clone, Default)]
struct Slow {
    sent: Arc<Mutex<Vec<(Instant, Instant, usize)>>>,
}

impl Port for Slow {
    fn name(&self) -> String {
        "slow".to_owned()
    }

    fn medium(&self) -> Medium {
        Medium::Wire
    }

    async fn open(&mut self) -> Result<(), PortError> {
        Ok(())
    }

    fn poll_read(&mut self, _: &mut Context<'_>, _: &mut [u8]) -> Poll<io::Result<usize>> {
        Poll::Pending
    }

    fn send(&mut self, bytes: &[u8], _: SerialSettings) -> io::Result<()> {
        let begin = Instant::now();
        thread::sleep(HELD_UP);
        let mut sent = self.sent.lock().expect("a lock");
        sent.push((begin, Instant::now(), bytes.len()));
        Ok(())
    }

    fn close(&mut self) {}
}

#[tokio::test]
async fn a_task_that_is_held_up_keeps_the_silence_all_the_same() {
    let port = Slow::default();
    let sent = Arc::clone(&port.sent);
    let board = setup(Family::R55, 4, Protocol::R55);
    let modules = vec![(module(&board), Plan::NEVER)];
    let bus = railbus_host::Config {
        settle: Micros::from_millis(10),
        echo: railbus_host::EchoMode::Off,
        ..railbus_host::Config::default()
    };
    let line = Line::over(port, bus, modules, None).expect("a line");
    assert_eq!(line.name(), "slow");
    soon(line.opened()).await.expect("open");

    let on = Bank::one(Channel::new(0).expect("a channel"), true);
    let unanswered = Terms {
        verify: false,
        ..Terms::default()
    };
    let first = line.run(ModuleId(0), Op::WriteSilent(on), unanswered);
    let second = line.run(ModuleId(0), Op::ReadOutputs, Terms::default());
    let (first, second) = soon(async { tokio::join!(first, second) }).await;
    assert_eq!(first.expect("sent").confirmed, Confirmation::Sent);
    assert!(matches!(second, Err(Fault::NoReply(_))), "{second:?}");

    let sent = sent.lock().expect("a lock").clone();
    let (_, left_after, len) = sent[0];
    let (asked, ..) = sent[1];
    // The frame's time counts from when it was really sent, and then comes the board's gap.
    let least = SerialSettings::FACTORY.frame_time(len) + board.request_gap();
    assert!(asked - left_after >= Duration::from_micros(least.0));
    soon(line.close()).await;
    assert_eq!(line.state(), LineState::Closed);
}
