//! All or nothing: what is taken back, and where it goes.

use crate::board::{self, k, until};
use crate::safety::{config, known, switch, text};
use crate::several::{ALL, failures, set};
use railbus_site::config::Place;
use railbus_site::{CommandError, Config, PointQuality, Service};
use railbus_wire::crc16;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpListener;

/// An EDA9060A at address 1, whose first relay gives pulses and is in one all the time, and an
/// ERC-8 at address 2 that refuses every write. Counts the pulses that are begun.
fn answer(request: &[u8], pulses: &AtomicU32) -> Option<Vec<u8>> {
    let [address, function, ..] = *request else {
        return None;
    };
    let mut reply = match (address, function) {
        (1, 1) => vec![1, 1, 1, 1],
        (1, 3) => vec![1, 3, 2, 1, 50],
        (1, 5) => {
            pulses.fetch_add(1, Ordering::Relaxed);
            request[..6].to_vec()
        }
        (_, 1 | 2) => vec![address, function, 1, 0],
        _ => vec![address, function | 0x80, 4],
    };
    reply.extend(crc16(&reply).to_le_bytes());
    Some(reply)
}

#[tokio::test]
async fn taking_back_begins_no_pulse_again() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let port = listener.local_addr().unwrap();
    let pulses = Arc::new(AtomicU32::new(0));
    let begun = Arc::clone(&pulses);
    tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.unwrap();
        let mut request = [0; 64];
        while let Ok(len @ 1..) = stream.read(&mut request).await {
            if let Some(reply) = answer(&request[..len], &begun) {
                stream.write_all(&reply).await.unwrap();
            }
        }
    });
    let text = format!(
        "[line.main]\nport = \"tcp:{port}\"\n\
         [module.gate]\nline = \"main\"\nmodel = \"eda9060a\"\nprotocol = \"rtu\"\naddress = 1\n\
         [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 2\n"
    );
    let service = Service::start(Config::parse(&text).unwrap()).unwrap();
    let is_good = |module| service.point(module, k(1)).unwrap().quality == PointQuality::Good;
    until(|| is_good("gate") && is_good("oven")).await;
    let set = ["gate", "oven"].map(|module| (Place::new(module, k(1)), true));
    let done = service.batch(&set, ALL).await.unwrap();
    assert!(!done.undone, "{done:?}");
    assert_eq!(done.parts[0].end, Err(CommandError::NotUndone), "{done:?}");
    assert!(done.parts[1].end.is_err(), "{done:?}");
    assert_eq!(
        pulses.load(Ordering::Relaxed),
        1,
        "begun by the batch alone"
    );
    service.close().await;
}

/// Somebody has switched a relay by hand since it was read last.
#[tokio::test]
async fn what_is_taken_back_goes_where_it_was_and_not_where_it_was_read_before() {
    let (port, boards) = board::start().await;
    let rarely = "poll = \"1m\"\nmax_age = \"10m\"\naddress";
    let text = text(&port, "").replace("address", rarely);
    let service = Service::start(Config::parse(&text).unwrap()).unwrap();
    service.opened("main").await.unwrap();
    for module in ["oven", "yard"] {
        service.read_fresh(module).await.unwrap();
    }
    boards.set(3, 1);
    boards.refuse_together(1);
    let set = set(&[("oven", 1, true), ("yard", 1, true), ("yard", 2, true)]);
    let done = service.batch(&set, ALL).await.unwrap();
    let refused = Some("refused");
    assert_eq!(failures(&done), [Some("undone"), refused, refused]);
    assert!(done.undone);
    assert_eq!(boards.relays(3), 1, "as it was");
    service.close().await;
}

/// The configuration wants to be asked by now.
#[tokio::test]
async fn what_it_may_is_asked_again_in_its_turn() {
    let (port, boards) = board::start().await;
    let service = Service::start(config(&port, "")).unwrap();
    known(&service).await;
    boards.slow(100);
    let site = service.clone();
    let first = tokio::spawn(async move { switch(&site, "oven", 1, false).await });
    until(|| !service.audit().is_empty()).await;
    let site = service.clone();
    let both = set(&[("oven", 1, true), ("yard", 1, true)]);
    let waits = tokio::spawn(async move { site.batch(&both, ALL).await });
    tokio::task::yield_now().await;
    let asks = text(&port, "[module.oven.point.k1]\nconfirm = true\n");
    service.reload(&asks).await.unwrap();
    assert!(!first.is_finished(), "the other one waits yet");
    first.await.unwrap().unwrap();
    let done = waits.await.unwrap().unwrap();
    assert_eq!(failures(&done), [Some("confirm"), Some("not_tried")]);
    assert!(!done.undone, "nothing was done");
    assert!(boards.writes().iter().all(|write| write.on == 0));
    service.close().await;
}
