//! The machinery of outlets, tried with the kind of [`super::textline`].

use super::outlet::Outlet;
use super::stage::{OutletStage, folder};
use super::supervisor::{OutletId, Supervised};
use super::*;
use railbus_api::outlets::OutletState;
use railbus_api::problem::codes;
use railbus_store::audit::Origin;
use std::net::SocketAddr;
use std::path::Path;
use tokio::io::{AsyncBufReadExt as _, AsyncWriteExt as _, BufReader};
use tokio::net::{TcpListener, TcpStream};

/// A site none of whose lines can be opened.
const SITE: &str = "[line.main]\nport = \"/dev/ttyS99\"\n[module.oven]\nline = \"main\"\n\
    model = \"erc8\"\naddress = 3\n[module.pump]\nline = \"main\"\nmodel = \"erc8\"\naddress = 4\n";

fn staged(name: &str, outlets: &str) -> OutletStage {
    OutletStage::running(folder(name), &format!("{SITE}{outlets}"))
}

async fn reload(stage: &OutletStage, outlets: &str) {
    stage.reload(&format!("{SITE}{outlets}")).await;
    stage.changes.send_modify(|count| *count += 1);
}

fn id(name: &str) -> OutletId {
    OutletId {
        kind: "textline",
        name: name.to_owned(),
    }
}

fn look<T>(stage: &OutletStage, name: &str, look: impl FnOnce(&Supervised) -> T) -> Option<T> {
    stage.northbound.look(&id(name), look)
}

/// Waits until an outlet is in this state.
async fn until(stage: &OutletStage, name: &str, state: OutletState) {
    stage
        .until(&id(name), |outlet| outlet.state() == state)
        .await;
}

fn outlet(name: &str, at: SocketAddr, more: &str) -> String {
    let (host, port) = (at.ip(), at.port());
    format!("[outlet.{name}]\ntype = \"textline\"\nhost = \"{host}\"\nport = {port}\n{more}\n")
}

/// The other side of an outlet.
struct Peer(BufReader<TcpStream>);

impl Peer {
    async fn accept(listener: &TcpListener) -> Peer {
        Peer(BufReader::new(listener.accept().await.unwrap().0))
    }

    async fn line(&mut self) -> String {
        let mut line = String::new();
        self.0.read_line(&mut line).await.unwrap();
        line
    }

    /// Reads until the outlet is gone.
    async fn closed(&mut self) {
        while !self.line().await.is_empty() {}
    }

    async fn ask(&mut self, command: &str) -> String {
        let command = format!("{command}\n");
        self.0
            .get_mut()
            .write_all(command.as_bytes())
            .await
            .unwrap();
        loop {
            let line = self.line().await;
            if !line.starts_with("changes") && !line.starts_with("points") {
                return line.trim().to_owned();
            }
        }
    }
}

#[tokio::test]
async fn an_outlet_gets_the_site_with_its_own_rights() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let at = listener.local_addr().unwrap();
    let stage = staged("rights", &outlet("x", at, "write = [\"oven.k1\"]"));
    let mut peer = Peer::accept(&listener).await;
    assert_eq!(peer.line().await, "points 16\n");
    until(&stage, "x", OutletState::Running).await;
    assert_eq!(peer.ask("pump.k1 on").await, "failed not_permitted");
    assert_eq!(peer.ask("oven.k2 on").await, "failed not_permitted");
    let end = peer.ask("oven.k1 on").await;
    assert!(
        end.starts_with("failed ") && !end.ends_with("permitted"),
        "its line is gone: {end}"
    );
    // Without `write` it only reads. Other settings are another run.
    reload(&stage, &outlet("x", at, "")).await;
    let mut peer = Peer::accept(&listener).await;
    assert_eq!(peer.line().await, "points 16\n");
    assert_eq!(peer.ask("oven.k1 on").await, "failed role_too_low");
    stage.northbound.close().await;
    peer.closed().await;
}

#[tokio::test]
async fn one_that_fails_says_why_and_holds_up_no_other() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let at = listener.local_addr().unwrap();
    let nowhere = TcpListener::bind("127.0.0.1:0")
        .await
        .unwrap()
        .local_addr()
        .unwrap();
    let both = |address| [outlet("bad", address, ""), outlet("good", at, "")].concat();
    let stage = staged("fails", &both(nowhere));
    let mut peer = Peer::accept(&listener).await;
    assert_eq!(peer.line().await, "points 16\n");
    until(&stage, "bad", OutletState::Waiting).await;
    let code = look(&stage, "bad", |outlet| {
        outlet.error().map(|error| error.problem.code.clone())
    });
    assert_eq!(code.flatten().as_deref(), Some("E0857"));
    until(&stage, "good", OutletState::Running).await;
    reload(&stage, &both(at)).await;
    let mut mended = Peer::accept(&listener).await;
    assert_eq!(
        mended.line().await,
        "points 16\n",
        "at once, with another address"
    );
    reload(&stage, &outlet("good", at, "enabled = false")).await;
    until(&stage, "good", OutletState::Stopped).await;
    peer.closed().await;
    mended.closed().await;
    assert!(look(&stage, "bad", |_| ()).is_none());
}

fn hang(_: Outlet) -> kind::Work<()> {
    Box::pin(std::future::pending())
}

#[tokio::test]
async fn tests_that_hang_are_bounded_though_their_callers_have_gone() {
    let at = "127.0.0.1:4000".parse().unwrap();
    let stage = staged("hang", &outlet("x", at, "enabled = false"));
    let id = id("x");
    let ask = || stage.northbound.aside(&id, Origin::program("li"), hang);
    for _ in 0..4 {
        let gone = tokio::time::timeout(std::time::Duration::ZERO, ask()).await;
        assert!(gone.is_err());
    }
    assert_eq!(ask().await.unwrap_err().code, codes::OVERLOADED.code);
}

fn until_stopped(outlet: Outlet) -> kind::Work<()> {
    Box::pin(async move { outlet.stopped().await })
}

fn is_to_stop(outlet: Outlet) -> kind::Work<bool> {
    Box::pin(async move {
        let at_once = tokio::time::timeout(std::time::Duration::ZERO, outlet.stopped()).await;
        at_once.is_ok()
    })
}

#[tokio::test]
async fn a_test_is_to_stop_when_its_caller_is_gone_and_not_before() {
    let at = "127.0.0.1:4000".parse().unwrap();
    let stage = staged("gone", &outlet("x", at, "enabled = false"));
    let id = id("x");
    let by = || Origin::program("li");
    for _ in 0..4 {
        let ask = stage.northbound.aside(&id, by(), until_stopped);
        let gone = tokio::time::timeout(std::time::Duration::ZERO, ask).await;
        assert!(gone.is_err());
    }
    let end = loop {
        match stage.northbound.aside(&id, by(), is_to_stop).await {
            Err(problem) if problem.code == codes::OVERLOADED.code => {
                tokio::task::yield_now().await;
            }
            end => break end,
        }
    };
    assert_eq!(end, Ok(false));
}

#[test]
fn a_panic_is_an_end_with_its_reason() {
    let end =
        outlet::on_this_thread(|| -> kind::Work<()> { Box::pin(async { panic!("canary {}", 1) }) });
    assert_eq!(end, Err("panic: canary 1".to_owned()));
}

#[test]
fn what_is_wrong_with_settings_is_told_with_its_place() {
    let told = |text: &str| {
        let text = format!("{SITE}{text}");
        let config = Config::parse(&text).unwrap();
        let lines = SITE.matches('\n').count();
        let each = settings::check(&text, &config).into_iter();
        each.map(|one| (one.line - lines, one.column, one.path, one.kind.code()))
            .collect::<Vec<_>>()
    };
    let at = "127.0.0.1:4000".parse().unwrap();
    assert_eq!(told(&outlet("x", at, "enabled = false\nquiet = true")), []);
    let path = |key: &str| format!("outlet.x.{key}");
    assert_eq!(
        told("[outlet.x]\ntype = \"textlien\"\n"),
        [(2, 1, path("type"), "E0815")]
    );
    assert_eq!(
        told("[outlet.x]\ntype = \"webhook\"\n"),
        [(2, 1, path("type"), "E0815")],
        "it has a table of its own"
    );
    let wrong = "[outlet.x]\ntype = \"textline\"\n  write = [\"a b\"]\nprot = 1\nenabled = 1\n\
        port = 0\n";
    assert_eq!(
        told(wrong),
        [
            (1, 9, path("host"), "E0813"),
            (3, 3, path("write"), "E0821"),
            (4, 1, path("prot"), "E0812"),
            (5, 1, path("enabled"), "E0814"),
            (6, 1, path("port"), "E0816"),
        ]
    );
    let empty = "[outlet.x]\ntype = \"textline\"\nhost = \"\"\n";
    assert_eq!(told(empty), [(3, 1, path("host"), "E0872")]);
    assert_eq!(told(&outlet("x", at, "line = \"main\"")), []);
    let elsewhere = outlet("x", at, "line = \"mian\"");
    assert_eq!(told(&elsewhere), [(5, 1, path("line"), "E0820")]);
}

/// A kind is its folder and its line: what it is called stands in no other file of the gateway.
#[test]
fn a_kind_is_one_folder_and_one_line() {
    let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    let mut folders = vec![sources.clone()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => folders.push(path),
                false => files.push(path),
            }
        }
    }
    let mut more = Vec::new();
    for kind in NORTHBOUND {
        let own = sources.join("northbound").join(kind.name);
        assert!(own.is_dir(), "{}", kind.name);
        let line = [
            format!("mod {};", kind.name),
            format!("&{}::KIND,", kind.name),
            // Only what is older than the routes of all kinds has routes of its own.
            format!(
                "pub(crate) const OF_KINDS: &[Route] = super::{}::routes::ROUTES;",
                kind.name
            ),
        ];
        // The tests name the kind that they try, and ids by others are what they are.
        let tests = sources.join("northbound/tests.rs");
        let ids = sources.join("northbound/sparkplug/requirements.rs");
        // The other end of one kind.
        let centre = sources.join("hub");
        let is_exempt = |path: &Path| {
            let is_centre = path.with_extension("").starts_with(&centre);
            path.starts_with(&own) || path == tests || path == ids || is_centre
        };
        for path in files.iter().filter(|path| !is_exempt(path)) {
            let text = std::fs::read_to_string(path).unwrap();
            // The library of all outlets at a broker has the name of one kind in its own, and what
            // is built only for a kind says so.
            let feature = format!("feature = \"{}\"", kind.name);
            let is_named = |line: &&str| {
                let rest = line.replace("rumqttc", "").replace(&feature, "");
                rest.contains(kind.name)
            };
            let named = text.lines().filter(is_named);
            let named = named.filter(|text| !line.iter().any(|line| line == text.trim()));
            more.extend(named.map(|line| format!("{}: {line}", path.display())));
        }
    }
    assert!(more.is_empty(), "{more:#?}");
}

/// What the recipe in `CONTRIBUTING.md` names is there, for every kind.
#[test]
fn the_recipe_names_the_files_of_a_kind() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let text = std::fs::read_to_string(root.join("CONTRIBUTING.md")).unwrap();
    let (_, recipe) = text
        .split_once("\n## Adding an outlet\n")
        .expect("a recipe");
    let recipe = recipe.split("\n## ").next().unwrap();
    let named = recipe.split('`').skip(1).step_by(2);
    let named: Vec<&str> = named.filter(|word| word.contains('/')).collect();
    let own = "crates/gateway/src/northbound/<kind>/mod.rs";
    let table = "crates/gateway/src/northbound.rs";
    assert!(named.contains(&own) && named.contains(&table), "{named:?}");
    for kind in NORTHBOUND {
        for path in &named {
            let path = root.join(path.replace("<kind>", kind.name));
            assert!(path.is_file(), "{}: {}", kind.name, path.display());
        }
    }
}

/// What the demo has is a valid configuration; an outlet whose port is taken is left out.
#[test]
fn the_demo_has_its_outlets_where_their_ports_are_free() {
    let (text, outlets) = demo_where(|_| true);
    assert!(!outlets.is_empty());
    let text = railbus_plant::demo::text("/dev/ttyS99") + &text;
    let config = Config::parse(&text).unwrap();
    check(Lang::En, "railbus.toml", &text, &config).unwrap();
    assert_eq!(config.outlets.len(), outlets.len());
    for outlet in &outlets {
        assert!(outlet.listen.ip().is_loopback(), "{outlet:?}");
        // Nobody switches anything without asking for it.
        let settings = &config.outlets[outlet.name].settings;
        assert!(!settings.contains_key("write"), "{outlet:?}");
    }
    let (text, outlets) = demo_where(|_| false);
    assert!(text.is_empty() && outlets.is_empty());
}

/// A table that was left out would be a centre's to say.
#[test]
fn every_table_of_outlets_is_a_sites_own() {
    use railbus_site::config::part::OWN_TABLES;
    for kind in NORTHBOUND {
        assert!(OWN_TABLES.contains(&kind.table), "{}", kind.table);
    }
}
