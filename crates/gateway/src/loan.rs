//! Exclusive access to a line for a command that changes settings of its modules. It lasts as long
//! as the connection: however the command ends, it is released.

use super::access::{Caller, Need};
use super::answer;
use super::doc::Doc;
use super::listen::ended;
use super::route::Route;
use super::site::Site;
use axum::body::{Body, Bytes};
use axum::extract::{Path, State};
use axum::http::Response;
use axum::routing::post;
use hyper::body::Frame;
use railbus_app::api::failures;
use railbus_site::{ExclusiveHold, Rights};
use std::convert::Infallible;
use std::pin::Pin;
use std::task::{Context, Poll};
use tokio::sync::oneshot;

/// The routes of this file.
pub(super) const ROUTES: &[Route] =
    &[
        Route::new("POST", "/lines/{line}/loan", Need::Owner, || post(lend)).doc(
            Doc::new("Have a line for as long as the connection lasts").media(&["text/plain"]),
        ),
    ];

/// `POST /api/v1/lines/{line}/loan`: sends an empty line when the port is free, and then nothing
/// for as long as it is lent.
pub(super) async fn lend(State(site): State<Site>, Path(line): Path<String>) -> Response<Body> {
    let loan = match site.service.lend(&line).await {
        Ok(loan) => loan,
        Err(failure) => return answer::problem(&failures::of_line(&site.service, &line, &failure)),
    };
    let (held, gone) = oneshot::channel();
    let (lent, over) = oneshot::channel();
    tokio::spawn(take_back(site, loan, gone, lent));
    Response::new(Body::new(Held {
        told: false,
        over,
        _held: held,
    }))
}

/// Releases the line once the reader has gone; when the daemon stops, there is nothing to release.
/// When the access is revoked, the response ends: the holder stops where that is safe, and its port
/// is free then.
async fn take_back(
    mut site: Site,
    loan: ExclusiveHold,
    mut gone: oneshot::Receiver<()>,
    lent: oneshot::Sender<()>,
) {
    tokio::select! {
        () = ended(&mut site.stop) => return loan.leave(),
        _ = &mut gone => {}
        () = tokio::time::sleep_until(loan.until()) => {}
    }
    drop(lent);
    let owner = site
        .service
        .on_behalf_of(Caller::owner().origin(), Rights::all());
    site.desk.take_back(loan, &owner).await;
}

/// The response body: dropped with the connection.
struct Held {
    told: bool,
    /// Closed when the access ends.
    over: oneshot::Receiver<()>,
    _held: oneshot::Sender<()>,
}

impl hyper::body::Body for Held {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        if std::mem::replace(&mut self.told, true) {
            return Pin::new(&mut self.over).poll(context).map(|_| None);
        }
        Poll::Ready(Some(Ok(Frame::data(Bytes::from_static(b"\n")))))
    }
}
