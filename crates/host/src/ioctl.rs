//! Serial port requests that no library wraps, and waiting on descriptors. The only file with
//! `unsafe`.
#![allow(
    unsafe_code,
    reason = "the kernel reads and writes what these requests point to"
)]

use rustix::fd::{AsFd, OwnedFd};
use rustix::io;
use rustix::ioctl::{Getter, Opcode, Setter, ioctl, opcode};
use std::ffi::{c_int, c_uchar, c_uint, c_ulong, c_ushort};
use tokio::io::Interest;
use tokio::io::unix::AsyncFd;

/// Numbers from the kernel's `asm-generic/ioctls.h`, which these architectures share.
#[cfg(not(any(
    target_arch = "x86",
    target_arch = "x86_64",
    target_arch = "arm",
    target_arch = "aarch64",
    target_arch = "riscv32",
    target_arch = "riscv64",
    target_arch = "loongarch64",
)))]
compile_error!("the numbers of serial port requests are not known for this architecture");

const TIOCMBIC: Opcode = 0x5417;
const TIOCGSERIAL: Opcode = 0x541E;
const TIOCSSERIAL: Opcode = 0x541F;
const TIOCGRS485: Opcode = 0x542E;
const TIOCSRS485: Opcode = 0x542F;
const TIOCGEXCL: Opcode = opcode::read::<c_int>(b'T', 0x40);

const TIOCM_RTS: c_int = 0x004;
const ASYNC_LOW_LATENCY: c_int = 1 << 13;

/// `struct serial_struct` of the kernel's `linux/serial.h`.
#[repr(C)]
struct SerialStruct {
    kind: c_int,
    line: c_int,
    port: c_uint,
    irq: c_int,
    flags: c_int,
    xmit_fifo_size: c_int,
    custom_divisor: c_int,
    baud_base: c_int,
    close_delay: c_ushort,
    io_type: c_uchar,
    reserved_char: c_uchar,
    hub6: c_int,
    closing_wait: c_ushort,
    closing_wait2: c_ushort,
    iomem_base: *mut c_uchar,
    iomem_reg_shift: c_ushort,
    port_high: c_uint,
    iomap_base: c_ulong,
}

/// `struct serial_rs485` of the kernel's `linux/serial.h`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct SerialRs485 {
    pub(crate) flags: u32,
    pub(crate) delay_rts_before_send: u32,
    pub(crate) delay_rts_after_send: u32,
    /// Addresses for some controllers, and padding.
    pub(crate) rest: [u32; 5],
}

/// Bits of [`SerialRs485::flags`].
pub(crate) const RS485_ENABLED: u32 = 1 << 0;
pub(crate) const RS485_RTS_ON_SEND: u32 = 1 << 1;
pub(crate) const RS485_RTS_AFTER_SEND: u32 = 1 << 2;
pub(crate) const RS485_RX_DURING_TX: u32 = 1 << 4;
pub(crate) const RS485_TERMINATE_BUS: u32 = 1 << 5;

/// Registers a descriptor with the runtime for reading.
pub(crate) fn watch(fd: OwnedFd) -> std::io::Result<AsyncFd<OwnedFd>> {
    // SAFETY: an `OwnedFd` is open as long as it lives, and always the same.
    Ok(unsafe { AsyncFd::register_with_interest(fd, Interest::READABLE) }?)
}

/// Whether further opening is forbidden (TIOCGEXCL).
pub(crate) fn is_exclusive(port: impl AsFd) -> io::Result<bool> {
    // SAFETY: the request writes one int.
    let exclusive = unsafe { ioctl(port, Getter::<TIOCGEXCL, c_int>::new()) }?;
    Ok(exclusive != 0)
}

/// Lowers RTS, with which some adapters drive the line (TIOCMBIC).
pub(crate) fn lower_rts(port: impl AsFd) -> io::Result<()> {
    // SAFETY: the request reads one int.
    unsafe { ioctl(port, Setter::<TIOCMBIC, c_int>::new(TIOCM_RTS)) }
}

/// Asks the driver to pass bytes on at once (ASYNC_LOW_LATENCY); whether it confirms that. FTDI
/// adapters otherwise hold them back for up to 16 ms.
pub(crate) fn set_low_latency(port: impl AsFd) -> io::Result<bool> {
    let mut serial = serial_struct(&port)?;
    if serial.flags & ASYNC_LOW_LATENCY != 0 {
        return Ok(true);
    }
    serial.flags |= ASYNC_LOW_LATENCY;
    // SAFETY: the request reads one `serial_struct`, which is what the kernel gave us but for
    // one flag.
    unsafe { ioctl(&port, Setter::<TIOCSSERIAL, SerialStruct>::new(serial)) }?;
    Ok(serial_struct(&port)?.flags & ASYNC_LOW_LATENCY != 0)
}

fn serial_struct(port: impl AsFd) -> io::Result<SerialStruct> {
    // SAFETY: the request writes one `serial_struct`.
    unsafe { ioctl(port, Getter::<TIOCGSERIAL, SerialStruct>::new()) }
}

/// How the driver currently switches the transceiver's direction (TIOCGRS485).
pub(crate) fn rs485(port: impl AsFd) -> io::Result<SerialRs485> {
    // SAFETY: the request writes one `serial_rs485`.
    unsafe { ioctl(port, Getter::<TIOCGRS485, SerialRs485>::new()) }
}

/// Makes the driver switch the transceiver's direction by RTS (TIOCSRS485).
pub(crate) fn set_rs485(port: impl AsFd, wanted: SerialRs485) -> io::Result<()> {
    // SAFETY: the request reads and writes one `serial_rs485`, of which `Setter` owns a copy.
    unsafe { ioctl(port, Rs485Request(wanted)) }
}

/// The kernel writes back what it applied, so a plain `Setter` does not do.
struct Rs485Request(SerialRs485);

// SAFETY: the pointer is to a whole `serial_rs485` that lives as long as the request.
unsafe impl rustix::ioctl::Ioctl for Rs485Request {
    type Output = ();
    const IS_MUTATING: bool = true;

    fn opcode(&self) -> Opcode {
        TIOCSRS485
    }

    fn as_ptr(&mut self) -> *mut std::ffi::c_void {
        (&raw mut self.0).cast()
    }

    unsafe fn output_from_ptr(
        _: rustix::ioctl::IoctlOutput,
        _: *mut std::ffi::c_void,
    ) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn structures_are_as_long_as_the_kernels() {
        assert_eq!(size_of::<SerialRs485>(), 32);
        if cfg!(target_pointer_width = "64") {
            assert_eq!(size_of::<SerialStruct>(), 72);
        }
    }
}
