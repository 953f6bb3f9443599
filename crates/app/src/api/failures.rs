//! From the site's failures to the problems of the API.

use railbus_api::problem::{Problem, ProblemType, codes};
use railbus_api::types::LineInfo;
use railbus_bus::Evidence;
use railbus_device::{Point, Refusal};
use railbus_host::{Fault, LineState, PortAccess, PortError, Presence};
use railbus_site::config::ConfigProblem;
use railbus_site::{CommandError, Service};
use railbus_wire::Micros;
use railbus_words::Lang;
use serde_json::json;

/// Why a command to a module was not carried out.
pub fn problem(
    service: &Service,
    module: &str,
    point: Option<Point>,
    failure: &CommandError,
) -> Problem {
    let of_point = |kind, point: &Point| {
        let problem = about(service, Problem::new(kind), module);
        problem.with("point", label(service, module, *point))
    };
    let problem = match failure {
        CommandError::NoSuchModule => no_such_module(service, module),
        CommandError::NoSuchPoint => about(service, Problem::new(codes::NO_SUCH_POINT), module),
        CommandError::NoSuchLine => Problem::new(codes::NO_SUCH_LINE),
        CommandError::Lent => Problem::new(codes::LINE_CLOSED).with("reason", "lent"),
        CommandError::NotAnOutput(point) => of_point(codes::NOT_AN_OUTPUT, point),
        CommandError::Locked(point) => of_point(codes::LOCKED, point),
        CommandError::NotAsAsked(point, is) => {
            of_point(codes::NOT_AS_ASKED, point).with("value", *is)
        }
        CommandError::NotAudited => about(service, Problem::new(codes::NOT_AUDITED), module),
        CommandError::PulseWidth {
            point,
            asked,
            own,
            pulse_mode,
        } => {
            let problem = of_point(codes::PULSE_WIDTH, point).with("pulse_mode", *pulse_mode);
            let path = format!("{module}.{}", label(service, module, *point));
            pulse_hints(problem, &path, *asked, *own)
        }
        CommandError::Confirm(point) => of_point(codes::CONFIRM, point),
        CommandError::Interlock { point, by } => {
            let problem = of_point(codes::INTERLOCK, point).with("by", by.clone());
            problem.with_hint(format!("railbus set {by} off"))
        }
        CommandError::MinOff { point, left } => {
            let left = left.0.div_ceil(1_000);
            of_point(codes::MIN_OFF, point).with("retry_after_ms", left)
        }
        CommandError::Unwatched(point) => of_point(codes::UNWATCHED, point),
        CommandError::NoLease(point) => of_point(codes::NO_LEASE, point),
        CommandError::LeaseTime(point) => {
            of_point(codes::BAD_REQUEST, point).with("reason", "\"ttl_ms\" is 200 to 3600000")
        }
        CommandError::NotKept(why) => Problem::new(codes::NOT_KEPT).with("reason", why.to_string()),
        CommandError::NotTakenOver(why) => {
            let problem = about(service, Problem::new(codes::NOT_TAKEN_OVER), module);
            problem.with("reason", why.to_string())
        }
        CommandError::Due { path, left } => Problem::new(codes::OUTPUT_DUE)
            .with("path", path.clone())
            .with("retry_after_ms", left.0.div_ceil(1_000)),
        CommandError::NotTried => about(service, Problem::new(codes::NOT_TRIED), module),
        CommandError::Undone => about(service, Problem::new(codes::UNDONE), module),
        CommandError::NotUndone => about(service, Problem::new(codes::NOT_UNDONE), module),
        CommandError::RoleTooLow { .. }
        | CommandError::NotPermitted { .. }
        | CommandError::Limited(_) => of_rights(failure),
        CommandError::NoSuchGroup => Problem::new(codes::NO_SUCH_GROUP),
        CommandError::NoSuchScene => Problem::new(codes::NO_SUCH_SCENE),
        CommandError::Playing => Problem::new(codes::PLAYING),
        CommandError::NotRead(fault) | CommandError::Line(fault) => {
            let problem = of_fault(service, module, fault);
            match point {
                Some(point) => {
                    let problem = problem.with("point", label(service, module, point));
                    of_channel(service, module, fault, problem)
                }
                None => problem,
            }
        }
    };
    Problem {
        may_have_acted: failure.may_have_acted(),
        ..problem
    }
}

/// A board that does not report its number of channels may lack the one that does not respond while
/// the board does.
fn of_channel(service: &Service, module: &str, fault: &Fault, problem: Problem) -> Problem {
    let board = service.module(module).filter(|status| {
        status.setup.family.datasheet().channels_vary && status.presence == Presence::Online
    });
    match (fault, board) {
        (Fault::NoReply(_), Some(_)) => problem.with("channel_doubtful", true),
        _ => problem,
    }
}

/// Why a module could not be read. A read has no effect.
pub fn of_read(
    service: &Service,
    module: &str,
    point: Option<Point>,
    failure: &CommandError,
) -> Problem {
    Problem {
        may_have_acted: false,
        ..problem(service, module, point, failure)
    }
}

/// The alternatives to a pulse that the module does not support.
fn pulse_hints(
    problem: Problem,
    path: &str,
    asked: Option<Micros>,
    own: Option<Micros>,
) -> Problem {
    let by_host = |asked: u64| format!("railbus pulse {path} {asked}ms --by host");
    let Some(own) = own else {
        return problem.with_hint(format!("railbus pulse {path} 500ms"));
    };
    let problem = problem.with("width_ms", own.0 / 1_000);
    match asked {
        // The module's own width was requested, but the output is in level mode.
        None => problem.with_hint(by_host(500)),
        Some(asked) => problem
            .with_hint(format!("railbus pulse {path}"))
            .with_hint(by_host(asked.0 / 1_000)),
    }
}

/// There is no such module; these are the existing ones.
pub fn no_such_module(service: &Service, name: &str) -> Problem {
    let known: Vec<String> = service.config().modules.keys().cloned().collect();
    Problem::new(codes::NO_SUCH_MODULE)
        .with("name", name)
        .with("known", known)
}

/// The module has no such point; these are the ones it has.
pub fn no_such_point(service: &Service, module: &str, name: &str) -> Problem {
    let points = service.points(module);
    let known: Vec<String> = points.into_iter().map(|point| point.label).collect();
    Problem::new(codes::NO_SUCH_POINT)
        .with("module", module)
        .with("name", name)
        .with("known", known)
}

/// There is no such line; these are the existing ones.
pub fn no_such_line(service: &Service, name: &str) -> Problem {
    let known: Vec<String> = service.config().lines.keys().cloned().collect();
    Problem::new(codes::NO_SUCH_LINE)
        .with("name", name)
        .with("known", known)
}

/// The line's error for a command to a module.
fn of_fault(service: &Service, module: &str, fault: &Fault) -> Problem {
    if *fault == Fault::Closed {
        let line = service.module(module).map(|module| module.line);
        return line_closed(service, &line.unwrap_or_default()).with("module", module);
    }
    let problem = about(service, Problem::new(kind_of(fault)), module);
    match fault {
        Fault::NoReply(evidence) => {
            let problem = with_evidence(problem, evidence);
            let line = problem.text("line");
            problem.with_hint(format!("railbus scan -l {line}"))
        }
        Fault::Garbled(evidence) => with_evidence(problem, evidence),
        Fault::Expired => match service.module(module) {
            Some(status) if status.presence != Presence::Online && status.lost.garbled > 0 => {
                let lost = serde_json::to_value(super::convert::lost(status.lost));
                problem.with("lost", lost.unwrap_or_default())
            }
            _ => problem,
        },
        Fault::OtherModel { .. } => {
            let status = service.module(module);
            match status.and_then(|status| status.stranger) {
                Some(found) => problem.with("answers_as", found),
                None => problem,
            }
        }
        Fault::Refused(Refusal::Exception(why)) => problem
            .with("exception", why.0)
            .with("refusal", format!("Modbus exception {why}")),
        Fault::Refused(Refusal::Invalid) => problem.with("refusal", "?AA"),
        Fault::Refused(Refusal::WatchdogTripped) => problem.with("refusal", "!AA"),
        _ => problem,
    }
}

/// Why a line accepts no commands.
pub fn line_closed(service: &Service, line: &str) -> Problem {
    let mut problem = Problem::new(codes::LINE_CLOSED).with("line", line);
    let Some(status) = service.line(line) else {
        return problem;
    };
    problem = problem.with("port", status.port.as_str());
    match &status.state {
        LineState::Absent(why) => port_closed(problem, &status.port, why),
        LineState::Opening => problem.with("reason", "opening"),
        LineState::Up | LineState::Closed => problem.with("reason", "closed"),
    }
}

/// Why a port that is no line's can't be used.
pub fn port_lost(port: &str, why: &PortError) -> Problem {
    let problem = Problem::new(codes::LINE_CLOSED).with("port", port);
    port_closed(problem, port, why)
}

/// The problem with why the port can't be used, by whom, and how to get access.
fn port_closed(problem: Problem, port: &str, why: &PortError) -> Problem {
    let problem = problem.with("reason", why.name());
    match why {
        PortError::Busy {
            holder: Some(holder),
        } => problem.with("holder", format!("{} ({})", holder.name, holder.pid)),
        PortError::Permission(access) => {
            let problem = match &access.group_name {
                Some(group) => problem.with("group", group.clone()),
                None => problem,
            };
            problem.with_hint(right_to(port, access))
        }
        _ => problem,
    }
}

/// How to get access to a port: through its group, or, if users can't join that, with a rule that
/// assigns the device to one they can.
pub fn right_to(port: &str, access: &PortAccess) -> String {
    if let Some(group) = access.group_to_join() {
        return format!("sudo usermod -aG {group} $USER");
    }
    let path = port.strip_prefix("pty:").unwrap_or(port);
    let device = std::fs::canonicalize(path).unwrap_or_else(|_| path.into());
    match device.file_name().and_then(|name| name.to_str()) {
        Some(name) if name.starts_with("tty") => {
            let rule = format!("SUBSYSTEM==\"tty\", KERNEL==\"{name}\"");
            let rule = format!("{rule}, GROUP=\"dialout\", MODE=\"0660\"");
            let kept = format!("echo '{rule}' | sudo tee -a /etc/udev/rules.d/77-railbus.rules");
            format!("{kept} && sudo udevadm control --reload && sudo udevadm trigger /dev/{name}")
        }
        _ => format!("ls -l {path}"),
    }
}

/// The same for a line as reported by the API.
pub fn line_down(line: &LineInfo) -> Problem {
    let problem = Problem::new(codes::LINE_CLOSED)
        .with("line", line.line.as_str())
        .with("port", line.port.as_str())
        .with("reason", line.reason.as_deref().unwrap_or("closed"));
    match &line.holder {
        Some(holder) => problem.with("holder", holder.as_str()),
        None => problem,
    }
}

/// The line's error for something other than a command to a module.
pub fn of_line(service: &Service, line: &str, failure: &CommandError) -> Problem {
    let problem = match failure {
        CommandError::NoSuchLine => no_such_line(service, line),
        CommandError::Line(Fault::Closed) | CommandError::Lent => line_closed(service, line),
        CommandError::Line(fault) => Problem::new(kind_of(fault)).with("line", line),
        CommandError::NotAudited => Problem::new(codes::NOT_AUDITED).with("line", line),
        // A frame for an address that is no module's.
        CommandError::NotPermitted { module, .. } if module.is_empty() => {
            Problem::new(codes::POINT_RIGHT).with("line", line)
        }
        CommandError::Due { .. } => problem(service, line, None, failure),
        CommandError::RoleTooLow { .. }
        | CommandError::NotPermitted { .. }
        | CommandError::Limited(_) => of_rights(failure),
        // A raw frame never ends like this.
        _ => Problem::new(codes::INTERNAL).with("reason", failure.name()),
    };
    Problem {
        may_have_acted: failure.may_have_acted(),
        ..problem
    }
}

/// Why a caller may not do something.
pub fn of_rights(failure: &CommandError) -> Problem {
    match failure {
        CommandError::RoleTooLow { role, need } => {
            let problem = Problem::new(codes::ROLE).with("role", role.name());
            problem.with("need", need.name())
        }
        CommandError::NotPermitted { module, label } => {
            let problem = Problem::new(codes::POINT_RIGHT).with("module", module.as_str());
            problem.with("point", label.as_str())
        }
        CommandError::Limited(points) => {
            Problem::new(codes::LIMITED).with("points", points.to_vec())
        }
        _ => Problem::new(codes::INTERNAL).with("reason", failure.name()),
    }
}

/// Why a command to outputs of several modules was not carried out.
pub fn of_several(failure: &CommandError) -> Problem {
    let problem = match failure {
        CommandError::Playing => Problem::new(codes::PLAYING),
        CommandError::NotRead(fault) | CommandError::Line(fault) => Problem::new(kind_of(fault)),
        CommandError::RoleTooLow { .. }
        | CommandError::NotPermitted { .. }
        | CommandError::Limited(_) => of_rights(failure),
        // Everything else is the result of one of its outputs.
        _ => Problem::new(codes::INTERNAL).with("reason", failure.name()),
    };
    problem.perhaps_acted(failure.may_have_acted())
}

const fn kind_of(fault: &Fault) -> ProblemType {
    match fault {
        Fault::Unsupported => codes::UNSUPPORTED,
        Fault::Overloaded => codes::OVERLOADED,
        Fault::Expired => codes::EXPIRED,
        Fault::Locked => codes::LOCKED,
        Fault::Closed => codes::LINE_CLOSED,
        Fault::OtherModel { .. } => codes::OTHER_MODEL,
        Fault::Refused(_) => codes::REFUSED,
        Fault::NoReply(_) => codes::NO_REPLY,
        Fault::Garbled(_) => codes::GARBLED,
        Fault::NotVerified => codes::NOT_VERIFIED,
        Fault::Unknown => codes::UNKNOWN,
    }
}

fn with_evidence(problem: Problem, evidence: &Evidence) -> Problem {
    let problem = problem
        .with("attempts", evidence.attempts)
        .with("rx_bytes", evidence.bytes);
    match evidence.why {
        Some(why) => problem.with("why", why.to_string()),
        None => problem,
    }
}

/// Adds the module and its place.
fn about(service: &Service, problem: Problem, module: &str) -> Problem {
    let problem = problem.with("module", module);
    let Some(status) = service.module(module) else {
        return problem;
    };
    let setup = status.setup;
    problem
        .with("line", status.line)
        .with("address", setup.address.0)
        .with("protocol", setup.protocol.name())
        .with("model", setup.family.name())
        .with("baud", setup.serial.baud.rate())
        .with("format", setup.serial.character.to_string())
}

fn label(service: &Service, module: &str, point: Point) -> String {
    let status = service.point(module, point);
    status.map(|status| status.label).unwrap_or_default()
}

/// A rejected configuration.
pub fn bad_config(lang: Lang, file: &str, problems: &[ConfigProblem]) -> Problem {
    let entry = |problem: &ConfigProblem| {
        json!({
            "line": problem.line,
            "column": problem.column,
            "path": problem.path,
            "code": problem.kind.code(),
            "reason": super::config_words::reason(lang, &problem.kind),
        })
    };
    let entries: Vec<_> = problems.iter().map(entry).collect();
    Problem::new(codes::BAD_CONFIG)
        .with("file", file)
        .with("problems", entries)
}
