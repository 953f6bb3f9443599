//! Tables that are sent row by row, without keeping them in memory.

use super::access::Caller;
use super::route::{Answer, Asked};
use super::site::Site;
use axum::body::{Body, Bytes};
use axum::http::Response;
use axum::http::header::{CONTENT_DISPOSITION, CONTENT_TYPE, HeaderValue};
use http_body_util::channel::{Channel, Sender};
use railbus_app::render::csv::csv;
use railbus_words::Lang;
use std::convert::Infallible;
use std::pin::Pin;

/// How many chunks are buffered for a slow reader.
const PIECES_MAX: usize = 4;
/// The byte order mark, which tells a spreadsheet that a file is UTF-8.
const MARK: &str = "\u{FEFF}";

/// The file format.
pub(super) struct File {
    csv: bool,
    /// Without it, spreadsheets on Chinese systems assume GBK.
    mark: bool,
    name: &'static str,
}

impl File {
    /// The requested format; none if it does not exist.
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

    /// Says what a response is, and what it is to be called.
    fn describe(&self, response: &mut Answer, name: &str) {
        let (content_type, ending) = match self.csv {
            true => ("text/csv; charset=utf-8", "csv"),
            false => ("application/x-ndjson", "ndjson"),
        };
        let headers = response.headers_mut();
        headers.insert(CONTENT_TYPE, HeaderValue::from_static(content_type));
        let name = format!("attachment; filename=\"{name}.{ending}\"");
        if let Ok(name) = HeaderValue::from_str(&name) {
            headers.insert(CONTENT_DISPOSITION, name);
        }
    }

    /// What precedes the rows.
    pub(super) fn head(&self, columns: &[&str]) -> String {
        let mark = if self.mark { MARK } else { "" };
        match self.csv {
            true => format!("{mark}{}", csv(columns)),
            false => String::new(),
        }
    }
}

/// A table that is sent at once, as a file for spreadsheets.
pub(super) fn whole_csv(
    name: &str,
    lang: Lang,
    columns: &[String],
    rows: &[Vec<String>],
) -> Answer {
    let file = File {
        csv: true,
        mark: lang == Lang::Zh,
        name: "",
    };
    fn cells(row: &[String]) -> Vec<&str> {
        row.iter().map(String::as_str).collect()
    }
    let mut text = file.head(&cells(columns));
    for row in rows {
        text += &csv(&cells(row));
    }
    let mut response = Response::new(Body::from(text));
    file.describe(&mut response, name);
    response
}

/// Where rows are sent.
pub(super) struct Sink {
    sender: Sender<Bytes, Infallible>,
    /// Resolves when the caller loses its permission.
    over: Pin<Box<dyn Future<Output = ()> + Send>>,
}

impl Sink {
    /// Sends rows; false if the reader has gone or the daemon stops.
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

/// A response that is sent in chunks.
pub(super) fn stream(site: &Site, who: &Caller, file: &File) -> (Answer, Sink) {
    let (sender, body) = Channel::<Bytes, Infallible>::new(PIECES_MAX);
    let mut response = Response::new(Body::new(body));
    file.describe(&mut response, file.name);
    let over = Box::pin(site.over(who));
    (response, Sink { sender, over })
}
