//! Tables that are sent row by row: nothing is held but what is under way.

use super::access::Caller;
use super::routes::{Answer, Asked, Site};
use axum::body::{Body, Bytes};
use axum::http::Response;
use axum::http::header::{CONTENT_DISPOSITION, CONTENT_TYPE, HeaderValue};
use http_body_util::channel::{Channel, Sender};
use railbus_app::render::csv::csv;
use railbus_words::Lang;
use std::convert::Infallible;
use std::pin::Pin;

/// How many pieces wait for a slow reader.
const PIECES_MAX: usize = 4;
/// What tells a spreadsheet that a file is UTF-8.
const MARK: &str = "\u{FEFF}";

/// The form of a file.
pub(super) struct File {
    csv: bool,
    /// Spreadsheets of Chinese systems take a file for GBK without it.
    mark: bool,
    name: &'static str,
}

impl File {
    /// What is asked for; none where there is no such format.
    pub(super) fn asked(asked: &Asked, lang: Lang, name: &'static str) -> Option<File> {
        let csv = match asked.get("format").map(String::as_str) {
            None | Some("csv") => true,
            Some("ndjson") => false,
            Some(_) => return None,
        };
        Some(File {
            csv,
            mark: csv && lang == Lang::Zh,
            name,
        })
    }

    pub(super) const fn is_csv(&self) -> bool {
        self.csv
    }

    /// What stands before the rows.
    pub(super) fn head(&self, columns: &[&str]) -> String {
        let mark = if self.mark { MARK } else { "" };
        match self.csv {
            true => format!("{mark}{}", csv(columns)),
            false => String::new(),
        }
    }
}

/// Where rows are sent to.
pub(super) struct Sink {
    sender: Sender<Bytes, Infallible>,
    /// Comes when nobody may read any more.
    over: Pin<Box<dyn Future<Output = ()> + Send>>,
}

impl Sink {
    /// Sends some rows; false where nobody reads any more, or the daemon ends.
    pub(super) async fn send(&mut self, rows: String) -> bool {
        if rows.is_empty() {
            return true;
        }
        tokio::select! {
            () = &mut self.over => false,
            sent = self.sender.send_data(Bytes::from(rows)) => sent.is_ok(),
        }
    }
}

/// An answer that is sent piece by piece.
pub(super) fn stream(site: &Site, who: &Caller, file: &File) -> (Answer, Sink) {
    let (sender, body) = Channel::<Bytes, Infallible>::new(PIECES_MAX);
    let mut response = Response::new(Body::new(body));
    let (content_type, ending) = match file.csv {
        true => ("text/csv; charset=utf-8", "csv"),
        false => ("application/x-ndjson", "ndjson"),
    };
    let headers = response.headers_mut();
    headers.insert(CONTENT_TYPE, HeaderValue::from_static(content_type));
    let name = format!("attachment; filename=\"{}.{ending}\"", file.name);
    if let Ok(name) = HeaderValue::from_str(&name) {
        headers.insert(CONTENT_DISPOSITION, name);
    }
    let over = Box::pin(site.over(who));
    (response, Sink { sender, over })
}
