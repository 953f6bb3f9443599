//! The gateway over sockets, in front of the simulated line of the demo, which other protocols are
//! spoken on, too.

use crate::northbound::stage::{OutletStage, PATIENCE, folder, free_address};
use crate::northbound::supervisor::OutletId;
use railbus_host::Fault;
use railbus_plant::background::Background;
use railbus_plant::remote::Remote;
use railbus_site::{PointQuality, PointValue, RawTerms, Service};
use railbus_wire::mbap::{self, Message};
use railbus_wire::{Decoded, Exchange};
use railbus_words::Lang;
use std::net::SocketAddr;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;

const OVEN: u8 = 3;
const TANK: u8 = 5;
const COILS: [u8; 5] = [1, 0, 60, 0, 8];

struct Served {
    line: Option<Background>,
    stage: OutletStage,
    at: SocketAddr,
}

impl Served {
    async fn start(name: &str, more: &str) -> Served {
        let (at, folder) = (free_address().await, folder(&format!("line-{name}")));
        let line = Background::start(Lang::En, folder.join("line")).unwrap();
        let port = format!("pty:{}", line.path().display());
        let text = railbus_plant::demo::text(&port);
        let kind = super::KIND.name;
        let outlet = format!(
            "[outlet.tool]\ntype = \"{kind}\"\nline = \"main\"\nlisten = \"{at}\"\n{more}\n"
        );
        let stage = OutletStage::running(folder, &format!("{text}{outlet}"));
        let line = Some(line);
        let served = Served { line, stage, at };
        served.until_good("oven").await;
        served
    }

    /// Waits until this is so; it is looked at whenever something has happened at the site.
    async fn until(&self, is_so: impl Fn(&Service) -> bool) {
        let mut site = self.stage.service.follow();
        let looks = async {
            while !is_so(&self.stage.service) {
                site.next().await.unwrap();
            }
        };
        tokio::time::timeout(PATIENCE, looks).await.unwrap();
    }

    async fn until_good(&self, module: &str) {
        let is_good = |service: &Service| {
            let (_, points) = service.points_now(module);
            points
                .iter()
                .all(|point| point.quality == PointQuality::Good)
        };
        self.until(is_good).await;
    }

    /// The outputs of the oven as the site has them.
    fn outputs(&self) -> Vec<bool> {
        let (_, points) = self.stage.service.points_now("oven");
        let values = points.iter().map(|point| point.value);
        values
            .map(|value| value == Some(PointValue::Bool(true)))
            .collect()
    }

    async fn connect(&self) -> TcpStream {
        let id = OutletId {
            kind: super::KIND.name,
            name: "tool".to_owned(),
        };
        self.stage.until_running(&id).await;
        TcpStream::connect(self.at).await.unwrap()
    }

    async fn order(&self, text: &str) {
        let remote = self.line.as_ref().unwrap().remote();
        let wanted = remote.read(Lang::En, text).unwrap().unwrap();
        remote.order(vec![wanted]).await.unwrap();
    }

    async fn unplug(&self) {
        let remote = self.line.as_ref().unwrap().remote();
        remote.order(vec![Remote::plug(false)]).await.unwrap();
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        drop(self.line.take());
    }
}

async fn send(stream: &mut TcpStream, transaction: u16, unit: u8, pdu: &[u8]) {
    let mut request = mbap::header(transaction, 1 + pdu.len()).to_vec();
    request.push(unit);
    request.extend_from_slice(pdu);
    stream.write_all(&request).await.unwrap();
}

/// The next answer: transaction, unit, and what follows.
async fn next(stream: &mut TcpStream) -> (u16, u8, Vec<u8>) {
    let mut received = vec![0; mbap::HEADER];
    let answer = async {
        stream.read_exact(&mut received).await.unwrap();
        let mut rest = vec![0; usize::from(received[5])];
        stream.read_exact(&mut rest).await.unwrap();
        received.extend(rest);
    };
    tokio::time::timeout(PATIENCE, answer).await.unwrap();
    match Message::decode(&received) {
        Decoded::Whole { value, .. } => (value.transaction, value.unit.0, value.pdu.to_vec()),
        other => panic!("{other:?}"),
    }
}

async fn ask(stream: &mut TcpStream, unit: u8, pdu: &[u8]) -> Vec<u8> {
    send(stream, 0x1234, unit, pdu).await;
    let (transaction, of, answer) = next(stream).await;
    assert_eq!((transaction, of), (0x1234, unit));
    answer
}

/// What a unit that has power answers. A machine that does not get round to the simulator makes it
/// silent, which is said as such.
async fn value(stream: &mut TcpStream, unit: u8, pdu: &[u8]) -> Vec<u8> {
    loop {
        match ask(stream, unit, pdu).await {
            silent if silent == [pdu[0] | 0x80, 11] => {}
            answer => return answer,
        }
    }
}

#[tokio::test]
async fn a_master_reads_and_switches_beside_polling() {
    let served = Served::start("switches", "write = [\"oven.k1\"]").await;
    let mut master = served.connect().await;
    assert_eq!(value(&mut master, OVEN, &COILS).await, [1, 1, 0]);
    let on = ask(&mut master, OVEN, &[5, 0, 60, 0xFF, 0]).await;
    assert_eq!(on, [5, 0, 60, 0xFF, 0]);
    // By the time of the answer the site has read it back.
    assert!(served.outputs()[0]);
    assert_eq!(value(&mut master, OVEN, &COILS).await, [1, 1, 1]);
    // Without rights; a register of settings; all modules at once.
    assert_eq!(
        ask(&mut master, OVEN, &[5, 0, 61, 0xFF, 0]).await,
        [0x85, 1]
    );
    assert_eq!(ask(&mut master, OVEN, &[6, 0, 4, 0, 9]).await, [0x86, 1]);
    assert_eq!(ask(&mut master, 0, &[5, 0, 61, 0xFF, 0]).await, [0x85, 1]);
    assert_eq!(value(&mut master, OVEN, &COILS).await, [1, 1, 1]);
    // Registers that are in no map, as the module has them: this one says no by itself.
    let own = value(&mut master, OVEN, &[4, 0, 0, 0, 1]).await;
    assert_eq!(own[0], 0x84, "{own:?}");
    assert_eq!(
        value(&mut master, TANK, &[3, 0, 6, 0, 2]).await[..2],
        [3, 4]
    );
    served.stage.northbound.close().await;
}

#[tokio::test]
async fn a_dead_unit_and_a_line_that_has_gone_are_said_as_such() {
    let served = Served::start("dead", "").await;
    let mut master = served.connect().await;
    assert_eq!(value(&mut master, OVEN, &COILS).await, [1, 1, 0]);
    assert_eq!(
        ask(&mut master, OVEN, &[5, 0, 60, 0xFF, 0]).await,
        [0x85, 1]
    );
    served.order("power oven off").await;
    // A unit that does not exist is not answered either; others are.
    send(&mut master, 1, OVEN, &COILS).await;
    send(&mut master, 2, 77, &COILS).await;
    send(&mut master, 3, TANK, &[3, 0, 6, 0, 2]).await;
    let mut answers = Vec::new();
    for _ in 0..3 {
        let (transaction, _, answer) = next(&mut master).await;
        answers.push((transaction, answer[..2].to_vec()));
    }
    answers.sort();
    let want = [(1, vec![0x81, 11]), (2, vec![0x81, 11]), (3, vec![3, 4])];
    assert_eq!(answers, want);
    served.order("power oven on").await;
    served.until_good("oven").await;
    let again = async { while value(&mut master, OVEN, &COILS).await != [1, 1, 0] {} };
    tokio::time::timeout(PATIENCE, again).await.unwrap();
    served.unplug().await;
    let gone = async {
        loop {
            match ask(&mut master, TANK, &[3, 0, 6, 0, 2]).await[..] {
                [0x83, 10] => return,
                // The line has not noticed yet.
                [3, ..] | [0x83, 11] => {}
                ref other => panic!("{other:?}"),
            }
        }
    };
    tokio::time::timeout(PATIENCE, gone).await.unwrap();
    served.stage.northbound.close().await;
}

#[tokio::test]
async fn the_site_sends_no_write_as_a_read() {
    let served = Served::start("writes", "").await;
    let mut frame = vec![OVEN, 5, 0, 60, 0xFF, 0];
    frame.extend(railbus_wire::crc16(&frame).to_le_bytes());
    let write = railbus_commission::request(railbus_wire::Protocol::Rtu, &frame).unwrap();
    let end = served
        .stage
        .service
        .read_for_master("main", write, RawTerms::default());
    assert_eq!(end.await, Err(Fault::Unsupported.into()));
    let mut master = served.connect().await;
    assert_eq!(value(&mut master, OVEN, &COILS).await, [1, 1, 0]);
    served.stage.northbound.close().await;
}

/// A read of unit 85 can be, byte by byte, a command of a 0x55 board: it is not sent on a line with
/// such a board.
#[tokio::test]
async fn what_another_module_would_obey_is_not_sent() {
    let served = Served::start("foreign", "").await;
    let mut master = served.connect().await;
    // 55 01 12 .. .. .. .. SUM: "switch on" of board 1.
    let is_command = |pdu: &[u8]| {
        let mut frame = [&[85][..], pdu].concat();
        frame.extend(railbus_wire::crc16(&frame).to_le_bytes());
        let read = railbus_commission::request(railbus_wire::Protocol::Rtu, &frame);
        assert!(matches!(read, Some(Exchange::Rtu(_))));
        railbus_wire::carries_command(&frame, railbus_wire::Protocol::R55)
    };
    let mut reads = (0..=255).flat_map(|low| (1..=200).map(move |count| [1, 0x12, low, 0, count]));
    let found = reads.find(|pdu| is_command(pdu)).unwrap();
    assert_eq!(ask(&mut master, 85, &found).await, [0x81, 1]);
    // The site refuses it before the line sees it: also where no such board is configured.
    let mut frame = [&[85][..], &found].concat();
    frame.extend(railbus_wire::crc16(&frame).to_le_bytes());
    let read = railbus_commission::request(railbus_wire::Protocol::Rtu, &frame).unwrap();
    let terms = RawTerms::default();
    let end = served
        .stage
        .service
        .read_for_master("main", read, terms)
        .await;
    assert_eq!(end, Err(Fault::Unsupported.into()));
    served.stage.northbound.close().await;
}
