//! Access to the accounts: through the daemon, or in the file of the state folder if none runs; and
//! to those of the centre of a fleet.

use super::Context;
use super::context::hub_socket;
use super::fleet::unusable;
use crate::args;
use crate::backend::DaemonClient;
use clap::{Arg, ArgMatches, value_parser};
use hyper::Method;
use railbus_api::problem::{Problem, codes};
use railbus_app::failure::Failure;
use railbus_client::HubClient;
use railbus_gateway::access::{Gate, desk};
use railbus_words::{Lang, Phrase};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The folder of the centre in that of its fleet.
const HUB: &str = "hub";
/// A file that each such folder has.
const SERVERS: &str = "servers";

/// A request concerning the accounts.
pub(super) enum AccountRequest<'a> {
    Users,
    AddUser(Value),
    ChangeUser(&'a str, Value),
    RemoveUser(&'a str),
    Tokens,
    AddToken(Value),
    RevokeToken(&'a str),
    SetupLink,
}

/// What holds the accounts.
enum Accounts {
    Daemon(DaemonClient),
    Hub(HubClient),
    File(Arc<Gate>),
}

/// `--fleet`: the accounts of the centre of a fleet instead of those of the site.
pub(super) fn fleet(lang: Lang, help: impl Phrase) -> Arg {
    args::flag(lang, "fleet", help)
        .value_name("DIR")
        .value_parser(value_parser!(PathBuf))
}

/// Carries out a request and returns its result.
pub(super) fn send(
    context: &Context,
    matches: &ArgMatches,
    request: &AccountRequest<'_>,
) -> Result<Value, Failure> {
    let fleet = matches.try_get_one::<PathBuf>("fleet").ok().flatten();
    context.block(async {
        let found = match fleet {
            Some(folder) => Accounts::of_fleet(context, matches, folder).await,
            None => Accounts::find(context).await,
        };
        let told = match found? {
            Accounts::Daemon(daemon) => {
                let (method, path, body) = request.http();
                daemon.request(method, &path, &body).await
            }
            Accounts::Hub(hub) => {
                let (method, path, body) = request.http();
                hub.request(method, &path, &body).await
            }
            Accounts::File(access) => {
                let serve = match fleet {
                    Some(folder) => {
                        let folder = folder.display();
                        format!("railbus fleet serve {folder} --listen 127.0.0.1:7486")
                    }
                    None => "railbus serve".to_owned(),
                };
                of_file(&access, request, serve).await
            }
        };
        told.map_err(|problem| context.failure(&problem))
    })
}

impl Accounts {
    async fn find(context: &Context) -> Result<Accounts, Failure> {
        let files = context.files().await?;
        if let Some(daemon) = files.daemon {
            return Ok(Accounts::Daemon(daemon));
        }
        let access = Gate::open(&files.state);
        let access = access.map_err(|problem| context.failure(&problem))?;
        Ok(Accounts::File(Arc::new(access)))
    }

    /// Those of a fleet's centre: in its folder, or through the socket of the centre that has them
    /// locked there.
    async fn of_fleet(
        context: &Context,
        matches: &ArgMatches,
        folder: &Path,
    ) -> Result<Accounts, Failure> {
        let hub = folder.join(HUB);
        // Any other folder would become one with accounts.
        let servers = hub.join(SERVERS);
        if let Err(error) = std::fs::metadata(&servers) {
            return Err(unusable(context.lang, &servers, &error));
        }
        match Gate::open(&hub) {
            Ok(access) => Ok(Accounts::File(Arc::new(access))),
            Err(held) if held.code == codes::ACCOUNTS_HELD.code => {
                let serving = serving(matches, folder).await;
                let serving = serving.ok_or_else(|| context.failure(&held))?;
                Ok(Accounts::Hub(serving))
            }
            Err(problem) => Err(context.failure(&problem)),
        }
    }
}

/// The centre that has the accounts of this fleet: another one must not get the request.
async fn serving(matches: &ArgMatches, folder: &Path) -> Option<HubClient> {
    let named = hub_socket(matches);
    let hub = HubClient::find(named.as_deref()).await.ok()?;
    let told = hub.accounts().await.ok()?.folder?;
    let wanted = folder.canonicalize().ok()?;
    (Path::new(&told) == wanted).then_some(hub)
}

impl<'a> AccountRequest<'a> {
    /// The request of the API.
    fn http(&self) -> (Method, Vec<&'a str>, Value) {
        let nothing = json!({});
        match self {
            AccountRequest::Users => (Method::GET, vec!["users"], nothing),
            AccountRequest::AddUser(user) => (Method::POST, vec!["users"], user.clone()),
            AccountRequest::ChangeUser(name, change) => {
                (Method::PATCH, vec!["users", name], change.clone())
            }
            AccountRequest::RemoveUser(name) => (Method::DELETE, vec!["users", name], nothing),
            AccountRequest::Tokens => (Method::GET, vec!["tokens"], nothing),
            AccountRequest::AddToken(token) => (Method::POST, vec!["tokens"], token.clone()),
            AccountRequest::RevokeToken(name) => (Method::DELETE, vec!["tokens", name], nothing),
            AccountRequest::SetupLink => (Method::POST, vec!["setup-link"], nothing),
        }
    }
}

/// In the file; for a link a program has to be started first, by this command.
async fn of_file(
    access: &Arc<Gate>,
    request: &AccountRequest<'_>,
    serve: String,
) -> Result<Value, Problem> {
    let text = |value: &Value| value.to_string().into_bytes();
    match request {
        AccountRequest::Users => Ok(desk::users(access)),
        AccountRequest::AddUser(user) => desk::add_user(access, &text(user)).await,
        AccountRequest::ChangeUser(name, change) => {
            desk::change_user(access, name, None, &text(change)).await
        }
        AccountRequest::RemoveUser(name) => desk::remove_user(access, name).await,
        AccountRequest::Tokens => Ok(desk::tokens(access)),
        AccountRequest::AddToken(token) => desk::add_token(access, "owner", &text(token)).await,
        AccountRequest::RevokeToken(name) => desk::remove_token(access, name).await,
        AccountRequest::SetupLink => {
            let problem = Problem::new(codes::DAEMON);
            Err(problem.with_hint(serve))
        }
    }
}
