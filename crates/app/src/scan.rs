//! Parameters and results of a scan, for the command line and the gateway.

use railbus_commission::scan::{Answer, Found, Question, Verdict};
use railbus_device::{Family, Setup};
use railbus_wire::{Frame, Protocol};
use railbus_words::hex;

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
pub fn could_be(found: &Found) -> Vec<&'static str> {
    let families = found.identity.could_be.iter();
    families.map(|family| family.name()).collect()
}

/// Its requests and responses.
pub fn evidence(found: &Found) -> Vec<String> {
    let tried = |bytes: &Vec<u8>| question(found.asked, &(found.asked.ask, bytes.clone()));
    let garbled = found.garbled.iter().map(tried);
    let answers = found.answers.iter();
    let answers = answers.map(|answer| question(found.asked, answer));
    garbled.chain(answers).collect()
}

/// A request and its response.
fn question(asked: Question, (ask, bytes): &Answer) -> String {
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
pub fn setup(found: &Found, model: Option<Family>) -> Option<Setup> {
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
}
