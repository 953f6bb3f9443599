//! An adapter with a relay board on its line: a pseudo-terminal under a stable name, whatever its
//! number is.

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::OwnedFd;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::symlink;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// The other end of a new pseudo-terminal, and its name.
pub(crate) fn terminal() -> (OwnedFd, PathBuf) {
    let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
    let master = openpt(flags).expect("a terminal");
    grantpt(&master).expect("it is ours");
    unlockpt(&master).expect("it is ours");
    let name = ptsname(&master, Vec::new()).expect("a name");
    let name = PathBuf::from(std::ffi::OsStr::from_bytes(name.as_bytes()));
    (master, name)
}

/// An adapter that is plugged in. It is pulled out when this is dropped.
pub(crate) struct Adapter {
    link: PathBuf,
    /// Which terminal it is this time.
    pub(crate) device: PathBuf,
    pulled: Arc<AtomicBool>,
    board: Option<JoinHandle<()>>,
}

impl Adapter {
    pub(crate) fn plug(link: PathBuf) -> Adapter {
        let (master, device) = terminal();
        let pulled = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&pulled);
        let board = std::thread::spawn(move || board(&master, &told));
        // As udev does it: the name appears when the device is there.
        symlink(&device, &link).expect("a link");
        Adapter {
            link,
            device,
            pulled,
            board: Some(board),
        }
    }
}

impl Drop for Adapter {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.link);
        self.pulled.store(true, Ordering::SeqCst);
        if let Some(board) = self.board.take() {
            let _ = board.join();
        }
    }
}

/// An ERC-8 at address 3: coils from 60 on, functions 01, 05 and 0F.
fn board(line: &OwnedFd, pulled: &AtomicBool) {
    let mut relays = 0_u8;
    let look_again = Timespec {
        tv_sec: 0,
        tv_nsec: 20_000_000,
    };
    while !pulled.load(Ordering::SeqCst) {
        let mut waits = [PollFd::new(line, PollFlags::IN)];
        let _ = poll(&mut waits, Some(&look_again));
        let mut request = [0; 64];
        match rustix::io::read(line, &mut request) {
            Ok(len @ 8..) => {
                let _ = rustix::io::write(line, &answer(&request[..len], &mut relays));
            }
            Ok(_) => {}
            // It is not open.
            Err(_) => std::thread::sleep(Duration::from_millis(10)),
        }
    }
}

pub(crate) fn answer(request: &[u8], relays: &mut u8) -> Vec<u8> {
    let coil = request[3].wrapping_sub(60);
    let mut reply = match request[1] {
        1 => vec![3, 1, 1, *relays >> coil],
        5 => {
            let bit = 1 << coil;
            *relays = if request[4] == 0xFF {
                *relays | bit
            } else {
                *relays & !bit
            };
            request[..6].to_vec()
        }
        15 => {
            let mask = (((1_u16 << request[5]) - 1) as u8) << coil;
            *relays = *relays & !mask | (request[7] << coil) & mask;
            request[..6].to_vec()
        }
        other => vec![3, other | 0x80, 1],
    };
    reply.extend(crc16(&reply).to_le_bytes());
    reply
}

/// The checksum of Modbus.
fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |crc, _| match crc & 1 {
            1 => crc >> 1 ^ 0xA001,
            _ => crc >> 1,
        })
    })
}
