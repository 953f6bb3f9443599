//! What the stores can do on this disk: samples a second over some seconds, a day's chart of one
//! point, and how long a command waits for its audit entry to be durable. Run it with
//! `--release`; the folder it works in can be named.
#![allow(clippy::print_stdout, reason = "printing is what it is for")]

use railbus_device::{Point, PointKind};
use railbus_site::{Config, Service, WriteTerms};
use railbus_store::audit::AuditLog;
use railbus_store::history::{History, Keep, Sample, SampleQuality};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// For so long samples are written.
const SUSTAINED: Duration = Duration::from_secs(10);
/// How many points change.
const POINTS: usize = 1_000;
/// How many commands are written down, one after the other and side by side.
const COMMANDS: usize = 500;
const THEN: i64 = 1_700_000_000_000;
const DAY: i64 = 86_400;

#[tokio::main(flavor = "current_thread")]
async fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).map_or_else(
        || std::env::temp_dir().join(format!("railbus-stores-{}", std::process::id())),
        PathBuf::from,
    );
    std::fs::create_dir_all(&folder)?;
    let history = History::open(&folder, Keep::default())?;
    sustained(&history).await;
    day(&history).await?;
    history.close().await;
    commands(&folder).await?;
    std::fs::remove_dir_all(&folder)?;
    Ok(())
}

/// Writes as many samples as are taken.
async fn sustained(history: &History) {
    let paths: Vec<Arc<str>> = (0..POINTS)
        .map(|number| Arc::from(format!("module{}.ai{}", number / 8, number % 8)))
        .collect();
    let begun = Instant::now();
    let (mut count, mut t) = (0_u64, THEN);
    while begun.elapsed() < SUSTAINED {
        for path in &paths {
            // A full queue is waited for here; a recorder would drop and count.
            while !history.sample(Arc::clone(path), sample(t, count)) {
                tokio::time::sleep(Duration::from_millis(1)).await;
            }
            count += 1;
        }
        t += 50;
    }
    let storage = history.storage().await;
    let seconds = begun.elapsed().as_secs_f64();
    let per_sample = storage.bytes as f64 / storage.samples as f64;
    println!(
        "{:.0} samples/s over {seconds:.1} s, {per_sample:.1} bytes each, WAL {} kB",
        storage.samples as f64 / seconds,
        storage.wal_bytes / 1_000,
    );
}

fn sample(t: i64, number: u64) -> Sample {
    Sample {
        t,
        value: Some((number % 1_000) as f64 / 100.0),
        grade: SampleQuality::Good,
    }
}

/// Draws a day of a point that changes every second.
async fn day(history: &History) -> Result<(), Box<dyn Error>> {
    let path: Arc<str> = Arc::from("tank.ai1");
    for second in 0..DAY {
        let sample = sample(THEN + second * 1_000, second.unsigned_abs());
        while !history.sample(Arc::clone(&path), sample) {
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
    }
    history.storage().await;
    let mut times = Vec::new();
    for _ in 0..20 {
        let begun = Instant::now();
        history.chart(&path, THEN, THEN + DAY * 1_000, 600).await?;
        times.push(begun.elapsed());
    }
    tell("a day's chart of 86,400 samples", &mut times);
    Ok(())
}

/// Writes to a line that has no port: what is left is the time that the log takes.
async fn commands(folder: &Path) -> Result<(), Box<dyn Error>> {
    let text = "[line.main]\nport = \"/dev/no-such-port\"\n\
                [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";
    let config = Config::parse(text).map_err(|problems| format!("{problems:?}"))?;
    let service = Service::start_quiet(config)?;
    let mut without = Vec::new();
    for _ in 0..COMMANDS {
        without.push(command(&service).await);
    }
    tell("a command without a log", &mut without);
    service.keep_audit(AuditLog::open(folder)?.0);
    let mut alone = Vec::new();
    for _ in 0..COMMANDS {
        alone.push(command(&service).await);
    }
    tell("a command with it, alone", &mut alone);
    let begun = Instant::now();
    let together = (0..COMMANDS).map(|_| {
        let service = service.clone();
        tokio::spawn(async move { command(&service).await })
    });
    let mut times = Vec::new();
    for task in together.collect::<Vec<_>>() {
        times.push(task.await?);
    }
    let per_second = COMMANDS as f64 / begun.elapsed().as_secs_f64();
    tell("a command with it, of 500 at once", &mut times);
    println!("{per_second:.0} commands/s");
    Ok(())
}

async fn command(service: &Service) -> Duration {
    let k1 = Point {
        kind: PointKind::Output,
        index: 0,
    };
    let begun = Instant::now();
    // The line has no port, which is told; only the time counts.
    let _ = service
        .write("oven", &[(k1, true)], WriteTerms::default())
        .await;
    begun.elapsed()
}

fn tell(what: &str, times: &mut [Duration]) {
    times.sort();
    let at = |percent: usize| times.get(times.len() * percent / 100).copied();
    println!(
        "{what}: median {:?}, p99 {:?}",
        at(50).unwrap_or_default(),
        at(99).unwrap_or_default()
    );
}
