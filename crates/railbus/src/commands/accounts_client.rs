//! Access to the accounts: through the daemon, or in the file of the state folder if none runs.

use super::Context;
use crate::backend::DaemonClient;
use hyper::Method;
use railbus_api::problem::{Problem, codes};
use railbus_app::failure::Failure;
use railbus_gateway::access::{Gate, desk};
use serde_json::{Value, json};
use std::sync::Arc;

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
    File(Arc<Gate>),
}

/// Carries out a request and returns its result.
pub(super) fn send(context: &Context, request: &AccountRequest<'_>) -> Result<Value, Failure> {
    context.block(async {
        let told = match Accounts::find(context).await? {
            Accounts::Daemon(daemon) => of_daemon(&daemon, request).await,
            Accounts::File(access) => of_file(&access, request).await,
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
}

async fn of_daemon(daemon: &DaemonClient, request: &AccountRequest<'_>) -> Result<Value, Problem> {
    let nothing = json!({});
    let (method, path, body) = match request {
        AccountRequest::Users => (Method::GET, vec!["users"], &nothing),
        AccountRequest::AddUser(user) => (Method::POST, vec!["users"], user),
        AccountRequest::ChangeUser(name, change) => (Method::PATCH, vec!["users", name], change),
        AccountRequest::RemoveUser(name) => (Method::DELETE, vec!["users", name], &nothing),
        AccountRequest::Tokens => (Method::GET, vec!["tokens"], &nothing),
        AccountRequest::AddToken(token) => (Method::POST, vec!["tokens"], token),
        AccountRequest::RevokeToken(name) => (Method::DELETE, vec!["tokens", name], &nothing),
        AccountRequest::SetupLink => (Method::POST, vec!["setup-link"], &nothing),
    };
    daemon.request(method, &path, body).await
}

async fn of_file(access: &Arc<Gate>, request: &AccountRequest<'_>) -> Result<Value, Problem> {
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
            Err(problem.with_hint("railbus serve"))
        }
    }
}
