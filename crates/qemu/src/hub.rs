//! One half-duplex line: what one member says, all others hear that have the same speed.

use std::io::{Read, Write};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Whose turn it is when a speed is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// The member's own.
    Speaks,
    /// Another one's.
    Hears,
}

/// Who is on the line.
struct Member {
    hears: Box<dyn Write + Send>,
    /// Its speed in baud, where anybody knows it.
    speed: Box<dyn FnMut(Turn) -> Option<u32> + Send>,
}

/// A line. Members keep their places; who has left leaves an empty one.
#[derive(Clone, Default)]
pub struct Hub {
    members: Arc<Mutex<Vec<Option<Member>>>>,
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

    /// Somebody joins, and leaves when nothing more can come from them.
    pub fn join(
        &self,
        mut says: impl Read + Send + 'static,
        hears: impl Write + Send + 'static,
        speed: impl FnMut(Turn) -> Option<u32> + Send + 'static,
    ) {
        let mut members = self.members();
        let own = members.len();
        members.push(Some(Member {
            hears: Box::new(hears),
            speed: Box::new(speed),
        }));
        let hub = self.clone();
        std::thread::spawn(move || {
            let mut buffer = [0; 512];
            while let Ok(count @ 1..) = says.read(&mut buffer) {
                hub.broadcast(own, &buffer[..count]);
            }
            hub.members()[own] = None;
        });
    }

    fn broadcast(&self, from: usize, bytes: &[u8]) {
        let mut members = self.members();
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
            if understood && member.hears.write_all(bytes).is_err() {
                *slot = None;
            }
        }
    }

    fn members(&self) -> MutexGuard<'_, Vec<Option<Member>>> {
        self.members.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Whether receivers at these speeds understand each other: 4 % are too many.
const fn is_same(one: u32, other: u32) -> bool {
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
        // 25 MHz by a whole number is not quite 9600.
        let mut members = [member(&hub, 9600), member(&hub, 9601), member(&hub, 19200)];
        members[0].write_all(b"x").expect("it is heard");
        members[1].read_exact(&mut [0]).expect("it hears");
        members[2].set_nonblocking(true).expect("a socket");
        assert!(members[2].read(&mut [0]).is_err());
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
