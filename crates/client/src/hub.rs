//! A client of the centre of a fleet, over its socket.

use super::http::{Answer, Asked, send, send_asked};
use super::{api_path, plain, read};
use hyper::Method;
use railbus_api::fleet::{
    FleetAccounts, FleetBulkPreview, FleetBulkSites, FleetCommands, FleetConfig, FleetConfigText,
    FleetRemoval, FleetSitePoints, FleetSiteTold, FleetSites, GiveBulk, PreviewBulk, SetSiteConfig,
    SetSiteGroups,
};
use railbus_api::problem::{Problem, codes};
use railbus_app::socket;
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::path::{Path, PathBuf};
use tokio::net::UnixStream;

/// Where answers have the text of a configuration.
const WANTED_TEXT: &str = "/wanted/text";
const TEXT: &str = "/text";

/// The centre behind a socket. Requests fail with the problem that it reports, or with
/// [`codes::DAEMON`] if it can't be reached.
#[derive(Clone, Debug)]
pub struct HubClient {
    socket: PathBuf,
}

impl HubClient {
    /// The one at this socket; or the first that answers at the usual places.
    ///
    /// # Errors
    /// [`codes::DAEMON`] if none answers at the usual places.
    pub async fn find(named: Option<&Path>) -> Result<HubClient, Problem> {
        if let Some(socket) = named {
            return Ok(HubClient::at(socket));
        }
        for socket in socket::places(socket::HUB) {
            if UnixStream::connect(&socket).await.is_ok() {
                return Ok(HubClient { socket });
            }
        }
        Err(unreached(Problem::new(codes::DAEMON)))
    }

    /// The one at this socket.
    #[must_use]
    pub fn at(socket: &Path) -> HubClient {
        let socket = socket.to_owned();
        HubClient { socket }
    }

    /// The path of its socket.
    pub(crate) fn socket(&self) -> &Path {
        &self.socket
    }

    /// All sites.
    ///
    /// # Errors
    /// It can't be reached.
    pub async fn sites(&self) -> Result<FleetSites, Problem> {
        self.get("/fleet/v1/sites").await
    }

    /// The sites of this group, of which the name is as it must be.
    ///
    /// # Errors
    /// It can't be reached.
    pub async fn sites_in(&self, group: &str) -> Result<FleetSites, Problem> {
        self.get(&format!("/fleet/v1/sites?group={group}")).await
    }

    /// Sets the groups that a site is in.
    ///
    /// # Errors
    /// They can't be stored, or the centre can't be reached.
    pub async fn set_groups(
        &self,
        site: &str,
        groups: &[String],
    ) -> Result<FleetSiteTold, Problem> {
        let wanted = SetSiteGroups {
            groups: groups.to_vec(),
        };
        let body = serde_json::to_vec(&wanted).unwrap_or_default();
        let path = format!("/fleet/v1/sites/{site}/groups");
        self.act(Method::PUT, &path, body).await
    }

    /// A site with its points.
    ///
    /// # Errors
    /// There is no such site, or the centre can't be reached.
    pub async fn site(&self, name: &str) -> Result<FleetSitePoints, Problem> {
        self.get(&format!("/fleet/v1/sites/{name}")).await
    }

    /// The configuration that a site is to have, and how far it is.
    ///
    /// # Errors
    /// There is no such site, or the centre can't be reached.
    pub async fn config(&self, site: &str) -> Result<FleetConfig, Problem> {
        let path = format!("/fleet/v1/sites/{site}/config");
        let answer = send(&self.socket, Method::GET, &path, Vec::new()).await;
        self.told_with(answer, WANTED_TEXT).await
    }

    /// Gives a site another configuration.
    ///
    /// # Errors
    /// It can't be one, the site takes none, or it was not stored, or that is not known.
    pub async fn set_config(
        &self,
        site: &str,
        wanted: &SetSiteConfig,
    ) -> Result<FleetConfig, Problem> {
        let body = serde_json::to_vec(wanted).unwrap_or_default();
        let path = format!("/fleet/v1/sites/{site}/config");
        let answer = send(&self.socket, Method::PUT, &path, body).await;
        self.told_with(answer, WANTED_TEXT).await
    }

    /// The configuration that a site has now.
    ///
    /// # Errors
    /// It is not connected or takes none from the centre, or the centre can't be reached.
    pub async fn config_text(&self, site: &str) -> Result<FleetConfigText, Problem> {
        let path = format!("/fleet/v1/sites/{site}/config/text");
        let answer = send(&self.socket, Method::GET, &path, Vec::new()).await;
        self.told_with(answer, TEXT).await
    }

    /// Removes a site that is offline.
    ///
    /// # Errors
    /// There is no such site, it is not known to be offline, or the centre can't be reached.
    pub async fn remove(&self, name: &str) -> Result<FleetRemoval, Problem> {
        let path = format!("/fleet/v1/sites/{name}");
        self.act(Method::DELETE, &path, Vec::new()).await
    }

    /// The newest commands to sites, the newest last.
    ///
    /// # Errors
    /// It can't be reached.
    pub async fn commands(&self) -> Result<FleetCommands, Problem> {
        self.get("/fleet/v1/commands").await
    }

    /// The sites that a command would go to. Nothing is sent.
    ///
    /// # Errors
    /// It is no command, or the centre can't be reached.
    pub async fn preview(&self, wanted: &PreviewBulk) -> Result<FleetBulkPreview, Problem> {
        let body = serde_json::to_vec(wanted).unwrap_or_default();
        let path = "/fleet/v1/commands/preview";
        let said: Value = self
            .act(Method::POST, path, body)
            .await
            .map_err(|problem| Problem {
                may_have_acted: false,
                ..problem
            })?;
        self.told(said)
    }

    /// Gives the same command to many sites, under this id.
    ///
    /// # Errors
    /// It was not recorded, or that is not known.
    pub async fn give_bulk(&self, id: &str, wanted: &GiveBulk) -> Result<FleetBulkSites, Problem> {
        let asked = Asked {
            method: Method::POST,
            path: "/fleet/v1/commands?limit=0",
            body: serde_json::to_vec(wanted).unwrap_or_default(),
            seen: None,
            key: Some(id),
        };
        self.acted(send_asked(&self.socket, asked).await).await
    }

    /// Wants no more commands of this order to be sent.
    ///
    /// # Errors
    /// There is no such order, or that could not be recorded.
    pub async fn stop_bulk(&self, id: &str) -> Result<FleetBulkSites, Problem> {
        let path = format!("/fleet/v1/commands/{id}/stop?limit=0");
        self.act(Method::POST, &path, Vec::new()).await
    }

    /// A command to many sites; with its sites, or only how many are how.
    ///
    /// # Errors
    /// There is no such order, or the centre can't be reached.
    pub async fn bulk(&self, id: &str, with_sites: bool) -> Result<FleetBulkSites, Problem> {
        let limit = if with_sites { "" } else { "?limit=0" };
        self.get(&format!("/fleet/v1/commands/{id}{limit}")).await
    }

    /// Which accounts it has.
    ///
    /// # Errors
    /// It can't be reached, or is no centre.
    pub async fn accounts(&self) -> Result<FleetAccounts, Problem> {
        self.get("/fleet/v1/accounts").await
    }

    /// A request concerning its accounts: `["users", "li"]` is `/api/v1/users/li`.
    ///
    /// # Errors
    /// What it says, or that it can't be reached.
    pub async fn request(
        &self,
        method: Method,
        path: &[&str],
        body: &Value,
    ) -> Result<Value, Problem> {
        let body = serde_json::to_vec(body).unwrap_or_default();
        self.act(method, &api_path(path), body).await
    }

    /// A request that changes something.
    async fn act<T: DeserializeOwned>(
        &self,
        method: Method,
        path: &str,
        body: Vec<u8>,
    ) -> Result<T, Problem> {
        self.acted(send(&self.socket, method, path, body).await)
            .await
    }

    /// The answer to such a request.
    async fn acted<T: DeserializeOwned>(
        &self,
        answer: Result<Answer, Problem>,
    ) -> Result<T, Problem> {
        let answer = answer.map_err(unreached)?;
        // It answered that it was done: only its answer could not be read.
        let said = read(&self.socket, &answer.whole().await?);
        said.map_err(|problem| problem.perhaps_acted(true))
    }

    async fn get<T: DeserializeOwned>(&self, path: &str) -> Result<T, Problem> {
        let answer = send(&self.socket, Method::GET, path, Vec::new()).await;
        let answer = answer.map_err(unreached)?;
        let said: Value = read(&self.socket, &answer.whole().await?)?;
        self.told(said)
    }

    /// What it tells, with the text at this place as it is: whoever prints that looks at it.
    async fn told_with<T: DeserializeOwned>(
        &self,
        answer: Result<Answer, Problem>,
        place: &str,
    ) -> Result<T, Problem> {
        let answer = answer.map_err(unreached)?;
        let acts = answer.acts();
        let body = answer.whole().await?;
        // If something was to be done, it was.
        let said = read(&self.socket, &body).map(|said| plain_but(said, place));
        let said = said.and_then(|said: Value| {
            let said = serde_json::to_vec(&said).unwrap_or_default();
            read(&self.socket, &said)
        });
        said.map_err(|problem: Problem| problem.perhaps_acted(acts))
    }

    /// What it tells, some of which sites said.
    fn told<T: DeserializeOwned>(&self, said: Value) -> Result<T, Problem> {
        let said = serde_json::to_vec(&plain(said)).unwrap_or_default();
        read(&self.socket, &said)
    }
}

/// The centre can't be reached: it, not the daemon of a site, is to be started.
pub(crate) fn unreached(problem: Problem) -> Problem {
    match problem.code == codes::DAEMON.code {
        true => problem.with_hint("railbus fleet serve DIR"),
        false => problem,
    }
}

/// Without characters that control a terminal, but in the text at this place.
fn plain_but(mut said: Value, place: &str) -> Value {
    let text = said.pointer_mut(place).map(Value::take);
    let mut said = plain(said);
    if let (Some(text), Some(at)) = (text, said.pointer_mut(place)) {
        *at = text;
    }
    said
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_configuration_keeps_its_lines_and_nothing_else_does() {
        let said = |text: &str| json!({ "site": "a\u{1b}[2J", "wanted": { "text": text } });
        let told = plain_but(said("a = 1\n\tb\u{1b}"), WANTED_TEXT);
        assert_eq!(
            told,
            json!({ "site": "a[2J", "wanted": { "text": "a = 1\n\tb\u{1b}" } })
        );
        // There is none.
        for none in [json!({ "site": "a" }), json!([]), json!(null)] {
            assert_eq!(plain_but(none.clone(), WANTED_TEXT), none);
        }
    }
}
