//! Relays that do not move: what is told of a command that the module acknowledged and that was
//! then read back otherwise.

use crate::board::{k, until};
use railbus_device::Point;
use railbus_host::{Confirmation, Fault, LineState};
use railbus_site::{CommandError, Config, PointQuality, Service, WriteDone, WriteTerms};
use railbus_store::audit::End;
use railbus_wire::{crc16, sum8};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpListener;
use tokio::task::JoinSet;

/// A module at address 1 whose relays are off and stay off.
#[derive(Clone, Copy, Debug)]
struct Stuck {
    model: &'static str,
    protocol: &'static str,
    /// What it says of its pulse outputs.
    pulses: Option<u8>,
    /// After a write every read of its outputs but the first is lost.
    loses: bool,
}

impl Stuck {
    const fn new(model: &'static str, protocol: &'static str, pulses: Option<u8>) -> Stuck {
        Stuck {
            model,
            protocol,
            pulses,
            loses: false,
        }
    }

    const fn losing(model: &'static str, protocol: &'static str) -> Stuck {
        Stuck {
            loses: true,
            ..Stuck::new(model, protocol, None)
        }
    }

    /// What it answers; `reads` are those of its outputs since the last write.
    fn answer(self, request: &[u8], reads: &mut Option<u32>) -> Option<Vec<u8>> {
        let (is_write, is_read) = match (self.protocol, request) {
            ("rtu", [_, function, ..]) => (*function == 5, *function == 1),
            ("ascii", [first, ..]) => (*first == b'#', request == b"$016\r"),
            ("lc02", [_, _, _, command, ..]) => (*command == 4, *command == 3),
            (_, [_, _, command, ..]) => (*command == 0x12, *command == 0x10),
            _ => (false, false),
        };
        if is_write {
            *reads = Some(0);
        }
        if let Some(reads) = reads.as_mut().filter(|_| is_read) {
            *reads += 1;
            if self.loses && *reads > 1 {
                return None;
            }
        }
        match (self.protocol, request) {
            ("rtu", _) => {
                let mut reply = match request[1] {
                    1 | 2 => vec![1, request[1], 1, 0],
                    3 => vec![1, 3, 2, self.pulses?, 5],
                    5 => request[..6].to_vec(),
                    other => vec![1, other | 0x80, 1],
                };
                reply.extend(crc16(&reply).to_le_bytes());
                Some(reply)
            }
            ("ascii", _) if is_write => Some(b">\r".to_vec()),
            ("ascii", _) if is_read => Some(b"!000F00\r".to_vec()),
            ("ascii", b"$013\r") => Some(format!("!01{:02X}05\r", self.pulses?).into_bytes()),
            ("lc02", _) if is_write => Some(vec![0x6C, 0x63, 1, 1, 0x0D]),
            ("lc02", _) if is_read => Some(vec![0x6C, 0x63, 1, 0, 0x0F, 0x10, 0x0D]),
            ("lc02", [_, _, _, 6, ..]) => {
                let mask = self.pulses?;
                Some(vec![0x6C, 0x63, 1, mask, 5, 6 + mask, 0x0D])
            }
            ("r55", _) if is_write || is_read => {
                let state = u8::from(is_write);
                let mut reply = vec![0x22, 1, request[2], 0, 0, 0, state];
                reply.push(sum8(&reply));
                Some(reply)
            }
            _ => None,
        }
    }

    /// Switches its first relay on, with or without polls beside; what is told of that.
    async fn switch_on(self, polled: bool) -> Result<WriteDone, CommandError> {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let port = listener.local_addr().unwrap();
        tokio::spawn(async move {
            let (mut stream, _) = listener.accept().await.unwrap();
            let (mut request, mut reads) = ([0; 64], None);
            while let Ok(len @ 1..) = stream.read(&mut request).await {
                if reads.is_none() {
                    // Who was slow is waited for on a busy machine, too.
                    tokio::time::sleep(SLOW).await;
                }
                if let Some(reply) = self.answer(&request[..len], &mut reads) {
                    stream.write_all(&reply).await.unwrap();
                }
            }
        });
        let Stuck {
            model, protocol, ..
        } = self;
        let text = format!(
            "[line.main]\nport = \"tcp:{port}\"\n[module.oven]\nline = \"main\"\n\
             model = \"{model}\"\nprotocol = \"{protocol}\"\naddress = 1\n"
        );
        let config = Config::parse(&text).unwrap();
        let service = match polled {
            true => Service::start(config).unwrap(),
            false => Service::start_quiet(config).unwrap(),
        };
        let is_good = || service.point("oven", FIRST).unwrap().quality == PointQuality::Good;
        let is_up = || service.line("main").unwrap().state == LineState::Up;
        until(|| is_up() && (!polled || is_good())).await;
        let end = service
            .write("oven", &[(FIRST, true)], WriteTerms::default())
            .await;
        let entry = service.audit().pop().unwrap();
        let told = match &end {
            Ok(_) => "reply",
            Err(failure) => failure.name(),
        };
        assert_eq!(entry.end.map(End::name), Some(told), "{self:?}");
        service.close().await;
        end
    }
}

const FIRST: Point = k(1);
/// How long it takes for every answer before the first write.
const SLOW: Duration = Duration::from_millis(120);

#[tokio::test]
async fn what_is_read_back_otherwise_is_never_told_as_done() {
    let stuck = [
        Stuck::new("eda9060a", "ascii", Some(0)),
        Stuck::new("eda9060a", "rtu", Some(0)),
        Stuck::new("eda9060a", "lc02", Some(0)),
        // An EDA9060, which knows no pulses, or an EDA9050 in its place.
        Stuck::new("eda9060a", "ascii", None),
        Stuck::new("eda9060a", "rtu", None),
        Stuck::losing("eda9060a", "rtu"),
        Stuck::losing("erc8", "rtu"),
        Stuck::losing("eda9050", "lc02"),
        Stuck::losing("eda9050", "ascii"),
        Stuck::losing("r55", "r55"),
    ];
    let mut ends = JoinSet::new();
    for module in stuck {
        for polled in [false, true] {
            ends.spawn(async move { (module, polled, module.switch_on(polled).await) });
        }
    }
    for (module, polled, end) in ends.join_all().await {
        let told = matches!(end, Err(CommandError::Line(Fault::NotVerified)));
        assert!(told, "{module:?}, polled {polled}: {end:?}");
    }
}

#[tokio::test]
async fn a_pulse_that_is_over_was_acknowledged_and_its_output_is_off() {
    for protocol in ["ascii", "rtu", "lc02"] {
        for polled in [false, true] {
            let module = Stuck::new("eda9060a", protocol, Some(1));
            let done = module.switch_on(polled).await.unwrap();
            let before = polled.then_some(false);
            assert_eq!(done.confirmed, Confirmation::Reply, "{module:?}");
            assert_eq!(done.outputs, [(FIRST, Some(false), before)], "{module:?}");
        }
    }
}
