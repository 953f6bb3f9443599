//! Requests and replies: modules, and every request to them with its reply, which the simulated
//! modules gave beforehand.

use railbus_device::{Bank, Eeprom, Family, Module, Op, Options, Setup};
use railbus_sim::{Input, Output, VirtualLine, VirtualLineConfig, demo};
use railbus_wire::{Address, Channel, Frame, Instant, Micros, Protocol, SerialSettings};

/// Each protocol alone, and the demo line, where four of them are mixed.
pub const NAMES: [&str; 5] = ["rtu", "ascii", "lc02", "r55", "demo"];

/// Modules on one line and their replies.
pub struct Scene {
    /// The modules, as they are described to the line master.
    pub modules: Vec<Setup>,
    /// One round of reads, in the order in which the line master sends them.
    pub reads: Vec<Step>,
    /// Other requests that may come: identification, fences, and the write of [`command`].
    others: Vec<Step>,
    /// From the end of a request to the reply.
    pub turnaround: Micros,
}

/// One exchange.
pub struct Step {
    /// The request.
    pub request: Vec<u8>,
    /// Its reply.
    pub reply: Vec<u8>,
    /// The silence that is needed before the request.
    pub gap: Micros,
}

/// The write that is measured: the first output on.
pub fn command() -> Op {
    Op::Write(Channel::new(0).map_or(Bank::default(), |first| Bank::one(first, true)))
}

/// 3.5 characters of 10 bits at this speed, whatever the speed.
pub fn t3_5(baud: u32) -> Micros {
    Micros(35_000_000_u64.div_ceil(u64::from(baud)))
}

impl Scene {
    /// The scene of this name on a line of this speed; 0 is a line without a speed.
    pub fn new(name: &str, baud: u32) -> Result<Scene, String> {
        let alone = |family, protocol| {
            vec![Setup {
                protocol,
                ..Setup::new(family, Address(3))
            }]
        };
        let mut modules = match name {
            "rtu" => alone(Family::Erc8, Protocol::Rtu),
            "ascii" => alone(Family::Eda9050, Protocol::Ascii),
            "lc02" => alone(Family::Eda9050, Protocol::Lc02),
            "r55" => alone(Family::R55, Protocol::R55),
            "demo" => demo::modules().map(|(_, setup)| setup).to_vec(),
            _ => return Err(format!("there is no scene `{name}`")),
        };
        let mut turnaround = Micros::from_millis(5);
        for setup in &mut modules {
            if baud == 0 {
                setup.gap = Some(Micros::ZERO);
            } else if name == "rtu" {
                setup.gap = Some(t3_5(baud));
                turnaround = t3_5(baud);
            }
        }
        let (mut reads, mut others) = (Vec::new(), Vec::new());
        for setup in &modules {
            let module = Module::new(*setup).map_err(|why| why.to_string())?;
            // The write first: afterwards the module shows what it did.
            for op in [command(), Op::Fence, Op::Identify]
                .into_iter()
                .chain(module.on_online_op())
            {
                others.extend(step(&module, &op)?);
            }
            for op in module.full_poll() {
                reads.extend(step(&module, &op)?);
            }
        }
        Ok(Scene {
            modules,
            reads,
            others,
            turnaround,
        })
    }

    /// The exchange that begins with these bytes, if they are a whole request.
    pub fn answer(&self, request: &[u8]) -> Option<&Step> {
        let steps = || self.reads.iter().chain(&self.others);
        steps().find(|step| step.request == request)
    }
}

/// The request of an op and a simulated module's reply to it after [`command`].
fn step(module: &Module, op: &Op) -> Result<Option<Step>, String> {
    let Ok(exchange) = module.exchange(op) else {
        return Ok(None);
    };
    let setup = module.setup();
    let mut line = VirtualLine::new(VirtualLineConfig::default());
    line.add(
        Instant(0),
        "module",
        setup,
        Eeprom::of(setup),
        Options::default(),
    )
    .map_err(|why| why.to_string())?;
    let mut now = Instant(1_000_000);
    let mut frame = Frame::new();
    if let Ok(write) = module.exchange(&command())
        && op.is_read()
    {
        write.encode(&mut frame);
        ask(&mut line, &mut now, frame.bytes());
    }
    exchange.encode(&mut frame);
    let reply = ask(&mut line, &mut now, frame.bytes());
    if exchange.decode_response(&reply).whole().is_none() {
        return Err(format!("the simulated module answers {reply:?} to {op:?}"));
    }
    Ok(Some(Step {
        request: frame.bytes().to_vec(),
        reply,
        gap: setup.request_gap(),
    }))
}

/// What a line in virtual time answers within a second.
pub fn ask(line: &mut VirtualLine, now: &mut Instant, request: &[u8]) -> Vec<u8> {
    let end = *now + Micros::from_secs(1);
    let settings = SerialSettings::FACTORY;
    line.handle(
        *now,
        Input::Send {
            bytes: request,
            settings,
        },
    );
    let mut reply = Vec::new();
    loop {
        match line.poll() {
            Output::Heard { bytes, .. } => reply.extend_from_slice(bytes),
            Output::Effect { .. } => {}
            Output::Wait(at) => {
                *now = at.map_or(end, |at| at.min(end));
                line.handle(*now, Input::Timeout);
                if *now == end {
                    return reply;
                }
            }
        }
    }
}
