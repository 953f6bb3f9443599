//! What sites and servers may be called.

/// The longest name of a site in bytes. It stands in every subject.
const SITE_LEN_MAX: usize = 64;
/// The longest name of a host in bytes (RFC 1035, 2.3.4).
const HOST_LEN_MAX: usize = 253;
/// The longest part of it.
const LABEL_LEN_MAX: usize = 63;

/// Whether a site may have this name: 1 to 64 of `a-z`, `0-9`, `-` and `_`.
///
/// A name is one token of a subject. A dot would make two of it, a star or `>` a pattern, and two
/// names that differ in case only would be taken for one by people.
#[must_use]
pub fn is_site_name(name: &str) -> bool {
    let is_allowed = |letter: u8| matches!(letter, b'a'..=b'z' | b'0'..=b'9' | b'-' | b'_');
    (1..=SITE_LEN_MAX).contains(&name.len()) && name.bytes().all(is_allowed)
}

/// Whether this can be the address of a server: a host name or an IPv4 address.
///
/// It is written into configurations of other programs, and names a folder.
#[must_use]
pub fn is_node_name(name: &str) -> bool {
    let is_label = |label: &str| {
        let is_allowed = |letter: u8| letter.is_ascii_alphanumeric() || letter == b'-';
        (1..=LABEL_LEN_MAX).contains(&label.len())
            && label.bytes().all(is_allowed)
            && !label.starts_with('-')
            && !label.ends_with('-')
    };
    name.len() <= HOST_LEN_MAX && name.split('.').all(is_label)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_site_is_one_token_of_a_subject() {
        let longest = "a".repeat(SITE_LEN_MAX);
        for good in ["p", "plant7", "plant-7", "7_b", &longest] {
            assert!(is_site_name(good), "{good}");
        }
        let longer = "a".repeat(SITE_LEN_MAX + 1);
        let bad = [
            "", "a.b", "*", ">", "a b", "a\n", "Plant", "\u{e9}", "a/b", "$SYS", &longer,
        ];
        for bad in bad {
            assert!(!is_site_name(bad), "{bad}");
        }
    }

    #[test]
    fn a_server_has_a_host_name() {
        for good in [
            "nats1",
            "nats1.plant.example",
            "10.0.0.7",
            "N-1",
            "127.0.0.1",
        ] {
            assert!(is_node_name(good), "{good}");
        }
        let label = "a".repeat(LABEL_LEN_MAX + 1);
        let name = ["a"; 128].join(".");
        let bad = [
            "", ".", "a..b", "a.", "-a", "a-", "a_b", "a:1", "../a", "a b", "a\"", "::1", &label,
            &name,
        ];
        for bad in bad {
            assert!(!is_node_name(bad), "{bad}");
        }
    }
}
