use super::*;
use rcgen::{CertificateParams, KeyPair};
use rustls::ServerConfig;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpListener;
use tokio_rustls::TlsAcceptor;

/// What the receiver does with a connection.
enum Deed {
    Say(&'static str),
    Hang,
    Close,
}

/// A receiver for one request, which it gives back.
async fn receive(deed: Deed) -> (String, tokio::task::JoinHandle<String>) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = format!("http://{}/hook?x=1", listener.local_addr().unwrap());
    let task = tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.unwrap();
        let mut text = Vec::new();
        while !text.ends_with(b"{\"schema\":1}") {
            assert_ne!(stream.read_buf(&mut text).await.unwrap(), 0);
        }
        match deed {
            Deed::Say(answer) => {
                stream.write_all(answer.as_bytes()).await.unwrap();
                // What follows a redirect would be heard here.
                let more = tokio::time::timeout(Duration::from_millis(300), listener.accept());
                assert!(more.await.is_err(), "it came again");
            }
            // Until the other end has gone.
            Deed::Hang => {
                let _ = stream.read(&mut [0]).await;
            }
            Deed::Close => {}
        }
        String::from_utf8(text).unwrap()
    });
    (url, task)
}

fn parcel(url: &str, secret: Option<&str>) -> Parcel {
    Parcel {
        url: url.to_owned(),
        allowed: Vec::new(),
        id: "01EVENT".to_owned(),
        body: Bytes::from_static(b"{\"schema\":1}"),
        secret: secret.map(|secret| Arc::new(Secret::new(secret.to_owned()))),
    }
}

async fn end_of(deed: Deed) -> Result<u16, Failed> {
    let (url, receiver) = receive(deed).await;
    let end = Carrier::new(LIMIT).carry(&parcel(&url, None)).await;
    receiver.await.unwrap();
    end
}

#[tokio::test]
async fn what_is_sent_can_be_verified() {
    let (url, receiver) = receive(Deed::Say("HTTP/1.1 204 No Content\r\n\r\n")).await;
    let end = Carrier::new(LIMIT)
        .carry(&parcel(&url, Some("canary of sixteen")))
        .await;
    assert_eq!(end, Ok(204));
    let text = receiver.await.unwrap();
    assert!(text.starts_with("POST /hook?x=1 HTTP/1.1\r\n"), "{text}");
    assert!(
        text.contains("content-type: application/json\r\n"),
        "{text}"
    );
    assert!(text.contains("x-railbus-event: 01EVENT\r\n"), "{text}");
    assert!(!text.contains("canary"), "{text}");
    let header = |name: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(name));
        line.unwrap_or_default().to_owned()
    };
    let at: i64 = header("x-railbus-timestamp: ").parse().unwrap();
    assert!((Timestamp::now().as_second() - at).abs() < 600);
    let secret = Secret::new("canary of sixteen".to_owned());
    let wanted = signature(&secret, at, b"{\"schema\":1}").unwrap();
    assert_eq!(header("x-railbus-signature: "), format!("sha256={wanted}"));
}

#[test]
fn the_signature_is_that_of_other_programs() {
    // printf '1700000000.{"schema":1}' | openssl dgst -sha256 -hmac 'a secret of ours'
    let secret = Secret::new("a secret of ours".to_owned());
    let signed = signature(&secret, 1_700_000_000, b"{\"schema\":1}").unwrap();
    assert_eq!(
        signed,
        "caf23d28fa5d68bac50b172c5cd77aa411fe67a963d7be0da32afc443817a212"
    );
}

#[tokio::test]
async fn an_answer_is_what_its_status_says_and_no_more_of_it_is_read() {
    let say = |text| end_of(Deed::Say(text));
    let endless = "HTTP/1.1 200 OK\r\nContent-Length: 999999999\r\n\r\nand so on";
    assert_eq!(say(endless).await, Ok(200));
    let moved = "HTTP/1.1 307 Moved\r\nLocation: /other\r\nContent-Length: 0\r\n\r\n";
    assert_eq!(say(moved).await, Err(Failed::Refused(307, None)));
    let broken = "HTTP/1.1 500 Oh\r\nContent-Length: 0\r\n\r\n";
    assert_eq!(say(broken).await, Err(Failed::Refused(500, None)));
    let busy = "HTTP/1.1 429 Busy\r\nRetry-After: 7\r\nContent-Length: 0\r\n\r\n";
    let wait = Some(Duration::from_secs(7));
    assert_eq!(say(busy).await, Err(Failed::Refused(429, wait)));
    let unreached = |end| matches!(end, Err(Failed::Unreached(_)));
    assert!(unreached(say("SSH-2.0-x\r\n\r\n").await));
    assert!(unreached(end_of(Deed::Close).await));
}

#[tokio::test]
async fn a_receiver_that_hangs_is_left() {
    let (url, receiver) = receive(Deed::Hang).await;
    let carrier = Carrier::new(Duration::from_millis(300));
    assert_eq!(carrier.carry(&parcel(&url, None)).await, Err(Failed::Slow));
    receiver.await.unwrap();
}

#[tokio::test]
async fn who_is_not_there_or_not_trusted_is_told_apart() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    drop(listener);
    let carrier = Carrier::new(LIMIT);
    let end = carrier
        .carry(&parcel(&format!("http://{address}/"), None))
        .await;
    assert!(matches!(end, Err(Failed::Unreached(_))), "{end:?}");
    // It speaks no TLS.
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = format!(
        "https://localhost:{}/",
        listener.local_addr().unwrap().port()
    );
    let plain = tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.unwrap();
        stream.write_all(b"HTTP/1.1 400 Bad\r\n\r\n").await.unwrap();
        let _ = stream.read_to_end(&mut Vec::new()).await;
    });
    let end = carrier.carry(&parcel(&url, None)).await;
    assert!(matches!(end, Err(Failed::Tls(_))), "{end:?}");
    plain.await.unwrap();
}

#[tokio::test]
async fn over_tls_it_goes_to_whom_is_trusted_and_nobody_else() {
    let key = KeyPair::generate().unwrap();
    let params = CertificateParams::new(vec!["localhost".to_owned()]).unwrap();
    let cert = params.self_signed(&key).unwrap().der().clone();
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let server = ServerConfig::builder_with_provider(Arc::clone(&provider))
        .with_safe_default_protocol_versions()
        .unwrap()
        .with_no_client_auth()
        .with_single_cert(vec![cert.clone()], key.serialize_der().try_into().unwrap())
        .unwrap();
    let acceptor = TlsAcceptor::from(Arc::new(server));
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let port = listener.local_addr().unwrap().port();
    let receiver = tokio::spawn(async move {
        loop {
            let (stream, _) = listener.accept().await.unwrap();
            let Ok(mut stream) = acceptor.accept(stream).await else {
                continue;
            };
            let mut text = Vec::new();
            while !text.ends_with(b"{\"schema\":1}") {
                assert_ne!(stream.read_buf(&mut text).await.unwrap(), 0);
            }
            let answer = b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n";
            stream.write_all(answer).await.unwrap();
        }
    });
    let carrier = Carrier::new(LIMIT);
    let carry = async |host: &str| {
        let url = format!("https://{host}:{port}/");
        carrier.carry(&parcel(&url, None)).await
    };
    let end = carry("localhost").await;
    assert!(matches!(end, Err(Failed::Tls(_))), "{end:?}");
    let mut roots = RootCertStore::empty();
    roots.add(cert).unwrap();
    let client = ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .unwrap()
        .with_root_certificates(roots)
        .with_no_client_auth();
    *carrier.trust.lock().unwrap() = Some(Arc::new(client));
    assert_eq!(carry("localhost").await, Ok(200));
    let other = carry("127.0.0.1").await;
    assert!(
        matches!(other, Err(Failed::Tls(_))),
        "another name: {other:?}"
    );
    receiver.abort();
}

/// `127.1` looks like a name, and resolves to this machine, as any name could when it is resolved
/// again.
#[tokio::test]
async fn a_name_that_leads_to_this_machine_is_refused_unless_the_owner_allows_it() {
    let (url, receiver) = receive(Deed::Say("HTTP/1.1 204 No Content\r\n\r\n")).await;
    let named = url.replace("127.0.0.1", "127.1");
    let refused = Carrier::new(LIMIT).carry(&parcel(&named, None)).await;
    let problem = refused.as_ref().err().map(|failed| failed.problem().code);
    assert_eq!(problem.as_deref(), Some("E0925"), "{refused:?}");
    for allowed in ["127.0.0.2", "127.1:1"] {
        let parcel = Parcel {
            allowed: vec![allowed.to_owned()],
            ..parcel(&named, None)
        };
        assert!(
            Carrier::new(LIMIT).carry(&parcel).await.is_err(),
            "{allowed}"
        );
    }
    let parcel = Parcel {
        allowed: vec!["127.0.0.1".to_owned()],
        ..parcel(&named, None)
    };
    assert_eq!(Carrier::new(LIMIT).carry(&parcel).await, Ok(204));
    receiver.await.unwrap();
}
