use super::*;
use crate::rights::Here;

const LINE: &str = "[line.main]\nport = \"/dev/ttyS99\"\n";
const OWN: &str = "\n[outlet.hook]\ntype = \"textline\"\nhost = \"127.0.0.1\"\nenabled = false\n";
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
        whole.starts_with(&part) && whole.contains("[outlet.hook]"),
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
    outlet.take_back("hq", (whole, text.clone())).await.unwrap();
    assert_eq!(outlet.read().await.unwrap(), text);
    assert!(!here.site.service.config().modules.contains_key("oven"));
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
            "[line.main]\nport = \"/home/li/modem\"\n",
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
    let is_other = |end: Result<(), NotApplied>| match end {
        Err(NotApplied::Other(text)) => text == other,
        _ => false,
    };
    let before = || LINE.to_owned();
    let checked = outlet.check(BY, before(), String::new()).await;
    assert!(is_other(checked.map(|_| ())));
    assert!(is_other(outlet.apply(BY, (before(), String::new())).await));
    assert!(is_other(
        outlet.take_back("hq", (before(), String::new())).await
    ));
    assert_eq!(here.site.desk.text().await.unwrap(), other);
}
