//! `GET /api/v1/ws`: changes as they happen, for the web pages.
//!
//! Every topic is a task that follows the site for one client, and passes messages to the
//! connection through a short queue. If the client is slow the queue fills up, the task waits, and
//! further changes wait at the site, which drops the oldest and reports how many: then the client
//! gets that number and a new snapshot. Nothing grows without bound.

mod frames;
mod limit;
mod news;
mod print;
mod sim;
mod topic;

pub(super) use limit::SocketLimit;
pub(super) use print::Printer;

use super::access::{Caller, Need};
use super::doc::Doc;
use super::route::{Answer, Asked, Route};
use super::site::Site;
use super::{answer, language};
use axum::Extension;
use axum::extract::State;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::http::{HeaderMap, StatusCode};
use axum::response::IntoResponse;
use axum::routing::get;
use railbus_api::problem::{Problem, codes};
use railbus_words::Lang;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::time::Duration;
use tokio::sync::{OwnedSemaphorePermit, mpsc};
use tokio::task::JoinHandle;
use tokio::time::{Instant, sleep_until, timeout};
use topic::Topic;

/// The routes of this file.
pub(super) const ROUTES: &[Route] = &[Route::new("GET", "/ws", Need::VIEWER, || get(connect))
    .stream()
    .doc(
        Doc::new("A WebSocket: subscribe to topics, and hear what changes")
            .query(&[
                ("lang", "en or zh"),
                ("csrf", "with a session: its own token"),
            ])
            .status("101"),
    )];

/// The longest message of a client.
const MESSAGE_MAX: usize = 64 << 10;
/// How much is read of it at a time: clients say little, and each has room for so much.
const READ_MAX: usize = 4 << 10;
/// How many topics one connection may have.
const TOPICS_MAX: usize = 32;
/// How many messages are queued for a slow client.
const WAITING_MAX: usize = 4;
/// After this time without a message a client is pinged.
const QUIET_MAX: Duration = Duration::from_secs(30);
/// How long it may take to answer, and to receive a message.
const PATIENCE: Duration = Duration::from_secs(15);
/// A topic sends the first change at once, and then no more often than this: 20 Hz.
const PACE: Duration = Duration::from_millis(50);

/// A message of the client.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Wish {
    #[serde(default)]
    sub: Vec<String>,
    #[serde(default)]
    unsub: Vec<String>,
}

async fn connect(
    State(site): State<Site>,
    asked: Asked,
    Extension(who): Extension<Caller>,
    headers: HeaderMap,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Answer {
    let upgrade = match upgrade {
        Ok(upgrade) => upgrade,
        Err(why) => {
            let status = why.into_response().status();
            return refuse(status, "no request for a WebSocket");
        }
    };
    let Some(place) = site.sockets.acquire() else {
        return answer::problem(&Problem::new(codes::OVERLOADED));
    };
    let lang = language::of(&site, &asked, &headers);
    upgrade
        .max_message_size(MESSAGE_MAX)
        .max_frame_size(MESSAGE_MAX)
        .read_buffer_size(READ_MAX)
        .on_upgrade(move |socket| Connection::new(site, lang, socket, place).run(who))
}

fn refuse(status: StatusCode, reason: &str) -> Answer {
    let problem = Problem {
        status: status.as_u16(),
        ..Problem::new(codes::BAD_REQUEST)
    };
    answer::problem(&problem.with("reason", reason))
}

/// A task that ends with its topic.
struct Feed(JoinHandle<()>);

impl Drop for Feed {
    fn drop(&mut self) {
        self.0.abort();
    }
}

/// Where a topic sends its messages.
#[derive(Debug)]
struct Out {
    topic: String,
    seq: u64,
    messages: mpsc::Sender<String>,
    /// When it may send the next change.
    next: Instant,
}

/// The client has gone.
#[derive(Debug)]
struct Gone;

impl Out {
    /// Sends the whole state.
    async fn snapshot(&mut self, data: &impl Serialize) -> Result<(), Gone> {
        self.tell("snapshot", "data", &json(data)).await
    }

    /// Sends a change; the next one waits for its pace.
    async fn delta(&mut self, key: &str, data: &impl Serialize) -> Result<(), Gone> {
        self.next = Instant::now() + PACE;
        self.tell("delta", key, &json(data)).await
    }

    /// This many changes were lost to this client.
    async fn dropped(&mut self, count: u64) -> Result<(), Gone> {
        self.tell("dropped", "n", &json(&count)).await
    }

    /// Sends data that is JSON already.
    async fn tell(&mut self, kind: &str, key: &str, data: &str) -> Result<(), Gone> {
        let topic = json(&self.topic);
        let seq = self.seq;
        self.seq += 1;
        let text = format!(r#"{{"type":"{kind}","topic":{topic},"seq":{seq},"{key}":{data}}}"#);
        self.messages.send(text).await.map_err(|_| Gone)
    }

    /// Waits until the next change may be sent.
    async fn paced(&self) {
        if Instant::now() < self.next {
            sleep_until(self.next).await;
        }
    }
}

fn json(data: &impl Serialize) -> String {
    serde_json::to_string(data).unwrap_or_default()
}

/// One client.
struct Connection {
    site: Site,
    lang: Lang,
    socket: WebSocket,
    topics: BTreeMap<String, Feed>,
    messages: (mpsc::Sender<String>, mpsc::Receiver<String>),
    _place: OwnedSemaphorePermit,
}

impl Connection {
    fn new(site: Site, lang: Lang, socket: WebSocket, place: OwnedSemaphorePermit) -> Connection {
        Connection {
            site,
            lang,
            socket,
            topics: BTreeMap::new(),
            messages: mpsc::channel(WAITING_MAX),
            _place: place,
        }
    }

    /// Runs until the client goes, is silent for too long, loses its permission, or the daemon
    /// stops.
    async fn run(mut self, who: Caller) {
        let mut over = std::pin::pin!(self.site.over(&who));
        let mut due = Instant::now() + QUIET_MAX;
        let mut asked = false;
        loop {
            let sent = tokio::select! {
                () = &mut over => {
                    self.send(Message::Close(None)).await;
                    return;
                }
                came = self.socket.recv() => {
                    let Some(Ok(message)) = came else {
                        return;
                    };
                    (due, asked) = (Instant::now() + QUIET_MAX, false);
                    self.take(message).await
                }
                Some(text) = self.messages.1.recv() => self.send(Message::Text(text.into())).await,
                () = sleep_until(due) => {
                    if asked {
                        return;
                    }
                    (due, asked) = (Instant::now() + PATIENCE, true);
                    self.send(Message::Ping(Default::default())).await
                }
            };
            if !sent {
                return;
            }
        }
    }

    /// Whether it could be sent.
    async fn send(&mut self, message: Message) -> bool {
        let sent = timeout(PATIENCE, self.socket.send(message)).await;
        sent.is_ok_and(|sent| sent.is_ok())
    }

    /// Handles a message of the client; false if it can't be answered any more.
    async fn take(&mut self, message: Message) -> bool {
        let text = match &message {
            Message::Text(text) => text.as_str(),
            Message::Binary(_) => "",
            Message::Ping(_) | Message::Pong(_) => return true,
            Message::Close(_) => return false,
        };
        let wish: Wish = match serde_json::from_str(text) {
            Ok(wish) => wish,
            Err(why) => {
                let problem = Problem::new(codes::BAD_REQUEST).with("reason", why.to_string());
                return self.complain(None, problem).await;
            }
        };
        for name in &wish.unsub {
            self.topics.remove(name);
        }
        for name in wish.sub {
            if let Err(problem) = self.subscribe(&name)
                && !self.complain(Some(&name), problem).await
            {
                return false;
            }
        }
        true
    }

    async fn complain(&mut self, topic: Option<&str>, problem: Problem) -> bool {
        let told = match topic {
            Some(topic) => {
                serde_json::json!({ "type": "problem", "topic": topic, "problem": problem })
            }
            None => serde_json::json!({ "type": "problem", "problem": problem }),
        };
        self.send(Message::Text(told.to_string().into())).await
    }

    /// Subscribes to a topic; one that is subscribed to already starts again with a snapshot.
    fn subscribe(&mut self, name: &str) -> Result<(), Problem> {
        let topic = Topic::parse(&self.site, name)?;
        self.topics.remove(name);
        self.topics.retain(|_, feed| !feed.0.is_finished());
        if self.topics.len() >= TOPICS_MAX {
            return Err(Problem::new(codes::OVERLOADED).with("reason", "too many topics"));
        }
        let out = Out {
            topic: name.to_owned(),
            seq: 0,
            messages: self.messages.0.clone(),
            next: Instant::now(),
        };
        let feed = tokio::spawn(topic.run(self.site.clone(), self.lang, out));
        self.topics.insert(name.to_owned(), Feed(feed));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn the_first_change_is_told_at_once_and_the_next_keeps_the_pace() {
        let (messages, mut told) = mpsc::channel(WAITING_MAX);
        let start = Instant::now();
        let mut out = Out {
            topic: "lines".to_owned(),
            seq: 0,
            messages,
            next: start,
        };
        let at_once = timeout(Duration::ZERO, out.paced()).await;
        assert!(at_once.is_ok());
        out.delta("lines", &[1]).await.unwrap();
        out.paced().await;
        assert!(start.elapsed() >= PACE);
        out.dropped(7).await.unwrap();
        assert_eq!(
            told.recv().await.unwrap(),
            r#"{"type":"delta","topic":"lines","seq":0,"lines":[1]}"#
        );
        assert_eq!(
            told.recv().await.unwrap(),
            r#"{"type":"dropped","topic":"lines","seq":1,"n":7}"#
        );
    }
}
