//! Every way in which a command can fail, at every place where it is reported: all of them must
//! agree on whether it may have acted.

use super::{Code, Failure};
use crate::api::{control, failures};
use crate::render::Format;
use crate::render::colour::Paint;
use crate::texts::AppText;
use railbus_api::problem::Problem;
use railbus_bus::Evidence;
use railbus_device::{Point, PointKind, Refusal};
use railbus_host::Fault;
use railbus_site::{CommandError, Config, Role, Service};
use railbus_wire::Micros;
use railbus_words::Lang;
use std::io::ErrorKind;

const CONFIG: &str = "[line.main]\nport = \"tcp:127.0.0.1:1\"\n\
    [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";

const POINT: Point = Point {
    kind: PointKind::Output,
    index: 0,
};

/// All faults, and the meaning of each.
fn faults() -> Vec<(Fault, bool)> {
    let evidence = Evidence::default();
    let all = [
        Fault::Unsupported,
        Fault::Overloaded,
        Fault::Expired,
        Fault::Locked,
        Fault::Closed,
        Fault::OtherModel { sent: false },
        Fault::OtherModel { sent: true },
        Fault::Refused(Refusal::Invalid),
        Fault::NoReply(evidence),
        Fault::Garbled(evidence),
        Fault::NotVerified,
        Fault::Unknown,
    ];
    let each = all.map(|fault| {
        // A new fault needs an arm here, and an entry in the list above.
        let acted = match fault {
            Fault::Unsupported
            | Fault::Overloaded
            | Fault::Expired
            | Fault::Locked
            | Fault::Closed
            | Fault::Refused(_)
            | Fault::OtherModel { sent: false } => false,
            Fault::OtherModel { sent: true }
            | Fault::NoReply(_)
            | Fault::Garbled(_)
            | Fault::NotVerified
            | Fault::Unknown => true,
        };
        (fault, acted)
    });
    each.to_vec()
}

/// All failures, and the meaning of each.
fn failures() -> Vec<(CommandError, bool)> {
    let point = POINT;
    let mut all = vec![
        CommandError::NoSuchLine,
        CommandError::NoSuchModule,
        CommandError::NoSuchPoint,
        CommandError::Lent,
        CommandError::NotAnOutput(point),
        CommandError::Locked(point),
        CommandError::NotAsAsked(point, true),
        CommandError::PulseWidth {
            point,
            asked: None,
            own: None,
            pulse_mode: false,
        },
        CommandError::NotAudited,
        CommandError::Confirm(point),
        CommandError::Interlock {
            point,
            by: "oven.k2".to_owned(),
        },
        CommandError::MinOff {
            point,
            left: Micros::ZERO,
        },
        CommandError::Unwatched(point),
        CommandError::NoLease(point),
        CommandError::LeaseTime(point),
        CommandError::NotKept(ErrorKind::StorageFull),
        CommandError::NotTakenOver(ErrorKind::StorageFull),
        CommandError::Due {
            path: "oven.k1".to_owned(),
            left: Micros::ZERO,
        },
        CommandError::NotTried,
        CommandError::Undone,
        CommandError::NotUndone,
        CommandError::RoleTooLow {
            role: Role::Viewer,
            need: Role::Operator,
        },
        CommandError::NotPermitted {
            module: "oven".to_owned(),
            label: "k1".to_owned(),
        },
        CommandError::Limited(["oven.k1".to_owned()].into()),
        CommandError::NoSuchGroup,
        CommandError::NoSuchScene,
        CommandError::Playing,
    ];
    all.extend(
        faults()
            .into_iter()
            .map(|(fault, _)| CommandError::NotRead(fault)),
    );
    all.extend(
        faults()
            .into_iter()
            .map(|(fault, _)| CommandError::Line(fault)),
    );
    let each = all.into_iter().map(|failure| {
        // A new failure needs an arm here, and an entry in the list above.
        let acted = match &failure {
            CommandError::NoSuchLine
            | CommandError::NoSuchModule
            | CommandError::NoSuchPoint
            | CommandError::Lent
            | CommandError::NotAnOutput(_)
            | CommandError::Locked(_)
            | CommandError::NotAsAsked(..)
            | CommandError::PulseWidth { .. }
            | CommandError::NotAudited
            | CommandError::Confirm(_)
            | CommandError::Interlock { .. }
            | CommandError::MinOff { .. }
            | CommandError::Unwatched(_)
            | CommandError::NoLease(_)
            | CommandError::LeaseTime(_)
            | CommandError::NotKept(_)
            | CommandError::Due { .. }
            | CommandError::NotTried
            | CommandError::Undone
            | CommandError::RoleTooLow { .. }
            | CommandError::NotPermitted { .. }
            | CommandError::Limited(_)
            | CommandError::NoSuchGroup
            | CommandError::NoSuchScene
            | CommandError::Playing
            | CommandError::NotRead(_) => false,
            CommandError::NotUndone | CommandError::NotTakenOver(_) => true,
            CommandError::Line(fault) => {
                let known = faults().into_iter().find(|(known, _)| known == fault);
                known.expect("it is in the list").1
            }
        };
        (failure, acted)
    });
    each.collect()
}

/// Everything made from a problem says the same.
fn said_everywhere(name: &str, problem: &Problem, acted: bool) {
    let body = serde_json::to_value(problem).expect("JSON");
    assert_eq!(body["may_have_acted"] == true, acted, "{name}: the API");
    // A client of the API parses it; the command line puts it into words.
    let back: Problem = serde_json::from_value(body).expect("a problem");
    assert_eq!(back.may_have_acted, acted, "{name}: read back");
    for lang in [Lang::En, Lang::Zh] {
        let sentence = lang.get(AppText::MayHaveActed);
        let failure = Failure::of_problem(lang, &back);
        let count = usize::from(acted);
        let json = failure.tell(lang, Format::Json, Paint::Plain, None);
        let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
        assert_eq!(
            json["error"]["may_have_acted"] == true,
            acted,
            "{name}: -o json"
        );
        for text in [failure.render(lang), json["error"]["why"].to_string()] {
            assert_eq!(text.matches(sentence).count(), count, "{name}: {text}");
        }
        // Errors of the gateway's procedures are made from such a failure again.
        assert_eq!(failure.to_problem().may_have_acted, acted, "{name}: again");
        let parts = ["oven.k1", "pump.do0"].map(str::to_owned);
        let parts = parts.into_iter().filter(|_| acted).collect();
        let several = Failure::of(lang, Code::Partial).perhaps_acted_on(parts);
        let text = several.render(lang);
        assert_eq!(text.matches(sentence).count(), 2 * count, "{name}: {text}");
    }
}

#[tokio::test]
async fn whether_it_may_have_acted_is_the_same_everywhere() {
    let config = Config::parse(CONFIG).expect("a configuration");
    let service = Service::start_quiet(config).expect("a site");
    let point = POINT;
    for (failure, acted) in failures() {
        let name = format!("{failure:?}");
        assert_eq!(failure.may_have_acted(), acted, "{name}");
        for at in [None, Some(point)] {
            let problem = failures::problem(&service, "oven", at, &failure);
            said_everywhere(&name, &problem, acted);
            let read = failures::of_read(&service, "oven", at, &failure);
            said_everywhere(&name, &read, false);
        }
        let problem = failures::of_line(&service, "main", &failure);
        said_everywhere(&name, &problem, acted);
        for several in [control::of_group, control::of_scene] {
            said_everywhere(&name, &several(&service, "heat", &failure), acted);
        }
    }
    service.close().await;
}
