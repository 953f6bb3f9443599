//! Commands for several outputs at once, and leases, in terms of the API.

use super::{ask, convert, failures};
use railbus_api::control::{
    BatchAnswer, BatchRequest, BatchResult, GroupInfo, GroupRequest, GroupValue, GroupWord,
    LeaseAnswer, LeaseRequest, SceneInfo, SceneRequest, StepInfo,
};
use railbus_api::problem::{Problem, codes};
use railbus_api::types::SCHEMA;
use railbus_site::config::{MEMBERS_MAX, Name, Place, Step};
use railbus_site::{
    BatchDone, BatchTerms, CommandError, Config, GroupState, LeaseTerms, Part, Service, WriteDone,
};
use railbus_wire::Micros;
use std::collections::{BTreeMap, BTreeSet};

/// Switches several outputs of any modules.
pub async fn batch(service: &Service, wanted: BatchRequest) -> Result<BatchAnswer, Problem> {
    let wrong = |reason: String| Problem::new(codes::BAD_REQUEST).with("reason", reason);
    if wanted.set.is_empty() {
        return Err(wrong("\"set\" names no output".to_owned()));
    }
    if wanted.set.len() > MEMBERS_MAX {
        return Err(wrong(format!(
            "\"set\" names more than {MEMBERS_MAX} outputs"
        )));
    }
    let mut named = BTreeSet::new();
    let mut set = Vec::with_capacity(wanted.set.len());
    for item in &wanted.set {
        let (module, point) = ask::find(service, &item.path)?;
        let place = Place::new(&module, point);
        if !named.insert(place.clone()) {
            return Err(wrong(format!("{} is named twice", item.path)));
        }
        set.push((place, item.value));
    }
    let terms = BatchTerms {
        verify: wanted.verify,
        confirm: wanted.confirm,
        all_or_nothing: wanted.all_or_nothing,
        within: ask::within(wanted.within_ms)?,
    };
    let done = service.batch(&set, terms).await;
    let done = done.map_err(|failure| failures::problem(service, "", None, &failure))?;
    Ok(answer(service, done))
}

/// All groups.
pub fn groups(service: &Service) -> Vec<GroupInfo> {
    let config = service.config();
    let groups = config.groups.iter();
    groups
        .map(|(name, group)| GroupInfo {
            group: name.clone(),
            name: names(&group.name),
            members: paths(&config, &group.members),
            frames: service.frames_of(&group.members),
        })
        .collect()
}

/// The paths of the outputs of a group.
pub fn members(service: &Service, group: &str) -> Result<Vec<String>, Problem> {
    let config = service.config();
    match config.groups.get(group) {
        Some(found) => Ok(paths(&config, &found.members)),
        None => Err(no_such_group(&config, group)),
    }
}

/// Switches a group.
pub async fn set_group(
    service: &Service,
    group: &str,
    wanted: GroupRequest,
) -> Result<BatchAnswer, Problem> {
    let to = match wanted.value {
        GroupValue::Set(on) => GroupState::Set(on),
        GroupValue::Word(GroupWord::Toggle) => GroupState::Toggle,
    };
    let terms = BatchTerms {
        verify: wanted.verify,
        confirm: wanted.confirm,
        all_or_nothing: wanted.all_or_nothing,
        within: ask::within(wanted.within_ms)?,
    };
    match service.set_group(group, to, terms).await {
        Ok(done) => Ok(answer(service, done)),
        Err(failure) => Err(of_group(service, group, &failure)),
    }
}

/// All scenes.
pub fn scenes(service: &Service) -> Vec<SceneInfo> {
    let config = service.config();
    let step = |step: &Step| match step {
        Step::Set(place, value) => StepInfo::Set {
            path: config.path(place),
            value: *value,
        },
        Step::Wait(time) => StepInfo::Wait {
            wait_ms: convert::millis(*time),
        },
    };
    let scenes = config.scenes.iter();
    scenes
        .map(|(name, scene)| SceneInfo {
            scene: name.clone(),
            name: names(&scene.name),
            steps: scene.steps.iter().map(step).collect(),
        })
        .collect()
}

/// The paths of the outputs that a scene switches.
pub fn outputs_of_scene(service: &Service, scene: &str) -> Result<Vec<String>, Problem> {
    let config = service.config();
    let Some(found) = config.scenes.get(scene) else {
        return Err(no_such_scene(&config, scene));
    };
    let places = found.steps.iter().filter_map(|step| match step {
        Step::Set(place, _) => Some(config.path(place)),
        Step::Wait(_) => None,
    });
    Ok(places.collect())
}

/// Runs a scene.
pub async fn play(
    service: &Service,
    scene: &str,
    wanted: SceneRequest,
) -> Result<BatchAnswer, Problem> {
    let terms = BatchTerms {
        confirm: wanted.confirm,
        within: ask::within(wanted.within_ms)?,
        ..BatchTerms::default()
    };
    match service.play(scene, terms).await {
        Ok(done) => Ok(answer(service, done)),
        Err(failure) => Err(of_scene(service, scene, &failure)),
    }
}

/// Takes or renews a lease.
pub async fn lease(
    service: &Service,
    path: &str,
    wanted: LeaseRequest,
) -> Result<LeaseAnswer, Problem> {
    let (module, point) = ask::find(service, path)?;
    let time = Micros(wanted.ttl_ms.saturating_mul(1_000));
    let terms = LeaseTerms {
        confirm: wanted.confirm,
        within: ask::within(wanted.within_ms)?,
    };
    let held = (wanted.value, time);
    let leased = service.lease(&module, point, held, terms).await;
    let leased =
        leased.map_err(|failure| failures::problem(service, &module, Some(point), &failure))?;
    let until = convert::from_now(leased.left);
    Ok(match leased.written {
        Some(written) => LeaseAnswer {
            until,
            ..lease_answer(&written)
        },
        None => LeaseAnswer {
            value: Some(wanted.value),
            until,
            renewed: true,
            before: None,
            confirmed: None,
            audit: None,
        },
    })
}

/// Ends a lease.
pub async fn end_lease(service: &Service, path: &str) -> Result<LeaseAnswer, Problem> {
    let (module, point) = ask::find(service, path)?;
    let ended = service.end_lease(&module, point).await;
    let ended =
        ended.map_err(|failure| failures::problem(service, &module, Some(point), &failure))?;
    let held = LeaseAnswer {
        value: None,
        until: None,
        renewed: false,
        before: None,
        confirmed: None,
        audit: None,
    };
    Ok(ended.as_ref().map_or(held, lease_answer))
}

fn lease_answer(written: &WriteDone) -> LeaseAnswer {
    let output = written.outputs.first();
    LeaseAnswer {
        value: output.and_then(|(_, value, _)| *value),
        until: None,
        renewed: false,
        before: output.and_then(|(_, _, before)| *before),
        confirmed: Some(convert::confirmed(written.confirmed)),
        audit: Some(written.audit.clone()),
    }
}

fn answer(service: &Service, done: BatchDone) -> BatchAnswer {
    let config = service.config();
    let results = done.parts.into_iter();
    BatchAnswer {
        schema: SCHEMA,
        results: results.map(|part| result(service, &config, part)).collect(),
        undone: done.undone,
    }
}

fn result(service: &Service, config: &Config, part: Part) -> BatchResult {
    let path = config.path(&part.place);
    match part.end {
        Ok(done) => BatchResult {
            path,
            value: done.value,
            before: done.before,
            confirmed: Some(convert::confirmed(done.confirmed)),
            took_ms: Some(convert::millis(done.took)),
            audit: Some(done.audit),
            error: None,
        },
        Err(failure) => BatchResult {
            path,
            value: None,
            before: None,
            confirmed: None,
            took_ms: None,
            audit: None,
            error: Some(failures::problem(
                service,
                &part.place.module,
                Some(part.place.point),
                &failure,
            )),
        },
    }
}

fn paths(config: &Config, places: &[Place]) -> Vec<String> {
    places.iter().map(|place| config.path(place)).collect()
}

/// The display name, by language.
pub fn names(name: &Name) -> BTreeMap<String, String> {
    let each = [("en", &name.en), ("zh", &name.zh)];
    let named = each
        .into_iter()
        .filter_map(|(lang, name)| Some((lang.to_owned(), name.clone()?)));
    named.collect()
}

/// Why a group was not switched.
pub fn of_group(service: &Service, group: &str, failure: &CommandError) -> Problem {
    match failure {
        CommandError::NoSuchGroup => no_such_group(&service.config(), group),
        failure => failures::of_several(failure).with("group", group),
    }
}

/// Why a scene was not played.
pub fn of_scene(service: &Service, scene: &str, failure: &CommandError) -> Problem {
    match failure {
        CommandError::NoSuchScene => no_such_scene(&service.config(), scene),
        failure => failures::of_several(failure).with("scene", scene),
    }
}

fn no_such_group(config: &Config, name: &str) -> Problem {
    let known: Vec<String> = config.groups.keys().cloned().collect();
    let problem = Problem::new(codes::NO_SUCH_GROUP).with("name", name);
    problem.with("known", known)
}

fn no_such_scene(config: &Config, name: &str) -> Problem {
    let known: Vec<String> = config.scenes.keys().cloned().collect();
    let problem = Problem::new(codes::NO_SUCH_SCENE).with("name", name);
    problem.with("known", known)
}
