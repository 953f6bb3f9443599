//! The ASCII protocol of the EDA modules, a part of the ADAM/DCON command set.
//!
//! `delimiter address body [checksum] CR`, with the delimiters `$ % # @ ~` in requests and `! > ?`
//! in replies [EDA §2.1]. The data reply and `>` carry no address, so they can only be decoded with
//! their request.

use crate::{Address, Frame, Malformed, PulseWidth};

mod device;
mod reply;
mod text;

pub use device::{DecodeRules, address_of};
pub use text::Text;

/// The end of every frame.
pub const CR: u8 = 0x0D;
/// The longest frame in characters, including CR; a module drops a longer one [EDA §2.9].
pub const FRAME_MAX: usize = 33;
/// The order of [`Request::WriteOutputs`] for all outputs.
pub const ALL_OUTPUTS: u8 = 0x00;
/// Bit 6 of the data format: the checksum is on [EDA §2.12].
pub const FORMAT_CHECKSUM: u8 = 0x40;
/// The type code of a digital module [EDA §2.11].
pub const TYPE_DIGITAL: u8 = 0x40;

/// A request to one module, and its reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Exchange {
    /// The module, 00 to FF. [`Request::SampleAll`] and [`Request::HostOk`] are broadcasts and
    /// carry none.
    pub address: Address,
    /// Whether frames carry a checksum; module and host must agree.
    pub checksum: bool,
    /// The request.
    pub request: Request,
}

/// A request. EDA modules support those marked so; the others are those of ADAM, ICP DAS and NuDAM
/// modules [ADAM §2].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// `$AAM`: the model's name (EDA).
    ReadName,
    /// `$AAF`: the firmware's version.
    ReadFirmware,
    /// `$AA2`: type, speed and format (EDA).
    ReadConfig,
    /// `%AANNTTCCFF`: new address, type, speed and format (EDA).
    WriteConfig {
        /// The new address.
        new_address: Address,
        /// 40 for a digital module.
        type_code: u8,
        /// The code of the speed, 03 to 07 on EDA modules.
        baud_code: u8,
        /// [`FORMAT_CHECKSUM`] or 0.
        format: u8,
    },
    /// `$AA6`: outputs and inputs (EDA).
    ReadData,
    /// `#AAoodd`: switch outputs (EDA).
    WriteOutputs {
        /// [`ALL_OUTPUTS`], or 10 to 17 for the single channel in the low digit. ICP DAS
        /// also has 0A, 0B (bytes) and A0 to B7 (channels of a byte).
        order: u8,
        /// All outputs (bit n = channel n), or 00 or 01 for one.
        data: u8,
    },
    /// `$AA3`: which outputs give pulses, and their width (EDA9060A).
    ReadPulse,
    /// `#AA4mmww`: set what `$AA3` reads (EDA9060A). Its length distinguishes it from `#AAoodd`.
    WritePulse {
        /// Bit n = channel n gives pulses.
        mask: u8,
        /// The width of all pulses.
        width: PulseWidth,
    },
    /// `$AA4`: the sample that [`Request::SampleAll`] latched.
    ReadLatched,
    /// `#**`: latch the inputs of all modules. Gets no reply.
    SampleAll,
    /// `$AA5`: has it restarted since this was last read?
    ReadReset,
    /// `$AAI`: is INIT* grounded?
    ReadInit,
    /// `@AA`: outputs and inputs as four digits.
    ReadAll,
    /// `~**`: the host is alive. Gets no reply.
    HostOk,
    /// `~AA0`: has the host watchdog tripped?
    ReadWatchdogStatus,
    /// `~AA1`: clear a tripped host watchdog.
    ClearWatchdog,
    /// `~AA2`: read the host watchdog's time.
    ReadWatchdog,
    /// `~AA3EVV`: set the host watchdog. For NuDAM modules `~AA3` means something else.
    WriteWatchdog {
        /// Enable or disable it.
        enabled: bool,
        /// The time in tenths of a second, 0 to 255.
        tenths: u8,
    },
    /// `~AA4`: read the outputs of power-on and of a tripped watchdog.
    ReadSafe,
    /// `~AA5PPSS`: set them.
    WriteSafe {
        /// Outputs at power-on, bit n = channel n.
        power_on: u8,
        /// Outputs when the host watchdog trips, bit n = channel n.
        safe: u8,
    },
    /// `~AAO(name)`: rename, 1 to 8 characters.
    Rename(Text),
}

/// A response.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Response {
    /// `!AA…` to [`Request::ReadName`] and [`Request::ReadFirmware`].
    Text(Text),
    /// `!AATTCCFF` to [`Request::ReadConfig`].
    Config {
        /// 40 for a digital module.
        type_code: u8,
        /// The code of the speed.
        baud_code: u8,
        /// Compare only bit 6, [`FORMAT_CHECKSUM`]: others use more bits.
        format: u8,
    },
    /// `!OOII00` to [`Request::ReadData`]; for modules with one kind of channel the meaning of the
    /// two bytes is in their manual.
    Data {
        /// Bit n = output n is on.
        outputs: u8,
        /// Bit n = input n is high or open.
        inputs: u8,
    },
    /// `!AAmmww` to [`Request::ReadPulse`].
    Pulse {
        /// Bit n = channel n gives pulses.
        mask: u8,
        /// The width of all pulses.
        width: PulseWidth,
    },
    /// `!SOOII00` to [`Request::ReadLatched`].
    Latched {
        /// Whether this sample is read for the first time.
        first: bool,
        /// Bit n = output n was on.
        outputs: u8,
        /// Bit n = input n was high.
        inputs: u8,
    },
    /// `!AAS` to [`Request::ReadReset`] and [`Request::ReadInit`]: the digit 0 or 1.
    Flag(bool),
    /// `!AASS` to [`Request::ReadWatchdogStatus`]; 04 is tripped.
    Status(u8),
    /// `!AAEVV` to [`Request::ReadWatchdog`].
    Watchdog {
        /// Whether it is enabled.
        enabled: bool,
        /// The time in tenths of a second.
        tenths: u8,
    },
    /// `!AAPPSS` to [`Request::ReadSafe`].
    Safe {
        /// Outputs at power-on, bit n = channel n.
        power_on: u8,
        /// Outputs when the host watchdog trips, bit n = channel n.
        safe: u8,
    },
    /// `>dddd` to [`Request::ReadAll`].
    All(u16),
    /// `>` or `!AA` to a write.
    Done,
    /// `?AA`, or `?` alone: refused. EDA modules are silent instead.
    Invalid,
    /// `!` to an output write: the module's host watchdog has tripped and it ignores writes.
    Ignored,
}

impl Request {
    /// Whether it is a broadcast, which gets no reply.
    #[must_use]
    pub const fn is_broadcast(&self) -> bool {
        matches!(self, Request::SampleAll | Request::HostOk)
    }

    /// The characters between address and checksum.
    #[inline]
    fn body(&self, out: &mut Frame) {
        match *self {
            Request::ReadName => out.push(b'M'),
            Request::ReadFirmware => out.push(b'F'),
            Request::ReadConfig | Request::ReadWatchdog => out.push(b'2'),
            Request::WriteConfig {
                new_address,
                type_code,
                baud_code,
                format,
            } => put(out, &[new_address.0, type_code, baud_code, format]),
            Request::ReadData => out.push(b'6'),
            Request::WriteOutputs { order, data } => put(out, &[order, data]),
            Request::ReadPulse => out.push(b'3'),
            Request::WritePulse { mask, width } => {
                out.push(b'4');
                put(out, &[mask, width.tenths()]);
            }
            Request::ReadLatched | Request::ReadSafe => out.push(b'4'),
            Request::SampleAll | Request::HostOk | Request::ReadAll => {}
            Request::ReadReset => out.push(b'5'),
            Request::ReadInit => out.push(b'I'),
            Request::ReadWatchdogStatus => out.push(b'0'),
            Request::ClearWatchdog => out.push(b'1'),
            Request::WriteWatchdog { enabled, tenths } => {
                out.extend(&[b'3', b'0' + u8::from(enabled)]);
                put(out, &[tenths]);
            }
            Request::WriteSafe { power_on, safe } => {
                out.push(b'5');
                put(out, &[power_on, safe]);
            }
            Request::Rename(name) => {
                out.push(b'O');
                out.extend(name.bytes());
            }
        }
    }

    #[inline]
    const fn delimiter(&self) -> u8 {
        match self {
            Request::ReadName
            | Request::ReadFirmware
            | Request::ReadConfig
            | Request::ReadData
            | Request::ReadPulse
            | Request::ReadLatched
            | Request::ReadReset
            | Request::ReadInit => b'$',
            Request::WriteConfig { .. } => b'%',
            Request::WriteOutputs { .. } | Request::WritePulse { .. } | Request::SampleAll => b'#',
            Request::ReadAll => b'@',
            Request::HostOk
            | Request::ReadWatchdogStatus
            | Request::ClearWatchdog
            | Request::ReadWatchdog
            | Request::WriteWatchdog { .. }
            | Request::ReadSafe
            | Request::WriteSafe { .. }
            | Request::Rename(_) => b'~',
        }
    }
}

impl Exchange {
    /// Writes the request frame in upper case.
    #[inline]
    pub fn encode(&self, out: &mut Frame) {
        let [high, low] = if self.request.is_broadcast() {
            *b"**"
        } else {
            crate::hex::digits(self.address.0)
        };
        out.set([self.request.delimiter(), high, low]);
        self.request.body(out);
        close(self.checksum, out);
    }

    /// Whether the request gets a reply.
    #[must_use]
    pub const fn expects_reply(&self) -> bool {
        !self.request.is_broadcast()
    }
}

/// Appends bytes as hexadecimal digits.
#[cfg_attr(feature = "small", inline(never))]
#[cfg_attr(not(feature = "small"), inline)]
fn put(out: &mut Frame, bytes: &[u8]) {
    for byte in bytes {
        out.extend(&crate::hex::digits(*byte));
    }
}

/// Appends the checksum, if there is one, and the CR. The checksum is the sum of the codes of all
/// characters before it [EDA §2.5].
#[inline]
fn close(checksum: bool, out: &mut Frame) {
    if checksum {
        let [high, low] = crate::hex::digits(crate::sum8(out.bytes()));
        out.extend(&[high, low, CR]);
    } else {
        out.push(CR);
    }
}

/// The characters of one frame without its CR, and the sum of their codes.
#[derive(Clone, Copy)]
struct Line<'a> {
    characters: &'a [u8],
    sum: u8,
}

impl<'a> Line<'a> {
    /// The frame at the beginning of `rx`, if it is complete.
    #[inline]
    fn first(rx: &'a [u8]) -> Option<Line<'a>> {
        let longest = rx.get(..FRAME_MAX).unwrap_or(rx);
        let mut sum: u8 = 0;
        let end = longest.iter().position(|&character| {
            sum = sum.wrapping_add(character);
            character == CR
        })?;
        Some(Line {
            characters: rx.get(..end)?,
            sum: sum.wrapping_sub(CR),
        })
    }

    /// The length of the whole frame.
    #[inline]
    const fn frame_len(self) -> usize {
        self.characters.len() + 1
    }

    /// The characters before the checksum, if the checksum is correct.
    #[inline]
    fn unsealed(self, checksum: bool, lower_case: bool) -> Result<&'a [u8], Malformed> {
        if !checksum {
            return Ok(self.characters);
        }
        let Some((text, &[high, low])) = self.characters.split_last_chunk::<2>() else {
            return Err(Malformed::Checksum);
        };
        let sum = self.sum.wrapping_sub(high).wrapping_sub(low);
        if crate::hex::byte(high, low, lower_case) == Some(sum) {
            Ok(text)
        } else {
            Err(Malformed::Checksum)
        }
    }
}
