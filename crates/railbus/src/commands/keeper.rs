//! Whoever keeps the accounts: the daemon, or the file of the state folder where none runs.

use super::Context;
use crate::backend::Remote;
use hyper::Method;
use railbus_api::problem::{Problem, codes};
use railbus_app::failure::Failure;
use railbus_gateway::access::{Gate, desk};
use serde_json::{Value, json};
use std::sync::Arc;

/// What is asked of the accounts.
pub(super) enum Order<'a> {
    Users,
    AddUser(Value),
    ChangeUser(&'a str, Value),
    RemoveUser(&'a str),
    Tokens,
    AddToken(Value),
    RevokeToken(&'a str),
    SetupLink,
}

/// Whoever keeps the accounts.
enum Keeper {
    Daemon(Remote),
    File(Arc<Gate>),
}

/// Asks, and waits for the answer.
pub(super) fn ask(context: &Context, order: &Order<'_>) -> Result<Value, Failure> {
    context.block(async {
        let told = match Keeper::find(context).await? {
            Keeper::Daemon(daemon) => of_daemon(&daemon, order).await,
            Keeper::File(access) => of_file(&access, order).await,
        };
        told.map_err(|problem| context.failure(&problem))
    })
}

impl Keeper {
    async fn find(context: &Context) -> Result<Keeper, Failure> {
        let files = context.files().await?;
        if let Some(daemon) = files.daemon {
            return Ok(Keeper::Daemon(daemon));
        }
        let access = Gate::open(&files.state);
        let access = access.map_err(|problem| context.failure(&problem))?;
        Ok(Keeper::File(Arc::new(access)))
    }
}

async fn of_daemon(daemon: &Remote, order: &Order<'_>) -> Result<Value, Problem> {
    let nothing = json!({});
    let (method, path, body) = match order {
        Order::Users => (Method::GET, vec!["users"], &nothing),
        Order::AddUser(user) => (Method::POST, vec!["users"], user),
        Order::ChangeUser(name, change) => (Method::PATCH, vec!["users", name], change),
        Order::RemoveUser(name) => (Method::DELETE, vec!["users", name], &nothing),
        Order::Tokens => (Method::GET, vec!["tokens"], &nothing),
        Order::AddToken(token) => (Method::POST, vec!["tokens"], token),
        Order::RevokeToken(name) => (Method::DELETE, vec!["tokens", name], &nothing),
        Order::SetupLink => (Method::POST, vec!["setup-link"], &nothing),
    };
    daemon.order(method, &path, body).await
}

async fn of_file(access: &Arc<Gate>, order: &Order<'_>) -> Result<Value, Problem> {
    let text = |value: &Value| value.to_string().into_bytes();
    match order {
        Order::Users => Ok(desk::users(access)),
        Order::AddUser(user) => desk::add_user(access, &text(user)).await,
        Order::ChangeUser(name, change) => {
            desk::change_user(access, name, None, &text(change)).await
        }
        Order::RemoveUser(name) => desk::remove_user(access, name).await,
        Order::Tokens => Ok(desk::tokens(access)),
        Order::AddToken(token) => desk::add_token(access, "owner", &text(token)).await,
        Order::RevokeToken(name) => desk::remove_token(access, name).await,
        Order::SetupLink => {
            let problem = Problem::new(codes::DAEMON);
            Err(problem.with_hint("railbus serve"))
        }
    }
}
