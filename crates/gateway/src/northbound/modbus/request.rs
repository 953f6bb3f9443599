//! Requests to units, without what frames them: they are answered from images, or are writes for
//! the site.

use super::ends::{self, LastEnd};
use super::image::{Look, UnitImage};
use super::map::Space;
use railbus_device::Point;
use railbus_host::Confirmation;
use railbus_site::{CommandError, Config};
use railbus_wire::rtu::{self, Exception, Identification, Request, WordBlock};
use railbus_wire::{Address, Frame, Words};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Functions that no module here has, so that the codec of modules does not know them.
const MASK_WRITE: u8 = 0x16;
const READ_WRITE: u8 = 0x17;
/// How many registers a read with a write may have, and the write [MODBUS §3.2].
const READ_MAX: u16 = 125;
const WRITE_MAX: u16 = 121;
/// The units of the gateway itself.
pub(crate) const GATEWAY: [u8; 2] = [0, 255];
const VENDOR: &str = "railbus";
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// The units of a site, and what is asked of it when registers about a unit are read.
pub(crate) struct Units<'a> {
    /// By their numbers.
    pub(crate) images: &'a mut BTreeMap<u8, UnitImage>,
    /// Age, presence and round trip of a module.
    pub(crate) look: Look<'a>,
    /// What the site is called.
    pub(crate) site: &'a str,
    /// The configuration that they are of.
    pub(crate) config: &'a Arc<Config>,
}

/// A write to be carried out by the site.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct UnitWrite {
    /// The unit.
    pub(crate) unit: u8,
    /// Its module, by name.
    pub(crate) module: Arc<str>,
    /// The outputs, and their new states.
    pub(crate) set: Vec<(Point, bool)>,
    /// The number of the command among those to this unit.
    pub(crate) number: u16,
    /// The configuration by which the unit was this module.
    pub(crate) asked_by: Arc<Config>,
    /// The beginning of the request, which the answer repeats [MODBUS §2.3] [MODBUS §2.4].
    pub(crate) echo: Vec<u8>,
    /// These holding registers are the answer instead, as they are after the write.
    reads: Option<(u16, u16)>,
}

/// How a write ended; an error with the digits of its code.
pub(crate) type WriteEnd = Result<Confirmation, (CommandError, u16)>;

/// Records the end of a write in the status registers of its unit, also if its client has
/// disconnected.
pub(crate) fn note_end(images: &mut BTreeMap<u8, UnitImage>, write: &UnitWrite, end: &WriteEnd) {
    let (told, code) = match end {
        Ok(confirmed) => (LastEnd::from(*confirmed), 0),
        Err((failure, code)) => (ends::of_failure(failure).1, *code),
    };
    let image = images.get_mut(&write.unit);
    if let Some(image) = image.filter(|image| image.module == write.module) {
        image.ended(write.number, told, code);
    }
}

/// An answer with an exception, from the unit on [MODBUS §2.6].
pub(crate) fn refusal(unit: u8, pdu: &[u8], why: Exception) -> [u8; 3] {
    let function = pdu.first().copied().unwrap_or_default();
    [unit, function | 0x80, why.0]
}

impl Units<'_> {
    /// Appends the answer to a request, from the unit on; or the write that it asks for, which is
    /// answered when it has ended ([`Units::written`]).
    ///
    /// # Errors
    /// The exception to answer with; what was appended is to be dropped. A write where none
    /// may begin is [`Exception::BUSY`].
    pub(crate) fn ask(
        &mut self,
        unit: u8,
        pdu: &[u8],
        may_begin: bool,
        out: &mut Vec<u8>,
    ) -> Result<Option<UnitWrite>, Exception> {
        // Whatever is asked of it.
        if !self.images.contains_key(&unit) && !GATEWAY.contains(&unit) {
            return Err(Exception::PATH);
        }
        if let (Some(&(MASK_WRITE | READ_WRITE)), Some(image)) =
            (pdu.first(), self.images.get_mut(&unit))
        {
            let asked = combined(image, pdu)?;
            if asked.set.is_empty() {
                out.push(unit);
                out.extend_from_slice(pdu);
                return Ok(None);
            }
            return begin(unit, (image, self.config), asked, may_begin).map(Some);
        }
        let exchange = rtu::Exchange::decode_pdu(Address(unit), pdu);
        let request = match &exchange {
            Ok(exchange) => &exchange.request,
            Err(error) => {
                let exception = error.exception();
                return Err(exception.map_or(Exception::FUNCTION, |(_, _, why)| why));
            }
        };
        let Some(image) = self.images.get_mut(&unit) else {
            return match request {
                Request::Identify { code, object } => {
                    let said = [VENDOR, VENDOR, VERSION, self.site];
                    identify(unit, (*code, *object), said, out).map(|()| None)
                }
                _ => Err(Exception::FUNCTION),
            };
        };
        let (space, span) = match request {
            Request::ReadCoils(span) => (Space::Coils, (span.start(), span.count())),
            Request::ReadDiscreteInputs(span) => {
                (Space::DiscreteInputs, (span.start(), span.count()))
            }
            Request::ReadHoldingRegisters(span) => {
                (Space::HoldingRegisters, (span.start(), span.count()))
            }
            Request::ReadInputRegisters(span) => {
                (Space::InputRegisters, (span.start(), span.count()))
            }
            Request::WriteCoil { .. }
            | Request::WriteRegister { .. }
            | Request::WriteCoils(_)
            | Request::WriteRegisters(_) => {
                let asked = Asked {
                    set: image.writes(request)?,
                    // Every write has these [MODBUS §2.3].
                    echo: pdu.get(..5).ok_or(Exception::VALUE)?.to_vec(),
                    reads: None,
                };
                return begin(unit, (image, self.config), asked, may_begin).map(Some);
            }
            Request::Identify { code, object } => {
                let model = image.setup.family.profile().model;
                let said = [VENDOR, model, VERSION, &image.module];
                return identify(unit, (*code, *object), said, out).map(|()| None);
            }
            Request::Diagnose { .. } => return Err(Exception::FUNCTION),
        };
        out.extend_from_slice(&[unit, request.function().code()]);
        match space {
            Space::Coils | Space::DiscreteInputs => image.read_bits(space, span, out),
            Space::HoldingRegisters | Space::InputRegisters => {
                image.read_words(space, span, self.look, out)
            }
        }?;
        Ok(None)
    }

    /// Appends the answer to a write that was carried out, from the unit on.
    ///
    /// # Errors
    /// The exception to answer with where registers are to be read after it, and can't be; what
    /// was appended is to be dropped.
    pub(crate) fn written(&self, write: &UnitWrite, out: &mut Vec<u8>) -> Result<(), Exception> {
        let Some(span) = write.reads else {
            out.push(write.unit);
            out.extend_from_slice(&write.echo);
            return Ok(());
        };
        out.extend_from_slice(&[write.unit, READ_WRITE]);
        match self.images.get(&write.unit) {
            Some(image) if image.module == write.module => {
                image.read_words(Space::HoldingRegisters, span, self.look, out)
            }
            // The write was carried out, but the unit is another module now.
            _ => Err(Exception::TARGET),
        }
    }
}

/// A write that a request asks for.
struct Asked {
    set: Vec<(Point, bool)>,
    echo: Vec<u8>,
    reads: Option<(u16, u16)>,
}

/// The write, as the last command of its unit.
fn begin(
    unit: u8,
    (image, config): (&mut UnitImage, &Arc<Config>),
    asked: Asked,
    may_begin: bool,
) -> Result<UnitWrite, Exception> {
    let &[_, high, low, ..] = &*asked.echo else {
        return Err(Exception::VALUE);
    };
    if !may_begin {
        return Err(Exception::BUSY);
    }
    let last = &mut image.last;
    last.number = last.number.wrapping_add(1);
    (last.end, last.code) = (LastEnd::UnderWay, 0);
    last.at = u16::from_be_bytes([high, low]);
    Ok(UnitWrite {
        unit,
        module: Arc::clone(&image.module),
        set: asked.set,
        number: last.number,
        asked_by: Arc::clone(config),
        echo: asked.echo,
        reads: asked.reads,
    })
}

/// Functions 16h and 17h: some bits of a register, and a read after a write.
fn combined(image: &UnitImage, pdu: &[u8]) -> Result<Asked, Exception> {
    match *pdu {
        [
            MASK_WRITE,
            at_high,
            at_low,
            and_high,
            and_low,
            or_high,
            or_low,
        ] => {
            let [at, and, or] =
                [[at_high, at_low], [and_high, and_low], [or_high, or_low]].map(u16::from_be_bytes);
            Ok(Asked {
                set: image.writes_masked(at, and, or)?,
                echo: pdu.to_vec(),
                reads: None,
            })
        }
        [
            READ_WRITE,
            r1,
            r0,
            rc1,
            rc0,
            w1,
            w0,
            wc1,
            wc0,
            len,
            ref data @ ..,
        ] => {
            let [start, count, at, words] =
                [[r1, r0], [rc1, rc0], [w1, w0], [wc1, wc0]].map(u16::from_be_bytes);
            let fits = (1..=READ_MAX).contains(&count)
                && (1..=WRITE_MAX).contains(&words)
                && usize::from(len) == data.len()
                && data.len() == 2 * usize::from(words);
            let block = Words::from_packed(data).and_then(|words| WordBlock::new(at, words));
            let (true, Some(block)) = (fits, block) else {
                return Err(Exception::VALUE);
            };
            image.has_holding(start, count)?;
            Ok(Asked {
                set: image.writes(&Request::WriteRegisters(block))?,
                echo: vec![READ_WRITE, w1, w0],
                reads: Some((start, count)),
            })
        }
        _ => Err(Exception::VALUE),
    }
}

/// Vendor, product, revision and name [BEYOND §5].
fn identify(
    unit: u8,
    (code, object): (u8, u8),
    said: [&str; 4],
    out: &mut Vec<u8>,
) -> Result<(), Exception> {
    const NUMBERS: [u8; 4] = [
        Identification::VENDOR,
        Identification::PRODUCT,
        Identification::REVISION,
        Identification::NAME,
    ];
    let all: Vec<(u8, &str)> = NUMBERS.into_iter().zip(said).collect();
    let listed = match code {
        1 => all.get(..3).unwrap_or_default(),
        2..=4 => &all,
        _ => return Err(Exception::VALUE),
    };
    let at = listed.iter().position(|(number, _)| *number == object);
    let wanted = match (code, at) {
        (4, None) => return Err(Exception::ADDRESS),
        (4, Some(at)) => listed.get(at..=at),
        // One that does not exist is the first.
        (_, at) => listed.get(at.unwrap_or(0)..),
    };
    let is_text = |letter: &char| (' '..='~').contains(letter);
    let ascii = |text: &str| text.chars().filter(is_text).take(48).collect();
    let wanted = wanted.unwrap_or_default().iter();
    let objects: Vec<(u8, String)> = wanted
        .map(|(number, text)| (*number, ascii(text)))
        .collect();
    let texts: Vec<(u8, &str)> = objects
        .iter()
        .map(|(number, text)| (*number, text.as_str()))
        .collect();
    let mut frame = Frame::new();
    rtu::encode_identification(Address(unit), code, &texts, &mut frame);
    // Without its CRC.
    let inside = frame.bytes();
    let inside = inside.get(..inside.len().saturating_sub(2));
    out.extend_from_slice(inside.unwrap_or_default());
    Ok(())
}
