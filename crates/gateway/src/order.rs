//! A mutating request: the caller and what it wants. Everything that switches an output or changes
//! the configuration begins with one.

use super::access::Caller;
use super::keys::{self, broken};
use super::remote_order::RemoteOrder;
use super::route::Answer;
use super::site::Site;
use super::{answer, body};
use axum::Extension;
use axum::body::Bytes;
use axum::extract::{FromRequest, FromRequestParts, Request};
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Response};
use railbus_api::problem::{Problem, codes};
use railbus_site::{CommandKey, KEY_LEN_MAX, Service};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::sync::Arc;

/// The content of a request.
pub(super) struct Order {
    pub(super) site: Site,
    pub(super) who: Caller,
    pub(super) headers: HeaderMap,
    /// How it came, where a remote caller gave it.
    remote: Option<RemoteOrder>,
    body: Bytes,
}

impl FromRequest<Site> for Order {
    type Rejection = Response;

    async fn from_request(request: Request, site: &Site) -> Result<Order, Response> {
        let (mut parts, body) = request.into_parts();
        let who = Extension::<Caller>::from_request_parts(&mut parts, site).await;
        let Extension(who) = who.map_err(IntoResponse::into_response)?;
        let headers = parts.headers.clone();
        let remote = parts.extensions.get().copied();
        let body = Bytes::from_request(Request::from_parts(parts, body), site).await;
        Ok(Order {
            site: site.clone(),
            who,
            headers,
            remote,
            body: body.map_err(IntoResponse::into_response)?,
        })
    }
}

impl Order {
    /// Parses its body. No body is the same as an empty object.
    pub(super) fn read<T: DeserializeOwned>(&self) -> Result<T, Problem> {
        let text: &[u8] = if self.body.is_empty() {
            b"{}"
        } else {
            &self.body
        };
        let wrong = |error: serde_json::Error| wrong(&error.to_string());
        body::parse(text).map_err(wrong)
    }

    /// The same for a body that contains a secret: an error only reports the position.
    pub(super) fn read_secret<T: DeserializeOwned>(&self) -> Result<T, Problem> {
        super::access::read(&self.body)
    }

    /// The outputs that the caller may switch.
    pub(super) fn rights(&self) -> Arc<[String]> {
        Arc::clone(&self.who.points)
    }

    /// Carries it out on one output, if the caller may switch that.
    pub(super) async fn on_point<T, R, F, Fut>(
        self,
        what: &'static str,
        (module, label): (String, String),
        run: F,
    ) -> Answer
    where
        T: DeserializeOwned + Send + 'static,
        R: Serialize,
        F: FnOnce(Service, String, T) -> Fut + Send + 'static,
        Fut: Future<Output = Result<R, Problem>> + Send + 'static,
    {
        let path = format!("{module}.{label}");
        match self.who.may_write(&path) {
            Ok(()) => self.carry_out((what, path), run).await,
            Err(problem) => self.refused((what, path), &problem),
        }
    }

    /// It is not carried out. One that was given before is told of all the same: rights that are
    /// gone, and names that are, say nothing of what it did then.
    fn refused(self, what: (&'static str, String), problem: &Problem) -> Answer {
        let Some(remote) = self.remote.filter(|remote| remote.tell) else {
            return answer::problem(problem);
        };
        match self.key(what) {
            Ok(Some(key)) => {
                let has_rights = problem.code != codes::POINT_RIGHT.code;
                remote.told(&self.site.service, &key, has_rights)
            }
            _ => answer::problem(problem),
        }
    }

    /// The key under which it is carried out once, if it has one.
    fn key(&self, what: (&'static str, String)) -> Result<Option<CommandKey>, Problem> {
        let key = match self.headers.get("idempotency-key").map(|key| key.to_str()) {
            None => return Ok(None),
            Some(Ok(key)) if (1..=KEY_LEN_MAX).contains(&key.len()) => key.to_owned(),
            Some(_) => return Err(wrong("an Idempotency-Key has 1 to 128 characters of ASCII")),
        };
        Ok(Some(CommandKey {
            key,
            caller: self.who.id.clone(),
            command: vec![what.0.into(), what.1.into(), self.body.to_vec()],
        }))
    }

    /// Carries it out on a task of its own: even if the caller goes away, the command ends
    /// properly. With an `Idempotency-Key` it is carried out once.
    pub(super) async fn carry_out<T, R, F, Fut>(
        self,
        what: (&'static str, String),
        run: F,
    ) -> Answer
    where
        T: DeserializeOwned + Send + 'static,
        R: Serialize,
        F: FnOnce(Service, String, T) -> Fut + Send + 'static,
        Fut: Future<Output = Result<R, Problem>> + Send + 'static,
    {
        self.carry_out_if(what, |_, _, _| Ok(()), run).await
    }

    /// The same, if it is allowed. A caller that has lost its permission must not learn the result
    /// of an earlier request either, so this is checked before the key is looked up.
    pub(super) async fn carry_out_if<T, R, F, Fut>(
        self,
        what: (&'static str, String),
        may: impl Fn(&Service, &str, &T) -> Result<(), Problem> + Send + 'static,
        run: F,
    ) -> Answer
    where
        T: DeserializeOwned + Send + 'static,
        R: Serialize,
        F: FnOnce(Service, String, T) -> Fut + Send + 'static,
        Fut: Future<Output = Result<R, Problem>> + Send + 'static,
    {
        let key = match self.key(what.clone()) {
            Ok(key) => key,
            Err(problem) => return answer::problem(&problem),
        };
        let (who, site) = (&self.who, &self.site);
        let service = site.service.on_behalf_of(who.origin(), who.rights());
        let allowed = |wanted: &T| may(&service, &what.1, wanted);
        let wanted = self.read().and_then(|wanted| {
            allowed(&wanted)?;
            Ok(wanted)
        });
        let wanted = match wanted {
            Ok(wanted) => wanted,
            Err(problem) => return self.refused(what, &problem),
        };
        let name = what.1.clone();
        let (remote, body) = (self.remote, self.body.clone());
        let end = async move {
            // What is left of its time now: its key may have waited for the disk.
            let wanted = match &remote {
                Some(remote) => remote.in_time(&body)?,
                None => wanted,
            };
            // The site asks for the rights once more, in the step in which the command begins.
            run(service, name, wanted).await.map(as_json)
        };
        let end = async move { tokio::spawn(end).await.unwrap_or_else(broken) };
        let Some(key) = key else {
            return match self.remote {
                Some(_) => bad_request("a remote command without an Idempotency-Key"),
                None => answer::text(end.await),
            };
        };
        match &self.remote {
            Some(remote) if !remote.may_begin() => remote.told(&self.site.service, &key, true),
            _ => answer::text(keys::once(&self.site.service, key, end).await),
        }
    }
}

fn as_json(value: impl Serialize) -> Bytes {
    // The API's own types are always valid JSON.
    Bytes::from(serde_json::to_vec(&value).unwrap_or_default())
}

fn wrong(reason: &str) -> Problem {
    Problem::new(codes::BAD_REQUEST).with("reason", reason)
}

pub(super) fn bad_request(reason: &str) -> Answer {
    answer::problem(&wrong(reason))
}
