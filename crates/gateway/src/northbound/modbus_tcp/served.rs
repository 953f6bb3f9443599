//! The server over sockets: what one client does holds up no other, and not its end.

use crate::northbound::stage::{OutletStage, PATIENCE, folder, free_address};
use crate::northbound::supervisor::{OutletId, Supervised};
use railbus_api::outlets::OutletState;
use std::io::{Read as _, Write as _};
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;
use std::thread;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::sync::mpsc;

/// A site whose line can't be opened: its values are not known.
const SITE: &str = "[line.main]\nport = \"/dev/ttyS99\"\n[module.oven]\nline = \"main\"\n\
    model = \"erc8\"\naddress = 3\n";
/// A read of the first coil of unit 3, and that it can't be told: it was never read, or its line is
/// not there.
const READ: [u8; 12] = [0, 7, 0, 0, 0, 6, 3, 1, 0, 60, 0, 1];
const REFUSED: [u8; 8] = [0, 7, 0, 0, 0, 3, 3, 0x81];
/// Behind it in a site: settings of the outlet.
pub(super) const MORE: &str = "# outlet\n";

/// How many answers to others may come before one, where they are many: what two clients are
/// answered in a few turns, and what they take while this thread waits for the processor.
const TURN_MAX: usize = 50_000;

pub(super) struct Served {
    pub(super) stage: OutletStage,
    at: SocketAddr,
}

impl Served {
    pub(super) async fn start(name: &str) -> Served {
        Served::start_with(name, |_| SITE.to_owned()).await
    }

    /// The same with another site, and more settings at its end; it may have files in the folder.
    pub(super) async fn start_with(name: &str, site: impl FnOnce(&Path) -> String) -> Served {
        let (at, folder) = (free_address().await, folder(&format!("modbus-{name}")));
        let text = with_outlet(&site(&folder), at);
        let stage = OutletStage::running(folder, &text);
        Served { stage, at }
    }

    /// Waits until this is true of the outlet.
    pub(super) async fn until(&self, is_so: impl Fn(&Supervised) -> bool) {
        let id = OutletId {
            kind: super::KIND.name,
            name: "scada".to_owned(),
        };
        self.stage.until(&id, is_so).await;
    }

    /// A connection, as soon as the server listens.
    pub(super) async fn connect(&self) -> TcpStream {
        self.until(|outlet| outlet.state() == OutletState::Running)
            .await;
        TcpStream::connect(self.at).await.unwrap()
    }

    /// Brings a configuration into force that nobody has checked, as where a module has moved.
    async fn reload(&self, text: &str) {
        self.stage.reload(&with_outlet(text, self.at)).await;
    }
}

/// A site and the outlet; the settings of the outlet that stand behind the site are kept.
fn with_outlet(site: &str, at: SocketAddr) -> String {
    let (site, more) = site.split_once(MORE).unwrap_or((site, ""));
    format!("{site}[outlet.scada]\ntype = \"modbus_tcp\"\nlisten = \"{at}\"\n{more}")
}

async fn read(stream: &mut TcpStream) -> [u8; 9] {
    let mut answer = [0; 9];
    stream.write_all(&READ).await.unwrap();
    let read = stream.read_exact(&mut answer);
    tokio::time::timeout(PATIENCE, read).await.unwrap().unwrap();
    answer
}

/// It sends without a pause, and takes every answer.
#[tokio::test]
async fn a_flooding_client_does_not_block_others() {
    let served = Served::start("floods").await;
    let (mut flood, answered) = (Vec::new(), Arc::new(AtomicUsize::new(0)));
    let (begins, mut began) = mpsc::unbounded_channel();
    for _ in 0..2 {
        let stream = served.connect().await.into_std().unwrap();
        stream.set_nonblocking(false).unwrap();
        let (mut from, mut to) = (stream.try_clone().unwrap(), stream);
        let begins = begins.clone();
        let (requests, count) = (READ.repeat(300), Arc::clone(&answered));
        flood.push(thread::spawn(
            move || {
                while to.write_all(&requests).is_ok() {}
            },
        ));
        flood.push(thread::spawn(move || {
            let mut answers = vec![0; 64 * 1024];
            assert!(from.read(&mut answers).unwrap() > 0);
            begins.send(()).unwrap();
            while let Ok(len @ 1..) = from.read(&mut answers) {
                count.fetch_add(len / (REFUSED.len() + 1), Relaxed);
            }
        }));
    }
    let mut other = served.connect().await;
    for _ in 0..2 {
        began.recv().await.unwrap();
    }
    let mut before_it = Vec::new();
    for _ in 0..21 {
        let before = answered.load(Relaxed);
        assert!(read(&mut other).await.starts_with(&REFUSED));
        before_it.push(answered.load(Relaxed) - before);
    }
    before_it.sort_unstable();
    // In its turn: not behind all that the others send.
    assert!(before_it[10] < TURN_MAX, "{before_it:?}");
    // It is to stop within a second, or is left alone and goes on answering.
    served.stage.northbound.close().await;
    let mut byte = [0];
    let end = tokio::time::timeout(PATIENCE, other.read(&mut byte)).await;
    assert!(matches!(end, Ok(Ok(0) | Err(_))), "{end:?}");
    for each in flood {
        each.join().unwrap();
    }
}

#[tokio::test]
async fn no_more_than_eight_of_one_address_are_served() {
    let served = Served::start("many").await;
    let mut served_ones = Vec::new();
    for _ in 0..8 {
        let mut stream = served.connect().await;
        assert!(read(&mut stream).await.starts_with(&REFUSED));
        served_ones.push(stream);
    }
    let mut ninth = served.connect().await;
    let mut byte = [0];
    let end = tokio::time::timeout(PATIENCE, ninth.read(&mut byte)).await;
    assert!(matches!(end, Ok(Ok(0) | Err(_))), "{end:?}");
    for stream in &mut served_ones {
        assert!(read(stream).await.starts_with(&REFUSED));
    }
    drop(served_ones.pop());
    // There is room again, as soon as the server has noticed.
    let again = async {
        loop {
            let mut stream = served.connect().await;
            let mut answer = [0; 9];
            let asked = stream.write_all(&READ).await.is_ok();
            if asked && stream.read_exact(&mut answer).await.is_ok() {
                return answer;
            }
        }
    };
    let answer = tokio::time::timeout(PATIENCE, again).await.unwrap();
    assert!(answer.starts_with(&REFUSED));
    served.stage.northbound.close().await;
}

/// A module moves onto the unit of another: neither is one until they are told apart, the server
/// goes on, and says why.
#[tokio::test]
async fn two_modules_on_one_unit_are_no_unit() {
    let served = Served::start("moves").await;
    let mut client = served.connect().await;
    let code = |outlet: &Supervised| outlet.error().map(|error| error.problem.code.clone());
    let other = |address: u8| {
        format!(
            "{SITE}[line.far]\nport = \"/dev/ttyS98\"\n[module.pump]\nline = \"far\"\n\
             model = \"erc8\"\naddress = {address}\n"
        )
    };
    assert_eq!(identified(&mut client, 3).await, [0x2B, 0x0E]);
    served.reload(&other(3)).await;
    served
        .until(|outlet| code(outlet).as_deref() == Some("E0887"))
        .await;
    assert_eq!(identified(&mut client, 3).await, [0xAB, 0x0A]);
    served.reload(&other(4)).await;
    served
        .until(|outlet| outlet.state() == OutletState::Running)
        .await;
    for unit in [3, 4] {
        assert_eq!(identified(&mut client, unit).await, [0x2B, 0x0E]);
    }
    served.stage.northbound.close().await;
}

/// The first two bytes of what a unit says that it is: function and kind, or the exception.
async fn identified(stream: &mut TcpStream, unit: u8) -> [u8; 2] {
    let ask = [0, 9, 0, 0, 0, 5, unit, 0x2B, 0x0E, 4, 0];
    stream.write_all(&ask).await.unwrap();
    let mut header = [0; 7];
    let answered = async {
        stream.read_exact(&mut header).await.unwrap();
        let mut rest = vec![0; usize::from(header[5]) - 1];
        stream.read_exact(&mut rest).await.unwrap();
        [rest[0], rest[1]]
    };
    tokio::time::timeout(PATIENCE, answered).await.unwrap()
}
