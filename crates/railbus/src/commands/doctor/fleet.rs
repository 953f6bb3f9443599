//! The sites of a fleet, as the centre that runs on this machine knows them.

use super::texts::DoctorText;
use crate::commands::Context;
use crate::commands::fleet::{ago, key_end};
use railbus_api::fleet::{FleetPresence, FleetSite, FleetSites};
use railbus_api::problem::Problem;
use railbus_app::doctor::{Finding, Section};
use railbus_app::failure::Failure;
use railbus_app::socket;
use railbus_app::texts::AppText;
use railbus_client::HubClient;
use railbus_fleet::{CLOCKS_DIFFER_MS, COPY_GONE};
use railbus_words::{Lang, time};
use std::os::unix::net::UnixStream;
use std::time::Duration;

/// So many sites are named in a finding.
const NAMED_MAX: usize = 5;

/// The findings about the fleet; none without a centre on this machine.
pub(super) async fn check(context: &Context, now_s: u64) -> Vec<Finding> {
    let mut refused = Vec::new();
    for path in socket::places(socket::HUB) {
        if std::fs::symlink_metadata(&path).is_err() {
            continue;
        }
        if let Err(error) = UnixStream::connect(&path) {
            let detail = format!("{}: {}", path.display(), error.kind());
            refused.push(Finding::warning(Section::Fleet, "D608", detail));
            continue;
        }
        let hub = HubClient::at(&path);
        return match hub.sites().await {
            Ok(told) => of_sites(context.lang, &path.display().to_string(), &told, now_s),
            Err(problem) => {
                let detail = format!("{}: {}", path.display(), problem.text("reason"));
                vec![Finding::error(Section::Fleet, "D608", detail)]
            }
        };
    }
    refused
}

/// What a problem of the centre says, with its code, and where to read of it.
fn of_problem(lang: Lang, code: &'static str, problem: &Problem) -> Finding {
    let failure = Failure::of_problem(lang, problem);
    let why: String = failure
        .why()
        .iter()
        .map(|why| format!(" · {why}"))
        .collect();
    let detail = format!("{} {}{why}", problem.code, failure.message());
    let finding = Finding::error(Section::Fleet, code, detail);
    finding.with_advice(format!("railbus explain {}", problem.code))
}

/// One finding for each kind of problem, with its sites.
fn of_sites(lang: Lang, socket: &str, told: &FleetSites, now_s: u64) -> Vec<Finding> {
    let error = |code, detail| Finding::error(Section::Fleet, code, detail);
    let warning = |code, detail| Finding::warning(Section::Fleet, code, detail);
    let mut found = Vec::new();
    let own = &told.connection;
    match (&own.error, own.connected) {
        (Some(problem), true) => found.push(of_problem(lang, "D609", problem)),
        (Some(problem), false) => found.push(of_problem(lang, "D601", problem)),
        // It has just started.
        (None, false) => found.push(warning("D601", String::new())),
        (None, true) => {}
    }
    let of = |about: &dyn Fn(&FleetSite) -> Option<String>| sites(lang, told, about);
    let away = |site: &FleetSite| {
        let is_away = site.presence == FleetPresence::Offline;
        is_away.then(|| site.heard_ms.map_or_else(String::new, |ms| ago(lang, ms)))
    };
    // Where the centre has no connection, that is said of none.
    let incomplete = |site: &FleetSite| {
        let is_away = site.presence == FleetPresence::Offline;
        (own.connected && !is_away && !site.current).then(String::new)
    };
    let copied = |site: &FleetSite| {
        let asked = site
            .duplicate_ms
            .filter(|ms| Duration::from_millis(*ms) < COPY_GONE);
        asked.map(|ms| ago(lang, ms))
    };
    let clock = |site: &FleetSite| {
        let off = site.clock_ahead_ms.map(i64::unsigned_abs);
        let off = off.filter(|off| *off > CLOCKS_DIFFER_MS);
        off.map(|off| time::span(lang, off / 1_000))
    };
    // The key of one that is away may have expired, and is not why it is to be looked at.
    let key = |site: &FleetSite| {
        let is_there = site.presence == FleetPresence::Online;
        key_end(site, now_s).filter(|_| is_there)
    };
    found.extend(of(&away).map(|detail| error("D602", detail)));
    found.extend(of(&incomplete).map(|detail| warning("D603", detail)));
    found.extend(of(&copied).map(|detail| error("D604", detail)));
    found.extend(of(&clock).map(|detail| warning("D605", detail)));
    found.extend(of(&key).map(|detail| warning("D606", detail)));
    if own.unreadable > 0 {
        found.push(warning("D607", own.unreadable.to_string()));
    }
    if found.is_empty() && told.sites.is_empty() {
        let text = lang.fill(DoctorText::FleetEmpty, &[("socket", &socket)]);
        found.push(Finding::good(Section::Fleet, text));
    } else if found.is_empty() {
        let values: &[(&str, &dyn std::fmt::Display)] =
            &[("socket", &socket), ("sites", &told.sites.len())];
        let text = lang.fill(DoctorText::FleetGood, values);
        found.push(Finding::good(Section::Fleet, text));
    }
    found
}

/// The sites of which there is something to say, each with it; none if there are none.
fn sites(
    lang: Lang,
    told: &FleetSites,
    about: &dyn Fn(&FleetSite) -> Option<String>,
) -> Option<String> {
    let told = told.sites.iter();
    let mut affected = told.filter_map(|site| Some((&site.site, about(site)?)));
    let name = |(site, what): (&String, String)| match what.is_empty() {
        true => site.clone(),
        false => lang.fill(DoctorText::SiteWith, &[("site", site), ("what", &what)]),
    };
    let named: Vec<String> = affected.by_ref().take(NAMED_MAX).map(name).collect();
    let more = affected.count();
    let mut detail = named.join(lang.get(AppText::Comma));
    if more > 0 {
        detail += &lang.fill(DoctorText::MoreSites, &[("count", &more)]);
    }
    (!named.is_empty()).then_some(detail)
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_api::fleet::{FleetCounts, HubConnection};
    use railbus_api::problem::codes;

    /// 2026-11-29.
    const NOW_S: u64 = 1_795_910_400;

    fn well(name: &str) -> FleetSite {
        FleetSite {
            site: name.to_owned(),
            presence: FleetPresence::Online,
            heard_ms: Some(900),
            current: true,
            known_ms: Some(900),
            behind: Some(0),
            points: 9,
            clock_ahead_ms: Some(-40),
            version: "0.1.0".to_owned(),
            key_until: Some("2027-02-20T00:00:00Z".to_owned()),
            duplicate_ms: None,
            groups: Vec::new(),
            config: None,
            attention: Vec::new(),
        }
    }

    fn told(sites: Vec<FleetSite>) -> FleetSites {
        FleetSites {
            schema: 1,
            connection: HubConnection {
                connected: true,
                error: None,
                unreadable: 0,
            },
            total: sites.len(),
            counts: FleetCounts::default(),
            groups: Vec::new(),
            sites,
        }
    }

    fn found(lang: Lang, told: &FleetSites) -> Vec<String> {
        let found = of_sites(lang, "/run/hub.sock", told, NOW_S).into_iter();
        found
            .map(|finding| {
                let code = finding.code.unwrap_or("-");
                format!("{} {code} {}", finding.state.name(), finding.detail)
            })
            .collect()
    }

    #[test]
    fn a_fleet_without_problems_is_said_to_be_well() {
        let told = told(vec![well("plant1"), well("plant2")]);
        assert_eq!(
            found(Lang::En, &told),
            ["ok - /run/hub.sock: sites online: 2, all values current"]
        );
        let none = FleetSites {
            sites: Vec::new(),
            ..told
        };
        assert_eq!(
            found(Lang::En, &none),
            ["ok - /run/hub.sock: no site has connected yet"]
        );
    }

    #[test]
    fn each_problem_is_told_once_with_its_sites() {
        let mut fleet = told(vec![
            FleetSite {
                presence: FleetPresence::Offline,
                heard_ms: Some(300_000),
                current: false,
                ..well("plant1")
            },
            FleetSite {
                current: false,
                ..well("plant2")
            },
            FleetSite {
                clock_ahead_ms: Some(-60_000),
                duplicate_ms: Some(60_000),
                key_until: Some("2026-12-10T00:00:00Z".to_owned()),
                ..well("plant3")
            },
        ]);
        fleet.connection.unreadable = 3;
        assert_eq!(
            found(Lang::En, &fleet),
            [
                "error D602 plant1 (5 min ago)",
                "warning D603 plant2",
                "error D604 plant3 (1 min ago)",
                "warning D605 plant3 (1 min)",
                "warning D606 plant3 (2026-12-10)",
                "warning D607 3",
            ]
        );
        assert_eq!(found(Lang::Zh, &fleet)[0], "error D602 plant1（5 分钟前）");
    }

    #[test]
    fn a_centre_without_its_servers_says_nothing_of_sites() {
        let unknown = FleetSite {
            presence: FleetPresence::Unknown,
            current: false,
            clock_ahead_ms: None,
            ..well("plant1")
        };
        let mut fleet = told(vec![unknown]);
        fleet.connection.connected = false;
        assert_eq!(found(Lang::En, &fleet), ["warning D601 "]);
        let problem = Problem::new(codes::FLEET_ENDED).with("reason", "disconnected");
        fleet.connection.error = Some(problem);
        let lost = found(Lang::En, &fleet);
        assert_eq!(lost.len(), 1, "{lost:?}");
        assert!(lost[0].starts_with("error D601 E0165 "), "{lost:?}");
        // Connected, and not for long enough to know of the site; the error is not the servers'.
        fleet.connection.connected = true;
        let unknown = found(Lang::En, &fleet);
        assert!(unknown[0].starts_with("error D609 E0165 "), "{unknown:?}");
        assert_eq!(unknown[1..], ["warning D603 plant1"]);
        fleet.connection.error = None;
        assert_eq!(found(Lang::En, &fleet), ["warning D603 plant1"]);
    }

    #[test]
    fn what_is_over_or_small_is_not_reported() {
        let gone = FleetSite {
            duplicate_ms: Some(600_000),
            clock_ahead_ms: Some(30_000),
            ..well("plant1")
        };
        assert!(found(Lang::En, &told(vec![gone]))[0].starts_with("ok"));
        // Of one that is away, its key is not what is wrong first.
        let expired = FleetSite {
            presence: FleetPresence::Offline,
            key_until: Some("2026-05-01T00:00:00Z".to_owned()),
            heard_ms: None,
            current: false,
            ..well("plant1")
        };
        assert_eq!(found(Lang::En, &told(vec![expired])), ["error D602 plant1"]);
    }

    #[test]
    fn of_many_sites_a_few_are_named_and_the_others_counted() {
        let away = |number: usize| FleetSite {
            presence: FleetPresence::Offline,
            heard_ms: None,
            ..well(&format!("plant{number}"))
        };
        let fleet = told((1..=NAMED_MAX + 7).map(away).collect());
        assert_eq!(
            found(Lang::En, &fleet),
            ["error D602 plant1, plant2, plant3, plant4, plant5 and 7 more"]
        );
        let fleet = told((1..=NAMED_MAX).map(away).collect());
        assert!(!found(Lang::En, &fleet)[0].contains("more"));
    }
}
