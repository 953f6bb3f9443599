//! Queries and commands in terms of the API: for the server's clients, and for commands that run
//! without a server.

use super::{convert, failures};
use railbus_api::problem::{Problem, codes};
use railbus_api::types::{
    CommandInfo, LineInfo, ModuleInfo, OutputWritten, OutputsRequest, OutputsWritten, PointInfo,
    PulseRequest, Pulsed, Quality, Reason, ToggleRequest, WriteRequest, Written,
};
use railbus_device::Point;
use railbus_site::paths;
use railbus_site::{CommandError, Pulse, Service, ToggleTerms, Within, WriteDone, WriteTerms};
use railbus_wire::Micros;
use std::time::Instant;

/// All lines.
pub fn lines(service: &Service) -> Vec<LineInfo> {
    service.lines().into_iter().map(convert::line).collect()
}

/// All modules.
pub fn modules(service: &Service) -> Vec<ModuleInfo> {
    let modules = service.modules().into_iter();
    modules
        .map(|status| convert::module(service, status))
        .collect()
}

/// All modules, each read now: see [`fresh_points`]. One that does not answer is listed as offline.
pub async fn fresh_modules(service: &Service) -> Vec<ModuleInfo> {
    let mut modules = Vec::new();
    for name in service.config().modules.keys() {
        let _ = service.read_fresh(name).await;
        let status = service.module(name);
        modules.extend(status.map(|status| convert::module(service, status)));
    }
    modules
}

/// The selected points.
pub fn points(service: &Service, selectors: &[String]) -> Vec<PointInfo> {
    let config = service.config();
    let modules = config.modules.keys();
    modules
        .flat_map(|module| points_of(service, module, selectors))
        .collect()
}

/// The same for one module.
fn points_of(service: &Service, module: &str, selectors: &[String]) -> Vec<PointInfo> {
    let points = service.points(module).into_iter();
    points
        .filter(|status| paths::selects(selectors, &status.module, &status.label))
        .map(convert::point)
        .collect()
}

/// All points matched by one of the selectors, read now. A module that does not answer does not
/// prevent the others from being read, and its last known values count as those of an offline
/// module; if none answers, the error is returned. Each value is rated at the time its own module
/// was read: however long the others take after that, the value only gets older, which is not a
/// fault of its module.
pub async fn fresh_points(
    service: &Service,
    selectors: &[String],
) -> Result<Vec<PointInfo>, Problem> {
    let mut modules: Vec<String> = points(service, selectors)
        .into_iter()
        .map(|point| point.module)
        .collect();
    modules.dedup();
    let (mut silent, mut why) = (0, None);
    let mut asked = Vec::with_capacity(modules.len());
    for module in &modules {
        let read = service.read_fresh(module).await;
        let mut points = points_of(service, module, selectors);
        if let Err(failure) = read {
            why.get_or_insert_with(|| failures::of_read(service, module, None, &failure));
            silent += 1;
            for point in &mut points {
                point.quality = Quality::Bad;
                point.reason.get_or_insert(Reason::Offline);
            }
        }
        asked.push((Instant::now(), points));
    }
    match why {
        Some(why) if silent == modules.len() => Err(why),
        _ => Ok(asked.into_iter().flat_map(aged).collect()),
    }
}

/// Points as they were then, with their present age.
fn aged((then, mut points): (Instant, Vec<PointInfo>)) -> Vec<PointInfo> {
    let since = u64::try_from(then.elapsed().as_millis()).unwrap_or(u64::MAX);
    for age in points.iter_mut().filter_map(|point| point.age_ms.as_mut()) {
        *age = age.saturating_add(since);
    }
    points
}

/// Refuses the name of an unknown module or point; patterns may match nothing.
pub fn check_selector(service: &Service, selector: &str) -> Result<(), Problem> {
    if selector.contains(['*', '?']) {
        return Ok(());
    }
    if paths::split(selector).is_some() {
        return find(service, selector).map(|_| ());
    }
    match service.module(selector) {
        Some(_) => Ok(()),
        None => Err(failures::no_such_module(service, selector)),
    }
}

/// One point, by its path.
pub async fn point(service: &Service, path: &str, fresh: bool) -> Result<PointInfo, Problem> {
    let (module, point) = find(service, path)?;
    if fresh {
        let asked = service.read_fresh(&module).await;
        asked.map_err(|failure| failures::of_read(service, &module, Some(point), &failure))?;
    }
    let status = service.point(&module, point);
    let status = status.ok_or_else(|| failures::no_such_module(service, &module))?;
    Ok(convert::point(status))
}

/// Switches one output.
pub async fn write(
    service: &Service,
    path: &str,
    wanted: WriteRequest,
) -> Result<Written, Problem> {
    let terms = WriteTerms {
        verify: wanted.verify,
        silent: wanted.no_reply,
        only_if: wanted.only_if,
        confirm: wanted.confirm,
        within: within(wanted.within_ms)?,
    };
    let place = paths::split(path).unwrap_or((path, ""));
    match service.write_labelled(place, wanted.value, terms).await {
        Ok(done) => Ok(written(done)),
        Err(failure) => Err(not_written(service, path, &failure)),
    }
}

/// Why the output of a path was not switched. The path is looked up for the message only: it may
/// have been removed since, and `may_have_acted` is reported either way.
fn not_written(service: &Service, path: &str, failure: &CommandError) -> Problem {
    match find(service, path) {
        Ok((module, point)) => failures::problem(service, &module, Some(point), failure),
        Err(unknown)
            if matches!(
                failure,
                CommandError::NoSuchModule | CommandError::NoSuchPoint
            ) =>
        {
            unknown
        }
        Err(_) => {
            let (module, _) = paths::split(path).unwrap_or((path, ""));
            failures::problem(service, module, None, failure)
        }
    }
}

/// Switches several outputs of one module.
pub async fn outputs(
    service: &Service,
    module: &str,
    wanted: OutputsRequest,
) -> Result<OutputsWritten, Problem> {
    let mut set = Vec::with_capacity(wanted.set.len());
    for (label, on) in &wanted.set {
        let (_, point) = find(service, &format!("{module}.{label}"))?;
        set.push((point, *on));
    }
    if set.is_empty() {
        let problem = Problem::new(codes::BAD_REQUEST).with("module", module);
        return Err(problem.with("reason", "\"set\" names no output"));
    }
    let terms = WriteTerms {
        verify: wanted.verify,
        silent: wanted.no_reply,
        only_if: None,
        confirm: wanted.confirm,
        within: within(wanted.within_ms)?,
    };
    let done = service.write(module, &set, terms).await;
    let done = done.map_err(|failure| failures::problem(service, module, None, &failure))?;
    let label = |point: &Point| {
        let status = service.point(module, *point);
        status.map(|status| status.label).unwrap_or_default()
    };
    let each = done.outputs.iter().map(|(point, value, before)| {
        let (value, before) = (*value, *before);
        (label(point), OutputWritten { value, before })
    });
    Ok(OutputsWritten {
        set: each.collect(),
        confirmed: convert::confirmed(done.confirmed),
        took_ms: convert::millis(done.took),
        audit: done.audit,
    })
}

/// Toggles an output.
pub async fn toggle(
    service: &Service,
    path: &str,
    wanted: ToggleRequest,
) -> Result<Written, Problem> {
    let (module, point) = find(service, path)?;
    let terms = ToggleTerms {
        raw: wanted.raw,
        confirm: wanted.confirm,
        within: within(wanted.within_ms)?,
    };
    let done = service.toggle(&module, point, terms).await;
    done.map(written)
        .map_err(|failure| failures::problem(service, &module, Some(point), &failure))
}

/// Starts a pulse.
pub async fn pulse(service: &Service, path: &str, wanted: PulseRequest) -> Result<Pulsed, Problem> {
    let (module, point) = find(service, path)?;
    let pulse = Pulse {
        width: wanted.ms.map(|ms| Micros(ms.saturating_mul(1_000))),
        by: convert::by(wanted.by),
        off: wanted.off,
        confirm: wanted.confirm,
        within: within(wanted.within_ms)?,
    };
    let done = service.pulse(&module, point, pulse).await;
    let done =
        done.map_err(|failure| failures::problem(service, &module, Some(point), &failure))?;
    Ok(Pulsed {
        value: done.value,
        before: done.before,
        by: convert::timekeeper(done.by),
        ms: Some(convert::millis(done.width)),
        confirmed: convert::confirmed(done.confirmed),
        took_ms: convert::millis(done.took),
        audit: done.audit,
    })
}

/// A recent command.
pub fn command(service: &Service, id: &str) -> Result<CommandInfo, Problem> {
    let known = service.command(id).map(convert::command);
    known.ok_or_else(|| Problem::new(codes::NO_SUCH_COMMAND).with("name", id))
}

fn written(done: WriteDone) -> Written {
    let output = done.outputs.first();
    Written {
        value: output.and_then(|(_, value, _)| *value),
        before: output.and_then(|(_, _, before)| *before),
        confirmed: convert::confirmed(done.confirmed),
        took_ms: convert::millis(done.took),
        audit: done.audit,
        read_then_set: done.read_then_set,
    }
}

/// The time within which a command is wanted.
pub(super) fn within(millis: Option<u64>) -> Result<Within, Problem> {
    let Some(millis) = millis else {
        return Ok(Within::DEFAULT);
    };
    let within = Within::new(Micros(millis.saturating_mul(1_000)));
    let reason = "\"within_ms\" is 200 to 60000";
    within.ok_or_else(|| Problem::new(codes::BAD_REQUEST).with("reason", reason))
}

/// The module and the point of a path.
pub fn find(service: &Service, path: &str) -> Result<(String, Point), Problem> {
    let (module, label) = paths::split(path).unwrap_or((path, ""));
    let Some(status) = service.module(module) else {
        return Err(failures::no_such_module(service, module));
    };
    let point = status.setup.point(label);
    let point = point.ok_or_else(|| failures::no_such_point(service, module, label))?;
    Ok((module.to_owned(), point))
}

/// The only line.
pub fn only_line(service: &Service) -> Result<String, Problem> {
    let config = service.config();
    let mut names = config.lines.keys();
    match (names.next(), names.next()) {
        (Some(line), None) => Ok(line.clone()),
        _ => Err(failures::of_line(service, "", &CommandError::NoSuchLine)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_api::problem::codes;
    use railbus_site::Config;

    /// Between the end of a command and its answer another configuration may come into force.
    #[tokio::test]
    async fn a_command_to_an_output_that_is_gone_since_may_have_acted() {
        let text = "[line.main]\nport = \"/dev/ttyS99\"\n\
            [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";
        let service = Service::start_quiet(Config::parse(text).unwrap()).unwrap();
        let unknown = CommandError::Line(railbus_host::Fault::Unknown);
        for path in ["oven.k1", "oven.do0", "gone.k1", "gone"] {
            let problem = not_written(&service, path, &unknown);
            assert!(problem.may_have_acted, "{path}: {problem:?}");
            let missing = not_written(&service, path, &CommandError::NoSuchPoint);
            assert!(!missing.may_have_acted, "{path}: {missing:?}");
        }
        let missing = not_written(&service, "gone.k1", &CommandError::NoSuchModule);
        assert_eq!(missing.code, codes::NO_SUCH_MODULE.code);
        service.close().await;
    }
}
