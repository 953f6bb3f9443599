//! `POST /api/v1/scans`: finds the modules on lines, between the daemon's own polls. It only reads.

use super::access::Need;
use super::doc::Doc;
use super::listen::ended;
use super::ops::Op;
use super::order::Order;
use super::route::{Answer, Route};
use super::site::Site;
use axum::http::StatusCode;
use axum::routing::post;
use railbus_api::ops::{
    OpBegun, OpInfo, OpState, ScanDepth, ScanLeftOut, ScanModule, ScanPlace, ScanRequest,
    ScanResult,
};
use railbus_api::problem::{Problem, codes};
use railbus_app::api::{ask, convert, failures};
use railbus_app::scan::{ScanEnd, addresses, could_be, drive, evidence, met, ranges, setup};
use railbus_commission::scan::{
    Depth, FoundModule, Known, LeftOut, ScanOptions, ScanProgress, Scanner, Scope,
};
use railbus_device::Setup;
use railbus_host::{LineName, LineState, Probe};
use railbus_site::config::add::free_name;
use railbus_site::{LineStatus, RawTerms, Service};
use railbus_wire::{Baud, Micros, Protocol};
use std::ops::ControlFlow;
use std::sync::{Arc, Mutex, PoisonError};
use tokio::task::JoinSet;

/// The routes of this file.
pub(super) const ROUTES: &[Route] = &[Route::new("POST", "/scans", Need::ENGINEER, || post(begin))
    .doc(
        Doc::new("Ask who is on the lines, beside the polls of their modules")
            .takes::<ScanRequest>()
            .answers::<OpBegun>()
            .status("202"),
    )];

async fn begin(order: Order) -> Answer {
    let (here, name) = (order.site.clone(), order.who.name.clone());
    let run = |service: Service, _, wanted: ScanRequest| async move {
        start(here, service, name, &wanted)
    };
    let mut answer = order.carry_out(("scan", String::new()), run).await;
    if answer.status() == StatusCode::OK {
        *answer.status_mut() = StatusCode::ACCEPTED;
    }
    answer
}

/// Checks everything that can be checked, and starts it.
fn start(
    site: Site,
    service: Service,
    who: String,
    wanted: &ScanRequest,
) -> Result<OpBegun, Problem> {
    let mut lines = wanted.lines.clone();
    if lines.is_empty() {
        lines.push(ask::only_line(&service)?);
    }
    lines.sort_unstable();
    lines.dedup();
    let scanners = lines
        .iter()
        .map(|line| Ok((line.clone(), Scanner::new(scope(&service, line, wanted)?))))
        .collect::<Result<Vec<_>, Problem>>()?;
    let estimates = scanners
        .iter()
        .map(|(_, scanner)| scanner.progress().left.0);
    let info = OpInfo {
        // The lines are scanned in parallel.
        estimate_ms: estimates.max().unwrap_or_default() / 1_000,
        ..site.ops.begins_now("scan", lines, who)
    };
    let op = site.ops.begin(info)?;
    let begun = OpBegun { op: op.info().op };
    tokio::spawn(all(site, service, op, scanners));
    Ok(begun)
}

/// What to scan on a line.
fn scope(service: &Service, line: &str, wanted: &ScanRequest) -> Result<Scope, Problem> {
    let status = service.line(line);
    let status = status.ok_or_else(|| failures::no_such_line(service, line))?;
    if status.state != LineState::Up {
        return Err(failures::line_closed(service, line));
    }
    let port = status.port.parse::<LineName>();
    let mut wish = wish(wanted, &status)?;
    if let Ok(LineName::ModbusTcp { .. }) = port {
        wish.protocols.get_or_insert(vec![Protocol::Rtu]);
    }
    let scope = Scope::of(&wish, known(service, line));
    let refused = |reason: &str| {
        let problem = Problem::new(codes::BAD_REQUEST).with("line", line);
        Err(problem.with("reason", reason))
    };
    if scope.runs.is_empty() {
        return refused("nobody can be asked so");
    }
    let has_own_speed = matches!(port, Ok(LineName::Tcp { .. } | LineName::ModbusTcp { .. }));
    if has_own_speed && scope.runs.iter().any(|run| run.settings != status.serial) {
        return refused("a serial server sets the speed of this line");
    }
    Ok(scope)
}

fn wish(wanted: &ScanRequest, line: &LineStatus) -> Result<ScanOptions, Problem> {
    let wrong = |what: &str| Problem::new(codes::BAD_REQUEST).with("reason", what.to_owned());
    let protocol = |name: &String| {
        let found = Protocol::ALL.into_iter().find(|p| p.name() == name);
        found.ok_or_else(|| wrong("\"protocols\" can't be read"))
    };
    let baud = |rate: &u32| Baud::from_rate(*rate).ok_or_else(|| wrong("\"bauds\" can't be read"));
    let named = wanted.addresses.as_deref().map(addresses).transpose();
    let protocols = wanted.protocols.as_ref();
    let bauds = wanted.bauds.as_ref();
    Ok(ScanOptions {
        depth: match wanted.depth {
            ScanDepth::Quick => Depth::Quick,
            ScanDepth::Full => Depth::Full,
            ScanDepth::Deep => Depth::Deep,
        },
        line: Some(line.serial),
        addresses: named.map_err(|part| wrong(&format!("addresses: {part}")))?,
        protocols: protocols
            .map(|names| distinct(names.iter().map(protocol)))
            .transpose()?,
        bauds: bauds
            .map(|rates| distinct(rates.iter().map(baud)))
            .transpose()?,
        characters: None,
        checksum: None,
        silence: None,
        describes: false,
    })
}

/// Removes duplicates, keeping the order.
fn distinct<T: PartialEq>(
    named: impl Iterator<Item = Result<T, Problem>>,
) -> Result<Vec<T>, Problem> {
    let mut all = Vec::new();
    for one in named {
        let one = one?;
        if !all.contains(&one) {
            all.push(one);
        }
    }
    Ok(all)
}

/// The modules that the configuration has on this line.
fn known(service: &Service, line: &str) -> Vec<Known> {
    let config = service.config();
    let known = config.modules_of(line).map(|(name, module)| Known {
        name: name.clone(),
        family: module.setup.family,
        settings: module.setup.serial,
        protocol: module.setup.protocol,
        address: module.setup.address,
        checksum: module.setup.checksum,
    });
    known.collect()
}

/// The state of the scan of a line.
#[derive(Clone, Debug, Default)]
struct Part {
    done: u64,
    total: u64,
    left: Micros,
    found: Vec<(ScanModule, bool)>,
    setups: Vec<Option<Setup>>,
    missing: Vec<String>,
    /// The line, if slow modules may have been missed on it.
    slow: Option<String>,
    left_out: Vec<ScanLeftOut>,
}

impl Part {
    fn of(line: &str, scanner: &Scanner) -> Part {
        let found = scanner.found().iter();
        let told = |found: &FoundModule| (module(line, found), found.is_conflict());
        let mut part = Part {
            found: found.clone().map(told).collect(),
            setups: found.map(|found| setup(found, None)).collect(),
            ..Part::default()
        };
        part.reached(scanner.progress());
        part
    }

    fn reached(&mut self, progress: ScanProgress) {
        let count = |number: usize| u64::try_from(number).unwrap_or(u64::MAX);
        (self.done, self.total) = (count(progress.done), count(progress.total));
        self.left = progress.left;
    }

    fn ended(line: &str, scanner: &Scanner) -> Part {
        Part {
            left: Micros(0),
            missing: scanner.missing().map(str::to_owned).collect(),
            slow: scanner.is_slow().then(|| line.to_owned()),
            left_out: scanner
                .left_out()
                .iter()
                .map(|left| left_out(line, left))
                .collect(),
            ..Part::of(line, scanner)
        }
    }
}

fn module(line: &str, found: &FoundModule) -> ScanModule {
    let settings = found.asked.settings;
    let family = found.identity.family;
    let title = found.identity.model.clone();
    ScanModule {
        line: line.to_owned(),
        address: found.asked.address.0,
        protocol: found.protocol().name().to_owned(),
        model: family.map(|family| family.name().to_owned()),
        title: title
            .or_else(|| family.map(|family| family.to_string()))
            .unwrap_or_default(),
        by_behaviour: found.identity.by_behaviour,
        could_be: could_be(found).into_iter().map(str::to_owned).collect(),
        baud: settings.baud.rate(),
        format: settings.character.to_string(),
        checksum: found.checksum(),
        rtt_ms: convert::millis_tenths(found.rtt),
        verdict: found.verdict().name().to_owned(),
        evidence: evidence(found),
        name: found.known.clone(),
        differs: found.differs,
        suggest: None,
    }
}

fn left_out(line: &str, left: &LeftOut) -> ScanLeftOut {
    ScanLeftOut {
        line: line.to_owned(),
        protocol: left.ask.protocol().name().to_owned(),
        baud: left.settings.baud.rate(),
        format: left.settings.character.to_string(),
        addresses: ranges(&left.addresses),
    }
}

/// How the scan of a line ended.
enum End {
    Complete,
    Cancelled,
    Failed(Problem),
}

/// What the scans of the lines share.
struct Run {
    service: Service,
    op: Op,
    parts: Mutex<Vec<Part>>,
}

impl Run {
    /// Updates the part of a line.
    fn put(&self, index: usize, part: Part) {
        let mut parts = self.parts.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(old) = parts.get_mut(index) {
            *old = part;
        }
        let result = result(&self.service, &parts);
        self.op.tell(|info| {
            sum_up(info, &parts);
            info.found = u64::try_from(result.modules.len()).unwrap_or_default();
            info.result = result;
        });
    }

    /// Updates the progress of a line.
    fn progress(&self, index: usize, progress: ScanProgress) {
        let mut parts = self.parts.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(part) = parts.get_mut(index) {
            part.reached(progress);
        }
        self.op.tell(|info| sum_up(info, &parts));
    }
}

/// The progress of all lines together.
fn sum_up(info: &mut OpInfo, parts: &[Part]) {
    info.done = parts.iter().map(|part| part.done).sum();
    info.total = parts.iter().map(|part| part.total).sum();
    info.percent = (info.done * 1_000 / info.total.max(1)) as f64 / 10.0;
    let left = parts.iter().map(|part| part.left.0).max();
    info.left_ms = left.unwrap_or_default() / 1_000;
}

/// The modules found on all lines, with names for new ones.
fn result(service: &Service, parts: &[Part]) -> ScanResult {
    let config = service.config();
    let mut taken: Vec<(String, Setup)> = Vec::new();
    let mut result = ScanResult::default();
    for part in parts {
        for ((module, conflict), setup) in part.found.iter().zip(&part.setups) {
            let mut module = module.clone();
            if let (None, Some(setup)) = (&module.name, setup) {
                let name = free_name(&config, &taken, setup);
                taken.push((name.clone(), *setup));
                module.suggest = Some(name);
            }
            if *conflict {
                result.conflicts.push(ScanPlace {
                    line: module.line.clone(),
                    address: module.address,
                    protocol: module.protocol.clone(),
                    baud: module.baud,
                });
            }
            result.modules.push(module);
        }
        result.missing.extend(part.missing.iter().cloned());
        result.slow.extend(part.slow.clone());
        result.left_out.extend(part.left_out.iter().cloned());
    }
    let place = |module: &ScanModule| (module.line.clone(), module.baud, module.address);
    result.modules.sort_by_key(place);
    result
}

/// Scans the lines in parallel, and reports the end.
async fn all(site: Site, service: Service, op: Op, scanners: Vec<(String, Scanner)>) {
    let parts = scanners
        .iter()
        .map(|(line, scanner)| Part::of(line, scanner));
    let run = Arc::new(Run {
        service,
        op,
        parts: Mutex::new(parts.collect()),
    });
    let mut scans = JoinSet::new();
    for (index, (line, scanner)) in scanners.into_iter().enumerate() {
        scans.spawn(scan(site.clone(), Arc::clone(&run), index, line, scanner));
    }
    let mut end = End::Complete;
    while let Some(ended) = scans.join_next().await {
        match (ended, &end) {
            (_, End::Failed(_)) | (Ok(End::Complete), _) => {}
            (Ok(other), _) => end = other,
            (Err(why), _) => {
                let problem = Problem::new(codes::INTERNAL).with("reason", why.to_string());
                end = End::Failed(problem);
            }
        }
    }
    run.op.tell(|info| {
        info.left_ms = 0;
        (info.state, info.error) = match end {
            End::Complete => (OpState::Done, None),
            End::Cancelled => (OpState::Cancelled, None),
            End::Failed(problem) => (OpState::Failed, Some(problem)),
        };
        info.result.complete = info.state == OpState::Done;
    });
}

/// Scans a line.
async fn scan(
    mut site: Site,
    run: Arc<Run>,
    index: usize,
    line: String,
    mut scanner: Scanner,
) -> End {
    let probe = |probe: Probe| {
        let terms = RawTerms {
            settings: Some(probe.settings),
            gap: Some(probe.gap),
            timeout: Some(probe.timeout),
            clear: probe.clear,
        };
        let result = run.service.raw(&line, probe.exchange, terms);
        async { result.await.map(met) }
    };
    let stop = async {
        tokio::select! {
            () = run.op.cancelled() => {}
            () = ended(&mut site.stop) => {}
        }
    };
    let see = |scanner: &Scanner, found: Option<usize>| {
        match found {
            Some(_) => run.put(index, Part::of(&line, scanner)),
            None => run.progress(index, scanner.progress()),
        }
        ControlFlow::Continue(())
    };
    let end = match drive(&mut scanner, probe, stop, see).await {
        ScanEnd::Complete => End::Complete,
        ScanEnd::Stopped(()) => End::Cancelled,
        ScanEnd::Noise => End::Failed(Problem::new(codes::SCAN_NOISE).with("line", line.as_str())),
        ScanEnd::Failed(failure) => End::Failed(failures::of_line(&run.service, &line, &failure)),
    };
    run.put(index, Part::ended(&line, &scanner));
    end
}
