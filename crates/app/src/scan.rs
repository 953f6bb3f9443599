//! Parameters, driver and results of a scan, for the command line and the gateway.

use railbus_commission::scan::{
    Answer, FoundModule, ProbeOutcome, ScanProbe, ScanStep, Scanner, Verdict,
};
use railbus_device::{Family, Setup};
use railbus_host::{Probe, ProbeResult};
use railbus_wire::{Frame, Instant, Protocol};
use railbus_words::hex;
use std::ops::ControlFlow;
use std::pin::pin;
use std::time::Duration;

/// A request that takes this long waits for a silence that never comes.
const UNSENT_MAX: Duration = Duration::from_secs(10);

/// How a scan ended: `S` is why its caller stopped it, `F` why a request could not be sent.
#[derive(Debug)]
pub enum ScanEnd<S, F> {
    /// Everything was asked.
    Complete,
    /// The line is never silent.
    Noise,
    /// Its caller stopped it.
    Stopped(S),
    /// A request could not be sent.
    Failed(F),
}

/// Drives a scan to its end, or until `stop` resolves. Before each request, and when a module was
/// found or more is known about it, `see` gets the scanner; with the module's index in
/// [`Scanner::found`] if it is about a module.
pub async fn drive<S, F, P>(
    scanner: &mut Scanner,
    mut probe: impl FnMut(Probe) -> P,
    stop: impl Future<Output = S>,
    mut see: impl FnMut(&Scanner, Option<usize>) -> ControlFlow<S>,
) -> ScanEnd<S, F>
where
    P: Future<Output = Result<ProbeOutcome, F>>,
{
    let start = tokio::time::Instant::now();
    let now = || Instant(u64::try_from(start.elapsed().as_micros()).unwrap_or(u64::MAX));
    let mut stop = pin!(stop);
    loop {
        let (asks, found) = match scanner.next(now()) {
            ScanStep::Done if scanner.is_noisy() => return ScanEnd::Noise,
            ScanStep::Done => return ScanEnd::Complete,
            ScanStep::Found(index) => (None, Some(index)),
            ScanStep::Ask(asks) => (Some(asks), None),
        };
        if let ControlFlow::Break(why) = see(scanner, found) {
            return ScanEnd::Stopped(why);
        }
        let Some(asks) = asks else { continue };
        let met = tokio::select! {
            met = probe(asks) => met,
            why = &mut stop => return ScanEnd::Stopped(why),
            // Nothing is sent before the line is silent.
            () = tokio::time::sleep(UNSENT_MAX) => return ScanEnd::Noise,
        };
        match met {
            Ok(met) => scanner.met(now(), met),
            Err(why) => return ScanEnd::Failed(why),
        }
    }
}

/// The result of a line's probe, as a scan takes it.
#[must_use]
pub fn met(result: ProbeResult) -> ProbeOutcome {
    ProbeOutcome {
        outcome: result.outcome,
        bytes: result.bytes,
        after: result.after,
        late: result.late,
    }
}

/// Parses `1-32,0x40`; returns the invalid part.
///
/// # Errors
/// The invalid part.
pub fn addresses(text: &str) -> Result<Vec<u8>, String> {
    let mut all = Vec::new();
    for part in text.split(',') {
        let (low, high) = part.split_once('-').unwrap_or((part, part));
        let (low, high) = (crate::address(low)?, crate::address(high)?);
        if low > high {
            return Err(part.to_owned());
        }
        all.extend(low..=high);
    }
    all.sort_unstable();
    all.dedup();
    Ok(all)
}

/// `1-32,64`
pub fn ranges(addresses: &[u8]) -> String {
    let mut parts: Vec<(u8, u8)> = Vec::new();
    for address in addresses {
        match parts.last_mut() {
            Some((_, last)) if last.checked_add(1) == Some(*address) => *last = *address,
            _ => parts.push((*address, *address)),
        }
    }
    let told = parts.iter().map(|(first, last)| match first == last {
        true => first.to_string(),
        false => format!("{first}-{last}"),
    });
    told.collect::<Vec<_>>().join(",")
}

/// The models it could be, as named in the configuration.
pub fn could_be(found: &FoundModule) -> Vec<&'static str> {
    let families = found.identity.could_be.iter();
    families.map(|family| family.name()).collect()
}

/// Its requests and responses.
pub fn evidence(found: &FoundModule) -> Vec<String> {
    let tried = |bytes: &Vec<u8>| question(found.asked, &(found.asked.ask, bytes.clone()));
    let garbled = found.garbled.iter().map(tried);
    let answers = found.answers.iter();
    let answers = answers.map(|answer| question(found.asked, answer));
    garbled.chain(answers).collect()
}

/// A request and its response.
fn question(asked: ScanProbe, (ask, bytes): &Answer) -> String {
    let mut frame = Frame::new();
    if let Some(exchange) = asked.with(*ask).exchange() {
        exchange.encode(&mut frame);
    }
    let text = |bytes: &[u8]| match ask.protocol() {
        _ if bytes.is_empty() => "–".to_owned(),
        Protocol::Ascii => String::from_utf8_lossy(bytes).trim_end().to_owned(),
        _ => hex::spaced(bytes),
    };
    format!("{} → {}", text(frame.bytes()), text(bytes))
}

/// Its entry in the configuration. If it could be several models, it is the one the user names, if
/// that is among them.
pub fn setup(found: &FoundModule, model: Option<Family>) -> Option<Setup> {
    let identity = &found.identity;
    let family = match found.verdict() {
        Verdict::Ok => identity.family,
        Verdict::CouldBe => model.filter(|model| identity.could_be.contains(model)),
        Verdict::Refused | Verdict::Odd | Verdict::Garbled => None,
    };
    let family = family?;
    let setup = Setup {
        protocol: found.protocol(),
        serial: found.asked.settings,
        checksum: found.checksum().unwrap_or_default(),
        ..Setup::new(family, found.asked.address)
    };
    setup.check().is_ok().then_some(setup)
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_commission::scan::{ScanOptions, Scope};
    use railbus_host::Probed;
    use railbus_wire::Micros;
    use std::future::pending;

    #[test]
    fn addresses_are_read_as_ranges() {
        assert_eq!(addresses("1-3,0x40,2"), Ok(vec![1, 2, 3, 64]));
        for wrong in ["", "3-1", "1-", "256", "x"] {
            assert!(addresses(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn addresses_in_a_row_are_told_as_ranges() {
        assert_eq!(ranges(&[1, 2, 3, 7, 254, 255]), "1-3,7,254-255");
        assert_eq!(ranges(&[]), "");
    }

    /// A scan of four addresses, which ends when `stop` does; how often a request was made.
    async fn scanned<P: Future<Output = Result<ProbeOutcome, &'static str>>>(
        probe: impl Fn(Probe) -> P,
        stop: impl Future<Output = &'static str>,
    ) -> (ScanEnd<&'static str, &'static str>, usize) {
        let wish = ScanOptions {
            addresses: Some(vec![1, 2, 3, 4]),
            ..ScanOptions::default()
        };
        let mut scanner = Scanner::new(Scope::of(&wish, Vec::new()));
        let mut asked = 0;
        let see = |_: &Scanner, found: Option<usize>| {
            asked += usize::from(found.is_none());
            ControlFlow::Continue(())
        };
        let end = drive(&mut scanner, probe, stop, see).await;
        (end, asked)
    }

    async fn silence() -> Result<ProbeOutcome, &'static str> {
        tokio::time::sleep(Duration::from_millis(30)).await;
        Ok(ProbeOutcome {
            outcome: Probed::Silent,
            bytes: Vec::new(),
            after: Micros::ZERO,
            late: Vec::new(),
        })
    }

    #[tokio::test(start_paused = true)]
    async fn a_scan_is_driven_to_its_end() {
        let (end, asked) = scanned(|_| silence(), pending()).await;
        assert!(matches!(end, ScanEnd::Complete), "{end:?}");
        assert!(asked >= 4, "{asked}");
    }

    /// A request that waits for a silence that never comes ends the scan, and so does its caller,
    /// and a line that fails.
    #[tokio::test(start_paused = true)]
    async fn a_scan_ends_early() {
        let start = tokio::time::Instant::now();
        let (end, _) = scanned(|_| pending(), pending()).await;
        assert!(matches!(end, ScanEnd::Noise), "{end:?}");
        assert_eq!(start.elapsed(), UNSENT_MAX);
        let stop = async {
            tokio::time::sleep(Duration::from_millis(45)).await;
            "stopped"
        };
        let (end, asked) = scanned(|_| silence(), stop).await;
        assert!(matches!(end, ScanEnd::Stopped("stopped")), "{end:?}");
        assert_eq!(asked, 2);
        let (end, asked) = scanned(|_| async { Err("closed") }, pending()).await;
        assert!(matches!(end, ScanEnd::Failed("closed")), "{end:?}");
        assert_eq!(asked, 1);
    }
}
