use super::*;
use crate::rights::Here;

const LINE: &str = "[line.main]\nport = \"/dev/ttyS99\"\n";
const OWN: &str = "\n[history]\nkeep = \"9d\"\n";
const BY: (&str, &str) = ("hq", "li");

/// A site whose file has this text, and the end of an outlet.
fn site(name: &str, text: &str) -> (Here, RemoteConfig) {
    let here = Here::with(&format!("part-{name}"), text);
    let (outlet, daemon) = remote_config();
    tokio::spawn(daemon.serve(here.site.clone()));
    (here, outlet)
}

fn code(end: Result<String, NotApplied>) -> String {
    match end {
        Err(NotApplied::Refused(problem)) => problem.code,
        other => format!("{other:?}"),
    }
}

#[tokio::test]
async fn a_part_is_applied_and_the_rest_stays() {
    let text = format!("{LINE}{}", OWN);
    let (here, mut outlet) = site("applied", &text);
    let read = outlet.read().await.unwrap();
    assert_eq!(read, text);
    let part = format!("{LINE}[module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n");
    let whole = outlet.check(BY, read, part.clone()).await.unwrap();
    assert!(
        whole.starts_with(&part) && whole.contains("[history]"),
        "{whole}"
    );
    let change = (text.clone(), whole.clone());
    outlet.apply(BY, change).await.unwrap();
    outlet.changed().await.unwrap();
    assert_eq!(outlet.read().await.unwrap(), whole);
    assert!(here.site.service.config().modules.contains_key("oven"));
    let by = here.site.desk.generations().await.unwrap();
    assert_eq!(by.last().unwrap().who.as_deref(), Some("outlet:hq:li"));
    // And back.
    let back = outlet.take_back("hq", (whole.clone(), text.clone())).await;
    assert_eq!(back.unwrap(), text);
    assert_eq!(outlet.read().await.unwrap(), text);
    assert!(!here.site.service.config().modules.contains_key("oven"));
    // Once.
    let again = outlet.take_back("hq", (whole, text.clone())).await;
    assert!(matches!(again, Err(NotApplied::Other(now)) if now == text));
}

/// What only the site says was changed meanwhile: it stays.
#[tokio::test]
async fn what_the_site_says_stays_where_a_part_is_taken_back() {
    let text = format!("{LINE}{OWN}");
    let (here, outlet) = site("back", &text);
    let part = format!("{LINE}[group.all]\nmembers = []\n");
    let whole = outlet.check(BY, text.clone(), part).await.unwrap();
    outlet
        .apply(BY, (text.clone(), whole.clone()))
        .await
        .unwrap();
    let other = whole.replace("9d", "8d");
    std::fs::write(here.site.desk.file(), &other).unwrap();
    let back = outlet.take_back("hq", (whole, text.clone())).await.unwrap();
    assert_eq!(back, text.replace("9d", "8d"));
    assert_eq!(outlet.read().await.unwrap(), back);
}

/// A file that is gone, was emptied, or was changed and not read yet has not what is in force: a
/// part would leave nothing of what is the site's own.
#[tokio::test]
async fn a_file_that_lost_what_is_in_force_is_not_begun_anew() {
    let text = format!("{LINE}{OWN}");
    let (here, outlet) = site("lost", &text);
    for now in ["", LINE, "[line.main\n"] {
        std::fs::write(here.site.desk.file(), now).unwrap();
        let end = outlet.check(BY, now.to_owned(), LINE.to_owned()).await;
        assert!(matches!(end, Err(NotApplied::Failed(_))), "{now}: {end:?}");
        let end = outlet
            .apply(BY, (now.to_owned(), format!("{LINE}# x\n")))
            .await;
        assert!(matches!(end, Err(NotApplied::Failed(_))), "{now}: {end:?}");
        assert_eq!(here.site.desk.text().await.unwrap(), now);
    }
}

/// Also what was not checked before.
#[tokio::test]
async fn what_is_applied_has_the_permissions_of_an_engineer() {
    let (here, outlet) = site("rights", LINE);
    for (text, refused) in [
        (
            "[line.main]\nport = \"/srv/modem\"\n".to_owned(),
            codes::PORT_NOT_ALLOWED,
        ),
        (format!("{LINE}[audit]\nrequired = true\n"), codes::ROLE),
        ("[line.main]\nport = 7\n".to_owned(), codes::BAD_CONFIG),
    ] {
        let end = outlet.apply(BY, (LINE.to_owned(), text.clone())).await;
        assert_eq!(code(end), refused.code, "{text}");
    }
    assert_eq!(here.site.desk.text().await.unwrap(), LINE);
}

#[tokio::test]
async fn what_an_engineer_may_not_say_is_refused() {
    let (here, outlet) = site("refused", LINE);
    let check = async |part: &str| {
        let end = outlet.check(BY, LINE.to_owned(), part.to_owned()).await;
        code(end)
    };
    let own = "[audit]\nkeep_days = 9\n[ports]\nallow = [\"*\"]\n";
    for (part, refused) in [
        ("[line.main]\nport = 7\n", codes::BAD_CONFIG),
        ("[line.main\n", codes::BAD_CONFIG),
        (own, codes::SITE_OWN),
        (
            "[line.main]\nport = \"/srv/modem\"\n",
            codes::PORT_NOT_ALLOWED,
        ),
    ] {
        assert_eq!(check(part).await, refused.code, "{part}");
    }
    // Nobody has seen what it would do.
    let armed = format!(
        "{LINE}[module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n[rule.night]\n\
         when = {{ point = \"oven.k1\", is = true }}\nthen = [{{ notify = \"night\" }}]\n\
         armed = true\n"
    );
    assert_eq!(check(&armed).await, codes::RULE_NOT_TRIED.code);
    assert_eq!(here.site.desk.text().await.unwrap(), LINE);
}

#[tokio::test]
async fn another_text_than_was_seen_is_left_alone() {
    let (here, outlet) = site("other", LINE);
    let other = format!("{LINE}# By hand.\n");
    std::fs::write(here.site.desk.file(), &other).unwrap();
    let is_other = |end: Result<String, NotApplied>| match end {
        Err(NotApplied::Other(text)) => text == other,
        _ => false,
    };
    let before = || LINE.to_owned();
    let checked = outlet.check(BY, before(), String::new()).await;
    assert!(is_other(checked));
    assert!(is_other(outlet.apply(BY, (before(), String::new())).await));
    let changed = format!("{LINE}[group.all]\nmembers = []\n");
    assert!(is_other(
        outlet.take_back("hq", (changed, String::new())).await
    ));
    assert_eq!(here.site.desk.text().await.unwrap(), other);
}
