//! The line on real terminals, with simulated modules at the other end.

mod support;

use railbus_host::{
    Bank, Baud, Channel, Character, Confirmation, Event, Exchange, Family, Fault, Holder, Line,
    LineEvent, LineEvents, LineName, LineState, Medium, Micros, ModuleId, Observation, Op, Plan,
    Port, PortError, PortHistory, Presence, Probe, Probed, Protocol, RunId, SerialOptions,
    SerialPort, SerialSettings, Setup, Terms,
};
use railbus_wire::{Address, rtu};
use rustix::termios::{ControlModes, Termios, tcgetattr};
use std::fs::FileTimes;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, SystemTime};
use support::{Player, config, pty, setup, soon, temporary};

const FIRST: ModuleId = ModuleId(0);

fn erc8() -> Setup {
    setup(Family::Erc8, 3, Protocol::Rtu)
}

fn serial(path: &Path) -> LineName {
    LineName::Serial(path.to_owned())
}

fn switch(channel: u8, on: bool) -> Op {
    Op::Write(Bank::one(Channel::new(channel).expect("a channel"), on))
}

fn outputs(seen: Option<Observation>) -> Bank {
    match seen {
        Some(Observation::Channels { outputs, .. }) => outputs,
        other => panic!("no outputs: {other:?}"),
    }
}

/// A line with an ERC-8 that is not polled, and its simulation.
async fn quiet_line() -> (Line, Player, std::path::PathBuf) {
    let (master, path) = pty();
    let player = Player::start(master, &[erc8()], false);
    let line = Line::open(config(serial(&path), &[erc8()], Plan::NEVER)).expect("a line");
    soon(line.opened()).await.expect("open");
    (line, player, path)
}

#[tokio::test]
async fn a_write_is_read_back_and_a_read_is_seen() {
    let (line, player, _) = quiet_line().await;
    let done = soon(line.run(FIRST, switch(2, true), Terms::default())).await;
    let done = done.expect("written");
    assert_eq!(done.confirmed, Confirmation::Readback);
    assert_eq!(outputs(done.seen).on, 0b100);
    let done = soon(line.run(FIRST, Op::ReadOutputs, Terms::default())).await;
    let done = done.expect("read");
    assert_eq!(
        (done.confirmed, outputs(done.seen).on),
        (Confirmation::Reply, 0b100)
    );
    soon(line.close()).await;
    assert_eq!(player.stop()[0].outputs(), 0b100);
}

const fn is_lost_reading(event: &LineEvent) -> bool {
    matches!(
        event,
        LineEvent::Bus(Event::Missed {
            op: Op::ReadOutputs,
            fault: Fault::NoReply(_) | Fault::Garbled(_),
            ..
        })
    )
}

/// How many readings of outputs were lost before a command ended with its reply alone. The last one
/// ends it, and is reported after that.
async fn readings_lost(events: &mut LineEvents) -> usize {
    let mut lost = 0;
    loop {
        let event = events.next().await.expect("the line is open");
        if matches!(event, LineEvent::Bus(Event::Done { .. })) {
            let last = events.next().await.expect("the line is open");
            return lost + usize::from(is_lost_reading(&last));
        }
        lost += usize::from(is_lost_reading(&event));
    }
}

#[tokio::test]
async fn every_protocol_reads_and_writes() {
    for setup in [
        setup(Family::Eda9060a, 1, Protocol::Ascii),
        setup(Family::Eda9060a, 1, Protocol::Lc02),
        setup(Family::Eda9060a, 1, Protocol::Rtu),
        setup(Family::Eda9050, 2, Protocol::Ascii),
        setup(Family::R55, 4, Protocol::R55),
        setup(Family::Emd2a2q, 5, Protocol::Rtu),
    ] {
        let (master, path) = pty();
        let player = Player::start(master, &[setup], false);
        let line = Line::open(config(serial(&path), &[setup], Plan::NEVER)).expect("a line");
        let mut events = line.events();
        soon(line.opened()).await.expect("open");
        let done = soon(line.run(FIRST, switch(1, true), Terms::default())).await;
        let done = done.unwrap_or_else(|fault| panic!("{setup:?}: {fault:?}"));
        // A module that has answered within microseconds is waited for 20 ms: a machine that runs
        // the simulation later than that loses a reading, and after two only the reply is left.
        if done.confirmed == Confirmation::Reply {
            assert_eq!(soon(readings_lost(&mut events)).await, 2, "{setup:?}");
        } else {
            assert_eq!(done.confirmed, Confirmation::Readback, "{setup:?}");
        }
        let done = soon(line.run(FIRST, Op::ReadOutputs, Terms::default())).await;
        assert_eq!(outputs(done.expect("read").seen).on, 0b10, "{setup:?}");
        soon(line.close()).await;
        assert_eq!(player.stop()[0].outputs(), 0b10, "{setup:?}");
    }
}

#[tokio::test]
async fn a_paced_line_of_all_families_is_polled() {
    let setups = [
        setup(Family::Eda9060a, 1, Protocol::Ascii),
        setup(Family::Eda9050, 2, Protocol::Ascii),
        setup(Family::Erc8, 3, Protocol::Rtu),
        setup(Family::R55, 4, Protocol::R55),
        setup(Family::Emd2a2q, 5, Protocol::Rtu),
    ];
    let (master, path) = pty();
    let player = Player::start(master, &setups, true);
    let line = Line::open(config(serial(&path), &setups, Plan::default())).expect("a line");
    let mut events = line.events();
    let mut online = [false; 5];
    soon(async {
        while online.contains(&false) {
            if let Some(LineEvent::Bus(Event::Presence { module, presence })) = events.next().await
            {
                online[module.0] = presence == Presence::Online;
            }
        }
    })
    .await;
    let done = soon(line.run(ModuleId(3), switch(7, true), Terms::default())).await;
    assert_eq!(done.expect("written").confirmed, Confirmation::Readback);
    soon(line.close()).await;
    assert_eq!(player.stop()[3].outputs(), 1 << 7);
}

#[tokio::test]
async fn an_end_comes_to_the_observer_with_the_reading_it_rests_on_and_once() {
    let (master, path) = pty();
    let _player = Player::start(master, &[erc8()], false);
    let (told, mut calls) = tokio::sync::mpsc::unbounded_channel();
    let mut config = config(serial(&path), &[erc8()], Plan::NEVER);
    config.observer = Some(Box::new(move |events: &[LineEvent]| {
        let _ = told.send(events.to_vec());
    }));
    let line = Line::open(config).expect("a line");
    soon(line.opened()).await.expect("open");
    let submit = |run| line.submit(RunId(run), FIRST, switch(0, true), Terms::default());
    submit(7).expect("room");
    let mut ended = false;
    while !ended {
        let call = soon(calls.recv()).await.expect("the line lives");
        let mut seen = false;
        for event in call {
            match event {
                LineEvent::Bus(Event::Seen { .. }) => seen = true,
                LineEvent::Ended(run, end) => {
                    assert_eq!(run, RunId(7));
                    assert!(end.is_ok() && seen, "{end:?}");
                    ended = true;
                }
                _ => {}
            }
        }
    }
    // What the line has not done when it is closed ends too.
    for run in 8..12 {
        submit(run).expect("room");
    }
    soon(line.close()).await;
    assert_eq!(submit(12), Err(Fault::Closed));
    let mut ends = Vec::new();
    while let Some(call) = soon(calls.recv()).await {
        ends.extend(call.into_iter().filter_map(|event| match event {
            LineEvent::Ended(run, _) => Some(run.0),
            _ => None,
        }));
    }
    ends.sort_unstable();
    assert_eq!(ends, [8, 9, 10, 11]);
}

#[tokio::test]
async fn events_are_told_before_the_caller_is_answered() {
    let (master, path) = pty();
    let _player = Player::start(master, &[erc8()], false);
    let told = Arc::new(Mutex::new(Vec::new()));
    let writer = Arc::clone(&told);
    let mut config = config(serial(&path), &[erc8()], Plan::NEVER);
    config.observer = Some(Box::new(move |events| {
        writer.lock().expect("a lock").extend_from_slice(events);
    }));
    let line = Line::open(config).expect("a line");
    let mut events = line.events();
    soon(line.opened()).await.expect("open");
    let done = soon(line.run(FIRST, switch(0, true), Terms::default())).await;
    let took = done.expect("written").took;
    let told = told.lock().expect("a lock").clone();
    assert_eq!(told.first(), Some(&LineEvent::State(LineState::Up)));
    let is_end = |event: &LineEvent| match event {
        LineEvent::Bus(Event::Done {
            end, took: told, ..
        }) => end.is_ok() && *told == took,
        _ => false,
    };
    let is_seen = |event: &LineEvent| matches!(event, LineEvent::Bus(Event::Seen { .. }));
    let end = told.iter().position(is_end).expect("the end was told");
    assert!(told[..end].iter().any(is_seen));
    // The receivers got the same in the same order.
    for event in &told {
        assert_eq!(soon(events.next()).await.as_ref(), Some(event));
    }
}

#[tokio::test]
async fn a_port_that_vanished_comes_back_under_its_name() {
    let link = temporary("vanishing");
    let (master, path) = pty();
    std::os::unix::fs::symlink(&path, &link).expect("a link");
    let player = Player::start(master, &[erc8()], false);
    let line = Line::open(config(serial(&link), &[erc8()], Plan::NEVER)).expect("a line");
    let mut events = line.events();
    soon(line.opened()).await.expect("open");
    let done = soon(line.run(FIRST, switch(0, true), Terms::default())).await;
    done.expect("written");

    // Our end is closed and the name disappears, as when an adapter is pulled out.
    std::fs::remove_file(&link).expect("no link");
    drop(player);
    let mut states = Vec::new();
    let missing = LineState::Absent(Arc::new(PortError::Missing));
    soon(until(&mut events, &mut states, &missing)).await;
    let fault = soon(line.run(FIRST, Op::ReadOutputs, Terms::default())).await;
    assert_eq!(fault, Err(Fault::Closed));
    assert_eq!(soon(line.opened()).await, Err(PortError::Missing));

    // Another one comes under the same name.
    let (master, path) = pty();
    let _player = Player::start(master, &[erc8()], false);
    let back = tokio::time::Instant::now();
    std::os::unix::fs::symlink(&path, &link).expect("a link");
    soon(until(&mut events, &mut states, &LineState::Up)).await;
    assert!(back.elapsed() < Duration::from_secs(2));
    let gone = LineState::Absent(Arc::new(PortError::Gone));
    assert_eq!(states, [LineState::Up, gone, missing, LineState::Up]);
    let done = soon(line.run(FIRST, Op::ReadOutputs, Terms::default())).await;
    assert_eq!(outputs(done.expect("read").seen).on, 0);
    soon(line.close()).await;
    std::fs::remove_file(&link).expect("no link");
}

/// Collects states until this one.
async fn until(events: &mut LineEvents, states: &mut Vec<LineState>, last: &LineState) {
    while let Some(event) = events.next().await {
        if let LineEvent::State(state) = event {
            states.push(state);
            if states.last() == Some(last) {
                return;
            }
        }
    }
    panic!("closed before {last:?}: {states:?}");
}

#[tokio::test]
async fn a_command_cut_short_by_the_loss_is_unknown() {
    let (master, path) = pty();
    let line = Line::open(config(serial(&path), &[erc8()], Plan::NEVER)).expect("a line");
    soon(line.opened()).await.expect("open");
    let running = tokio::spawn({
        let line = line.clone();
        async move { line.run(FIRST, Op::ReadOutputs, Terms::default()).await }
    });
    let mut request = [0; 64];
    let read = tokio::task::spawn_blocking(move || {
        let count = rustix::io::read(&master, &mut request).expect("a request");
        (master, count)
    });
    let (master, count) = soon(read).await.expect("no panic");
    assert!(count > 0);
    drop(master);
    assert_eq!(soon(running).await.expect("no panic"), Err(Fault::Unknown));
}

#[tokio::test]
async fn a_busy_port_names_its_holder() {
    let (line, _player, path) = quiet_line().await;
    let second = Line::open(config(serial(&path), &[erc8()], Plan::NEVER)).expect("a line");
    match soon(second.opened()).await {
        Err(PortError::Busy {
            holder: Some(Holder { pid, name }),
        }) => {
            assert_eq!(pid, std::process::id());
            assert!(!name.is_empty());
        }
        other => panic!("{other:?}"),
    }
    // It waits for its turn.
    let mut events = second.events();
    soon(line.close()).await;
    soon(until(&mut events, &mut Vec::new(), &LineState::Up)).await;
}

#[tokio::test]
async fn what_is_not_there_is_missing_and_what_is_no_terminal_is_told() {
    for (path, why) in [
        ("/dev/railbus none such", PortError::Missing),
        ("/dev/null", PortError::NotATty),
    ] {
        let line = Line::open(config(serial(Path::new(path)), &[], Plan::NEVER)).expect("a line");
        assert_eq!(soon(line.opened()).await, Err(why.clone()));
        assert_eq!(line.state(), LineState::Absent(Arc::new(why)));
        soon(line.close()).await;
        assert_eq!(line.state(), LineState::Closed);
    }
}

fn modes(mode: &Termios) -> impl PartialEq + std::fmt::Debug + use<> {
    (
        (mode.input_modes, mode.output_modes),
        (mode.control_modes, mode.local_modes),
        (mode.input_speed(), mode.output_speed()),
        format!("{:?}", mode.special_codes),
    )
}

#[tokio::test]
async fn a_terminal_is_left_as_it_was_found() {
    let (master, path) = pty();
    let before = tcgetattr(&master).expect("modes");
    let line = Line::open(config(serial(&path), &[erc8()], Plan::NEVER)).expect("a line");
    soon(line.opened()).await.expect("open");
    // A pseudo-terminal's driver accepts no such setting.
    let granted = line.granted().expect("a driver was asked");
    assert!(!granted.low_latency && !granted.rs485);
    let open = tcgetattr(&master).expect("modes");
    assert_ne!(modes(&open), modes(&before));
    soon(line.close()).await;
    let after = tcgetattr(&master).expect("modes");
    assert_eq!(modes(&after), modes(&before));
    // And not locked: it can be opened once more.
    let line = Line::open(config(serial(&path), &[erc8()], Plan::NEVER)).expect("a line");
    soon(line.opened()).await.expect("open");
}

/// Sets a terminal's time stamp to this long ago.
fn written_ago(path: &Path, ago: Duration) {
    let then = SystemTime::now() - ago;
    let times = FileTimes::new().set_modified(then).set_accessed(then);
    let device = std::fs::OpenOptions::new().write(true).open(path);
    device
        .and_then(|file| file.set_times(times))
        .expect("the device's owner");
}

#[tokio::test]
async fn a_terminal_that_was_written_to_lately_has_not_rested() {
    let (_master, path) = pty();
    let mut port = SerialPort::new(path.clone(), SerialOptions::default());
    port.open().await.expect("a terminal");
    assert!(port.past() == PortHistory::Unknown, "it was made just now");
    written_ago(&path, Duration::from_secs(20));
    port.open().await.expect("a terminal");
    assert_eq!(port.past(), PortHistory::Rested);
    port.send(b"\x03", SerialSettings::FACTORY).expect("sent");
    port.open().await.expect("a terminal");
    assert_ne!(port.past(), PortHistory::Rested, "the system notes a write");
}

/// A killed process cleans up nothing. That the terminal was not closed in order is seen by the
/// next user, until enough time has passed that no late reply can come.
#[tokio::test]
async fn a_terminal_shows_that_it_was_not_given_up_in_order() {
    for settled in [true, false] {
        let (_master, path) = pty();
        let mut port = SerialPort::new(path.clone(), SerialOptions::default());
        port.open().await.expect("a terminal");
        assert_eq!(port.past(), PortHistory::Unknown);
        port.send(b"\x03", SerialSettings::FACTORY).expect("sent");
        if settled {
            port.settle();
        }
        let then = match settled {
            true => PortHistory::Unknown,
            false => PortHistory::Abandoned,
        };
        // Opening and closing it changes nothing about that, nor does listening.
        for listen_only in [false, true, false] {
            let options = SerialOptions {
                listen_only,
                ..SerialOptions::default()
            };
            port.close();
            port = SerialPort::new(path.clone(), options);
            port.open().await.expect("a terminal");
            assert_eq!(port.past(), then);
        }
    }
}

/// The program at the other end, such as a simulator, may keep both ends open. It is no rival, and
/// may not yet have noticed that a program was killed which had the terminal to itself.
#[tokio::test]
async fn who_makes_a_terminal_does_not_keep_others_from_it() {
    let (_master, path) = pty();
    let open = || std::fs::File::options().read(true).write(true).open(&path);
    let kept = open().expect("a terminal");
    rustix::termios::ioctl_tiocexcl(&kept).expect("exclusive");
    // Only root gets past the exclusive mode at all.
    if open().is_err() {
        return;
    }
    let mut port = SerialPort::new(path.clone(), SerialOptions::default());
    port.open().await.expect("free");
}

#[tokio::test]
async fn an_abandoned_line_is_listened_to_for_as_long_as_a_reply_is_late() {
    for past in [PortHistory::Unknown, PortHistory::Abandoned] {
        let (master, path) = pty();
        let mut port = SerialPort::new(path.clone(), SerialOptions::default());
        port.open().await.expect("a terminal");
        port.send(b"\x03", SerialSettings::FACTORY).expect("sent");
        if past == PortHistory::Unknown {
            port.settle();
        }
        port.close();
        let _player = Player::start(master, &[erc8()], false);
        let begun = std::time::Instant::now();
        let line = Line::open(config(serial(&path), &[erc8()], Plan::NEVER)).expect("a line");
        soon(line.opened()).await.expect("open");
        let read = soon(line.run(FIRST, Op::ReadOutputs, Terms::default())).await;
        assert!(read.is_ok(), "{read:?}");
        if past == PortHistory::Abandoned {
            let took = begun.elapsed();
            assert!(took >= Duration::from_millis(500), "{took:?}");
        }
        soon(line.close()).await;
        let mut port = SerialPort::new(path, SerialOptions::default());
        port.open().await.expect("a terminal");
        assert_eq!(port.past(), PortHistory::Unknown, "closed in order");
    }
}

#[tokio::test]
async fn a_line_at_rest_is_asked_at_once() {
    let settle = Micros::from_secs(3_600);
    let (master, path) = pty();
    written_ago(&path, Duration::from_secs(20));
    let _player = Player::start(master, &[erc8()], false);
    let mut config = config(serial(&path), &[erc8()], Plan::NEVER);
    config.bus.settle = settle;
    let line = Line::open(config).expect("a line");
    soon(line.opened()).await.expect("open");
    let read = soon(line.run(FIRST, Op::ReadOutputs, Terms::default())).await;
    assert!(read.is_ok(), "an hour later otherwise: {read:?}");
    soon(line.close()).await;
}

#[tokio::test]
async fn each_frame_brings_its_speed_and_format() {
    let (master, path) = pty();
    let mut port = SerialPort::new(path, SerialOptions::default());
    soon(port.open()).await.expect("open");
    assert_eq!(port.medium(), Medium::Buffered);
    assert_eq!(port.settings(), Some(SerialSettings::FACTORY));
    for baud in Baud::ALL {
        for character in Character::ALL {
            let wanted = SerialSettings { baud, character };
            port.send(b"x", wanted).expect("sent");
            assert_eq!(port.settings(), Some(wanted));
            let mode = tcgetattr(&master).expect("modes");
            assert_eq!(mode.output_speed(), baud.rate());
            assert!(!mode.control_modes.contains(ControlModes::PARENB));
        }
    }
    let mut sent = [0; 64];
    let mut count = 0;
    while count < 32 {
        count += rustix::io::read(&master, &mut sent).expect("bytes");
    }
    assert_eq!(count, 32);
}

#[tokio::test]
async fn what_nobody_takes_is_withdrawn() {
    let (master, path) = pty();
    let mut port = SerialPort::pseudo(path, SerialOptions::default());
    soon(port.open()).await.expect("open");
    let frame = [0x55; 200];
    let error = (0..1000).find_map(|_| port.send(&frame, SerialSettings::FACTORY).err());
    let error = error.expect("no buffer is that long");
    assert_eq!(PortError::of_loss(&error), PortError::Stuck);
    drop(master);
}

/// A read of the first coil.
fn probe(address: u8) -> Probe {
    let span = rtu::BitSpan::new(60, 1).expect("one coil");
    Probe {
        exchange: Exchange::rtu(Address(address), rtu::Request::ReadCoils(span)),
        settings: SerialSettings::FACTORY,
        gap: Micros::from_millis(20),
        timeout: Micros::from_millis(100),
        clear: false,
        changes: false,
        as_module: false,
    }
}

/// Two callers at the same time each get their own exchange, and a cancelled one frees its place.
#[tokio::test]
async fn probes_go_one_after_the_other() {
    let (line, player, _) = quiet_line().await;
    let slow = Probe {
        timeout: Micros::from_millis(500),
        ..probe(9)
    };
    let nobody = tokio::spawn({
        let line = line.clone();
        async move { line.probe(slow).await }
    });
    let switch = rtu::Request::WriteCoil {
        at: 60,
        value: rtu::CoilValue::ON,
    };
    for _ in 0..40 {
        // They wait behind an unanswered one, and are cancelled before they are sent.
        let gone = line.probe(Probe {
            exchange: Exchange::rtu(Address(3), switch),
            changes: true,
            ..probe(3)
        });
        let gone = tokio::time::timeout(Duration::from_millis(1), gone).await;
        assert!(gone.is_err());
    }
    let met = soon(line.probe(probe(3))).await.expect("its turn comes");
    assert_eq!(
        (met.outcome, met.bytes.first()),
        (Probed::Answered, Some(&3))
    );
    let met = soon(nobody).await.expect("a task").expect("probed");
    assert_eq!((met.outcome, met.bytes), (Probed::Silent, Vec::new()));
    soon(line.close()).await;
    assert_eq!(
        player.stop()[0].outputs(),
        0,
        "what was taken back was not sent"
    );
}

#[tokio::test]
async fn a_probe_brings_its_bytes() {
    let (line, _player, _) = quiet_line().await;
    let met = soon(line.probe(probe(3))).await.expect("probed");
    assert_eq!(met.outcome, Probed::Answered);
    assert_eq!(met.bytes[..4], [3, 1, 1, 0]);
    let met = soon(line.probe(probe(9))).await.expect("probed");
    assert_eq!((met.outcome, met.bytes), (Probed::Silent, Vec::new()));
}

#[tokio::test]
async fn a_caller_that_goes_away_takes_nothing_back() {
    let (line, player, _) = quiet_line().await;
    let mut events = line.events();
    let run = line.run(FIRST, switch(5, true), Terms::default());
    assert!(
        tokio::time::timeout(Duration::from_millis(1), run)
            .await
            .is_err()
    );
    soon(async {
        while !matches!(
            events.next().await,
            Some(LineEvent::Bus(Event::Done { end: Ok(_), .. }))
        ) {}
    })
    .await;
    drop(line);
    assert_eq!(player.stop()[0].outputs(), 1 << 5);
}

#[tokio::test]
async fn a_close_lets_commands_end() {
    let (line, player, _) = quiet_line().await;
    let running = tokio::spawn({
        let line = line.clone();
        async move { line.run(FIRST, switch(1, true), Terms::default()).await }
    });
    tokio::time::sleep(Duration::from_millis(15)).await;
    soon(line.close()).await;
    let done = soon(running).await.expect("no panic").expect("written");
    assert_eq!(done.confirmed, Confirmation::Readback);
    assert_eq!(line.state(), LineState::Closed);
    let late = soon(line.run(FIRST, Op::ReadOutputs, Terms::default())).await;
    assert_eq!(late, Err(Fault::Closed));
    assert_eq!(soon(line.events().next()).await, None);
    // Closing twice does no harm.
    soon(line.close()).await;
    assert_eq!(player.stop()[0].outputs(), 0b10);
}

#[tokio::test]
async fn the_last_handle_closes_the_line() {
    let (line, _player, path) = quiet_line().await;
    let mut events = line.events();
    drop(line);
    soon(until(&mut events, &mut Vec::new(), &LineState::Closed)).await;
    let line = Line::open(config(serial(&path), &[], Plan::NEVER)).expect("a line");
    soon(line.opened()).await.expect("open");
}

#[tokio::test]
async fn too_many_commands_are_refused_at_once() {
    let (line, _player, _) = quiet_line().await;
    // However late a busy machine is, none of those that are accepted expires.
    let terms = Terms {
        expires: Some(line.now() + Micros::from_secs(600)),
        ..Terms::default()
    };
    let runs: Vec<_> = (0..200)
        .map(|_| {
            let line = line.clone();
            tokio::spawn(async move { line.run(FIRST, Op::ReadOutputs, terms).await })
        })
        .collect();
    let mut overloaded = 0;
    for run in runs {
        match soon(run).await.expect("no panic") {
            Ok(done) => assert!(done.seen.is_some()),
            Err(Fault::Overloaded) => overloaded += 1,
            Err(other) => panic!("{other:?}"),
        }
    }
    assert!(
        overloaded >= 200 - 2 * railbus_host::JOBS_MAX,
        "{overloaded}"
    );
}
