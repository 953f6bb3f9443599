//! Whether the other side has read what we wrote.
#![allow(unsafe_code, reason = "the kernel writes the number that is asked for")]

use rustix::ioctl::{Getter, Opcode, ioctl};
use std::ffi::c_int;
use std::io;
use std::os::unix::net::UnixStream;

/// `SIOCOUTQ` of the kernel's `linux/sockios.h`.
const OUTQ: Opcode = 0x5411;

/// Whether the other side has read the last byte that we wrote.
pub(crate) fn is_taken(line: &UnixStream) -> io::Result<bool> {
    // SAFETY: this request of a socket writes one `int`, and reads nothing.
    let left = unsafe { ioctl(line, Getter::<OUTQ, c_int>::new()) };
    Ok(left? == 0)
}

#[cfg(test)]
mod tests {
    use super::is_taken;
    use std::io::{Read, Write};
    use std::os::unix::net::UnixStream;

    #[test]
    fn the_last_byte_counts() {
        let (mut ours, mut theirs) = UnixStream::pair().expect("a pair");
        assert!(is_taken(&ours).expect("a socket"));
        ours.write_all(b"$016\r").expect("there is room");
        theirs.read_exact(&mut [0; 4]).expect("they are there");
        assert!(!is_taken(&ours).expect("a socket"));
        theirs.read_exact(&mut [0]).expect("it is there");
        assert!(is_taken(&ours).expect("a socket"));
    }
}
