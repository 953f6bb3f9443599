//! The topics of a WebSocket.

use super::print::View;
use super::{Gone, Out, frames, news, sim};
use crate::ops::Op;
use crate::site::Site;
use railbus_api::ops::OpState;
use railbus_api::problem::{Problem, codes};
use railbus_app::api::{ask, failures, past};
use railbus_plant::remote::Remote;
use railbus_site::Service;
use railbus_words::Lang;

/// How many events are sent at once.
const BATCH_MAX: usize = 64;

/// A topic that can be subscribed to.
#[derive(Clone, Debug)]
pub(super) enum Topic {
    /// `points/#`, `points/pump/#`, `points/pump/do0`: the selected points, or all.
    Points(Vec<String>),
    /// `modules`.
    Modules,
    /// `lines`.
    Lines,
    /// `frames/main`.
    Frames(String),
    /// `events`.
    Events,
    /// `ops/ID`.
    Op(Box<Op>),
    /// `sim/main`.
    Sim(Remote),
}

impl Topic {
    /// Parses its name. What it names must exist.
    pub(super) fn parse(site: &Site, name: &str) -> Result<Topic, Problem> {
        let parts: Vec<&str> = name.split('/').collect();
        let topic = match parts.as_slice() {
            ["points", "#"] => Topic::Points(Vec::new()),
            ["points", module, "#"] => Topic::Points(vec![(*module).to_owned()]),
            ["points", module, label] => Topic::Points(vec![format!("{module}.{label}")]),
            ["modules"] => Topic::Modules,
            ["lines"] => Topic::Lines,
            ["frames", line] => Topic::Frames((*line).to_owned()),
            ["events"] => Topic::Events,
            ["sim", line] => Topic::Sim(sim::line(site, line)?.clone()),
            ["ops", number] => Topic::Op(Box::new(site.ops.get(number)?)),
            _ => {
                let known = [
                    "points/#",
                    "points/MODULE/#",
                    "points/MODULE/LABEL",
                    "modules",
                    "lines",
                    "frames/LINE",
                    "ops/ID",
                    "sim/LINE",
                    "events",
                ];
                let problem = Problem::new(codes::BAD_REQUEST).with("reason", "no such topic");
                return Err(problem.with("known", known.to_vec()));
            }
        };
        match &topic {
            Topic::Points(selectors) => {
                for selector in selectors {
                    ask::check_selector(&site.service, selector)?;
                }
            }
            Topic::Frames(line) if site.service.line(line).is_none() => {
                return Err(failures::no_such_line(&site.service, line));
            }
            _ => {}
        }
        Ok(topic)
    }

    /// Sends messages until the client has gone, or the topic ends.
    pub(super) async fn run(self, site: Site, lang: Lang, out: Out) {
        // A client that has gone is not an error.
        let _ = match self {
            Topic::Points(selectors) => news::follow(&site, View::Points(selectors), out).await,
            Topic::Modules => news::follow(&site, View::Modules, out).await,
            Topic::Lines => news::follow(&site, View::Lines, out).await,
            Topic::Op(op) => follow_op(&op, out).await,
            Topic::Sim(line) => sim::follow(&line, out).await,
            Topic::Events => follow_events(&site.service, out).await,
            Topic::Frames(line) => frames::follow(site.service, line, lang, out).await,
        };
    }
}

/// Sends the state of an operation until it has ended.
async fn follow_op(op: &Op, mut out: Out) -> Result<(), Gone> {
    let mut told = op.follow();
    let mut info = told.borrow_and_update().clone();
    out.snapshot(&info).await?;
    while info.state == OpState::Running && told.changed().await.is_ok() {
        // Further changes are included in the next message.
        out.paced().await;
        info = told.borrow_and_update().clone();
        out.delta("op", &info).await?;
    }
    Ok(())
}

/// Sends events as they happen. Earlier ones can be read from `/events`.
async fn follow_events(service: &Service, mut out: Out) -> Result<(), Gone> {
    let mut events = service.follow_events();
    out.snapshot(&[0; 0]).await?;
    let mut waiting = Vec::new();
    loop {
        tokio::select! {
            biased;
            event = events.next(), if waiting.len() < BATCH_MAX => match event {
                None => return Ok(()),
                Some(Ok(event)) => waiting.push(past::of_event(event)),
                Some(Err(count)) => {
                    out.dropped(count).await?;
                    out.snapshot(&[0; 0]).await?;
                }
            },
            () = out.paced(), if !waiting.is_empty() => {
                out.delta("events", &std::mem::take(&mut waiting)).await?;
            }
        }
    }
}
