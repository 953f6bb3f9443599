//! Frames of somebody's own, which no rule of the configuration holds back: what is known after
//! them must be true all the same.

use crate::board::{k, until};
use crate::safety::{site, switch};
use railbus_host::{Fault, Probed};
use railbus_site::{CommandError, PointQuality, PointValue, RawTerms, Service};
use railbus_store::audit::End;
use railbus_wire::{Address, Exchange, crc16, rtu};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpListener;

const LOCK: &str = "[module.oven.point.k1]\ninterlock = [\"yard.k1\"]\n";

/// Switches a relay by a frame of its own.
pub(crate) fn frame(address: u8, number: u8, on: bool) -> Exchange<'static> {
    let request = rtu::Request::WriteCoil {
        at: 59 + u16::from(number),
        value: if on {
            rtu::CoilValue::ON
        } else {
            rtu::CoilValue::OFF
        },
    };
    Exchange::rtu(Address(address), request)
}

async fn send(service: &Service, frame: Exchange<'static>) -> Result<Probed, CommandError> {
    let sent = service.send("main", frame, RawTerms::default(), "send it".to_owned());
    Ok(sent.await?.met.outcome)
}

#[tokio::test]
async fn a_read_waits_for_a_line_that_is_being_opened() {
    let (port, _) = crate::board::start().await;
    let service = crate::start(&port);
    let coils = rtu::Request::ReadCoils(rtu::BitSpan::new(60, 8).unwrap());
    let read = || Exchange::rtu(Address(3), coils);
    // Nothing of the line has run yet.
    let met = service.raw("main", read(), RawTerms::default()).await;
    assert_eq!(met.unwrap().outcome, Probed::Answered);
    service.close().await;
    let end = service.raw("main", read(), RawTerms::default()).await;
    assert_eq!(end.unwrap_err(), CommandError::Lent);

    // The first failure ends the waiting, not only an open port.
    let service = crate::start_absent();
    let end = service.raw("main", read(), RawTerms::default()).await;
    assert_eq!(end.unwrap_err(), CommandError::Line(Fault::Closed));
}

#[tokio::test]
async fn a_frame_of_ones_own_is_written_down_and_its_module_read_anew() {
    let (service, boards) = site(LOCK).await;
    switch(&service, "yard", 1, true).await.unwrap();
    // It goes past what excludes it: that is what it is asked for.
    let met = send(&service, frame(3, 1, true)).await.unwrap();
    assert_eq!((met, boards.relays(3)), (Probed::Answered, 1));
    let known = service.point("oven", k(1)).unwrap();
    assert_eq!(
        (known.value, known.quality),
        (Some(PointValue::Bool(true)), PointQuality::Good)
    );
    let entry = service.audit().pop().unwrap();
    assert_eq!(
        (&*entry.module, &*entry.what, entry.end.map(End::name)),
        ("oven", "send it", Some("reply"))
    );
    // What it did is not forgotten: nothing that it excludes goes on.
    switch(&service, "yard", 1, false).await.unwrap();
    let refused = switch(&service, "yard", 1, true).await;
    assert!(
        matches!(refused, Err(CommandError::Interlock { .. })),
        "{refused:?}"
    );
    // A broadcast is for both, and answered by none.
    let met = send(&service, frame(0, 1, false)).await.unwrap();
    assert_eq!((met, boards.relays(3)), (Probed::Silent, 0));
    let entry = service.audit().pop().unwrap();
    assert_eq!((&*entry.module, entry.end), ("", Some(End::Sent)));
    let good = |module| service.point(module, k(1)).unwrap().quality == PointQuality::Good;
    until(|| good("oven") && good("yard")).await;
    service.close().await;
}

#[tokio::test]
async fn a_module_that_does_not_answer_may_have_obeyed() {
    let (service, boards) = site(LOCK).await;
    boards.mute(3, true);
    let met = send(&service, frame(3, 1, true)).await.unwrap();
    assert_eq!(met, Probed::Silent);
    let entry = service.audit().pop().unwrap();
    assert_eq!(entry.end, Some(End::unsure("no_reply")));
    // What was known of it before does not count any more, though it is not offline yet.
    assert_ne!(
        service.point("oven", k(1)).unwrap().quality,
        PointQuality::Good
    );
    let refused = switch(&service, "yard", 1, true).await;
    assert!(
        matches!(refused, Err(CommandError::Interlock { .. })),
        "{refused:?}"
    );
    boards.mute(3, false);
    until(|| service.point("oven", k(1)).unwrap().quality == PointQuality::Good).await;
    switch(&service, "yard", 1, true).await.unwrap();
    service.close().await;
}

#[tokio::test]
async fn an_output_that_may_have_gone_off_stays_off_for_its_time() {
    let (service, boards) = site("[module.oven.point.k2]\nmin_off = \"1h\"\n").await;
    boards.set(3, 0b10);
    until(|| service.point("oven", k(2)).unwrap().value == Some(PointValue::Bool(true))).await;
    send(&service, frame(3, 2, false)).await.unwrap();
    assert_eq!(boards.relays(3), 0);
    let refused = switch(&service, "oven", 2, true).await;
    assert!(
        matches!(refused, Err(CommandError::MinOff { .. })),
        "{refused:?}"
    );
    service.close().await;
}

/// Two boards, of which that at address 4 answers late: right before the other one, whose relays
/// are asked for by a frame of one's own.
#[tokio::test]
async fn the_late_reply_of_another_module_is_no_part_of_the_reply() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let port = format!("tcp:{}", listener.local_addr().unwrap());
    let [is_slow, has_kept] = [(); 2].map(|()| Arc::new(AtomicBool::new(false)));
    let (slow, kept) = (Arc::clone(&is_slow), Arc::clone(&has_kept));
    tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.unwrap();
        let (mut request, mut late) = ([0; 64], Vec::new());
        while let Ok(8..) = stream.read(&mut request).await {
            let mut reply = vec![request[0], 1, 1, request[0]];
            reply.extend(crc16(&reply).to_le_bytes());
            if request[0] == 4 && slow.load(Ordering::SeqCst) {
                late = reply;
                kept.store(true, Ordering::SeqCst);
                continue;
            }
            late.extend(reply);
            stream.write_all(&std::mem::take(&mut late)).await.unwrap();
        }
    });
    let text = crate::safety::text(&port, "").replace("address", "poll = \"50ms\"\naddress");
    let text = text.replacen("50ms", "1h", 1);
    let service = Service::start(railbus_site::Config::parse(&text).unwrap()).unwrap();
    service.opened("main").await.unwrap();
    let good = || service.point("yard", k(1)).unwrap().quality == PointQuality::Good;
    until(good).await;
    is_slow.store(true, Ordering::SeqCst);
    until(|| has_kept.load(Ordering::SeqCst)).await;
    let coils = rtu::BitSpan::new(60, 8).unwrap();
    let asked = Exchange::rtu(Address(3), rtu::Request::ReadCoils(coils));
    let met = service
        .raw("main", asked, RawTerms::default())
        .await
        .unwrap();
    assert_eq!(met.outcome, Probed::Answered);
    assert_eq!(met.bytes.len(), 12, "both were heard: {:02X?}", met.bytes);
    let own = met.reply(&asked).unwrap();
    assert_eq!(own[..4], [3, 1, 1, 3]);
    service.close().await;
}
