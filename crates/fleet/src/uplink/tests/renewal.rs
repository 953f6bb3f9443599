//! A key is renewed in time, by the clock of the centre.

use super::*;
use crate::message::{FleetRefusal, KeyAnswer, KeyRequest, KeyResult};

const DAY: u64 = 86_400;
/// What the site's own clock says in these tests, in seconds since 1970.
const SITE_NOW: u64 = 1_700_000_000;
const AGAIN: Duration = Duration::from_secs(60 * 60);

/// What the credentials of the site say.
pub(super) fn claims(issued: u64, expires: u64) -> SiteClaims {
    SiteClaims {
        site: "plant7".to_owned(),
        key: "U".to_owned(),
        issued,
        expires: Some(expires),
        id: String::new(),
    }
}

/// With a session, of a centre with this clock, and a key of 90 days that is so old by then.
fn site(clock_s: u64, age: u64) -> Site {
    let mut site = Site::new();
    let issued = clock_s - age;
    let claims = claims(issued, issued + 90 * DAY);
    site.uplink.set_claims(&claims, "old".to_owned());
    site.handle(UplinkInput::Connected(MESSAGE_MAX));
    let hello = site.published();
    let welcome = Welcome {
        answer: Some(HelloAnswer::Session("s1".to_owned())),
        clock_ms: i64::try_from(clock_s * 1_000).unwrap(),
    };
    site.answer(hello[0].answer.unwrap(), &welcome.encode_to_vec());
    site
}

/// The number of the request for a longer time that is among these; none if there is none.
fn asked(messages: &[UpMessage]) -> Option<u64> {
    let renew = messages
        .iter()
        .find(|message| message.subject.ends_with(".renew"))?;
    assert_eq!(renew.subject, "rb.up.plant7.renew");
    let request = KeyRequest::decode(&*renew.payload).unwrap();
    assert_eq!((&*request.token, &*request.key), ("old", ""));
    renew.answer
}

#[test]
fn it_asks_in_the_last_third_by_the_clock_of_the_centre() {
    // The clock of the site is right, years ahead, or years behind.
    for centre in [SITE_NOW, SITE_NOW - 1_000 * DAY, SITE_NOW + 1_000 * DAY] {
        let mut site = site(centre, 59 * DAY);
        assert_eq!(asked(&site.published()), None);
        site.now += Duration::from_secs(DAY);
        assert_eq!(asked(&site.published()), None);
        site.now += Duration::from_secs(10);
        assert!(asked(&site.published()).is_some());
    }
}

#[test]
fn it_asks_again_every_hour_until_it_has_other_claims() {
    let mut site = site(SITE_NOW, 80 * DAY);
    let number = asked(&site.published()).unwrap();
    site.answer(number, b"\xff");
    let again = |site: &mut Site, wait| {
        site.now += wait;
        asked(&site.published())
    };
    assert_eq!(again(&mut site, AGAIN - BEAT), None);
    let number = again(&mut site, BEAT).unwrap();
    let refusal = FleetRefusal {
        code: "E0939".to_owned(),
        reason: "not now".to_owned(),
    };
    let end = Some(KeyResult::Refusal(refusal));
    site.answer(number, &answer(end));
    let told = UplinkOutput::NotRenewed("not now".to_owned());
    assert!(site.outputs().contains(&told));
    assert_eq!(again(&mut site, BEAT), None);
    let number = again(&mut site, AGAIN).unwrap();
    // An answer to another request is none.
    let end = Some(KeyResult::Token("new".to_owned()));
    let answer = answer(end);
    site.answer(number + 1_000, &answer);
    let is_renewed = |site: &mut Site| {
        site.outputs()
            .contains(&UplinkOutput::Renewed("new".into()))
    };
    assert!(!is_renewed(&mut site));
    site.answer(number, &answer);
    assert!(is_renewed(&mut site));
    let issued = SITE_NOW - DAY;
    site.uplink
        .set_claims(&claims(issued, issued + 90 * DAY), "new".to_owned());
    assert_eq!(again(&mut site, 2 * AGAIN), None);
}

#[test]
fn a_key_that_ends_soon_is_known_by_the_clock_of_the_centre() {
    // The clock of the site is years behind.
    let centre = SITE_NOW + 1_000 * DAY;
    let mut site = site(centre, 60 * DAY);
    let expires = i64::try_from(centre + 30 * DAY).unwrap();
    let clock_ms = i64::try_from(SITE_NOW * 1_000).unwrap();
    let ends = |site: &Site| site.uplink.key_ends(site.now, clock_ms, 21 * DAY);
    assert_eq!(ends(&site), None);
    site.now += Duration::from_secs(9 * DAY + 1);
    assert_eq!(ends(&site), Some(expires));
}

#[test]
fn without_a_session_it_does_not_ask() {
    let mut site = site(SITE_NOW, 80 * DAY);
    site.handle(UplinkInput::Lost);
    assert_eq!(asked(&site.published()), None);
    site.now += AGAIN;
    assert_eq!(asked(&site.published()), None);
}

fn answer(end: Option<KeyResult>) -> Vec<u8> {
    KeyAnswer {
        end,
        config_key: String::new(),
    }
    .encode_to_vec()
}
