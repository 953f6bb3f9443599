//! What lets a site in once: where the servers are, whom to trust, and a key that can do nothing
//! but ask for the key of this site.

use crate::creds::{CredsError, read_site_creds};
use crate::founding::NodeAddress;

/// The most bytes of an invitation.
pub const INVITATION_MAX: usize = 16 << 10;
/// The most servers that it names.
const SERVERS_MAX: usize = 16;
/// How the line with the servers begins.
const SERVERS: &str = "servers:";
const CA_BEGIN: &str = "-----BEGIN CERTIFICATE-----";
/// What the last line has.
const CREDS_END: &str = "END USER NKEY SEED";
const CA_END: &str = "-----END CERTIFICATE-----";

/// An invitation. The first one who uses it gets the key of its site.
#[derive(Clone, PartialEq, Eq)]
pub struct Invitation {
    /// The site.
    pub site: String,
    /// Its servers.
    pub servers: Vec<NodeAddress>,
    /// The certificate of the fleet's authority, as PEM.
    pub ca: String,
    /// The credentials with which the key is asked for.
    pub creds: String,
}

/// Without its key.
impl std::fmt::Debug for Invitation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Invitation")
            .field("site", &self.site)
            .finish_non_exhaustive()
    }
}

/// What is wrong with an invitation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InvitationError {
    /// It has too many bytes.
    Long,
    /// The line with the servers is missing, or one can't be a server.
    Servers,
    /// There is no certificate of the fleet.
    Ca,
    /// There are no credentials.
    Creds,
}

impl std::fmt::Display for InvitationError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            InvitationError::Long => "it is longer than an invitation",
            InvitationError::Servers => "the line with the servers is missing or cut off",
            InvitationError::Ca => "the certificate is missing or cut off",
            InvitationError::Creds => "the key is missing or cut off",
        })
    }
}

impl std::error::Error for InvitationError {}

impl From<CredsError> for InvitationError {
    fn from(_: CredsError) -> InvitationError {
        InvitationError::Creds
    }
}

impl Invitation {
    /// As a text, which can be a file or be pasted.
    #[must_use]
    pub fn text(&self) -> String {
        let servers: Vec<String> = self.servers.iter().map(ToString::to_string).collect();
        let (site, ca, creds) = (&self.site, self.ca.trim(), self.creds.trim());
        format!(
            "railbus invitation of {site}\n{SERVERS} {}\n{ca}\n{creds}\n",
            servers.join(" ")
        )
    }

    /// Reads one.
    ///
    /// # Errors
    /// [`InvitationError`].
    pub fn parse(text: &str) -> Result<Invitation, InvitationError> {
        if text.len() > INVITATION_MAX {
            return Err(InvitationError::Long);
        }
        // Mail and forms change the ends of lines.
        let lines: Vec<&str> = text.lines().map(str::trim).collect();
        let servers = lines.iter().find_map(|line| line.strip_prefix(SERVERS));
        let servers = servers.map(|list| list.split_whitespace().map(NodeAddress::parse).collect());
        let servers: Option<Vec<NodeAddress>> = servers.flatten();
        let servers = servers.filter(|servers| (1..=SERVERS_MAX).contains(&servers.len()));
        let place = |wanted: &str| lines.iter().position(|line| *line == wanted);
        let ca = match (place(CA_BEGIN), place(CA_END)) {
            (Some(begin), Some(end)) => lines.get(begin..=end),
            _ => None,
        };
        let ca = ca.ok_or(InvitationError::Ca)?.join("\n") + "\n";
        let containing = |wanted| lines.iter().position(|line: &&str| line.contains(wanted));
        let creds = match (containing("USER JWT"), containing(CREDS_END)) {
            (Some(begin), Some(end)) => lines.get(begin..=end),
            _ => None,
        };
        let creds = creds.ok_or(InvitationError::Creds)?.join("\n") + "\n";
        let claims = read_site_creds(&creds)?;
        // Not of the certificate: a line of it may begin as a seed does.
        let seed = creds.lines().find(|line| line.starts_with("SU"));
        let seed = seed.and_then(|seed| nkeys::KeyPair::from_seed(seed).ok());
        if seed.is_none_or(|seed| seed.public_key() != claims.key) {
            return Err(InvitationError::Creds);
        }
        Ok(Invitation {
            site: claims.site,
            servers: servers.ok_or(InvitationError::Servers)?,
            ca,
            creds,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::creds::SiteSigner;
    use nkeys::KeyPair;

    fn invitation() -> Invitation {
        let signing = KeyPair::new_account().seed().unwrap();
        let signer = SiteSigner::new(&signing, &KeyPair::new_account().public_key()).unwrap();
        Invitation {
            site: "plant7".to_owned(),
            servers: ["nats1", "10.0.0.7:4333"]
                .map(|server| NodeAddress::parse(server).unwrap())
                .to_vec(),
            // Base 64 has such lines, too.
            ca: format!("{CA_BEGIN}\neyJ0\nSUrfPmU0\nMIIB\n{CA_END}\n"),
            creds: signer.creds("plant7", 7, 100).unwrap(),
        }
    }

    #[test]
    fn what_is_written_is_read_also_with_other_ends_of_lines() {
        let own = invitation();
        let text = own.text();
        assert!(
            text.len() < 4_096,
            "a terminal takes no longer line: {}",
            text.len()
        );
        let read = |text: &str| {
            let read = Invitation::parse(text).unwrap();
            assert_eq!(read.site, own.site);
            assert_eq!((&read.servers, &read.ca), (&own.servers, &own.ca));
            assert_eq!(read_site_creds(&read.creds), read_site_creds(&own.creds));
        };
        read(&text);
        read(&text.replace('\n', "\r\n"));
        read(&format!("\n\n  {}\n\n", text.replace('\n', "\n  ")));
        assert!(!format!("{own:?}").contains("SU"), "{own:?}");
    }

    #[test]
    fn what_was_cut_off_is_told() {
        let own = invitation();
        let text = own.text();
        let mut found = Vec::new();
        for (end, _) in text.char_indices() {
            // All that is read is whole.
            match Invitation::parse(&text[..end]) {
                Ok(_) => assert_eq!(text[end..].trim_end_matches(['-', '\n']), ""),
                Err(error) => found.push(error),
            }
        }
        found.dedup();
        assert_eq!(found, [InvitationError::Ca, InvitationError::Creds]);
        let without = text.replace(SERVERS, "");
        assert_eq!(Invitation::parse(&without), Err(InvitationError::Servers));
        let wrong = text.replace("nats1:4222", "nats1:");
        assert_eq!(Invitation::parse(&wrong), Err(InvitationError::Servers));
        let other = invitation();
        let seed = |of: &Invitation| {
            let seed = of.creds.lines().find(|line| line.starts_with("SU"));
            seed.unwrap().to_owned()
        };
        let mixed = text.replace(&seed(&own), &seed(&other));
        assert_eq!(Invitation::parse(&mixed), Err(InvitationError::Creds));
        let long = text + &" ".repeat(INVITATION_MAX);
        assert_eq!(Invitation::parse(&long), Err(InvitationError::Long));
    }
}
