//! One half-duplex line: what one member sends, all others at the same speed receive.

use std::io::{Read, Write};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Which member's speed is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// The sender's.
    Speaks,
    /// A receiver's.
    Hears,
}

/// A member of the line.
struct Member {
    hears: Box<dyn Write + Send>,
    /// Its speed in baud, if known.
    speed: Box<dyn FnMut(Turn) -> Option<u32> + Send>,
}

/// Noise between the members.
type Noise = Box<dyn FnMut(&mut Vec<u8>) + Send>;

/// Members keep their index; one that has left leaves an empty slot.
#[derive(Default)]
struct Wire {
    members: Vec<Option<Member>>,
    noise: Option<Noise>,
}

/// A line.
#[derive(Clone, Default)]
pub struct Hub {
    wire: Arc<Mutex<Wire>>,
}

impl std::fmt::Debug for Hub {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Hub").finish_non_exhaustive()
    }
}

impl Hub {
    /// A line without members.
    #[must_use]
    pub fn new() -> Hub {
        Hub::default()
    }

    /// Joins a member, which leaves when nothing more can come from it.
    pub fn join(
        &self,
        mut says: impl Read + Send + 'static,
        hears: impl Write + Send + 'static,
        speed: impl FnMut(Turn) -> Option<u32> + Send + 'static,
    ) {
        let mut wire = self.wire();
        let own = wire.members.len();
        wire.members.push(Some(Member {
            hears: Box::new(hears),
            speed: Box::new(speed),
        }));
        let hub = self.clone();
        std::thread::spawn(move || {
            let mut buffer = [0; 512];
            while let Ok(count @ 1..) = says.read(&mut buffer) {
                hub.broadcast(own, &buffer[..count]);
            }
            hub.wire().members[own] = None;
        });
    }

    /// Passes everything sent from now on through this function, which may corrupt it.
    pub fn disturb(&self, noise: impl FnMut(&mut Vec<u8>) + Send + 'static) {
        self.wire().noise = Some(Box::new(noise));
    }

    fn broadcast(&self, from: usize, bytes: &[u8]) {
        let mut wire = self.wire();
        let Wire { members, noise } = &mut *wire;
        let mut bytes = bytes.to_vec();
        if let Some(noise) = noise {
            noise(&mut bytes);
        }
        let speed = members[from]
            .as_mut()
            .and_then(|member| (member.speed)(Turn::Speaks));
        let others = members.iter_mut().enumerate().filter(|(at, _)| *at != from);
        for (_, slot) in others {
            let Some(member) = slot else { continue };
            let understood = match (speed, (member.speed)(Turn::Hears)) {
                (Some(one), Some(other)) => is_same(one, other),
                _ => false,
            };
            if understood && member.hears.write_all(&bytes).is_err() {
                *slot = None;
            }
        }
    }

    fn wire(&self) -> MutexGuard<'_, Wire> {
        self.wire.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Whether receivers at these speeds understand each other: less than 4 % apart.
pub(crate) const fn is_same(one: u32, other: u32) -> bool {
    one.abs_diff(other) < one / 25
}

#[cfg(test)]
mod tests {
    use super::Hub;
    use std::io::{Read, Write};
    use std::os::unix::net::UnixStream;

    fn member(hub: &Hub, speed: u32) -> UnixStream {
        let (ours, theirs) = UnixStream::pair().expect("a pair");
        hub.join(
            theirs.try_clone().expect("a second handle"),
            theirs,
            move |_| Some(speed),
        );
        ours
    }

    #[test]
    fn what_one_says_all_others_hear() {
        let hub = Hub::new();
        let mut members = [member(&hub, 9600), member(&hub, 9600), member(&hub, 9600)];
        members[1].write_all(b"$016\r").expect("it is heard");
        for at in [0, 2] {
            let mut heard = [0; 5];
            members[at].read_exact(&mut heard).expect("it hears");
            assert_eq!(&heard, b"$016\r");
        }
        members[1].set_nonblocking(true).expect("a socket");
        assert!(members[1].read(&mut [0]).is_err(), "not its own words");
    }

    #[test]
    fn who_has_another_speed_does_not_understand() {
        let hub = Hub::new();
        // A division of 25 MHz by an integer is not exactly 9600.
        let mut members = [member(&hub, 9600), member(&hub, 9601), member(&hub, 19200)];
        members[0].write_all(b"x").expect("it is heard");
        members[1].read_exact(&mut [0]).expect("it hears");
        members[2].set_nonblocking(true).expect("a socket");
        assert!(members[2].read(&mut [0]).is_err());
    }

    #[test]
    fn what_disturbs_the_line_spoils_what_is_heard() {
        let hub = Hub::new();
        let mut members = [member(&hub, 9600), member(&hub, 9600)];
        hub.disturb(|bytes| bytes.retain(|byte| *byte != b'1'));
        members[0].write_all(b"$016\r").expect("it is heard");
        let mut heard = [0; 4];
        members[1].read_exact(&mut heard).expect("it hears");
        assert_eq!(&heard, b"$06\r");
    }

    #[test]
    fn who_leaves_holds_nobody_up() {
        let hub = Hub::new();
        let (first, mut second, mut third) =
            (member(&hub, 9600), member(&hub, 9600), member(&hub, 9600));
        drop(first);
        for _ in 0..100 {
            second.write_all(b"x").expect("it is heard");
            third.read_exact(&mut [0]).expect("it hears");
        }
    }
}
