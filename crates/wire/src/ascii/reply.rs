//! Replies: decoded by the host together with their request, written by the module.

use super::{Exchange, Line, Request, Response, Text, close, put};
use crate::hex::{byte, digit, digits};
use crate::{Address, Decoded, Frame, Malformed, PulseWidth, Reply};

/// The outer form of a reply.
#[derive(Clone, Copy)]
struct Form {
    lead: u8,
    /// Whether the address follows the first character.
    addressed: bool,
    /// The least number of characters after that, without the checksum.
    shortest: usize,
    /// The greatest number.
    longest: usize,
}

impl Form {
    /// `?AA`: refuses any request [ADAM §1.2].
    const REFUSED: Form = Form::fixed(b'?', true, 0);
    /// `?`: refuses a write of outputs only.
    const REFUSED_BARE: Form = Form::fixed(b'?', false, 0);
    /// `!`: ignores a write of outputs [ADAM §1.4].
    const IGNORED: Form = Form::fixed(b'!', false, 0);

    const fn fixed(lead: u8, addressed: bool, body: usize) -> Form {
        Form {
            lead,
            addressed,
            shortest: body,
            longest: body,
        }
    }

    /// How many characters surround the body, including CR.
    const fn around(&self, checksum: bool) -> usize {
        2 + if self.addressed { 2 } else { 0 } + if checksum { 2 } else { 0 }
    }

    /// The least and the greatest length of the whole frame.
    const fn lengths(&self, checksum: bool) -> (usize, usize) {
        let around = self.around(checksum);
        (self.shortest + around, self.longest + around)
    }
}

impl Request {
    /// The form of a good reply; none if there is no reply.
    #[inline]
    const fn good_form(&self) -> Option<Form> {
        Some(match self {
            Request::ReadName | Request::ReadFirmware => Form {
                lead: b'!',
                addressed: true,
                shortest: 1,
                longest: Text::MAX,
            },
            Request::ReadConfig => Form::fixed(b'!', true, 6),
            Request::ReadData => Form::fixed(b'!', false, 6),
            Request::ReadLatched => Form::fixed(b'!', false, 7),
            Request::ReadPulse | Request::ReadSafe => Form::fixed(b'!', true, 4),
            Request::ReadReset | Request::ReadInit => Form::fixed(b'!', true, 1),
            Request::ReadWatchdogStatus => Form::fixed(b'!', true, 2),
            Request::ReadWatchdog => Form::fixed(b'!', true, 3),
            Request::ReadAll => Form::fixed(b'>', false, 4),
            Request::WriteOutputs { .. } => Form::fixed(b'>', false, 0),
            Request::WriteConfig { .. }
            | Request::WritePulse { .. }
            | Request::ClearWatchdog
            | Request::WriteWatchdog { .. }
            | Request::WriteSafe { .. }
            | Request::Rename(_) => Form::fixed(b'!', true, 0),
            Request::SampleAll | Request::HostOk => return None,
        })
    }

    /// Whether a bare `?` may refuse it and a bare `!` may ignore it.
    #[inline]
    const fn writes_outputs(&self) -> bool {
        matches!(self, Request::WriteOutputs { .. })
    }

    /// All forms of its reply.
    fn forms(&self) -> impl Iterator<Item = Form> {
        let good = self.good_form();
        let bare = good.filter(|_| self.writes_outputs());
        [
            good,
            good.map(|_| Form::REFUSED),
            bare.map(|_| Form::REFUSED_BARE),
            bare.map(|_| Form::IGNORED),
        ]
        .into_iter()
        .flatten()
    }
}

impl Exchange {
    /// Decodes the beginning of `rx` as the reply to this request: first character, address,
    /// length, digits, checksum and CR are checked. Digits may be of either case, except those of
    /// the checksum: it protects every bit only if each sum has a single spelling.
    ///
    /// The reply to a configuration write may carry the old address or the new one [EDA §2.14].
    #[inline]
    pub fn decode_response(&self, rx: &[u8]) -> Decoded<Reply<Response>> {
        let Some(good) = self.request.good_form() else {
            return Decoded::Malformed(Malformed::Start);
        };
        let Some(line) = Line::first(rx) else {
            return self.unfinished(rx);
        };
        match self.read(line, good) {
            Ok(value) => Decoded::Whole {
                len: line.frame_len(),
                value,
            },
            Err(why) => Decoded::Malformed(why),
        }
    }

    /// The most characters of the good reply, including CR; 0 if there is no reply.
    #[must_use]
    pub const fn response_len_max(&self) -> usize {
        match self.request.good_form() {
            Some(form) => form.lengths(self.checksum).1,
            None => 0,
        }
    }

    /// Writes the reply of the module at `from`.
    #[inline]
    pub fn encode_response(&self, from: Address, response: &Response, out: &mut Frame) {
        let Some(good) = self.request.good_form() else {
            return out.clear();
        };
        let form = match response {
            Response::Invalid => Form::REFUSED,
            Response::Ignored => Form::IGNORED,
            _ => good,
        };
        let [high, low] = digits(from.0);
        if form.addressed {
            out.set([form.lead, high, low]);
        } else {
            out.set([form.lead]);
        }
        write_body(response, out);
        close(self.checksum, out);
    }

    /// Whether one frame could be a reply to both.
    ///
    /// Two forms are distinguished by first character, address and length. Replies without an
    /// address fit any module; a refusal `?AA` fits every request to its module.
    #[must_use]
    pub fn confusable(&self, other: &Exchange) -> bool {
        let mut forms = self.request.forms();
        forms.any(|mine| self.fits(mine, other))
    }

    /// Whether a good reply to this request can't be any reply to the other one, nor the reverse. A
    /// refusal is not a good reply.
    #[must_use]
    pub fn stands_apart(&self, other: &Exchange) -> bool {
        use Request::{ReadConfig, ReadName};
        // Also distinguished by their content.
        let pair = (self.request, other.request);
        let by_body = matches!(pair, (ReadConfig, ReadName) | (ReadName, ReadConfig));
        let good = self.request.good_form();
        by_body || good.is_some_and(|mine| !self.fits(mine, other))
    }

    /// Whether a reply of this form could be the reply to another request.
    fn fits(&self, mine: Form, other: &Exchange) -> bool {
        let same_module = self
            .answerers()
            .iter()
            .any(|address| other.answerers().contains(address));
        let (shortest, longest) = mine.lengths(self.checksum);
        other.request.forms().any(|theirs| {
            let (their_shortest, their_longest) = theirs.lengths(other.checksum);
            let both_addressed = mine.addressed && theirs.addressed;
            mine.lead == theirs.lead
                && shortest <= their_longest
                && their_shortest <= longest
                && (same_module || !both_addressed)
        })
    }

    /// The addresses that the reply may carry.
    #[inline]
    fn answerers(&self) -> [Address; 2] {
        match self.request {
            Request::WriteConfig { new_address, .. } => [self.address, new_address],
            _ => [self.address; 2],
        }
    }

    /// Decodes a reply.
    #[inline]
    fn read(&self, line: Line<'_>, good: Form) -> Result<Reply<Response>, Malformed> {
        let text = line.unsealed(self.checksum, false)?;
        let bare = |response| {
            Ok(Reply {
                from: None,
                response,
            })
        };
        let (from, body) = match *text {
            [b'?'] if self.request.writes_outputs() => return bare(Response::Invalid),
            [b'!'] if self.request.writes_outputs() => return bare(Response::Ignored),
            [b'?', high, low] => {
                return Ok(Reply {
                    from: Some(self.answerer([high, low])?),
                    response: Response::Invalid,
                });
            }
            [b'?', ..] => return Err(Malformed::Length),
            [lead, ..] if lead != good.lead => return Err(Malformed::Start),
            [_, high, low, ref body @ ..] if good.addressed => {
                (Some(self.answerer([high, low])?), body)
            }
            [_, ref body @ ..] if !good.addressed => (None, body),
            _ => return Err(Malformed::Length),
        };
        Ok(Reply {
            from,
            response: self.read_body(body)?,
        })
    }

    #[inline]
    fn answerer(&self, [high, low]: [u8; 2]) -> Result<Address, Malformed> {
        let from = Address(byte(high, low, true).ok_or(Malformed::Syntax)?);
        if self.answerers().contains(&from) {
            Ok(from)
        } else {
            Err(Malformed::Address)
        }
    }

    #[inline]
    fn read_body(&self, body: &[u8]) -> Result<Response, Malformed> {
        let two = |high: &u8, low: &u8| byte(*high, *low, true).ok_or(Malformed::Syntax);
        let flag = |digit: &u8| match digit {
            b'0' => Ok(false),
            b'1' => Ok(true),
            _ => Err(Malformed::Value),
        };
        Ok(match (&self.request, body) {
            // So that a late configuration is never taken for a name.
            (Request::ReadName, body) if looks_like_config(body) => return Err(Malformed::Value),
            (Request::ReadName | Request::ReadFirmware, _) => Response::Text(Text::parse(body)?),
            (Request::ReadConfig, [a, b, c, d, e, f]) => Response::Config {
                type_code: two(a, b)?,
                baud_code: two(c, d)?,
                format: two(e, f)?,
            },
            (Request::ReadData, [a, b, c, d, b'0', b'0']) => Response::Data {
                outputs: two(a, b)?,
                inputs: two(c, d)?,
            },
            (Request::ReadLatched, [s, a, b, c, d, b'0', b'0']) => Response::Latched {
                first: flag(s)?,
                outputs: two(a, b)?,
                inputs: two(c, d)?,
            },
            (Request::ReadPulse, [a, b, c, d]) => Response::Pulse {
                mask: two(a, b)?,
                width: PulseWidth::from_tenths(two(c, d)?).ok_or(Malformed::Value)?,
            },
            (Request::ReadSafe, [a, b, c, d]) => Response::Safe {
                power_on: two(a, b)?,
                safe: two(c, d)?,
            },
            (Request::ReadReset | Request::ReadInit, [s]) => Response::Flag(flag(s)?),
            (Request::ReadWatchdogStatus, [a, b]) => Response::Status(two(a, b)?),
            (Request::ReadWatchdog, [e, a, b]) => Response::Watchdog {
                enabled: flag(e)?,
                tenths: two(a, b)?,
            },
            (Request::ReadAll, [a, b, c, d]) => {
                Response::All(u16::from_be_bytes([two(a, b)?, two(c, d)?]))
            }
            (
                Request::WriteOutputs { .. }
                | Request::WriteConfig { .. }
                | Request::WritePulse { .. }
                | Request::ClearWatchdog
                | Request::WriteWatchdog { .. }
                | Request::WriteSafe { .. }
                | Request::Rename(_),
                [],
            ) => Response::Done,
            (Request::ReadData | Request::ReadLatched, [.., _, _]) => {
                return Err(Malformed::Syntax);
            }
            _ => return Err(Malformed::Length),
        })
    }

    /// What a beginning without a CR may still become.
    fn unfinished(&self, rx: &[u8]) -> Decoded<Reply<Response>> {
        let mut why = Malformed::Start;
        let mut least: Option<usize> = None;
        for form in self.request.forms() {
            match self.missing(rx, form) {
                Ok(more) => least = Some(least.map_or(more, |least| least.min(more))),
                Err(Malformed::Start) => {}
                Err(reason) => why = reason,
            }
        }
        match least {
            Some(more) => Decoded::Partial { more },
            None => Decoded::Malformed(why),
        }
    }

    /// The least number of missing characters, if this is the beginning of that form.
    fn missing(&self, rx: &[u8], form: Form) -> Result<usize, Malformed> {
        match *rx {
            [lead, ..] if lead != form.lead => return Err(Malformed::Start),
            [_, high, low, ..] if form.addressed => {
                self.answerer([high, low])?;
            }
            _ => {}
        }
        let (shortest, longest) = form.lengths(self.checksum);
        if rx.len() < longest {
            Ok(shortest.saturating_sub(rx.len()).max(1))
        } else {
            Err(Malformed::End)
        }
    }
}

/// Whether it is the configuration of a digital module, `40CCFF`: no module has a name like that.
fn looks_like_config(body: &[u8]) -> bool {
    matches!(body, [b'4', b'0', b'0', _, _, _]) && body.iter().all(u8::is_ascii_hexdigit)
}

/// The characters between address and checksum.
#[inline]
fn write_body(response: &Response, out: &mut Frame) {
    match *response {
        Response::Text(text) => {
            out.extend(text.bytes());
        }
        Response::Config {
            type_code,
            baud_code,
            format,
        } => put(out, &[type_code, baud_code, format]),
        Response::Data { outputs, inputs } => put(out, &[outputs, inputs, 0]),
        Response::Pulse { mask, width } => put(out, &[mask, width.tenths()]),
        Response::Safe { power_on, safe } => put(out, &[power_on, safe]),
        Response::Status(status) => put(out, &[status]),
        Response::All(word) => put(out, &word.to_be_bytes()),
        Response::Flag(flag) => out.push(digit(u8::from(flag))),
        Response::Watchdog { enabled, tenths } => {
            out.push(digit(u8::from(enabled)));
            put(out, &[tenths]);
        }
        Response::Latched {
            first,
            outputs,
            inputs,
        } => {
            out.push(digit(u8::from(first)));
            put(out, &[outputs, inputs, 0]);
        }
        Response::Done | Response::Invalid | Response::Ignored => {}
    }
}
