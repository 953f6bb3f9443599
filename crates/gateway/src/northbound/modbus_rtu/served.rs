//! The slave at a real terminal: asked by a master, unplugged and plugged in again.

use super::server;
use crate::northbound::stage::{OutletStage, PATIENCE, folder};
use crate::northbound::supervisor::{OutletId, Supervised};
use railbus_api::outlets::OutletState;
use railbus_store::audit::Origin;
use railbus_wire::crc16;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::fs::File;
use std::io::{Read as _, Write as _};
use std::os::unix::ffi::OsStringExt as _;
use std::path::{Path, PathBuf};

/// A site whose line can't be opened: its values are not known.
const SITE: &str = "[line.main]\nport = \"/dev/ttyS99\"\n[module.oven]\nline = \"main\"\n\
    model = \"erc8\"\naddress = 3\n";

/// The far end of a new terminal, to which a link leads.
fn plugged_in(link: &Path) -> File {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let path = ptsname(&master, Vec::new()).unwrap().into_bytes();
    let _ = std::fs::remove_file(link);
    std::os::unix::fs::symlink(std::ffi::OsString::from_vec(path), link).unwrap();
    master.into()
}

struct Served {
    stage: OutletStage,
}

impl Served {
    fn start(name: &str) -> (Served, PathBuf) {
        let folder = folder(&format!("rtu-{name}"));
        let link = folder.join("plc");
        let outlet = format!(
            "[outlet.plc]\ntype = \"modbus_rtu\"\nport = \"{}\"\n",
            link.display()
        );
        let stage = OutletStage::new(folder, &format!("{SITE}{outlet}"));
        (Served { stage }, link)
    }

    fn run(&self) {
        self.stage.run();
    }

    fn id() -> OutletId {
        OutletId {
            kind: super::KIND.name,
            name: "plc".to_owned(),
        }
    }

    /// Waits until this is true of the outlet.
    async fn until(&self, is_so: impl Fn(&Supervised) -> bool) {
        self.stage.until(&Served::id(), is_so).await;
    }

    async fn until_open(&self) {
        self.until(|outlet| outlet.state() == OutletState::Running)
            .await;
    }

    /// What the test of the outlet says.
    async fn tested(&self) -> Result<String, String> {
        let (id, by) = (Served::id(), Origin::program("tests"));
        let end = self
            .stage
            .northbound
            .aside(&id, by, |outlet| Box::pin(server::test(outlet)))
            .await;
        end.unwrap().map_err(|problem| problem.text("reason"))
    }
}

/// A request, and its answer of this length.
async fn asked(master: &File, pdu: &[u8], len: usize) -> Vec<u8> {
    let mut frame = [&[3][..], pdu].concat();
    let crc = crc16(&frame).to_le_bytes();
    frame.extend(crc);
    let mut line = master.try_clone().unwrap();
    let answered = tokio::task::spawn_blocking(move || {
        line.write_all(&frame).unwrap();
        let mut answer = vec![0; len];
        line.read_exact(&mut answer).unwrap();
        answer
    });
    let answer = tokio::time::timeout(PATIENCE, answered)
        .await
        .unwrap()
        .unwrap();
    assert_eq!((answer[0], crc16(&answer)), (3, 0));
    answer[1..len - 2].to_vec()
}

#[tokio::test]
async fn a_master_is_answered_and_a_port_that_was_gone_is_opened_again() {
    let (served, link) = Served::start("again");
    served.run();
    let reason = |outlet: &Supervised| outlet.error().map(|error| error.problem.text("reason"));
    served
        .until(|outlet| reason(outlet).as_deref() == Some("missing"))
        .await;
    assert_eq!(served.tested().await, Err("missing".to_owned()));
    let master = plugged_in(&link);
    served.until_open().await;
    assert_eq!(asked(&master, &[1, 0, 60, 0, 8], 5).await, [0x81, 0x0A]);
    assert_eq!(asked(&master, &[4, 0, 64, 0, 1], 7).await, [4, 2, 0, 4]);
    // Without rights, and it may be that the line is found out to be missing first.
    assert_eq!(asked(&master, &[5, 0, 60, 0xFF, 0], 5).await, [0x85, 2]);
    let said = served.tested().await.unwrap();
    assert!(said.contains("is open, 9600 8N1; requests: 3"), "{said}");
    drop(master);
    served
        .until(|outlet| reason(outlet).as_deref() == Some("gone"))
        .await;
    let master = plugged_in(&link);
    served.until_open().await;
    // What happened to the unit is still known.
    assert_eq!(
        asked(&master, &[4, 0, 68, 0, 2], 9).await,
        [4, 4, 0, 1, 0, 5]
    );
    served.stage.northbound.close().await;
}

/// It is opened for a test only where nothing runs that has it.
#[tokio::test]
async fn a_port_that_another_program_has_is_no_slaves() {
    let (served, link) = Served::start("busy");
    let _master = plugged_in(&link);
    let options = railbus_host::SerialOptions::default();
    let mut other = railbus_host::SerialPort::new(link, options);
    railbus_host::Port::open(&mut other).await.unwrap();
    served.run();
    served.until(|outlet| outlet.error().is_some()).await;
    assert_eq!(served.tested().await, Err("busy".to_owned()));
    drop(other);
    served.until_open().await;
    assert!(served.tested().await.is_ok());
    served.stage.northbound.close().await;
}
