//! The API for remote callers, whose requests arrive through an outlet. They read with the rights
//! of a viewer, and streams are not available. Commands have the rights of the outlet, and are
//! carried out once: [`super::remote_order`].
//!
//! Outlets run on threads of their own, without access to the daemon. They pass requests to it, and
//! it answers them with the handlers of the API.

use super::access::{Caller, Known, Role};
use super::answer;
use super::listen::ended;
use super::remote_order::RemoteOrder;
pub(crate) use super::remote_order::Settled;
use super::route::BASE;
use axum::Router;
use axum::body::{Body, Bytes, to_bytes};
use axum::http::header::{ACCEPT_LANGUAGE, CONTENT_TYPE};
use axum::http::{Request, Response};
use hyper::service::Service as _;
use hyper_util::service::TowerToHyperService;
use railbus_api::problem::{Problem, codes};
use railbus_site::Rights;
use railbus_words::width::is_shown;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc, oneshot, watch};

/// The most pending requests; more are refused.
const REQUESTS_MAX: usize = 8;
/// The longest body of an answer, in bytes. What else a site has to say waits for it: over 100
/// kbit/s 20 s, and after 30 s without a sign a connection is taken for dead.
const BODY_MAX: usize = 256 << 10;
/// How long an answer may take. A command lives 5 s, and so does a reading of a whole line.
const ANSWER_MAX: Duration = Duration::from_secs(20);
/// The longest name of who asks, in characters.
const USER_MAX: usize = 64;

/// A command besides what is asked.
#[derive(Clone, Debug)]
pub(crate) struct RemoteCommand {
    /// The outputs that may be switched, and by whom.
    pub(crate) rights: Rights,
    /// By which it is carried out once.
    pub(crate) key: String,
    pub(crate) body: Vec<u8>,
    /// By when it is begun, or that it is not.
    pub(crate) order: RemoteOrder,
}

/// What is asked.
#[derive(Clone, Debug)]
pub(crate) struct RemoteRequest {
    /// The method of HTTP.
    pub(crate) method: String,
    /// The path with its query: `/api/v1/points?select=oven`.
    pub(crate) path: String,
    /// The name of the caller at the other end of the outlet.
    pub(crate) user: String,
    /// As in `Accept-Language`; empty for errors without texts.
    pub(crate) language: String,
    /// None for reading.
    pub(crate) command: Option<RemoteCommand>,
}

/// The response to it.
#[cfg_attr(
    not(any(test, feature = "fleet")),
    expect(dead_code, reason = "no other outlet has remote callers")
)]
#[derive(Debug)]
pub(crate) struct RemoteAnswer {
    /// The status of HTTP.
    pub(crate) status: u16,
    /// The media type of the body.
    pub(crate) content_type: String,
    pub(crate) body: Bytes,
    /// What came of a command.
    pub(crate) settled: Settled,
    /// How long it took from when it was asked.
    pub(crate) took: Duration,
    /// Held until it is sent.
    pub(crate) permit: OwnedSemaphorePermit,
}

/// A request on its way to the handlers.
struct RemoteCall {
    request: RemoteRequest,
    /// Through which outlet it came.
    through: String,
    asked: Instant,
    to: oneshot::Sender<RemoteAnswer>,
    permit: OwnedSemaphorePermit,
}

/// The end of an outlet.
#[derive(Debug)]
pub(crate) struct RemoteApi {
    calls: mpsc::UnboundedSender<RemoteCall>,
    /// For each kind of request. Apart: who reads, or asks what came of commands, must not keep
    /// others from switching something off.
    permits: [Arc<Semaphore>; 3],
}

/// What a remote caller wants.
#[cfg_attr(
    not(any(test, feature = "fleet")),
    expect(dead_code, reason = "no other outlet has remote callers")
)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RemoteKind {
    /// To read.
    Read,
    /// To switch something.
    Command,
    /// To know what came of a command.
    Tell,
}

/// The end of the daemon. Not bounded itself: permits bound the requests.
pub(crate) struct RemoteCalls(mpsc::UnboundedReceiver<RemoteCall>);

/// Both ends.
pub(crate) fn remote_api() -> (RemoteApi, RemoteCalls) {
    let (calls, asked) = mpsc::unbounded_channel();
    (RemoteApi::to(calls), RemoteCalls(asked))
}

impl RemoteApi {
    fn to(calls: mpsc::UnboundedSender<RemoteCall>) -> RemoteApi {
        let permits = std::array::from_fn(|_| Arc::new(Semaphore::new(REQUESTS_MAX)));
        RemoteApi { calls, permits }
    }

    /// The same for another outlet, with permits of its own.
    pub(crate) fn for_another(&self) -> RemoteApi {
        RemoteApi::to(self.calls.clone())
    }

    /// A permit for one request of a kind. It is returned with the answer, and is to be held until
    /// that is sent.
    ///
    /// # Errors
    /// [`codes::OVERLOADED`] if [`REQUESTS_MAX`] of its kind are pending.
    #[cfg_attr(
        not(any(test, feature = "fleet")),
        expect(dead_code, reason = "no other outlet has remote callers")
    )]
    pub(crate) fn permit(&self, kind: RemoteKind) -> Result<OwnedSemaphorePermit, Problem> {
        let [reads, commands, tells] = &self.permits;
        let permits = match kind {
            RemoteKind::Read => reads,
            RemoteKind::Command => commands,
            RemoteKind::Tell => tells,
        };
        let permit = Arc::clone(permits).try_acquire_owned();
        permit.map_err(|_| {
            Problem::new(codes::OVERLOADED).with("reason", "too many requests at a time")
        })
    }

    /// Asks the API, through the outlet of this name.
    ///
    /// # Errors
    /// [`codes::DAEMON`] if the daemon is stopping. An error of the API itself is an answer.
    #[cfg_attr(
        not(any(test, feature = "fleet")),
        expect(dead_code, reason = "no other outlet has remote callers")
    )]
    pub(crate) async fn ask(
        &self,
        outlet: &str,
        request: RemoteRequest,
        permit: OwnedSemaphorePermit,
    ) -> Result<RemoteAnswer, Problem> {
        let (to, answered) = oneshot::channel();
        let call = RemoteCall {
            request,
            through: outlet.to_owned(),
            asked: Instant::now(),
            to,
            permit,
        };
        let stopping = || Problem::new(codes::DAEMON).with("reason", "stopping");
        self.calls.send(call).map_err(|_| stopping())?;
        answered.await.map_err(|_| stopping())
    }
}

impl RemoteCalls {
    /// Answers requests with these handlers until the daemon stops.
    pub(crate) async fn serve(mut self, handlers: Router, mut stop: watch::Receiver<bool>) {
        loop {
            let call = tokio::select! {
                biased;
                () = ended(&mut stop) => return,
                call = self.0.recv() => call,
            };
            let Some(call) = call else {
                return;
            };
            tokio::spawn(answered(handlers.clone(), call));
        }
    }
}

/// The name of somebody at the other end of an outlet, as logs have it.
pub(crate) fn shown_user(user: &str) -> String {
    let letters = user.chars().filter(|letter| is_shown(*letter));
    letters.take(USER_MAX).collect()
}

async fn answered(handlers: Router, call: RemoteCall) {
    let user = shown_user(&call.request.user);
    let rights = call.request.command.as_ref();
    let rights = rights.map(|command| command.rights.clone());
    let caller = Caller {
        // Not to be taken for one of the daemon's own users and tokens.
        name: format!("outlet:{}:{user}", call.through),
        id: format!("outlet:{}", call.through),
        role: Some(rights.as_ref().map_or(Role::Viewer, |rights| rights.role)),
        via: format!("outlet:{}", call.through),
        points: rights.map_or_else(Arc::default, |rights| rights.points),
        known: Known::Outlet,
    };
    let late = || {
        none(format!(
            "it had no answer within {} s",
            ANSWER_MAX.as_secs()
        ))
    };
    let asked = whole(handlers, caller, &call.request);
    let (answer, settled) = match tokio::time::timeout(ANSWER_MAX, asked).await {
        Ok(end) => end,
        // It goes on.
        Err(_) => (Err(late()), Settled::Later),
    };
    let (status, content_type, body) = match answer {
        Ok(answer) => answer,
        // A problem fits, and ends.
        Err(problem) => collected(answer::problem(&problem))
            .await
            .unwrap_or_default(),
    };
    // Fails if the caller is gone.
    let _ = call.to.send(RemoteAnswer {
        status,
        content_type,
        body,
        settled,
        took: call.asked.elapsed(),
        permit: call.permit,
    });
}

type Whole = (u16, String, Bytes);

/// The answer of the API, and what came of a command.
async fn whole(
    handlers: Router,
    caller: Caller,
    asked: &RemoteRequest,
) -> (Result<Whole, Problem>, Settled) {
    // What reached no handler was not begun, and is not under way.
    let refused = match asked.command.as_ref() {
        Some(command) if command.order.tell => Settled::Later,
        _ => Settled::Ended,
    };
    let request = match request(caller, asked) {
        Ok(request) => request,
        Err(problem) => return (Err(problem), refused),
    };
    let Ok(response) = TowerToHyperService::new(handlers).call(request).await;
    let settled = response.extensions().get().copied().unwrap_or(refused);
    let collected = collected(response).await;
    let settled = match (&collected, settled) {
        // What it says is not known here.
        (Err(_), Settled::Ended) if asked.command.is_some() => Settled::Later,
        (_, settled) => settled,
    };
    (collected, settled)
}

/// The request for the handlers.
fn request(caller: Caller, asked: &RemoteRequest) -> Result<Request<Body>, Problem> {
    let is_allowed = match asked.command {
        None => asked.method == "GET",
        Some(_) => ["PUT", "POST"].contains(&&*asked.method),
    };
    if !is_allowed {
        return Err(not_remote(&asked.method));
    }
    let is_of_api = asked
        .path
        .strip_prefix(BASE)
        .is_some_and(|rest| rest.starts_with('/'));
    if !is_of_api {
        return Err(Problem::new(codes::NO_SUCH_PAGE));
    }
    let request = Request::builder().uri(&asked.path).method(&*asked.method);
    let request = match asked.language.is_empty() {
        true => request,
        false => request.header(ACCEPT_LANGUAGE, &asked.language),
    };
    let request = request.extension(caller);
    let request = match &asked.command {
        None => request.body(Body::empty()),
        Some(command) => request
            .header("idempotency-key", &command.key)
            .header(CONTENT_TYPE, "application/json")
            .extension(command.order)
            .body(Body::from(command.body.clone())),
    };
    request.map_err(|error| Problem::new(codes::BAD_REQUEST).with("reason", error.to_string()))
}

async fn collected(response: Response<Body>) -> Result<Whole, Problem> {
    let (head, body) = response.into_parts();
    let content_type = head.headers.get(CONTENT_TYPE);
    let content_type = content_type.and_then(|value| value.to_str().ok());
    let content_type = content_type.unwrap_or_default().to_owned();
    let body = to_bytes(body, BODY_MAX).await;
    let body =
        body.map_err(|_| none(format!("its answer is longer than {} KiB", BODY_MAX >> 10)))?;
    Ok((head.status.as_u16(), content_type, body))
}

/// There is no answer.
fn none(reason: String) -> Problem {
    Problem::new(codes::SITE_AWAY).with("reason", reason)
}

/// Not available to remote callers.
pub(super) fn not_remote(reason: &str) -> Problem {
    Problem::new(codes::NOT_REMOTE).with("reason", reason)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::since_boot;
    use axum::Extension;
    use axum::http::HeaderMap;
    use axum::routing::{get, put};
    use std::sync::atomic::{AtomicUsize, Ordering};

    fn request(path: &str) -> RemoteRequest {
        RemoteRequest {
            method: "GET".to_owned(),
            path: path.to_owned(),
            user: "li".to_owned(),
            language: String::new(),
            command: None,
        }
    }

    fn code(answer: &RemoteAnswer) -> String {
        let problem: Problem = serde_json::from_slice(&answer.body).unwrap();
        assert_eq!(problem.status, answer.status);
        assert_eq!(answer.content_type, "application/problem+json");
        problem.code
    }

    async fn ask(api: &RemoteApi, request: RemoteRequest) -> Result<RemoteAnswer, Problem> {
        let kind = match &request.command {
            None => RemoteKind::Read,
            Some(command) if command.order.tell => RemoteKind::Tell,
            Some(_) => RemoteKind::Command,
        };
        let permit = api.permit(kind)?;
        api.ask("hq", request, permit).await
    }

    fn serving(handlers: Router) -> (RemoteApi, watch::Sender<bool>) {
        let (api, calls) = remote_api();
        let (stop, stopped) = watch::channel(false);
        tokio::spawn(calls.serve(handlers, stopped));
        (api, stop)
    }

    #[tokio::test]
    async fn who_asks_is_a_viewer_named_by_the_outlet() {
        let who = get(async |Extension(caller): Extension<Caller>| format!("{caller:?}"));
        let (api, _stop) = serving(Router::new().route("/api/v1/who", who));
        let long = RemoteRequest {
            user: "x\u{1b}".repeat(1_000),
            ..request("/api/v1/who?x=y")
        };
        let answer = ask(&api, long).await.unwrap();
        let caller = Caller {
            name: format!("outlet:hq:{}", "x".repeat(USER_MAX)),
            id: "outlet:hq".to_owned(),
            role: Some(Role::Viewer),
            via: "outlet:hq".to_owned(),
            points: Arc::default(),
            known: Known::Outlet,
        };
        assert_eq!(answer.body, format!("{caller:?}"));
        assert_eq!(answer.status, 200);
        assert!(answer.content_type.starts_with("text/plain"));
    }

    #[tokio::test]
    async fn what_is_no_request_for_reading_reaches_no_handler() {
        let reached = Arc::new(AtomicUsize::new(0));
        let counted = Arc::clone(&reached);
        let handler = async move || counted.fetch_add(1, Ordering::Relaxed).to_string();
        let (api, _stop) = serving(Router::new().fallback(handler));
        for method in ["PUT", "POST", "DELETE", "HEAD", "get", ""] {
            let asked = RemoteRequest {
                method: method.to_owned(),
                ..request("/api/v1/points")
            };
            let answer = ask(&api, asked).await.unwrap();
            assert_eq!(code(&answer), "E0937", "{method}");
        }
        for path in [
            "",
            "/",
            "/api/v1",
            "/api/v10/x",
            "/metrics",
            "http://x/api/v1/y",
        ] {
            let answer = ask(&api, request(path)).await.unwrap();
            assert_eq!(code(&answer), "E0110", "{path}");
        }
        let answer = ask(&api, request("/api/v1/\u{0}")).await.unwrap();
        assert_eq!(code(&answer), "E0806");
        assert_eq!(reached.load(Ordering::Relaxed), 0);
    }

    #[tokio::test]
    async fn what_is_too_long_for_a_message_is_refused() {
        let long = |length: usize| get(async move || "x".repeat(length));
        let handlers = Router::new()
            .route("/api/v1/fits", long(BODY_MAX))
            .route("/api/v1/not", long(BODY_MAX + 1));
        let (api, _stop) = serving(handlers);
        let fits = ask(&api, request("/api/v1/fits")).await.unwrap();
        assert_eq!((fits.status, fits.body.len()), (200, BODY_MAX));
        let long = ask(&api, request("/api/v1/not")).await.unwrap();
        assert_eq!(code(&long), "E0168");
    }

    fn command(tell: bool) -> RemoteRequest {
        let order = RemoteOrder {
            by: Some(since_boot() + Duration::from_secs(60)),
            tell,
            given: None,
        };
        RemoteRequest {
            method: "PUT".to_owned(),
            command: Some(RemoteCommand {
                rights: Rights {
                    role: Role::Operator,
                    points: ["oven".to_owned()].into(),
                },
                key: "c1".to_owned(),
                body: b"{\"value\":true}".to_vec(),
                order,
            }),
            ..request("/api/v1/points/oven/k1")
        }
    }

    #[tokio::test]
    async fn a_command_has_the_rights_of_its_outlet_and_a_key() {
        let handler =
            async |headers: HeaderMap, Extension(caller): Extension<Caller>, body: String| {
                let key = headers["idempotency-key"].to_str().unwrap().to_owned();
                format!("{key} {body} {:?} {:?}", caller.role, caller.points)
            };
        let router = Router::new().route("/api/v1/points/oven/k1", put(handler));
        let (api, _stop) = serving(router);
        let answer = ask(&api, command(false)).await.unwrap();
        let wanted = "c1 {\"value\":true} Some(Operator) [\"oven\"]";
        assert_eq!((answer.status, &*answer.body), (200, wanted.as_bytes()));
        assert_eq!(answer.settled, Settled::Ended);
    }

    /// Only what says what came of a command is taken for that.
    #[tokio::test(start_paused = true)]
    async fn what_does_not_say_what_came_of_a_command_leaves_that_open() {
        let long = put(async || "x".repeat(BODY_MAX + 1));
        let router = Router::new()
            .route("/api/v1/long", long)
            .route("/api/v1/never", put(std::future::pending::<()>))
            .route("/api/v1/lost", put(async || Extension(Settled::Lost)))
            .fallback(async || "refused");
        let (api, _stop) = serving(router);
        let settled = async |path: &str, tell| {
            let asked = RemoteRequest {
                path: path.to_owned(),
                ..command(tell)
            };
            ask(&api, asked).await.unwrap().settled
        };
        for tell in [false, true] {
            assert_eq!(settled("/api/v1/long", tell).await, Settled::Later);
            assert_eq!(settled("/api/v1/never", tell).await, Settled::Later);
            assert_eq!(settled("/api/v1/lost", tell).await, Settled::Lost);
        }
        assert_eq!(settled("/api/v1/else", false).await, Settled::Ended);
        assert_eq!(settled("/metrics", false).await, Settled::Ended);
        // It may have been begun before its rights were taken away.
        assert_eq!(settled("/api/v1/else", true).await, Settled::Later);
        assert_eq!(settled("/metrics", true).await, Settled::Later);
    }

    /// The time runs by itself where all wait.
    #[tokio::test(start_paused = true)]
    async fn so_many_are_under_way_and_none_for_ever() {
        let pending = get(std::future::pending::<()>);
        let (api, _stop) = serving(Router::new().route("/api/v1/never", pending));
        let api = Arc::new(api);
        let never = || {
            let api = Arc::clone(&api);
            tokio::spawn(async move { ask(&api, request("/api/v1/never")).await })
        };
        let under_way: Vec<_> = (0..REQUESTS_MAX).map(|_| never()).collect();
        tokio::time::sleep(ANSWER_MAX / 2).await;
        assert_eq!(never().await.unwrap().unwrap_err().code, "E0105");
        let mut sent = Vec::new();
        for asked in under_way {
            let answer = asked.await.unwrap().unwrap();
            assert_eq!(code(&answer), "E0168");
            sent.push(answer);
        }
        // Until they are sent.
        assert_eq!(never().await.unwrap().unwrap_err().code, "E0105");
        drop(sent);
        // A request goes on when its caller is gone, and keeps its permit.
        let left = never();
        tokio::time::sleep(ANSWER_MAX / 2).await;
        left.abort();
        let others: Vec<_> = (1..REQUESTS_MAX).map(|_| never()).collect();
        tokio::time::sleep(Duration::from_secs(1)).await;
        assert_eq!(never().await.unwrap().unwrap_err().code, "E0105");
        for asked in others {
            assert_eq!(code(&asked.await.unwrap().unwrap()), "E0168");
        }
    }

    #[tokio::test]
    async fn nothing_waits_for_a_daemon_that_stops() {
        let (api, stop) = serving(Router::new());
        stop.send(true).unwrap();
        let answer = ask(&api, request("/api/v1/points")).await;
        assert_eq!(answer.unwrap_err().code, Problem::new(codes::DAEMON).code);
    }
}
