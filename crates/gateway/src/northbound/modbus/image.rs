//! What is known of the points of a unit, and the answers to requests made of it.

use super::ends::{self, LastEnd};
use super::map::{Content, STATUS_LEN, Space, UnitMap};
use railbus_device::{Point, PointKind, Setup};
use railbus_site::{BadReason, PointQuality, PointStatus, PointValue};
use railbus_wire::rtu::{Exception, Request};
use std::sync::Arc;

/// A unit: a module, as a Modbus master sees it.
#[derive(Clone, Debug)]
pub(crate) struct UnitImage {
    /// The name of the module.
    pub(crate) module: Arc<str>,
    /// What it is.
    pub(crate) setup: Setup,
    /// Its line, by name.
    line: String,
    map: UnitMap,
    outputs: Vec<Cell>,
    inputs: Vec<Cell>,
    analogs: Vec<Cell>,
    variables: Vec<Cell>,
    /// The last command to it through this outlet.
    pub(crate) last: LastCommand,
}

/// A point, as it was told last.
#[derive(Clone, Copy, Debug)]
struct Cell {
    value: Option<PointValue>,
    quality: PointQuality,
    decimals: u8,
}

/// The last command to a unit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct LastCommand {
    /// One more than the one before.
    pub(crate) number: u16,
    /// Its end.
    pub(crate) end: LastEnd,
    /// The digits of its error code: 301 of `E0301`.
    pub(crate) code: u16,
    /// The first coil or register that it was for.
    pub(crate) at: u16,
}

/// What is asked of the site when registers about the unit itself are read: age, presence and round
/// trip, as they stand in these registers.
pub(crate) type Look<'a> = &'a dyn Fn(&str) -> [u16; 3];

impl UnitImage {
    /// A module of which nothing is known yet.
    pub(crate) fn new(module: &str, line: &str, setup: Setup, is_uniform: bool) -> UnitImage {
        let unread = Cell {
            value: None,
            quality: PointQuality::Bad(BadReason::NeverRead),
            decimals: 0,
        };
        let cells = |kind| vec![unread; usize::from(setup.count(kind))];
        UnitImage {
            module: module.into(),
            setup,
            line: line.to_owned(),
            map: UnitMap::of(&setup, is_uniform),
            outputs: cells(PointKind::Output),
            inputs: cells(PointKind::Input),
            analogs: cells(PointKind::Analog),
            variables: cells(PointKind::Variable),
            last: LastCommand::default(),
        }
    }

    /// Goes on from the image that the unit had before: with its last command if it is the same
    /// board under the same name, and in any case with the numbers of commands.
    pub(crate) fn goes_on_from(&mut self, before: &UnitImage) {
        let board = |image: &UnitImage| (image.setup.family, image.setup.address);
        let is_named = self.module == before.module && self.line == before.line;
        match is_named && board(self) == board(before) {
            true => self.last = before.last,
            // Also than that of a command that is still under way there.
            false => self.last.number = before.last.number.wrapping_add(1),
        }
    }

    /// A command to it has ended, with this error code. Nothing changes where another one has begun
    /// meanwhile.
    pub(crate) fn ended(&mut self, number: u16, end: LastEnd, code: u16) {
        if self.last.number == number {
            (self.last.end, self.last.code) = (end, code);
        }
    }

    /// A point is like this now.
    pub(crate) fn apply(&mut self, status: &PointStatus) {
        let index = usize::from(status.point.index);
        if let Some(cell) = self.cells_mut(status.point.kind).get_mut(index) {
            *cell = Cell {
                value: status.value,
                quality: status.quality,
                decimals: status.range.as_ref().map_or(0, |range| range.decimals),
            };
        }
    }

    fn cells(&self, kind: PointKind) -> &[Cell] {
        match kind {
            PointKind::Output => &self.outputs,
            PointKind::Input => &self.inputs,
            PointKind::Analog => &self.analogs,
            PointKind::Variable => &self.variables,
        }
    }

    fn cells_mut(&mut self, kind: PointKind) -> &mut [Cell] {
        match kind {
            PointKind::Output => &mut self.outputs,
            PointKind::Input => &mut self.inputs,
            PointKind::Analog => &mut self.analogs,
            PointKind::Variable => &mut self.variables,
        }
    }

    /// Appends the data of a reply: byte count and bits.
    pub(crate) fn read_bits(
        &self,
        space: Space,
        (start, count): (u16, u16),
        out: &mut Vec<u8>,
    ) -> Result<(), Exception> {
        let mut bytes = [0; 250];
        let len = usize::from(count.div_ceil(8));
        for at in 0..count {
            let is_on = self.bit(space, start.wrapping_add(at))?;
            if let Some(byte) = bytes.get_mut(usize::from(at / 8)) {
                *byte |= u8::from(is_on) << (at % 8);
            }
        }
        out.push(len as u8);
        out.extend_from_slice(bytes.get(..len).unwrap_or_default());
        Ok(())
    }

    fn bit(&self, space: Space, at: u16) -> Result<bool, Exception> {
        match self.map.find(space, at) {
            Some((Content::Bits(kind), offset)) => match self.value(kind, offset)? {
                PointValue::Bool(is_on) => Ok(is_on),
                PointValue::Analog(..) | PointValue::Number(_) => Err(Exception::FAILURE),
            },
            _ => Err(Exception::ADDRESS),
        }
    }

    /// The value of a point, if it is good.
    fn value(&self, kind: PointKind, index: u16) -> Result<PointValue, Exception> {
        let cell = self.cells(kind).get(usize::from(index));
        let cell = cell.ok_or(Exception::ADDRESS)?;
        match (ends::of_quality(cell.quality), cell.value) {
            (Some(why), _) => Err(why),
            (None, Some(value)) => Ok(value),
            (None, None) => Err(Exception::TARGET),
        }
    }

    /// Appends the data of a reply: byte count and registers.
    pub(crate) fn read_words(
        &self,
        space: Space,
        (start, count): (u16, u16),
        look: Look<'_>,
        out: &mut Vec<u8>,
    ) -> Result<(), Exception> {
        out.push((2 * count) as u8);
        let mut status = None;
        for at in 0..count {
            let at = start.wrapping_add(at);
            let (content, offset) = self.map.find(space, at).ok_or(Exception::ADDRESS)?;
            let word = match content {
                Content::Status => {
                    let status = status.get_or_insert_with(|| self.status(look));
                    status.get(usize::from(offset)).copied()
                }
                content => Some(self.word(content, offset)?),
            };
            let word = word.ok_or(Exception::ADDRESS)?;
            out.extend_from_slice(&word.to_be_bytes());
        }
        Ok(())
    }

    fn word(&self, content: Content, offset: u16) -> Result<u16, Exception> {
        let half = |number: u32, offset: u16| match offset % 2 {
            0 => (number >> 16) as u16,
            _ => number as u16,
        };
        match content {
            Content::OutputWords => self.output_word(offset),
            Content::Raw => match self.value(PointKind::Analog, offset)? {
                PointValue::Analog(_, register) => Ok(register),
                PointValue::Bool(_) | PointValue::Number(_) => Err(Exception::FAILURE),
            },
            Content::Scaled => {
                let value = self.analog(offset)?;
                let decimals = self.analogs.get(usize::from(offset));
                let decimals = decimals.map_or(0, |cell| i32::from(cell.decimals));
                let scaled = (value * 10f64.powi(decimals)).round();
                // A number that does not fit is no other number.
                match scaled >= f64::from(i16::MIN) && scaled <= f64::from(i16::MAX) {
                    true => Ok((scaled as i16).cast_unsigned()),
                    false => Err(Exception::FAILURE),
                }
            }
            Content::Floats => {
                let value = self.analog(offset / 2)? as f32;
                Ok(half(value.to_bits(), offset))
            }
            Content::Numbers => match self.value(PointKind::Variable, offset / 2)? {
                PointValue::Number(number) => Ok(half(number, offset)),
                PointValue::Bool(_) | PointValue::Analog(..) => Err(Exception::FAILURE),
            },
            Content::Bits(_) | Content::Status => Err(Exception::ADDRESS),
        }
    }

    fn analog(&self, index: u16) -> Result<f64, Exception> {
        match self.value(PointKind::Analog, index)? {
            PointValue::Analog(value, _) => Ok(value),
            PointValue::Bool(_) | PointValue::Number(_) => Err(Exception::FAILURE),
        }
    }

    /// The outputs of a word; bits without an output are 0.
    fn outputs_of(&self, word: u16) -> impl Iterator<Item = u16> + use<> {
        let outputs = self.outputs.len() as u16;
        let first = word.saturating_mul(16);
        first..outputs.min(first.saturating_add(16))
    }

    fn output_word(&self, word: u16) -> Result<u16, Exception> {
        let mut bits = 0;
        for index in self.outputs_of(word) {
            if self.value(PointKind::Output, index)? == PointValue::Bool(true) {
                bits |= 1 << (index % 16);
            }
        }
        Ok(bits)
    }

    /// The registers about the unit itself.
    fn status(&self, look: Look<'_>) -> [u16; STATUS_LEN as usize] {
        let kinds = [&self.outputs, &self.inputs, &self.analogs, &self.variables];
        let cells = kinds.into_iter().flatten();
        let quality = cells.map(|cell| ends::number_of(cell.quality)).max();
        let [age, presence, rtt] = look(&self.module);
        let last = self.last;
        [
            quality.unwrap_or_default(),
            age,
            presence,
            rtt,
            last.number,
            last.end as u16,
            last.code,
            last.at,
        ]
    }

    /// The outputs that a request writes, and their new states.
    ///
    /// # Errors
    /// The exception of a request that writes no outputs.
    pub(crate) fn writes(&self, request: &Request<'_>) -> Result<Vec<(Point, bool)>, Exception> {
        match request {
            Request::WriteCoil { at, value } => {
                // The value is checked before the address [MODBUS §3.5].
                let is_on = value.state().ok_or(Exception::VALUE)?;
                Ok(vec![(self.coil(*at)?, is_on)])
            }
            Request::WriteCoils(block) => {
                let values = (0..).zip(block.values().iter());
                values
                    .map(|(at, is_on)| Ok((self.coil(block.start().wrapping_add(at))?, is_on)))
                    .collect()
            }
            Request::WriteRegister { at, value } => self.of_words([(*at, *value)].into_iter()),
            Request::WriteRegisters(block) => self.of_words(block.words()),
            _ => Err(Exception::FUNCTION),
        }
    }

    /// The outputs of a word of which a mask sets the bits: those that are 0 in `and` get the bits
    /// of `or`, and the others are not commanded.
    pub(crate) fn writes_masked(
        &self,
        at: u16,
        and: u16,
        or: u16,
    ) -> Result<Vec<(Point, bool)>, Exception> {
        let mut set = self.of_word(at, or & !and)?;
        set.retain(|(point, _)| and & (1 << (point.index % 16)) == 0);
        Ok(set)
    }

    /// Whether all of these holding registers exist.
    pub(crate) fn has_holding(&self, start: u16, count: u16) -> Result<(), Exception> {
        let space = Space::HoldingRegisters;
        let exist = (0..count).all(|at| {
            let at = start.checked_add(at);
            at.is_some_and(|at| self.map.find(space, at).is_some())
        });
        match exist {
            true => Ok(()),
            false => Err(Exception::ADDRESS),
        }
    }

    fn coil(&self, at: u16) -> Result<Point, Exception> {
        match self.map.find(Space::Coils, at) {
            Some((Content::Bits(kind), offset)) => Ok(Point {
                kind,
                index: offset as u8,
            }),
            _ => Err(Exception::ADDRESS),
        }
    }

    fn of_words(
        &self,
        words: impl Iterator<Item = (u16, u16)>,
    ) -> Result<Vec<(Point, bool)>, Exception> {
        let mut set = Vec::new();
        for (at, word) in words {
            set.extend(self.of_word(at, word)?);
        }
        // Both words of a module with 16 outputs or fewer may be written; not only the second.
        match set.is_empty() {
            true => Err(Exception::ADDRESS),
            false => Ok(set),
        }
    }

    /// The outputs of a word, and their states by its bits.
    fn of_word(&self, at: u16, bits: u16) -> Result<Vec<(Point, bool)>, Exception> {
        let word = match self.map.find(Space::HoldingRegisters, at) {
            Some((Content::OutputWords, word)) => word,
            _ => return Err(Exception::ADDRESS),
        };
        let mut left = bits;
        let set = self.outputs_of(word).map(|index| {
            let bit = 1 << (index % 16);
            left &= !bit;
            let point = Point {
                kind: PointKind::Output,
                index: index as u8,
            };
            (point, bits & bit != 0)
        });
        let set: Vec<(Point, bool)> = set.collect();
        match left {
            0 => Ok(set),
            // An output that it does not have can't be switched on.
            _ => Err(Exception::VALUE),
        }
    }
}
