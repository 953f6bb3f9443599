//! When a certificate expires: the only field that is parsed here.

use jiff::Timestamp;
use jiff::civil::DateTime;
use jiff::tz::TimeZone;

/// Tags of ASN.1.
const VERSION: u8 = 0xA0;
const UTC_TIME: u8 = 0x17;
const GENERALIZED_TIME: u8 = 0x18;
/// Two digits of a year mean 1950 to 2049, as RFC 5280 has it.
const PIVOT: u32 = 50;

/// The end of a certificate's validity, as encoded in RFC 5280; none if it can't be found.
pub(super) fn not_after(der: &[u8]) -> Option<Timestamp> {
    let (_, certificate, _) = take(der)?;
    let (_, mut rest, _) = take(certificate)?;
    if let (VERSION, _, behind) = take(rest)? {
        rest = behind;
    }
    // Serial number, algorithm and issuer precede it.
    for _ in 0..3 {
        (_, _, rest) = take(rest)?;
    }
    let (_, validity, _) = take(rest)?;
    let (_, _, end) = take(validity)?;
    let (tag, text, _) = take(end)?;
    time(tag, std::str::from_utf8(text).ok()?)
}

/// Tag and content of the first element, and the rest.
fn take(bytes: &[u8]) -> Option<(u8, &[u8], &[u8])> {
    let (&tag, rest) = bytes.split_first()?;
    let (&first, rest) = rest.split_first()?;
    let (length, rest) = match first {
        0..=0x7F => (usize::from(first), rest),
        0x81..=0x84 => {
            let (digits, rest) = rest.split_at_checked(usize::from(first & 0x7F))?;
            let length = digits
                .iter()
                .fold(0, |sum, digit| sum << 8 | usize::from(*digit));
            (length, rest)
        }
        _ => return None,
    };
    let (content, rest) = rest.split_at_checked(length)?;
    Some((tag, content, rest))
}

fn time(tag: u8, text: &str) -> Option<Timestamp> {
    let text = text.strip_suffix('Z')?;
    let text = match tag {
        GENERALIZED_TIME => text.to_owned(),
        UTC_TIME => {
            let year: u32 = text.get(..2)?.parse().ok()?;
            format!("{}{text}", if year < PIVOT { 20 } else { 19 })
        }
        _ => return None,
    };
    let time = DateTime::strptime("%Y%m%d%H%M%S", text).ok()?;
    Some(time.to_zoned(TimeZone::UTC).ok()?.timestamp())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcgen::{CertificateParams, KeyPair, date_time_ymd};

    #[test]
    fn the_end_of_a_certificate_is_found() {
        for (year, wanted) in [
            (2031, "2031-02-03T00:00:00Z"),
            (2049, "2049-02-03T00:00:00Z"),
            // These have four digits.
            (2050, "2050-02-03T00:00:00Z"),
            (2099, "2099-02-03T00:00:00Z"),
        ] {
            let mut params = CertificateParams::new(vec!["plant.local".to_owned()]).unwrap();
            params.not_after = date_time_ymd(year, 2, 3);
            let cert = params.self_signed(&KeyPair::generate().unwrap()).unwrap();
            assert_eq!(
                not_after(cert.der()),
                Some(wanted.parse().unwrap()),
                "{year}"
            );
            for cut in 0..cert.der().len() {
                assert_eq!(not_after(&cert.der()[..cut]), None, "{cut}");
            }
        }
        assert_eq!(not_after(&[0x30, 0x84, 0xFF, 0xFF, 0xFF, 0xFF]), None);
        assert_eq!(
            time(UTC_TIME, "991231235959Z"),
            "1999-12-31T23:59:59Z".parse().ok()
        );
    }
}
