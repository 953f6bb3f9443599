//! The line over TCP: a serial server that passes bytes on, and a Modbus TCP gateway.

mod support;

use railbus_host::{
    Bank, Channel, Confirmation, Family, Fault, Line, LineName, LineState, ModuleId, Observation,
    Op, Plan, PortError, Presence, Protocol, Refusal, Setup, Terms,
};
use railbus_wire::rtu::Exception;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::thread;
use support::{Player, config, setup, soon};

const FIRST: ModuleId = ModuleId(0);

fn erc8() -> Setup {
    setup(Family::Erc8, 3, Protocol::Rtu)
}

fn listen() -> (TcpListener, u16) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = listener.local_addr().expect("an address").port();
    (listener, port)
}

/// The next connection to a server, without holding up the line.
async fn accept(listener: TcpListener) -> (TcpListener, TcpStream) {
    let accept = tokio::task::spawn_blocking(move || {
        let (stream, _) = listener.accept().expect("a connection");
        (listener, stream)
    });
    soon(accept).await.expect("no panic")
}

fn on(channel: u8) -> Op {
    Op::Write(Bank::one(Channel::new(channel).expect("a channel"), true))
}

fn open(name: LineName) -> Line {
    Line::open(config(name, &[erc8()], Plan::NEVER)).expect("a line")
}

fn raw(port: u16) -> LineName {
    let host = "127.0.0.1".to_owned();
    LineName::Tcp { host, port }
}

fn gateway(port: u16) -> LineName {
    let host = "127.0.0.1".to_owned();
    LineName::ModbusTcp { host, port }
}

#[tokio::test]
async fn a_serial_server_is_used_and_found_again() {
    let (listener, port) = listen();
    let line = open(raw(port));
    let (listener, stream) = accept(listener).await;
    let player = Player::start(stream.into(), &[erc8()], false);
    soon(line.opened()).await.expect("open");
    let done = soon(line.run(FIRST, on(4), Terms::default())).await;
    assert_eq!(done.expect("written").confirmed, Confirmation::Readback);

    let mut events = line.events();
    assert_eq!(player.stop()[0].outputs(), 1 << 4);
    let (_listener, stream) = accept(listener).await;
    let _player = Player::start(stream.into(), &[erc8()], false);
    let mut states = Vec::new();
    soon(async {
        while states.last() != Some(&LineState::Up) {
            if let Some(railbus_host::LineEvent::State(state)) = events.next().await {
                states.push(state);
            }
        }
    })
    .await;
    let gone = LineState::Absent(Arc::new(PortError::Gone));
    assert_eq!(states, [gone, LineState::Up]);
    let done = soon(line.run(FIRST, Op::ReadOutputs, Terms::default())).await;
    done.expect("read");
}

#[tokio::test]
async fn a_server_that_is_not_there_refuses() {
    let (listener, port) = listen();
    drop(listener);
    for name in [raw(port), gateway(port)] {
        let line = open(name);
        assert_eq!(soon(line.opened()).await, Err(PortError::Refused));
    }
}

#[tokio::test]
async fn a_host_that_has_no_address_is_missing() {
    let host = "railbus.invalid".to_owned();
    let line = open(LineName::Tcp { host, port: 1 });
    assert_eq!(soon(line.opened()).await, Err(PortError::Missing));
}

/// A gateway that answers each request, without its header, by the envelopes of `answer`.
fn serve(
    mut stream: TcpStream,
    mut answer: impl FnMut([u8; 2], &[u8]) -> Vec<u8> + Send + 'static,
) {
    thread::spawn(move || {
        let mut header = [0; 6];
        while stream.read_exact(&mut header).is_ok() {
            assert_eq!(header[2..5], [0, 0, 0]);
            let mut inside = vec![0; usize::from(header[5])];
            stream.read_exact(&mut inside).expect("the rest");
            let reply = answer([header[0], header[1]], &inside);
            stream.write_all(&reply).expect("sent");
        }
    });
}

fn envelope(transaction: [u8; 2], inside: &[u8]) -> Vec<u8> {
    let [high, low] = transaction;
    let header = [high, low, 0, 0, 0, inside.len() as u8];
    [&header, inside].concat()
}

#[tokio::test]
async fn a_gateway_is_read_and_written() {
    let (listener, port) = listen();
    let line = open(gateway(port));
    let (_listener, stream) = accept(listener).await;
    let mut coils = 0;
    serve(stream, move |transaction, inside| {
        let [older, _] = transaction;
        // A reply to an earlier request, which is not pending any more.
        let stale = envelope([older.wrapping_add(1), 0], &[3, 1, 1, 0x55]);
        let reply = match *inside {
            [3, 1, 0, 60, 0, 8] => vec![3, 1, 1, coils],
            [3, 5, 0, at, high, 0] => {
                coils |= u8::from(high == 0xFF) << (at - 60);
                inside.to_vec()
            }
            ref other => panic!("{other:02X?}"),
        };
        [stale, envelope(transaction, &reply)].concat()
    });
    soon(line.opened()).await.expect("open");
    let done = soon(line.run(FIRST, on(4), Terms::default())).await;
    let done = done.expect("written");
    assert_eq!(done.confirmed, Confirmation::Readback);
    match done.seen {
        Some(Observation::Channels { outputs, .. }) => assert_eq!(outputs.on, 1 << 4),
        other => panic!("{other:?}"),
    }
}

#[tokio::test]
async fn a_gateways_exceptions_are_refusals() {
    for code in [0x0A, 0x0B] {
        let (listener, port) = listen();
        let line = open(gateway(port));
        let (_listener, stream) = accept(listener).await;
        serve(stream, move |transaction, inside| {
            envelope(transaction, &[inside[0], inside[1] | 0x80, code])
        });
        soon(line.opened()).await.expect("open");
        let end = soon(line.run(FIRST, Op::ReadOutputs, Terms::default())).await;
        let refusal = Refusal::Exception(Exception(code));
        assert_eq!(end, Err(Fault::Refused(refusal)));
    }
}

#[tokio::test]
async fn what_speaks_no_modbus_tcp_is_left_and_tried_again() {
    let (listener, port) = listen();
    let line = open(gateway(port));
    let mut events = line.events();
    let (listener, stream) = accept(listener).await;
    serve(stream, |_, _| b"HTTP/1.1 400 Bad Request\r\n\r\n".to_vec());
    soon(line.opened()).await.expect("open");
    let end = soon(line.run(FIRST, Op::ReadOutputs, Terms::default())).await;
    assert_eq!(end, Err(Fault::Unknown));
    let garbled = LineState::Absent(Arc::new(PortError::Garbled));
    soon(async {
        while events.next().await != Some(railbus_host::LineEvent::State(garbled.clone())) {}
    })
    .await;
    accept(listener).await;
}

#[tokio::test]
async fn frames_of_other_protocols_go_nowhere_through_a_gateway() {
    let (listener, port) = listen();
    let ascii = setup(Family::Eda9060a, 1, Protocol::Ascii);
    let config = config(gateway(port), &[ascii], Plan::NEVER);
    let line = Line::open(config).expect("a line");
    let mut events = line.events();
    let (_listener, stream) = accept(listener).await;
    serve(stream, |_, inside| panic!("{inside:02X?} is no Modbus"));
    soon(line.opened()).await.expect("open");
    let end = soon(line.run(FIRST, Op::ReadOutputs, Terms::default())).await;
    assert!(matches!(end, Err(Fault::NoReply(_))), "{end:?}");
    drop(line);
    while let Some(event) = soon(events.next()).await {
        let online = Presence::Online;
        assert!(!matches!(
            event,
            railbus_host::LineEvent::Bus(railbus_host::Event::Presence { presence, .. })
                if presence == online
        ));
    }
}
