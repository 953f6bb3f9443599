//! The masters, each a process of its own: ours, the floor, and third-party ones.

use crate::scene::{Scene, command};
use railbus_host::{Event, Line, LineEvent, LineName, LineOptions, Module, ModuleId, Plan, Terms};
use railbus_wire::Micros;
use rustix::fd::OwnedFd;
use rustix::fs::{Mode, OFlags};
use rustix::time::{
    Itimerspec, TimerfdClockId, TimerfdFlags, TimerfdTimerFlags, Timespec, timerfd_create,
    timerfd_settime,
};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::Notify;
use tokio_modbus::client::{Reader, rtu};
use tokio_modbus::slave::Slave;

/// The master.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Master {
    /// A plain loop of write and read over the same bytes.
    Floor,
    /// `railbus_host::Line`, polling.
    Ours,
    /// `railbus_host::Line`, one command after the other, each read back.
    Commands,
    /// libmodbus, in C.
    Libmodbus,
    /// tokio-modbus on serial2-tokio.
    TokioModbus,
    /// Asynchronous pymodbus.
    Pymodbus,
}

use Master::{Commands, Floor, Libmodbus, Ours, Pymodbus, TokioModbus};

/// The third-party ones.
pub const PEERS: [Master; 3] = [Libmodbus, TokioModbus, Pymodbus];

impl Master {
    /// Its name in tables and arguments.
    pub const fn name(self) -> &'static str {
        match self {
            Floor => "floor",
            Ours => "railbus",
            Commands => "railbus commands",
            Libmodbus => "libmodbus",
            TokioModbus => "tokio-modbus",
            Pymodbus => "pymodbus async",
        }
    }

    /// The command to run it for this many exchanges; none if it is not installed.
    pub fn start(self, scene: (&str, u32), path: &Path, count: usize) -> Option<Command> {
        let coils = || {
            Scene::new("rtu", 0)
                .ok()
                .and_then(|scene| Coils::of(&scene))
        };
        let mut start = match self {
            Libmodbus => Command::new(compiled("libmodbus")?),
            Pymodbus => {
                let mut start = Command::new(python()?);
                start.arg(peers().join("pymodbus_master.py"));
                start
            }
            Floor | Ours | Commands | TokioModbus => {
                let mut start = Command::new(std::env::current_exe().ok()?);
                start.args(["--master", self.name(), scene.0, &scene.1.to_string()]);
                start.arg(path).arg(count.to_string());
                return Some(start);
            }
        };
        let coils = coils()?;
        start.arg(path);
        for number in [coils.address.into(), coils.first, coils.count] {
            start.arg(number.to_string());
        }
        start.arg(count.to_string());
        Some(start)
    }
}

/// What the third-party masters read: the coils of the scene `rtu`.
struct Coils {
    address: u8,
    first: u16,
    count: u16,
}

impl Coils {
    fn of(scene: &Scene) -> Option<Coils> {
        match scene.reads.first()?.request[..] {
            [address, 1, a, b, c, d, ..] => Some(Coils {
                address,
                first: u16::from_be_bytes([a, b]),
                count: u16::from_be_bytes([c, d]),
            }),
            _ => None,
        }
    }
}

fn peers() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("peers")
}

/// A peer in C on libmodbus, compiled beside this program unless that was done already. `None`
/// without a compiler or the library.
pub fn compiled(name: &str) -> Option<PathBuf> {
    let program = std::env::current_exe()
        .ok()?
        .with_file_name(format!("bench-{name}"));
    let source = peers().join(format!("{name}.c"));
    let age = |path: &Path| path.metadata().and_then(|about| about.modified()).ok();
    if age(&program) < age(&source) {
        let flags = Command::new("pkg-config")
            .args(["--cflags", "--libs", "libmodbus"])
            .output();
        let flags = flags.ok().filter(|end| end.status.success())?;
        let mut compile = Command::new("gcc");
        compile.args(["-O2", "-o"]).arg(&program).arg(&source);
        compile.args(String::from_utf8_lossy(&flags.stdout).split_whitespace());
        compile.status().ok().filter(|end| end.success())?;
    }
    Some(program)
}

/// A Python that has pymodbus: the one for which `cargo xtask` installs peers, or the system's.
fn python() -> Option<PathBuf> {
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/interop-venv/bin/python");
    [own, PathBuf::from("python3")].into_iter().find(|python| {
        Command::new(python)
            .args(["-c", "import pymodbus, serial"])
            .stderr(Stdio::null())
            .status()
            .is_ok_and(|end| end.success())
    })
}

/// Runs the master of this name for this many exchanges.
pub fn be(name: &str, scene: (&str, u32), path: &str, count: usize) -> Result<(), String> {
    let what = Scene::new(scene.0, scene.1)?;
    match [Floor, Ours, Commands, TokioModbus]
        .into_iter()
        .find(|master| master.name() == name)
    {
        Some(Floor) => floor(&what, path, count).map_err(|why| why.to_string()),
        Some(Ours) => runtime(false)?.block_on(polls(&what, path, count)),
        Some(Commands) => runtime(false)?.block_on(commands(&what, path, count)),
        Some(TokioModbus) => runtime(true)?.block_on(tokio_modbus(&what, path, count)),
        _ => Err(format!("there is no master `{name}`")),
    }
}

/// A line does not need tokio's timers; others do.
fn runtime(timers: bool) -> Result<tokio::runtime::Runtime, String> {
    let mut builder = tokio::runtime::Builder::new_current_thread();
    if timers {
        builder.enable_time();
    }
    builder.enable_io().build().map_err(|why| why.to_string())
}

/// The smallest master: the same requests, the same silence, without checking the replies.
fn floor(scene: &Scene, path: &str, count: usize) -> rustix::io::Result<()> {
    let port = rustix::fs::open(path, OFlags::RDWR | OFlags::NOCTTY, Mode::empty())?;
    let timer = timerfd_create(TimerfdClockId::Monotonic, TimerfdFlags::CLOEXEC)?;
    let mut buffer = [0; 300];
    for step in scene.reads.iter().cycle().take(count) {
        if step.gap > Micros::ZERO {
            pause(&timer, step.gap)?;
        }
        rustix::io::write(&port, &step.request)?;
        let mut left = step.reply.len();
        while left > 0 {
            left -= rustix::io::read(&port, &mut buffer[..left])?;
        }
    }
    Ok(())
}

fn pause(timer: &OwnedFd, span: Micros) -> rustix::io::Result<()> {
    let value = Itimerspec {
        it_interval: Timespec::default(),
        it_value: Timespec {
            tv_sec: 0,
            tv_nsec: (span.0 * 1000) as i64,
        },
    };
    timerfd_settime(timer, TimerfdTimerFlags::empty(), &value)?;
    rustix::io::read(timer, &mut [0; 8])?;
    Ok(())
}

fn line(scene: &Scene, path: &str, plan: Plan) -> Result<LineOptions, String> {
    let mut config = LineOptions::new(LineName::Serial(path.into()));
    for setup in &scene.modules {
        let module = Module::new(*setup).map_err(|why| why.to_string())?;
        config = config.with(module, plan);
    }
    Ok(config)
}

async fn polls(scene: &Scene, path: &str, count: usize) -> Result<(), String> {
    let done = Arc::new(Notify::new());
    let (notify, mut left) = (Arc::clone(&done), count);
    let plan = Plan {
        interval: Micros::ZERO,
        ..Plan::default()
    };
    let mut config = line(scene, path, plan)?;
    config.observer = Some(Box::new(move |events| {
        for event in events {
            if let LineEvent::Bus(Event::Seen { .. } | Event::Missed { .. }) = event {
                left = left.saturating_sub(1);
                if left == 0 {
                    notify.notify_one();
                }
            }
        }
    }));
    let line = Line::open(config).map_err(|why| format!("{why:?}"))?;
    done.notified().await;
    line.close().await;
    Ok(())
}

async fn commands(scene: &Scene, path: &str, count: usize) -> Result<(), String> {
    let line = Line::open(line(scene, path, Plan::NEVER)?).map_err(|why| format!("{why:?}"))?;
    line.opened().await.map_err(|why| format!("{why:?}"))?;
    for _ in 0..count {
        line.run(ModuleId(0), command(), Terms::default())
            .await
            .map_err(|why| format!("a command failed: {why:?}"))?;
    }
    line.close().await;
    Ok(())
}

async fn tokio_modbus(scene: &Scene, path: &str, count: usize) -> Result<(), String> {
    let coils = Coils::of(scene).ok_or("no coils to read")?;
    let port = serial2_tokio::SerialPort::open(path, 115_200).map_err(|why| why.to_string())?;
    let mut master = rtu::attach_slave(port, Slave(coils.address));
    for _ in 0..count {
        let read = master.read_coils(coils.first, coils.count);
        // A request that is not answered is given up.
        let _ = tokio::time::timeout(Duration::from_millis(200), read).await;
    }
    Ok(())
}
