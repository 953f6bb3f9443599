//! Compresses responses for clients that accept it. Only responses to reads without a secret in
//! them; those to commands are short, and may contain one.

use super::web::takes;
use axum::body::{Body, to_bytes};
use axum::extract::Request;
use axum::http::StatusCode;
use axum::http::header::{ACCEPT_ENCODING, CONTENT_ENCODING, CONTENT_LENGTH, HeaderValue, VARY};
use axum::middleware::Next;
use axum::response::Response;
use flate2::Compression;
use flate2::write::GzEncoder;
use hyper::body::Body as _;
use std::io::Write;

/// Shorter ones fit into a packet as they are.
const LEN_MIN: u64 = 1_024;
/// Longer ones would take too long, and block the lines for that time.
const LEN_MAX: u64 = 1 << 20;

/// Compresses a response that is complete. Streams are sent as they are.
pub(super) async fn answer(request: Request, next: Next) -> Response {
    let accepted = request.headers().get_all(ACCEPT_ENCODING).iter();
    let is_taken = accepted
        .filter_map(|list| list.to_str().ok())
        .any(|list| takes(list, "gzip"));
    let mut response = next.run(request).await;
    let length = response.body().size_hint().exact();
    let is_fit = response.status() == StatusCode::OK
        && !response.headers().contains_key(CONTENT_ENCODING)
        && length.is_some_and(|length| (LEN_MIN..=LEN_MAX).contains(&length));
    if !is_fit {
        return response;
    }
    response
        .headers_mut()
        .append(VARY, HeaderValue::from_static("Accept-Encoding"));
    if !is_taken {
        return response;
    }
    let (mut head, body) = response.into_parts();
    let most = usize::try_from(LEN_MAX).unwrap_or(usize::MAX);
    let Ok(plain) = to_bytes(body, most).await else {
        // A body of known length is complete.
        return Response::from_parts(head, Body::empty());
    };
    let body = match shorter(&plain) {
        Some(shorter) => {
            let gzip = HeaderValue::from_static("gzip");
            head.headers.insert(CONTENT_ENCODING, gzip);
            head.headers.remove(CONTENT_LENGTH);
            Body::from(shorter)
        }
        None => Body::from(plain),
    };
    Response::from_parts(head, body)
}

/// The compressed text, if it is any shorter.
fn shorter(plain: &[u8]) -> Option<Vec<u8>> {
    let mut gzip = GzEncoder::new(Vec::new(), Compression::fast());
    gzip.write_all(plain).ok()?;
    gzip.finish().ok().filter(|bytes| bytes.len() < plain.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::Router;
    use axum::middleware::from_fn;
    use axum::routing::get;
    use flate2::read::GzDecoder;
    use hyper::service::Service as _;
    use hyper_util::service::TowerToHyperService;
    use std::io::Read;

    async fn ask(path: &str, encodings: &str) -> (Option<String>, Vec<u8>) {
        let long = || async { "pump.do0 ".repeat(1_000) };
        let short = || async { "short" };
        let router = Router::new()
            .route("/long", get(long))
            .route("/short", get(short))
            .layer(from_fn(answer));
        let request = Request::get(path).header(ACCEPT_ENCODING, encodings);
        let request = request.body(Body::empty()).unwrap();
        let Ok(answer) = TowerToHyperService::new(router).call(request).await;
        let coding = answer.headers().get(CONTENT_ENCODING);
        let coding = coding.map(|coding| coding.to_str().unwrap().to_owned());
        let length = answer.headers().get(CONTENT_LENGTH).cloned();
        let body = to_bytes(Body::new(answer.into_body()), 1 << 20)
            .await
            .unwrap();
        if let Some(length) = length {
            assert_eq!(length.to_str().unwrap(), body.len().to_string());
        }
        (coding, body.to_vec())
    }

    #[tokio::test]
    async fn who_takes_gzip_gets_long_answers_shorter_and_the_same() {
        let (coding, body) = ask("/long", "br, gzip;q=0.5").await;
        assert_eq!(coding.as_deref(), Some("gzip"));
        assert!(body.len() < 900, "{}", body.len());
        let mut plain = String::new();
        GzDecoder::new(&body[..])
            .read_to_string(&mut plain)
            .unwrap();
        assert_eq!(plain, "pump.do0 ".repeat(1_000));
        for (path, encodings) in [("/long", ""), ("/long", "gzip;q=0"), ("/short", "gzip")] {
            let (coding, _) = ask(path, encodings).await;
            assert_eq!(coding, None, "{path} {encodings}");
        }
    }
}
