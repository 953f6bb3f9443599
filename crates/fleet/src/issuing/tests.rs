//! Who gets a key, and who does not.

use super::*;
use crate::creds::{read_site_creds, site_token};
use crate::dice::Dice;
use nkeys::KeyPair;

const NOW: u64 = 1_800_000_000;
const DAY: u64 = 86_400;

/// A centre, with the document of each site as it would be stored.
struct Hub {
    signers: Signers,
    document: Option<Vec<u8>>,
}

/// Credentials: the signed claims and the public key.
struct Own {
    token: String,
    key: String,
}

fn own(signer: &SiteSigner, site: &str, now: u64) -> Own {
    let creds = signer.creds(site, now, DAY).unwrap();
    Own {
        token: site_token(&creds).unwrap().to_owned(),
        key: read_site_creds(&creds).unwrap().key,
    }
}

fn new_key() -> String {
    KeyPair::new_user().public_key()
}

impl Hub {
    fn new() -> Hub {
        let account = KeyPair::new_account().public_key();
        let signer = || SiteSigner::new(&KeyPair::new_account().seed().unwrap(), &account);
        Hub {
            signers: Signers {
                sites: signer().unwrap(),
                invitations: Some(signer().unwrap()),
                config_key: "VKEY".to_owned(),
            },
            document: None,
        }
    }

    /// What comes of a request: what the claims say, or why there are none.
    fn ask(
        &mut self,
        kind: KeyRequestKind,
        site: &str,
        (token, key): (&str, &str),
        now: u64,
    ) -> Result<SiteClaims, String> {
        let request = KeyRequest {
            token: token.to_owned(),
            key: key.to_owned(),
        };
        let request = request.encode_to_vec();
        let granted = verify(&self.signers, kind, site, &request, now)
            .and_then(|wanted| wanted.grant(&self.signers, self.document.as_deref(), now));
        let (document, answer) = granted.map_err(|refusal| refusal.reason)?;
        self.document = Some(document);
        let answer = KeyAnswer::decode(&*answer).unwrap();
        assert_eq!(answer.config_key, "VKEY");
        let Some(KeyResult::Token(token)) = answer.end else {
            panic!("{answer:?}");
        };
        Ok(self.signers.sites.verified(&token, now).unwrap())
    }

    fn join(&mut self, by: &Own, key: &str, now: u64) -> Result<SiteClaims, String> {
        self.ask(KeyRequestKind::Join, "plant7", (&by.token, key), now)
    }

    fn renew(&mut self, by: &Own, now: u64) -> Result<SiteClaims, String> {
        self.ask(KeyRequestKind::Renew, "plant7", (&by.token, ""), now)
    }

    fn invitations(&self) -> &SiteSigner {
        self.signers.invitations.as_ref().unwrap()
    }

    fn invitation(&self, now: u64) -> Own {
        own(self.invitations(), "plant7", now)
    }

    fn revoke(&mut self, others: &[(String, u64)], now: u64) -> Vec<String> {
        let (document, keys) = revoke_noted(self.document.as_deref(), others, now).unwrap();
        self.document = Some(document);
        keys.into_iter().map(|issued| issued.key).collect()
    }
}

#[test]
fn an_invitation_counts_once_and_for_the_key_that_came_first() {
    let mut hub = Hub::new();
    let (invitation, key) = (hub.invitation(NOW), new_key());
    let claims = hub.join(&invitation, &key, NOW + 5).unwrap();
    assert_eq!((&*claims.site, &claims.key), ("plant7", &key));
    assert_eq!(claims.expires, Some(NOW + 5 + SITE_VALID_S));
    // The answer was lost.
    assert_eq!(hub.join(&invitation, &key, NOW + 9).unwrap().key, key);
    let used = Err("it was used before".to_owned());
    assert_eq!(hub.join(&invitation, &new_key(), NOW + 10), used);
    // Also once the key it was used for was revoked.
    let all = hub.revoke(&[], NOW + 11);
    assert_eq!(all, std::slice::from_ref(&key));
    let revoked = Err("the key was revoked".to_owned());
    assert_eq!(hub.join(&invitation, &key, NOW + 12), revoked);
    assert!(hub.join(&invitation, &new_key(), NOW + 12).is_err());
}

#[test]
fn an_invitation_is_none_that_is_old_revoked_of_another_site_or_no_invitation() {
    let mut hub = Hub::new();
    let key = new_key();
    let not_signed = Err("it has expired, or is not of this fleet and site".to_owned());
    let invitation = hub.invitation(NOW);
    assert_eq!(hub.join(&invitation, &key, NOW + DAY), not_signed);
    let other = own(hub.invitations(), "plant8", NOW);
    assert_eq!(hub.join(&other, &key, NOW), not_signed);
    // Of a site, or of another fleet.
    let site = own(&hub.signers.sites, "plant7", NOW);
    assert_eq!(hub.join(&site, &key, NOW), not_signed);
    let foreign = Hub::new().invitation(NOW);
    assert_eq!(hub.join(&foreign, &key, NOW), not_signed);
    // An unused invitation that was made before a revocation.
    hub.revoke(&[], NOW + 1);
    let revoked = Err("the keys of this site were revoked since".to_owned());
    assert_eq!(hub.join(&invitation, &key, NOW + 2), revoked);
    let same_second = hub.invitation(NOW + 1);
    assert_eq!(hub.join(&same_second, &key, NOW + 2), revoked);
    let later = hub.invitation(NOW + 2);
    assert!(hub.join(&later, &key, NOW + 2).is_ok());
    // What is no key of a site.
    for wrong in ["", "U", &KeyPair::new_account().public_key()] {
        let invitation = hub.invitation(NOW + 3);
        assert!(hub.join(&invitation, wrong, NOW + 3).is_err(), "{wrong}");
    }
}

#[test]
fn a_key_is_renewed_for_itself_only_and_not_once_it_was_revoked() {
    let mut hub = Hub::new();
    let made = own(&hub.signers.sites, "plant7", NOW);
    let renewed = hub
        .ask(
            KeyRequestKind::Renew,
            "plant7",
            (&made.token, &new_key()),
            NOW + 7,
        )
        .unwrap();
    assert_eq!(renewed.key, made.key);
    assert_eq!(renewed.expires, Some(NOW + 7 + SITE_VALID_S));
    // By what has expired, by an invitation, or by what another site has.
    assert!(hub.renew(&made, NOW + DAY).is_err());
    let invitation = hub.invitation(NOW);
    assert!(hub.renew(&invitation, NOW).is_err());
    let other = own(&hub.signers.sites, "plant8", NOW);
    assert!(hub.renew(&other, NOW).is_err());
    // One that was made by hand, and never renewed, is known to whoever revokes it.
    let by_hand = own(&hub.signers.sites, "plant7", NOW);
    let noted = [(by_hand.key.clone(), NOW + DAY)];
    let mut all = hub.revoke(&noted, NOW + 8);
    all.sort();
    let mut expected = [made.key.clone(), by_hand.key.clone()];
    expected.sort();
    assert_eq!(all, expected);
    let revoked = Err("the key was revoked".to_owned());
    assert_eq!(hub.renew(&made, NOW + 9), revoked);
    assert_eq!(hub.renew(&by_hand, NOW + 9), revoked);
    // Nor is one that nobody noted: it was signed before.
    let elsewhere = own(&hub.signers.sites, "plant7", NOW + 8);
    let since = Err("the keys of this site were revoked since".to_owned());
    assert_eq!(hub.renew(&elsewhere, NOW + 9), since);
    let later = own(&hub.signers.sites, "plant7", NOW + 9);
    assert!(hub.renew(&later, NOW + 9).is_ok());
}

#[test]
fn a_centre_whose_clock_is_wrong_does_no_harm() {
    let mut hub = Hub::new();
    let made = own(&hub.signers.sites, "plant7", NOW);
    let behind = Err("the clock of the centre is behind".to_owned());
    assert_eq!(hub.renew(&made, NOW - BEHIND_MAX_S - 1), behind);
    assert!(hub.renew(&made, NOW - BEHIND_MAX_S).is_ok());
    hub.renew(&made, NOW + 7).unwrap();
    hub.renew(&made, NOW).unwrap();
    let known = SiteKeys::decode(hub.document.as_deref().unwrap()).unwrap();
    assert_eq!(known.keys[0].until_s, NOW + 7 + SITE_VALID_S);
    // Revoked by one whose clock is right, then by one whose clock is behind.
    hub.revoke(&[], NOW + 100);
    hub.revoke(&[], NOW + 50);
    let before = hub.invitation(NOW + 60);
    assert!(hub.join(&before, &new_key(), NOW + 101).is_err());
    // Made by a clock that is ahead of the centre's: what is issued for it can be renewed, too.
    hub.revoke(&[], NOW + 340);
    let (ahead, key) = (hub.invitation(NOW + 345), new_key());
    let claims = hub.join(&ahead, &key, NOW + 110).unwrap();
    assert_eq!(claims.issued, NOW + 345);
    // One that was a year ahead is repaired by one that is right.
    hub.revoke(&[], NOW + 365 * DAY);
    hub.revoke(&[], NOW + 400);
    let later = hub.invitation(NOW + 401);
    assert!(hub.join(&later, &new_key(), NOW + 401).is_ok());
}

#[test]
fn a_fleet_without_invitations_renews_keys_all_the_same() {
    let mut hub = Hub::new();
    let (made, invitation) = (own(&hub.signers.sites, "plant7", NOW), hub.invitation(NOW));
    hub.signers.invitations = None;
    assert!(hub.renew(&made, NOW + 1).is_ok());
    let none = Err("the centre has no key to sign with".to_owned());
    assert_eq!(hub.join(&invitation, &new_key(), NOW + 1), none);
}

/// One step of a process that reads the document of a site, changes it, and stores it if it has not
/// changed meanwhile.
enum Step {
    Read,
    /// Stores what it made of the document with this revision.
    Store(usize, Vec<u8>, Outcome),
}

/// What a process has once its document is stored.
enum Outcome {
    Issued(String),
    Revoked(Vec<String>),
}

/// Joins at two processes of the centre and a revocation, their steps in any order: a key that was
/// handed out is one that the revocation knows, or its invitation is later than the revocation.
#[test]
fn whatever_comes_between_two_steps_a_revocation_knows_every_earlier_key() {
    let hub = Hub::new();
    let invitations: Vec<Own> = (0..2).map(|_| hub.invitation(NOW)).collect();
    let later = hub.invitation(NOW + 2);
    let keys: Vec<String> = (0..4).map(|_| new_key()).collect();
    // Process, invitation and key: two contend for one invitation.
    let joins = [
        (&invitations[0], &keys[0]),
        (&invitations[0], &keys[1]),
        (&invitations[1], &keys[2]),
        (&later, &keys[3]),
    ];
    let (mut issued_before, mut issued_later) = (0, 0);
    for seed in 0..60 {
        let mut dice = Dice(seed * 7_919);
        // Each version of the document; the last one is the latest.
        let mut versions: Vec<Option<Vec<u8>>> = vec![None];
        let mut steps: Vec<Option<Step>> = (0..=joins.len()).map(|_| Some(Step::Read)).collect();
        let (mut issued, mut revoked) = (Vec::new(), None);
        while steps.iter().any(Option::is_some) {
            let at = usize::try_from(dice.roll(steps.len() as u64)).unwrap();
            let Some(step) = steps[at].take() else {
                continue;
            };
            match step {
                Step::Read => {
                    let latest = versions.last().unwrap().as_deref();
                    let made = match joins.get(at) {
                        Some((by, key)) => {
                            let request = KeyRequest {
                                token: by.token.clone(),
                                key: (*key).clone(),
                            };
                            let request = request.encode_to_vec();
                            let kind = KeyRequestKind::Join;
                            let now = NOW + 3;
                            let verified = verify(&hub.signers, kind, "plant7", &request, now);
                            let granted = verified.unwrap().grant(&hub.signers, latest, now);
                            let granted = granted.ok();
                            granted.map(|(document, _)| (document, Outcome::Issued((*key).clone())))
                        }
                        None => {
                            let (document, keys) = revoke_noted(latest, &[], NOW + 1).unwrap();
                            let keys = keys.into_iter().map(|issued| issued.key).collect();
                            Some((document, Outcome::Revoked(keys)))
                        }
                    };
                    let revision = versions.len();
                    steps[at] =
                        made.map(|(document, outcome)| Step::Store(revision, document, outcome));
                }
                Step::Store(revision, ..) if revision != versions.len() => {
                    steps[at] = Some(Step::Read);
                }
                Step::Store(_, document, outcome) => {
                    versions.push(Some(document));
                    match outcome {
                        Outcome::Issued(key) => issued.push(key),
                        Outcome::Revoked(keys) => revoked = Some(keys),
                    }
                }
            }
        }
        let revoked = revoked.unwrap();
        for key in &issued {
            assert!(
                revoked.contains(key) || key == &keys[3],
                "seed {seed}: {key}"
            );
        }
        let both = issued.contains(&keys[0]) && issued.contains(&keys[1]);
        assert!(!both, "seed {seed}: one invitation was used twice");
        issued_before += issued.iter().filter(|key| **key != keys[3]).count();
        issued_later += usize::from(issued.contains(&keys[3]) && !revoked.contains(&keys[3]));
    }
    // All of it happened.
    assert!(
        issued_before > 10 && issued_later > 10,
        "{issued_before} {issued_later}"
    );
}

#[test]
fn the_document_of_a_site_does_not_grow_for_ever() {
    let mut hub = Hub::new();
    let issued = |at: usize| IssuedKey {
        key: format!("U{at}"),
        until_s: NOW + SITE_VALID_S,
        ..IssuedKey::default()
    };
    let keys = (0..KEYS_MAX).map(issued).collect();
    let full = SiteKeys { keys, revoked_s: 0 };
    hub.document = Some(full.encode_to_vec());
    let invitation = hub.invitation(NOW);
    let full = Err("this site has too many keys".to_owned());
    assert_eq!(hub.join(&invitation, &new_key(), NOW), full);
    // Long after they have expired there is room.
    let later = NOW + SITE_VALID_S + NOTED_AFTER_S;
    let invitation = hub.invitation(later);
    hub.join(&invitation, &new_key(), later).unwrap();
    let known = SiteKeys::decode(hub.document.as_deref().unwrap()).unwrap();
    assert_eq!(known.keys.len(), 1);
}

#[test]
fn what_cannot_be_read_is_refused_and_not_replaced() {
    let mut hub = Hub::new();
    hub.document = Some(vec![0xff]);
    let invitation = hub.invitation(NOW);
    let end = hub.join(&invitation, &new_key(), NOW).unwrap_err();
    assert!(end.starts_with("the noted keys can't be read"), "{end}");
    assert!(revoke_noted(hub.document.as_deref(), &[], NOW).is_err());
    for payload in [&b"\xff"[..], &[0; REQUEST_MAX + 1]] {
        let end = verify(&hub.signers, KeyRequestKind::Join, "plant7", payload, NOW);
        assert_eq!(end.unwrap_err().code, NOT_INVITED);
    }
}
