//! The requests of a scan. All of them only read, and no other protocol could take any of them for
//! a command.

use railbus_bus::Probe;
use railbus_device::{Family, Sign};
use railbus_wire::{
    Address, Decoded, Exchange, Frame, Micros, Protocol, REPLY_TIMEOUT, SerialSettings, ascii,
    foreign_command, lc02, r55, rtu,
};

/// How much longer the second pass waits for each Modbus module. An exception that arrives while
/// the next request is being sent is shorter than that, and leaves no trace: the second time it
/// arrives at another moment.
const SECOND_LOOK: Micros = Micros::from_millis(15);
/// Timeout for a module that is there, or may be slow.
pub(super) const PATIENCE: Micros = REPLY_TIMEOUT;
/// The scan timeout for slow modules: each gets at least as long as in the retry after an empty
/// scan, and the reply at a low speed fits in as well.
pub const SLOW_TIMEOUT: Micros = Micros::from_millis(400);

/// The addresses that an ERC-8 or EMD-2A2Q can have [ERC-8 §1.2, EMD-2A2Q §1.2]: there the gap
/// before a request is the long one that they need.
const SLOW_ADDRESSES: std::ops::RangeInclusive<u8> = 1..=32;
/// The gap an ERC-8 needs; an EMD-2A2Q needs less [ERC-8 §1.6].
const SLOW_GAP: Micros = Micros::from_millis(20);
/// Time from a received byte to the next sent one, caused by the machine and its adapter.
const HANDLING: Micros = Micros::from_millis(1);
/// The gap for all others.
const GAP: Micros = Micros::from_millis(5);

/// A kind of request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ProbeKind {
    /// To all 0x55 boards: report your address. Only if there is at most one.
    R55Address,
    /// The state of a 0x55 board [R55 §2.2].
    R55State,
    /// Address, speed and model in LC-02.
    Lc02Config,
    /// `$AAM`, with or without checksum.
    AsciiName(bool),
    /// Eight coils from 0: answered, or refused, by every Modbus module of the five families.
    Coils0,
    /// Nine coils from 0: one more than an EDA9050 has.
    NineCoils,
    /// Four registers from 0: model and address of an EDA9060A.
    Registers4,
    /// Eight registers from 0: an EMD-2A2Q.
    Registers8,
    /// Nine registers from 0: one more than an EMD-2A2Q has.
    NineRegisters,
    /// Eight coils from 60: an ERC-8.
    Coils60,
    /// Nine coils from 60: one more than an ERC-8 has.
    NineCoils60,
    /// One discrete input: an ERC-8 has none.
    Input,
    /// Coils 8 and 9: an EMD-2A2Q.
    Coils8,
    /// Coil 10: one more than an EMD-2A2Q has.
    Coil10,
    /// Identification, function 2B [BEYOND §5].
    Identification,
    /// Whether function 08 is supported, and so perhaps 2B [BEYOND §4.2]. It costs less than a
    /// request whose reply may be as long as any frame.
    Diagnosis,
    /// `$AAF`, with or without checksum [BEYOND §2.1].
    AsciiFirmware(bool),
}

impl ProbeKind {
    /// All of them.
    pub const ALL: [ProbeKind; 19] = [
        ProbeKind::R55Address,
        ProbeKind::R55State,
        ProbeKind::Lc02Config,
        ProbeKind::AsciiName(false),
        ProbeKind::AsciiName(true),
        ProbeKind::Coils0,
        ProbeKind::NineCoils,
        ProbeKind::Registers4,
        ProbeKind::Registers8,
        ProbeKind::NineRegisters,
        ProbeKind::Coils60,
        ProbeKind::NineCoils60,
        ProbeKind::Input,
        ProbeKind::Coils8,
        ProbeKind::Coil10,
        ProbeKind::Identification,
        ProbeKind::Diagnosis,
        ProbeKind::AsciiFirmware(false),
        ProbeKind::AsciiFirmware(true),
    ];

    /// Its protocol.
    #[must_use]
    pub const fn protocol(self) -> Protocol {
        match self {
            ProbeKind::R55Address | ProbeKind::R55State => Protocol::R55,
            ProbeKind::Lc02Config => Protocol::Lc02,
            ProbeKind::AsciiName(_) | ProbeKind::AsciiFirmware(_) => Protocol::Ascii,
            _ => Protocol::Rtu,
        }
    }

    /// Its name in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            ProbeKind::R55Address => "r55_address",
            ProbeKind::R55State => "r55_state",
            ProbeKind::Lc02Config => "lc02_config",
            ProbeKind::AsciiName(false) => "ascii_name",
            ProbeKind::AsciiName(true) => "ascii_name_checksum",
            ProbeKind::Coils0 => "coils_0",
            ProbeKind::NineCoils => "coils_0_9",
            ProbeKind::Registers4 => "registers_4",
            ProbeKind::Registers8 => "registers_8",
            ProbeKind::NineRegisters => "registers_9",
            ProbeKind::Coils60 => "coils_60",
            ProbeKind::NineCoils60 => "coils_60_9",
            ProbeKind::Input => "input_0",
            ProbeKind::Coils8 => "coils_8",
            ProbeKind::Coil10 => "coil_10",
            ProbeKind::Identification => "identification",
            ProbeKind::Diagnosis => "diagnosis",
            ProbeKind::AsciiFirmware(false) => "ascii_firmware",
            ProbeKind::AsciiFirmware(true) => "ascii_firmware_checksum",
        }
    }

    /// The request of that name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<ProbeKind> {
        ProbeKind::ALL.into_iter().find(|ask| ask.name() == name)
    }

    /// Whether it only identifies the module: nothing depends on the reply.
    pub(super) const fn is_description(self) -> bool {
        matches!(
            self,
            ProbeKind::Identification | ProbeKind::Diagnosis | ProbeKind::AsciiFirmware(_)
        )
    }

    /// The alternative if the frame must not be sent.
    const fn instead(self) -> Option<ProbeKind> {
        match self {
            ProbeKind::Coils0 => Some(ProbeKind::Registers4),
            _ => None,
        }
    }

    /// The read it sends to a Modbus module.
    fn modbus(self) -> Option<rtu::Request<'static>> {
        let coils = |start, count| Some(rtu::Request::ReadCoils(rtu::BitSpan::new(start, count)?));
        let registers = |count| {
            let span = rtu::WordSpan::new(0, count)?;
            Some(rtu::Request::ReadHoldingRegisters(span))
        };
        match self {
            ProbeKind::Coils0 => coils(0, 8),
            ProbeKind::NineCoils => coils(0, 9),
            ProbeKind::Coils60 => coils(60, 8),
            ProbeKind::NineCoils60 => coils(60, 9),
            ProbeKind::Coils8 => coils(8, 2),
            ProbeKind::Coil10 => coils(10, 1),
            ProbeKind::Input => rtu::BitSpan::new(0, 1).map(rtu::Request::ReadDiscreteInputs),
            ProbeKind::Registers4 => registers(4),
            ProbeKind::Registers8 => registers(8),
            ProbeKind::NineRegisters => registers(9),
            ProbeKind::Identification => Some(rtu::Request::Identify { code: 1, object: 0 }),
            ProbeKind::Diagnosis => Some(rtu::Request::Diagnose {
                sub: rtu::diagnosis::REGISTER,
                data: 0,
            }),
            ProbeKind::R55Address
            | ProbeKind::R55State
            | ProbeKind::Lc02Config
            | ProbeKind::AsciiName(_)
            | ProbeKind::AsciiFirmware(_) => None,
        }
    }

    /// The request that tests for this sign; `None` if a scan does not send it.
    pub(super) fn of(sign: &Sign) -> Option<ProbeKind> {
        let mut all = ProbeKind::ALL.into_iter();
        all.find(|ask| ask.modbus() == Some(sign.request))
    }

    /// The longest gap that a family needs which this request helps to identify.
    fn gap_of_families(self) -> Option<Micros> {
        let asks = |sign: Sign| ProbeKind::of(&sign) == Some(self);
        let families = Family::ALL.into_iter();
        let families = families.filter(|family| family.signs().any(asks));
        families.filter_map(|family| family.profile().gap).max()
    }

    /// The request to one module; `None` if no module has that address, or if it would be a
    /// broadcast.
    fn exchange(self, address: Address) -> Option<Exchange<'static>> {
        let all = address == r55::BROADCAST;
        match self {
            ProbeKind::R55Address => all.then(|| Exchange::r55(address, r55::Request::ReadAddress)),
            ProbeKind::R55State => (!all).then(|| Exchange::r55(address, r55::Request::ReadState)),
            ProbeKind::Lc02Config => Some(Exchange::lc02(address, lc02::Request::ReadConfig)),
            ProbeKind::AsciiName(checksum) => {
                Some(Exchange::ascii(address, checksum, ascii::Request::ReadName))
            }
            ProbeKind::AsciiFirmware(checksum) => {
                let request = ascii::Request::ReadFirmware;
                Some(Exchange::ascii(address, checksum, request))
            }
            _ => {
                (address != rtu::BROADCAST).then(|| Some(Exchange::rtu(address, self.modbus()?)))?
            }
        }
    }
}

/// A request to one address, at one speed and character format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ScanProbe {
    /// Speed and character format.
    pub settings: SerialSettings,
    /// The kind of request.
    pub ask: ProbeKind,
    /// The address.
    pub address: Address,
}

impl ScanProbe {
    /// The exchange; `None` if there is none for this address.
    #[must_use]
    pub fn exchange(&self) -> Option<Exchange<'static>> {
        self.ask.exchange(self.address)
    }

    /// Another request to the same module.
    #[must_use]
    pub fn with(self, ask: ProbeKind) -> ScanProbe {
        ScanProbe { ask, ..self }
    }

    /// The bytes sent, including a lone CR before ASCII frames; `None` if there is no such request.
    #[must_use]
    pub fn frame(&self) -> Option<Frame> {
        let mut bare = Frame::new();
        self.exchange()?.encode(&mut bare);
        let mut frame = Frame::new();
        if self.clears() {
            let _ = frame.extend(&[ascii::CR]);
        }
        frame.extend(bare.bytes()).then_some(frame)
    }

    /// The request, or an alternative if a module of another protocol could take its frame for a
    /// command, or the end of the frame `before` it together with its beginning; `None` if there is
    /// no alternative.
    pub(super) fn safe(self, before: &[u8]) -> Option<ScanProbe> {
        let frame = self.frame()?;
        let bytes = frame.bytes();
        let foreign = foreign_command(bytes, self.ask.protocol(), Protocol::ALL);
        if foreign.is_some() || make_command(before, bytes) {
            return self.with(self.ask.instead()?).safe(before);
        }
        Some(self)
    }

    /// Whether a lone CR precedes it, for ASCII modules that have received half of something else.
    const fn clears(&self) -> bool {
        matches!(self.ask.protocol(), Protocol::Ascii)
    }

    /// The gap before it.
    fn gap(&self) -> Micros {
        let slow = SLOW_ADDRESSES.contains(&self.address.0);
        if let ProbeKind::Registers8
        | ProbeKind::NineRegisters
        | ProbeKind::Coils8
        | ProbeKind::Coil10 = self.ask
        {
            // A module that gets this request has proved to be none of those that need more.
            let gap = self.ask.gap_of_families().unwrap_or(SLOW_GAP);
            return gap.max(self.settings.t3_5());
        }
        match self.ask.protocol() {
            // Nine coils are requested only from modules that answered eight, which neither does.
            Protocol::Rtu if slow && self.ask != ProbeKind::NineCoils => {
                SLOW_GAP.max(self.settings.t3_5())
            }
            Protocol::Rtu => GAP.max(self.settings.t3_5()),
            Protocol::Ascii | Protocol::Lc02 | Protocol::R55 => GAP,
        }
    }

    /// How long after the end of the request silence becomes certain, if `usual` is the usual time.
    /// A Modbus module needs 3.5 characters to detect that end, which is more at lower speeds.
    pub(super) fn silence(&self, usual: Micros) -> Micros {
        let slower = self.settings.t3_5() - SerialSettings::FACTORY.t3_5();
        match self.ask {
            ProbeKind::Registers4 => usual + SECOND_LOOK + slower,
            _ if self.ask.protocol() == Protocol::Rtu => usual + slower,
            _ => usual,
        }
    }

    /// What the reply takes on the wire.
    fn reply_time(&self) -> Micros {
        let longest = self.exchange().map_or(0, |asked| asked.response_len_max());
        self.settings.frame_time(longest)
    }

    /// Its time on the wire if there is no reply within `patience`, which includes the gap before
    /// the next request.
    pub(super) fn cost(&self, patience: Micros) -> Micros {
        let request = self.frame().map_or(0, |frame| frame.bytes().len());
        let wait = patience.max(self.reply_time());
        self.settings.frame_time(request) + wait.max(self.gap()) + HANDLING
    }

    /// The probe for it, with this timeout for the beginning of the reply.
    pub(super) fn probe(&self, patience: Micros) -> Option<Probe> {
        Some(Probe {
            exchange: self.exchange()?,
            settings: self.settings,
            gap: self.gap(),
            timeout: patience,
            clear: self.clears(),
            changes: false,
            as_module: false,
        })
    }

    /// Timeout for the beginning of a reply, if silence is to be certain after `silence` in total.
    /// A line waits for a whole reply: one that has begun by then is received to its end.
    pub(super) fn begins_within(&self, silence: Micros) -> Micros {
        silence - self.reply_time()
    }

    /// Total time until silence is certain, with this timeout for the beginning of a reply.
    pub(super) fn shows_after(&self, begin: Micros) -> Micros {
        begin + self.reply_time()
    }
}

/// Whether a module that searches for frames at every byte could take the end of one frame and the
/// beginning of the next for a command.
fn make_command(before: &[u8], next: &[u8]) -> bool {
    let mut joined = Frame::new();
    if !joined.extend(before) || !joined.extend(next) {
        return true;
    }
    (1..before.len()).any(|skip| {
        let rest = joined.bytes().get(skip..).unwrap_or_default();
        let in_both = |len: Option<usize>| len.is_some_and(|len| skip + len > before.len());
        let rules = |checksum| ascii::DecodeRules {
            checksum,
            lower_case: true,
        };
        in_both(whole_len(&r55::Exchange::decode_request(rest)))
            || in_both(whole_len(&lc02::Exchange::decode_request(rest)))
            || in_both(whole_len(&ascii::Exchange::decode_request(
                rest,
                rules(true),
            )))
            || in_both(whole_len(&ascii::Exchange::decode_request(
                rest,
                rules(false),
            )))
    })
}

const fn whole_len<T>(decoded: &Decoded<T>) -> Option<usize> {
    match decoded {
        Decoded::Whole { len, .. } => Some(*len),
        Decoded::Partial { .. } | Decoded::Malformed(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_wire::Baud;

    /// Every request that a scan may send; neither speed nor format change its bytes.
    fn all() -> Vec<(ScanProbe, Frame)> {
        let asks = ProbeKind::ALL.into_iter();
        let questions = asks.flat_map(|ask| (0..=255).map(move |address| (ask, address)));
        let questions = questions.filter_map(|(ask, address)| {
            let question = ScanProbe {
                settings: SerialSettings::FACTORY,
                ask,
                address: Address(address),
            };
            question.safe(&[])
        });
        questions
            .map(|question| (question, question.frame().unwrap()))
            .collect()
    }

    #[test]
    fn every_frame_only_reads_and_is_a_command_of_no_other_protocol() {
        let all = all();
        for (question, frame) in &all {
            let exchange = question.exchange().unwrap();
            assert!(exchange.expects_reply(), "{question:?}");
            let reads = match exchange {
                Exchange::Rtu(e) => e.request.is_read() && e.address != rtu::BROADCAST,
                Exchange::R55(e) => match e.request() {
                    r55::Request::ReadState => e.address() != r55::BROADCAST,
                    r55::Request::ReadAddress => e.address() == r55::BROADCAST,
                    _ => false,
                },
                Exchange::Lc02(e) => e.request == lc02::Request::ReadConfig,
                Exchange::Ascii(e) => matches!(
                    e.request,
                    ascii::Request::ReadName | ascii::Request::ReadFirmware
                ),
            };
            assert!(reads, "{question:?}");
            let own = question.ask.protocol();
            let foreign = foreign_command(frame.bytes(), own, Protocol::ALL);
            assert_eq!(foreign, None, "{question:?}");
        }
        // Hardly any frame had to be left out.
        assert!(all.len() > 2_200, "{}", all.len());
    }

    /// The end of one frame and the beginning of the next do not form a command either, nor does a
    /// lone CR complete one. Only a few pairs do, and those are not sent in succession.
    #[test]
    fn no_two_frames_after_each_other_make_a_command_between_them() {
        let all = all();
        let (mut pairs, mut made) = (0_usize, Vec::new());
        for (question, frame) in &all {
            // All others end in something that no command begins with.
            let begins = [b'$', b'#', b'%', b'@', b'~', 0x55, 0x4C];
            let tail = frame.bytes().get(1..).unwrap();
            if !tail.iter().any(|byte| begins.contains(byte)) {
                continue;
            }
            for (next, more) in &all {
                pairs += 1;
                if make_command(frame.bytes(), more.bytes()) {
                    assert_ne!(next.safe(frame.bytes()), Some(*next));
                    made.push((question.ask, question.address.0, next.ask, next.address.0));
                }
            }
        }
        // It happens to be a write of a 0x55 board's address: 55 6F 41 03 00 00 00 08.
        assert!(
            made.contains(&(ProbeKind::Registers4, 199, ProbeKind::Registers8, 65)),
            "{made:?}"
        );
        assert!(made.len() < 20 && pairs > 100_000, "{pairs} {made:?}");
        let lone_cr = |frame: &Frame| make_command(frame.bytes(), &[ascii::CR]);
        assert!(!all.iter().any(|(_, frame)| lone_cr(frame)));
    }

    #[test]
    fn a_question_that_is_a_command_elsewhere_is_asked_otherwise() {
        let question = |ask, address| ScanProbe {
            settings: SerialSettings::FACTORY,
            ask,
            address: Address(address),
        };
        for ask in ProbeKind::ALL {
            for address in 0..=255 {
                let asked = question(ask, address);
                let Some(frame) = asked.frame() else { continue };
                let foreign =
                    foreign_command(frame.bytes(), ask.protocol(), Protocol::ALL).is_some();
                assert_eq!(asked.safe(&[]) != Some(asked), foreign, "{asked:?}");
            }
        }
    }

    #[test]
    fn the_slow_timeout_is_patient_at_all_speeds_of_a_deep_scan() {
        let speeds = [Baud::B2400, Baud::B4800, Baud::B9600, Baud::B38400];
        let all = ProbeKind::ALL
            .into_iter()
            .filter(|ask| !ask.is_description());
        for (ask, baud) in all.flat_map(|ask| speeds.map(|baud| (ask, baud))) {
            let settings = SerialSettings {
                baud,
                ..SerialSettings::FACTORY
            };
            let address = Address(1);
            let asked = ScanProbe {
                settings,
                ask,
                address,
            };
            let waits = asked.begins_within(asked.silence(SLOW_TIMEOUT));
            assert!(waits >= PATIENCE, "{asked:?} {waits:?}");
        }
    }

    #[test]
    fn the_long_silence_is_kept_only_where_somebody_wants_it() {
        let gap = |ask, address| {
            let settings = SerialSettings::FACTORY;
            let address = Address(address);
            let asked = ScanProbe {
                settings,
                ask,
                address,
            };
            asked.gap()
        };
        assert_eq!(gap(ProbeKind::Coils0, 32), SLOW_GAP);
        assert_eq!(gap(ProbeKind::Coils0, 33), GAP);
        assert_eq!(gap(ProbeKind::R55State, 32), GAP);
    }
}
