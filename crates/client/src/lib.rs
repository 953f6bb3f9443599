//! A client of the daemon, over its socket: the same HTTP API as for everyone else.
//!
//! # Where things are
//! - One kept connection, and a method for what several commands ask: here. Requests as bytes:
//!   `http`. The centre of a fleet: `hub`.

#![forbid(unsafe_code)]

mod http;
mod hub;

pub use hub::HubClient;

use http::{Answer, Asked, Lines as TextLines, send, send_asked};
use hyper::Method;
use railbus_api::control::{
    BatchAnswer, GroupInfo, GroupRequest, Groups, SceneInfo, SceneRequest, Scenes,
};
use railbus_api::fleet::AT_SITE;
use railbus_api::outlets::{OutletInfo, OutletList, OutletMap};
use railbus_api::past::{HistoryInfo, VerifiedInfo};
use railbus_api::problem::{Problem, ProblemType, codes};
use railbus_api::sending::{SendAnswer, SendRequest};
use railbus_api::types::{
    FrameEvent, LineInfo, Lines, ModuleInfo, Modules, OutputsRequest, OutputsWritten, PointInfo,
    Points, PulseRequest, Pulsed, Quality, SiteInfo, ToggleRequest, WatchEvent, WriteRequest,
    Written,
};
use railbus_app::config_file;
use railbus_app::socket;
use railbus_app::texts::AppText;
use railbus_site::config::keeper::etag;
use railbus_words::Lang;
use railbus_words::width::is_shown;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Duration;
use tokio::net::UnixStream;
use tokio::sync::watch;
use tokio::task::JoinHandle;

/// Number of attempts and pause when waiting for the daemon to have a line back: one second.
const BACK_TRIES: usize = 50;
const BACK_PAUSE: Duration = Duration::from_millis(20);

/// The version of the API.
const SCHEMA: u8 = 1;
/// The endpoint that identifies the site.
const SITE: &str = "/api/v1/site";
/// Its timeout: the daemon knows the answer without asking anyone.
const SEARCH: Duration = Duration::from_secs(5);

/// The daemon behind a socket. Requests fail with the problem that it reports, or with
/// [`codes::DAEMON`] if it can't be reached.
#[derive(Clone, Debug)]
pub struct DaemonClient {
    socket: PathBuf,
    site: SiteInfo,
    /// Its name, for a site behind the centre of a fleet: the socket is that of the centre.
    far: Option<String>,
}

/// The resolution of a history.
#[derive(Clone, Copy, Debug)]
pub enum Resolution {
    /// Everything: every sample if there are only a few, otherwise buckets.
    Stretches(usize),
    /// In buckets of this many milliseconds.
    Step(u64),
    /// Only the last samples.
    Last(usize),
}

/// The daemon's events.
#[derive(Debug)]
pub struct Watch(TextLines);

impl Watch {
    /// The next event; `None` once the daemon has ended.
    pub async fn next(&mut self) -> Option<Result<WatchEvent, Problem>> {
        event(&mut self.0).await
    }
}

/// The traffic on a line of the daemon.
#[derive(Debug)]
pub struct Frames(TextLines);

impl Frames {
    /// The next event; `None` once the daemon has gone. Cancel-safe.
    pub async fn next(&mut self) -> Option<Result<FrameEvent, Problem>> {
        event(&mut self.0).await
    }
}

/// The records of a log, line by line.
#[derive(Debug)]
pub struct LogLines(TextLines);

impl LogLines {
    /// The next one; `None` at the end.
    pub async fn next(&mut self) -> Option<Result<String, Problem>> {
        self.0.next().await
    }
}

/// The next event known to this program. A newer daemon may send others; an empty line is sent to
/// check that the client is still there.
async fn event<T: DeserializeOwned>(lines: &mut TextLines) -> Option<Result<T, Problem>> {
    loop {
        match lines.next().await? {
            Err(problem) => return Some(Err(problem)),
            Ok(line) => {
                if let Ok(event) = serde_json::from_str(&line) {
                    return Some(Ok(event));
                }
            }
        }
    }
}

/// A line lent by the daemon. The daemon takes it back when this is dropped, or when this process
/// ends, for whatever reason.
#[derive(Debug)]
pub struct Borrowed {
    listening: JoinHandle<()>,
    over: watch::Receiver<bool>,
}

impl Borrowed {
    fn new(mut lines: TextLines) -> Borrowed {
        let (tell, over) = watch::channel(false);
        let listening = tokio::spawn(async move {
            while let Some(Ok(_)) = lines.next().await {}
            tell.send_replace(true);
        });
        Borrowed { listening, over }
    }

    /// True once the daemon wants the line back: its outputs may have to be switched off.
    pub fn over(&self) -> watch::Receiver<bool> {
        self.over.clone()
    }
}

impl Drop for Borrowed {
    fn drop(&mut self) {
        self.listening.abort();
    }
}

impl DaemonClient {
    /// Connects to the daemon at this socket, and asks which site it serves.
    pub async fn at(socket: &Path) -> Result<DaemonClient, Problem> {
        let asked = async {
            send(socket, Method::GET, SITE, Vec::new())
                .await?
                .whole()
                .await
        };
        let body = tokio::time::timeout(SEARCH, asked).await;
        let body = body.unwrap_or_else(|_| {
            let reason = format!("no answer within {} s", SEARCH.as_secs());
            Err(said_of(socket, codes::DAEMON, &reason))
        });
        let body = body.map_err(|problem| {
            // One of another version that does not have this endpoint.
            match problem.code == codes::NO_SUCH_PAGE.code {
                true => said_of(socket, codes::NO_SUCH_PAGE, SITE),
                false => problem,
            }
        })?;
        Ok(DaemonClient {
            site: read(socket, &body)?,
            socket: socket.to_owned(),
            far: None,
        })
    }

    /// The daemon of a site of a fleet, asked through its centre. It can only be read: nothing is
    /// switched or followed that way, and its files are not here.
    pub fn far(hub: &HubClient, site: &str) -> DaemonClient {
        DaemonClient {
            socket: hub.socket().to_owned(),
            site: SiteInfo {
                schema: SCHEMA,
                demo: false,
                config: site.to_owned(),
                state: String::new(),
            },
            far: Some(site.to_owned()),
        }
    }

    /// Whether it is a site of a fleet, asked through its centre.
    pub const fn is_far(&self) -> bool {
        self.far.is_some()
    }

    /// The daemons at the usual places; or why one gives no valid answer.
    pub async fn usual() -> Vec<Result<DaemonClient, Problem>> {
        let mut found = Vec::new();
        for socket in socket::places(socket::DAEMON) {
            if UnixStream::connect(&socket).await.is_ok() {
                found.push(DaemonClient::at(&socket).await);
            }
        }
        found
    }

    /// The path of its socket.
    pub fn socket(&self) -> &Path {
        &self.socket
    }

    /// Its configuration file.
    pub fn config(&self) -> &Path {
        Path::new(&self.site.config)
    }

    /// The state folder of its site.
    pub fn state(&self) -> &Path {
        Path::new(&self.site.state)
    }

    /// Its site, for people.
    pub fn name(&self, lang: Lang) -> String {
        match self.site.demo {
            true => lang.get(AppText::TheDemo).to_owned(),
            false => self.site.config.clone(),
        }
    }

    /// Whether its configuration is this file.
    pub fn serves(&self, file: &Path) -> bool {
        config_file::real(file) == self.config()
    }

    /// Replaces its configuration, which must still be the given one, and applies it.
    pub async fn replace_config(&self, before: &str, text: &str) -> Result<(), Problem> {
        let body = json!({ "text": text }).to_string().into_bytes();
        let asked = Asked {
            method: Method::PUT,
            path: "/api/v1/config",
            body,
            seen: Some(etag(before)),
            key: None,
        };
        let answer = send_asked(&self.socket, asked).await?;
        answer.whole().await.map(|_| ())
    }

    /// All lines of the site.
    pub async fn lines(&self) -> Result<Vec<LineInfo>, Problem> {
        let lines: Lines = self.get("/api/v1/lines").await?;
        Ok(lines.lines)
    }

    /// All modules of the site.
    pub async fn modules(&self) -> Result<Vec<ModuleInfo>, Problem> {
        let modules: Modules = self.get("/api/v1/modules").await?;
        Ok(modules.modules)
    }

    /// All integrations of the site.
    pub async fn outlets(&self) -> Result<Vec<OutletInfo>, Problem> {
        let list: OutletList = self.get("/api/v1/outlets").await?;
        Ok(list.outlets)
    }

    /// Where each point stands at the other side of an integration, in this language.
    pub async fn outlet_map(
        &self,
        kind: &str,
        outlet: &str,
        lang: Lang,
    ) -> Result<OutletMap, Problem> {
        let (kind, outlet) = (encoded(kind), encoded(outlet));
        let path = format!("/api/v1/outlets/{kind}/{outlet}/map?lang={}", lang.name());
        self.get(&path).await
    }

    /// The selected points, all by default; `fresh` ones are read first.
    pub async fn points(
        &self,
        selectors: &[String],
        fresh: bool,
    ) -> Result<Vec<PointInfo>, Problem> {
        let path = format!(
            "/api/v1/points?{}{}",
            select(selectors),
            fresh_as_query(fresh)
        );
        let answer = self.ask(Method::GET, &path, Vec::new()).await?;
        let transit_ms = answer.transit_ms();
        let points: Points = self.read(&self.whole(answer).await?)?;
        let mut points = points.points;
        if self.is_far() {
            let untimed = || self.untimed();
            let transit_ms = transit_ms.ok_or_else(untimed)?;
            points.iter_mut().for_each(|point| aged(point, transit_ms));
        }
        Ok(points)
    }

    /// Switches one output.
    pub async fn write(&self, path: &str, wanted: WriteRequest) -> Result<Written, Problem> {
        self.send(Method::PUT, &point(path, ""), &wanted).await
    }

    /// Switches several outputs of a module at once.
    pub async fn outputs(
        &self,
        module: &str,
        wanted: OutputsRequest,
    ) -> Result<OutputsWritten, Problem> {
        let path = format!("/api/v1/modules/{}/outputs", encoded(module));
        self.send(Method::PUT, &path, &wanted).await
    }

    /// All groups of the site.
    pub async fn groups(&self) -> Result<Vec<GroupInfo>, Problem> {
        let groups: Groups = self.get("/api/v1/groups").await?;
        Ok(groups.groups)
    }

    /// All scenes of the site.
    pub async fn scenes(&self) -> Result<Vec<SceneInfo>, Problem> {
        let scenes: Scenes = self.get("/api/v1/scenes").await?;
        Ok(scenes.scenes)
    }

    /// Runs a scene.
    pub async fn play(&self, scene: &str, wanted: SceneRequest) -> Result<BatchAnswer, Problem> {
        let path = format!("/api/v1/scenes/{}/run", encoded(scene));
        self.send(Method::POST, &path, &wanted).await
    }

    /// Switches a group.
    pub async fn set_group(
        &self,
        group: &str,
        wanted: GroupRequest,
    ) -> Result<BatchAnswer, Problem> {
        let path = format!("/api/v1/groups/{}/set", encoded(group));
        self.send(Method::POST, &path, &wanted).await
    }

    /// Toggles an output.
    pub async fn toggle(&self, path: &str, wanted: ToggleRequest) -> Result<Written, Problem> {
        self.send(Method::POST, &point(path, "/toggle"), &wanted)
            .await
    }

    /// Pulses an output.
    pub async fn pulse(&self, path: &str, wanted: PulseRequest) -> Result<Pulsed, Problem> {
        self.send(Method::POST, &point(path, "/pulse"), &wanted)
            .await
    }

    /// Sends a raw frame, or reports what it may do.
    pub async fn send_frame(&self, line: &str, wanted: SendRequest) -> Result<SendAnswer, Problem> {
        let path = format!("/api/v1/lines/{}/send", encoded(line));
        self.send(Method::POST, &path, &wanted).await
    }

    /// Follows the selected points, all by default.
    pub async fn watch(&self, selectors: &[String]) -> Result<Watch, Problem> {
        let path = format!("/api/v1/watch?{}", select(selectors));
        let answer = self.ask(Method::GET, &path, Vec::new()).await?;
        Ok(Watch(answer.lines().await?))
    }

    /// The traffic on a line from now on.
    pub async fn frames(&self, line: Option<&str>) -> Result<Frames, Problem> {
        let line = line.map(|line| format!("line={}", encoded(line)));
        let path = format!("/api/v1/frames/stream?{}", line.unwrap_or_default());
        let answer = self.ask(Method::GET, &path, Vec::new()).await?;
        Ok(Frames(answer.lines().await?))
    }

    /// Borrows a line: its port is free when this returns, until the loan is dropped.
    pub async fn borrow(&self, line: &str) -> Result<Borrowed, Problem> {
        let path = format!("/api/v1/lines/{}/loan", encoded(line));
        let answer = self.ask(Method::POST, &path, Vec::new()).await?;
        let mut lines = answer.lines().await?;
        match lines.next().await {
            Some(Ok(_)) => Ok(Borrowed::new(lines)),
            Some(Err(problem)) => Err(problem),
            None => Err(Problem::new(codes::DAEMON)),
        }
    }

    /// Waits until the daemon has the line back after a loan, so that the next command is not
    /// refused.
    pub async fn has_back(&self, line: &str) {
        let is_lent = |info: &LineInfo| info.line == line && info.reason.as_deref() == Some("lent");
        for _ in 0..BACK_TRIES {
            let lines = self.lines().await;
            if lines.is_ok_and(|lines| lines.iter().any(is_lent)) {
                tokio::time::sleep(BACK_PAUSE).await;
            } else {
                return;
            }
        }
    }

    /// The history of a point over a half-open interval, in milliseconds since 1970.
    pub async fn history(
        &self,
        point: &str,
        (from, to): (i64, i64),
        detail: Resolution,
    ) -> Result<HistoryInfo, Problem> {
        let point = encoded(point);
        let detail = match detail {
            Resolution::Stretches(count) => format!("buckets={count}"),
            Resolution::Step(millis) => format!("step={millis}"),
            Resolution::Last(count) => format!("limit={count}"),
        };
        let path = format!("/api/v1/history?point={point}&from={from}&to={to}&{detail}");
        self.get(&path).await
    }

    /// Whether the audit log is unchanged.
    pub async fn verified_audit(&self) -> Result<VerifiedInfo, Problem> {
        self.get("/api/v1/audit/verify").await
    }

    /// Every record of the audit log.
    pub async fn audit(&self, is_csv: bool) -> Result<LogLines, Problem> {
        let form = if is_csv { "csv" } else { "ndjson" };
        let path = format!("/api/v1/audit/export?format={form}&lang=en");
        let answer = self.ask(Method::GET, &path, Vec::new()).await?;
        Ok(LogLines(answer.lines().await?))
    }

    /// Sends any other request, to a path below that of the API.
    pub async fn request(
        &self,
        method: Method,
        path: &[&str],
        body: &Value,
    ) -> Result<Value, Problem> {
        self.send(method, &api_path(path), body).await
    }

    async fn ask(&self, method: Method, path: &str, body: Vec<u8>) -> Result<Answer, Problem> {
        match &self.far {
            None => send(&self.socket, method, path, body).await,
            Some(site) => {
                let path = format!("/s/{}{path}", encoded(site));
                let answer = send(&self.socket, method, &path, body).await;
                answer.map_err(hub::unreached)
            }
        }
    }

    async fn get<T: DeserializeOwned>(&self, path: &str) -> Result<T, Problem> {
        let answer = self.ask(Method::GET, path, Vec::new()).await?;
        self.read(&self.whole(answer).await?)
    }

    /// The body of an answer. What a site of a fleet says comes from another machine: no text of it
    /// controls a terminal, and neither its advice nor ours for such problems is for this machine.
    async fn whole(&self, answer: Answer) -> Result<Vec<u8>, Problem> {
        let is_of_site = answer.transit_ms().is_some();
        let body = answer.whole().await;
        if !self.is_far() {
            return body.map(Into::into);
        }
        match body {
            // What can't be read whole is not read in part.
            Ok(body) => {
                let said: Value = self.read(&body)?;
                Ok(serde_json::to_vec(&plain(said)).unwrap_or_default())
            }
            Err(problem) => {
                let said = serde_json::to_value(&problem)
                    .map(plain)
                    .unwrap_or_default();
                let problem = serde_json::from_value(said);
                let problem = problem.unwrap_or_else(|_| Problem::new(codes::DAEMON));
                // Others are of the centre.
                Err(match is_of_site {
                    true => self.of_its_site(problem),
                    false => problem,
                })
            }
        }
    }

    /// A problem of what this daemon serves: of a site of a fleet, it is one of another machine.
    pub fn of_its_site(&self, problem: Problem) -> Problem {
        match &self.far {
            None => problem,
            Some(site) => Problem {
                hint: Vec::new(),
                ..problem
            }
            .with(AT_SITE, site.as_str()),
        }
    }

    /// The centre does not say how old an answer is.
    fn untimed(&self) -> Problem {
        said_of(
            &self.socket,
            codes::DAEMON,
            "an answer without its time on the way",
        )
    }

    async fn send<T: DeserializeOwned>(
        &self,
        method: Method,
        path: &str,
        body: &impl Serialize,
    ) -> Result<T, Problem> {
        let body = serde_json::to_vec(body).unwrap_or_default();
        let answer = self.ask(method, path, body).await?;
        // It answered that it was done: only its answer could not be parsed.
        let read = self.read(&self.whole(answer).await?);
        read.map_err(|problem| problem.perhaps_acted(true))
    }

    fn read<T: DeserializeOwned>(&self, body: &[u8]) -> Result<T, Problem> {
        read(&self.socket, body)
    }
}

fn said_of(socket: &Path, kind: ProblemType, reason: &str) -> Problem {
    let socket = socket.display();
    Problem::new(kind)
        .with("socket", socket.to_string())
        .with("reason", format!("{socket}: {reason}"))
}

fn read<T: DeserializeOwned>(socket: &Path, body: &[u8]) -> Result<T, Problem> {
    serde_json::from_slice(body).map_err(|error| {
        Problem::new(codes::DAEMON)
            .with("socket", socket.display().to_string())
            .with("reason", error.to_string())
    })
}

/// A point as it is after its answer was on the way for this long. One that the site calls good
/// although it is older than it may be was read for this answer, with others that took long.
fn aged(point: &mut PointInfo, transit_ms: u64) {
    let Some(age) = point.age_ms else {
        return;
    };
    let now = age.saturating_add(transit_ms);
    point.age_ms = Some(now);
    let has_aged = point
        .max_age_ms
        .is_some_and(|most| age <= most && now > most);
    if has_aged && point.quality == Quality::Good {
        point.quality = Quality::Stale;
    }
}

/// Without characters that control a terminal or turn the direction of text.
pub(crate) fn plain(value: Value) -> Value {
    let text = |text: String| text.chars().filter(|letter| is_shown(*letter)).collect();
    match value {
        Value::String(said) => Value::String(text(said)),
        Value::Array(all) => all.into_iter().map(plain).collect(),
        Value::Object(all) => {
            let each = |(key, value): (String, Value)| (text(key), plain(value));
            Value::Object(all.into_iter().map(each).collect())
        }
        other => other,
    }
}

const fn fresh_as_query(fresh: bool) -> &'static str {
    if fresh { "fresh=1" } else { "" }
}

/// `select=pump,*.di*&`
fn select(selectors: &[String]) -> String {
    if selectors.is_empty() {
        return String::new();
    }
    let encoded: Vec<String> = selectors.iter().map(|selector| encoded(selector)).collect();
    format!("select={}&", encoded.join(","))
}

/// The endpoint of a point.
fn point(path: &str, what: &str) -> String {
    let (module, label) = path.split_once('.').unwrap_or((path, "-"));
    format!(
        "/api/v1/points/{}/{}{what}",
        encoded(module),
        encoded(label)
    )
}

/// The path of a request to the API of a site: `["points", "oven", "k1"]` is
/// `/api/v1/points/oven/k1`.
#[must_use]
pub fn api_path(parts: &[&str]) -> String {
    let parts: Vec<String> = parts.iter().map(|part| encoded(part)).collect();
    format!("/api/v1/{}", parts.join("/"))
}

/// With everything but letters, digits and `_*-` as `%XX`.
fn encoded(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for byte in text.bytes() {
        if byte.is_ascii_alphanumeric() || b"_*-.".contains(&byte) {
            out.push(char::from(byte));
        } else {
            out += &format!("%{byte:02X}");
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What was good at the site may be stale once it is here.
    #[test]
    fn what_was_on_its_way_is_older() {
        let point = |age_ms: Option<u64>, max_age_ms: Option<u64>| PointInfo {
            path: "pump.do0".to_owned(),
            age_ms,
            max_age_ms,
            ..serde_json::from_value(json!({
                "path": "", "module": "pump", "label": "do0", "kind": "output", "index": 0,
                "quality": "good", "value": true,
            }))
            .unwrap()
        };
        let after = |mut point: PointInfo, transit_ms| {
            aged(&mut point, transit_ms);
            (point.age_ms, point.quality)
        };
        let (good, stale) = (Quality::Good, Quality::Stale);
        assert_eq!(after(point(Some(200), Some(3_000)), 0), (Some(200), good));
        assert_eq!(
            after(point(Some(200), Some(3_000)), 2_800),
            (Some(3_000), good)
        );
        assert_eq!(
            after(point(Some(200), Some(3_000)), 2_801),
            (Some(3_001), stale)
        );
        assert_eq!(after(point(Some(200), None), 9_000), (Some(9_200), good));
        assert_eq!(after(point(None, Some(3_000)), 9_000), (None, good));
        // Read for this answer, before others that took long.
        assert_eq!(
            after(point(Some(4_000), Some(3_000)), 900),
            (Some(4_900), good)
        );
        let mut bad = point(Some(9_000), Some(3_000));
        bad.quality = Quality::Bad;
        assert_eq!(after(bad, 1).1, Quality::Bad);
    }

    #[test]
    fn no_text_controls_a_terminal() {
        let said = json!({ "a\u{7}": ["\u{1b}[31mred\n", 1, null, { "b": "好\u{9b}x\u{202e}" }] });
        assert_eq!(
            plain(said),
            json!({ "a": ["[31mred", 1, null, { "b": "好x" }] })
        );
    }

    #[test]
    fn names_can_not_leave_their_place() {
        assert_eq!(point("pump.do0", "/pulse"), "/api/v1/points/pump/do0/pulse");
        assert_eq!(point("a/b.c?d", ""), "/api/v1/points/a%2Fb/c%3Fd");
        assert_eq!(select(&["*.d?1".to_owned()]), "select=*.d%3F1&");
    }
}
