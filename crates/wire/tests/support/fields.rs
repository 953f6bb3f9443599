//! Between the `fields` of `vectors/*.json` and the values of this crate, in both directions.

use railbus_wire::*;
use serde_json::{Value, json};

/// A number of `fields`, which must be there and fit.
fn number<T: TryFrom<u64>>(fields: &Value, key: &str) -> T {
    let number = fields[key].as_u64();
    number
        .and_then(|number| T::try_from(number).ok())
        .unwrap_or_else(|| panic!("no fitting number `{key}` in {fields}"))
}

fn flag(fields: &Value, key: &str) -> bool {
    fields[key]
        .as_bool()
        .unwrap_or_else(|| panic!("no flag `{key}` in {fields}"))
}

fn name<'a>(fields: &'a Value, key: &str) -> &'a str {
    fields[key]
        .as_str()
        .unwrap_or_else(|| panic!("no text `{key}` in {fields}"))
}

fn address(fields: &Value) -> Address {
    Address(number(fields, "address"))
}

fn width(fields: &Value) -> PulseWidth {
    PulseWidth::from_tenths(number(fields, "width")).unwrap()
}

/// `one` with the members of `more` added.
fn with(mut one: Value, more: Value) -> Value {
    let (Value::Object(into), Value::Object(from)) = (&mut one, more) else {
        panic!("two objects are needed");
    };
    into.extend(from);
    one
}

pub(crate) mod rtu {
    use super::*;
    use railbus_wire::rtu::{
        BitBlock, BitSpan, CoilValue, Exception, Exchange, Function, Request, Response, WordBlock,
        WordSpan,
    };

    const FUNCTIONS: [(&str, Function); 10] = [
        ("read_coils", Function::ReadCoils),
        ("read_discrete_inputs", Function::ReadDiscreteInputs),
        ("read_holding_registers", Function::ReadHoldingRegisters),
        ("read_input_registers", Function::ReadInputRegisters),
        ("write_coil", Function::WriteCoil),
        ("write_register", Function::WriteRegister),
        ("write_coils", Function::WriteCoils),
        ("write_registers", Function::WriteRegisters),
        ("diagnose", Function::Diagnose),
        ("identify", Function::Identify),
    ];

    fn function_name(function: Function) -> &'static str {
        FUNCTIONS
            .iter()
            .find(|known| known.1 == function)
            .unwrap()
            .0
    }

    /// The data that a request or reply of these fields packs.
    pub(crate) fn packed(fields: &Value) -> Vec<u8> {
        let values = ["values", "bits", "words"]
            .into_iter()
            .find_map(|key| fields[key].as_array());
        let values = values.map(Vec::as_slice).unwrap_or_default();
        if values.iter().all(Value::is_boolean) {
            let byte = |bits: &[Value]| {
                bits.iter()
                    .rev()
                    .fold(0, |byte, bit| byte << 1 | u8::from(bit.as_bool().unwrap()))
            };
            values.chunks(8).map(byte).collect()
        } else {
            let word = |word: &Value| u16::try_from(word.as_u64().unwrap()).unwrap();
            values
                .iter()
                .flat_map(|value| word(value).to_be_bytes())
                .collect()
        }
    }

    pub(crate) fn show_request(exchange: &Exchange<'_>) -> Value {
        let head = json!({
            "address": exchange.address.0,
            "function": function_name(exchange.request.function()),
        });
        let run = |start: u16, count: u16| json!({ "start": start, "count": count });
        let one = |at: u16, value: u16| json!({ "at": at, "value": value });
        let body = match &exchange.request {
            Request::ReadCoils(span) | Request::ReadDiscreteInputs(span) => {
                run(span.start(), span.count())
            }
            Request::ReadHoldingRegisters(span) | Request::ReadInputRegisters(span) => {
                run(span.start(), span.count())
            }
            Request::WriteCoil { at, value } => one(*at, value.0),
            Request::WriteRegister { at, value } => one(*at, *value),
            Request::WriteCoils(block) => {
                let values: Vec<bool> = block.values().iter().collect();
                json!({ "start": block.start(), "values": values })
            }
            Request::WriteRegisters(block) => {
                let values: Vec<u16> = block.values().iter().collect();
                json!({ "start": block.start(), "values": values })
            }
            Request::Diagnose { sub, data } => json!({ "sub": sub, "data": data }),
            Request::Identify { code, object } => json!({ "code": code, "object": object }),
        };
        with(head, body)
    }

    pub(crate) fn build_request<'a>(fields: &Value, packed: &'a [u8]) -> Exchange<'a> {
        let function = name(fields, "function");
        let found = FUNCTIONS.iter().find(|known| known.0 == function);
        let bits = || BitSpan::new(number(fields, "start"), number(fields, "count")).unwrap();
        let words = || WordSpan::new(number(fields, "start"), number(fields, "count")).unwrap();
        let request = match found.unwrap_or_else(|| panic!("function `{function}`")).1 {
            Function::ReadCoils => Request::ReadCoils(bits()),
            Function::ReadDiscreteInputs => Request::ReadDiscreteInputs(bits()),
            Function::ReadHoldingRegisters => Request::ReadHoldingRegisters(words()),
            Function::ReadInputRegisters => Request::ReadInputRegisters(words()),
            Function::WriteCoil => Request::WriteCoil {
                at: number(fields, "at"),
                value: CoilValue(number(fields, "value")),
            },
            Function::WriteRegister => Request::WriteRegister {
                at: number(fields, "at"),
                value: number(fields, "value"),
            },
            Function::WriteCoils => {
                let count = fields["values"].as_array().unwrap().len();
                let values = Bits::from_packed(packed, count.try_into().unwrap()).unwrap();
                Request::WriteCoils(BitBlock::new(number(fields, "start"), values).unwrap())
            }
            Function::WriteRegisters => {
                let values = Words::from_packed(packed).unwrap();
                Request::WriteRegisters(WordBlock::new(number(fields, "start"), values).unwrap())
            }
            Function::Diagnose => Request::Diagnose {
                sub: number(fields, "sub"),
                data: number(fields, "data"),
            },
            Function::Identify => Request::Identify {
                code: number(fields, "code"),
                object: number(fields, "object"),
            },
        };
        Exchange {
            address: address(fields),
            request,
        }
    }

    pub(crate) fn show_response(exchange: &Exchange<'_>, reply: Reply<Response<'_>>) -> Value {
        let head = json!({
            "address": reply.from.unwrap().0,
            "function": function_name(exchange.request.function()),
        });
        let body = match reply.response {
            Response::Bits(bits) => json!({ "bits": bits.iter().collect::<Vec<bool>>() }),
            Response::Words(words) => json!({ "words": words.iter().collect::<Vec<u16>>() }),
            Response::Done => json!({ "ack": true }),
            Response::Exception(Exception(code)) => json!({ "exception": code }),
            other => panic!("no vector has {other:?}"),
        };
        with(head, body)
    }

    pub(crate) fn build_response<'a>(fields: &Value, packed: &'a [u8]) -> Response<'a> {
        if let Some(bits) = fields["bits"].as_array() {
            Response::Bits(Bits::from_packed(packed, bits.len().try_into().unwrap()).unwrap())
        } else if fields["words"].is_array() {
            Response::Words(Words::from_packed(packed).unwrap())
        } else if fields["exception"].is_u64() {
            Response::Exception(Exception(number(fields, "exception")))
        } else {
            assert!(flag(fields, "ack"));
            Response::Done
        }
    }
}

pub(crate) mod ascii {
    use super::*;
    use railbus_wire::ascii::{Exchange, Request, Response, Text};

    fn command(request: &Request) -> &'static str {
        match request {
            Request::ReadName => "read_name",
            Request::ReadConfig => "read_config",
            Request::WriteConfig { .. } => "write_config",
            Request::ReadData => "read_data",
            Request::WriteOutputs { .. } => "write_outputs",
            Request::ReadPulse => "read_pulse",
            Request::WritePulse { .. } => "write_pulse",
            Request::SampleAll => "sample_all",
            Request::HostOk => "host_ok",
            other => panic!("no vector has {other:?}"),
        }
    }

    pub(crate) fn show_request(exchange: &Exchange) -> Value {
        let to_all = exchange.request.is_broadcast();
        let head = json!({
            "address": (!to_all).then_some(exchange.address.0),
            "checksum": exchange.checksum,
            "command": command(&exchange.request),
        });
        let body = match exchange.request {
            Request::WriteConfig {
                new_address,
                type_code,
                baud_code,
                format,
            } => json!({
                "new_address": new_address.0,
                "type_code": type_code,
                "baud_code": baud_code,
                "format": format,
            }),
            Request::WriteOutputs { order, data } => json!({ "order": order, "data": data }),
            Request::WritePulse { mask, width } => json!({ "mask": mask, "width": width.tenths() }),
            _ => json!({}),
        };
        with(head, body)
    }

    pub(crate) fn build_request(fields: &Value) -> Exchange {
        let request = match name(fields, "command") {
            "read_name" => Request::ReadName,
            "read_config" => Request::ReadConfig,
            "write_config" => Request::WriteConfig {
                new_address: Address(number(fields, "new_address")),
                type_code: number(fields, "type_code"),
                baud_code: number(fields, "baud_code"),
                format: number(fields, "format"),
            },
            "read_data" => Request::ReadData,
            "write_outputs" => Request::WriteOutputs {
                order: number(fields, "order"),
                data: number(fields, "data"),
            },
            "read_pulse" => Request::ReadPulse,
            "write_pulse" => Request::WritePulse {
                mask: number(fields, "mask"),
                width: width(fields),
            },
            "sample_all" => Request::SampleAll,
            "host_ok" => Request::HostOk,
            other => panic!("command `{other}`"),
        };
        let address = if request.is_broadcast() {
            Address(0)
        } else {
            address(fields)
        };
        Exchange {
            address,
            checksum: flag(fields, "checksum"),
            request,
        }
    }

    pub(crate) fn show_response(exchange: &Exchange, reply: Reply<Response>) -> Value {
        let head = json!({
            "checksum": exchange.checksum,
            "command": command(&exchange.request),
            "address": reply.from.map(|from| from.0),
        });
        let body = match reply.response {
            Response::Text(text) => json!({ "name": text.as_str() }),
            Response::Config {
                type_code,
                baud_code,
                format,
            } => {
                json!({ "type_code": type_code, "baud_code": baud_code, "format": format })
            }
            Response::Data { outputs, inputs } => json!({ "outputs": outputs, "inputs": inputs }),
            Response::Pulse { mask, width } => json!({ "mask": mask, "width": width.tenths() }),
            Response::Done => json!({}),
            Response::Invalid => json!({ "invalid": true }),
            other => panic!("no vector has {other:?}"),
        };
        with(head, body)
    }

    pub(crate) fn build_response(fields: &Value) -> Response {
        if fields["invalid"] == true {
            return Response::Invalid;
        }
        match name(fields, "command") {
            "read_name" => Response::Text(Text::new(name(fields, "name").as_bytes()).unwrap()),
            "read_config" => Response::Config {
                type_code: number(fields, "type_code"),
                baud_code: number(fields, "baud_code"),
                format: number(fields, "format"),
            },
            "read_data" => Response::Data {
                outputs: number(fields, "outputs"),
                inputs: number(fields, "inputs"),
            },
            "read_pulse" => Response::Pulse {
                mask: number(fields, "mask"),
                width: width(fields),
            },
            _ => Response::Done,
        }
    }
}

pub(crate) mod lc02 {
    use super::*;
    use railbus_wire::lc02::{Exchange, Outputs, Request, Response};

    /// The channel number that stands for all outputs.
    const ALL: u8 = 255;

    fn command(request: &Request) -> &'static str {
        match request {
            Request::ReadConfig => "read_config",
            Request::WriteConfig { .. } => "write_config",
            Request::ReadData => "read_data",
            Request::WriteOutputs(_) => "write_outputs",
            Request::WritePulse { .. } => "write_pulse",
            Request::ReadPulse => "read_pulse",
        }
    }

    fn head(exchange: &Exchange, address: Address) -> Value {
        json!({ "address": address.0, "command": command(&exchange.request) })
    }

    pub(crate) fn show_request(exchange: &Exchange) -> Value {
        let body = match exchange.request {
            Request::WriteConfig {
                new_address,
                baud_code,
            } => {
                json!({ "new_address": new_address.0, "baud_code": baud_code })
            }
            Request::WriteOutputs(Outputs::All(value)) => json!({ "channel": ALL, "value": value }),
            Request::WriteOutputs(Outputs::One(channel, on)) => {
                json!({ "channel": channel.index(), "value": u8::from(on) })
            }
            Request::WritePulse { mask, width } => json!({ "mask": mask, "width": width.tenths() }),
            Request::ReadConfig | Request::ReadData | Request::ReadPulse => json!({}),
        };
        with(head(exchange, exchange.address), body)
    }

    pub(crate) fn build_request(fields: &Value) -> Exchange {
        let request = match name(fields, "command") {
            "read_config" => Request::ReadConfig,
            "write_config" => Request::WriteConfig {
                new_address: Address(number(fields, "new_address")),
                baud_code: number(fields, "baud_code"),
            },
            "read_data" => Request::ReadData,
            "write_outputs" => {
                let value: u8 = number(fields, "value");
                Request::WriteOutputs(match number(fields, "channel") {
                    ALL => Outputs::All(value),
                    channel => Outputs::One(Channel::new(channel).unwrap(), value == 1),
                })
            }
            "write_pulse" => Request::WritePulse {
                mask: number(fields, "mask"),
                width: width(fields),
            },
            "read_pulse" => Request::ReadPulse,
            other => panic!("command `{other}`"),
        };
        Exchange {
            address: address(fields),
            request,
        }
    }

    pub(crate) fn show_response(exchange: &Exchange, reply: Reply<Response>) -> Value {
        let body = match reply.response {
            Response::Config {
                baud_code,
                model,
                type_code,
            } => {
                json!({ "baud_code": baud_code, "model": model, "type_code": type_code })
            }
            Response::Data { outputs, inputs } => json!({ "outputs": outputs, "inputs": inputs }),
            Response::Pulse { mask, width } => json!({ "mask": mask, "width": width.tenths() }),
            Response::Done => json!({}),
        };
        with(head(exchange, reply.from.unwrap()), body)
    }

    pub(crate) fn build_response(fields: &Value) -> Response {
        match name(fields, "command") {
            "read_config" => Response::Config {
                baud_code: number(fields, "baud_code"),
                model: number(fields, "model"),
                type_code: number(fields, "type_code"),
            },
            "read_data" => Response::Data {
                outputs: number(fields, "outputs"),
                inputs: number(fields, "inputs"),
            },
            "read_pulse" => Response::Pulse {
                mask: number(fields, "mask"),
                width: width(fields),
            },
            _ => Response::Done,
        }
    }
}

pub(crate) mod r55 {
    use super::*;
    use railbus_wire::r55::{Exchange, Request, Response, U24};

    fn function(request: &Request) -> &'static str {
        match request {
            Request::ReadState => "read_state",
            Request::Open(_) => "open",
            Request::Close(_) => "close",
            Request::SetAll(_) => "set_all",
            Request::GroupOff(_) => "group_off",
            Request::GroupOn(_) => "group_on",
            Request::GroupToggle(_) => "group_toggle",
            Request::Toggle(_) => "toggle",
            Request::JogClose(..) => "jog_close",
            Request::JogOpen(..) => "jog_open",
            Request::ReadAddress => "read_address",
            Request::WriteAddress(_) => "write_address",
            Request::ReadVariable(_) => "read_variable",
            Request::WriteVariable(..) => "write_variable",
        }
    }

    pub(crate) fn show_request(exchange: &Exchange) -> Value {
        let request = exchange.request();
        let head = json!({
            "address": exchange.address().0,
            "function": function(&request),
            "reply": exchange.expects_reply(),
        });
        let terminal = |channel: Channel| channel.index() + 1;
        let body = match request {
            Request::Open(channel) | Request::Close(channel) | Request::Toggle(channel) => {
                json!({ "channel": terminal(channel) })
            }
            Request::SetAll(state) => json!({ "state": state }),
            Request::GroupOff(mask) | Request::GroupOn(mask) | Request::GroupToggle(mask) => {
                json!({ "mask": mask })
            }
            Request::JogClose(channel, ms) | Request::JogOpen(channel, ms) => {
                json!({ "channel": terminal(channel), "ms": ms.get() })
            }
            Request::WriteAddress(new) => json!({ "new_address": new.0 }),
            Request::ReadVariable(index) => json!({ "index": index }),
            Request::WriteVariable(index, value) => {
                json!({ "index": index, "value": value.get() })
            }
            Request::ReadState | Request::ReadAddress => json!({}),
        };
        with(head, body)
    }

    pub(crate) fn build_request(fields: &Value) -> Exchange {
        let channel = || Channel::new(number::<u8>(fields, "channel") - 1).unwrap();
        let u24 = |key| U24::new(number(fields, key)).unwrap();
        let request = match name(fields, "function") {
            "read_state" => Request::ReadState,
            "open" => Request::Open(channel()),
            "close" => Request::Close(channel()),
            "set_all" => Request::SetAll(number(fields, "state")),
            "group_off" => Request::GroupOff(number(fields, "mask")),
            "group_on" => Request::GroupOn(number(fields, "mask")),
            "group_toggle" => Request::GroupToggle(number(fields, "mask")),
            "toggle" => Request::Toggle(channel()),
            "jog_close" => Request::JogClose(channel(), u24("ms")),
            "jog_open" => Request::JogOpen(channel(), u24("ms")),
            "read_address" => Request::ReadAddress,
            "write_address" => Request::WriteAddress(Address(number(fields, "new_address"))),
            "read_variable" => Request::ReadVariable(number(fields, "index")),
            "write_variable" => Request::WriteVariable(number(fields, "index"), u24("value")),
            other => panic!("function `{other}`"),
        };
        let exchange = Exchange::new(address(fields), request);
        match flag(fields, "reply") {
            true => exchange,
            false => exchange.without_reply().unwrap(),
        }
    }

    pub(crate) fn show_response(exchange: &Exchange, reply: Reply<Response>) -> Value {
        json!({
            "address": reply.from.unwrap().0,
            "function": function(&exchange.request()),
            "data": reply.response.data,
        })
    }

    pub(crate) fn build_response(fields: &Value) -> Response {
        let data = fields["data"].as_array().unwrap();
        let bytes: Vec<u8> = data
            .iter()
            .map(|byte| u8::try_from(byte.as_u64().unwrap()).unwrap())
            .collect();
        Response {
            data: bytes.try_into().unwrap(),
        }
    }
}

pub(crate) mod lcus {
    use super::*;
    use railbus_wire::lcus::Request;

    pub(crate) fn show(request: &Request) -> Value {
        json!({ "channel": request.channel, "on": request.on })
    }

    pub(crate) fn build(fields: &Value) -> Request {
        Request {
            channel: number(fields, "channel"),
            on: flag(fields, "on"),
        }
    }
}

/// The address that a reply of these fields is sent from.
pub(crate) fn sender(fields: &Value) -> Address {
    Address(
        fields["address"]
            .as_u64()
            .map_or(0, |address| address.try_into().unwrap()),
    )
}
