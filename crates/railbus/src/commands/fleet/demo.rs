//! `railbus fleet demo`: a whole fleet on this machine: one server, the centre and simulated sites,
//! as processes of their own, until it is stopped.

use super::{FleetText, enrol, init};
use crate::args;
use crate::backend::DaemonClient;
use crate::commands::Context;
use crate::commands::context::hub_socket;
use crate::commands::stop::Stop;
use clap::{ArgMatches, Command, value_parser};
use hyper::Method;
use railbus_api::problem::Problem;
use railbus_app::failure::Failure;
use railbus_app::own_folder::OwnFolder;
use railbus_app::render::{Format, out, records};
use railbus_client::HubClient;
use railbus_fleet::NodeAddress;
use railbus_fleet::founding::found;
use railbus_words::{Code, Lang};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};
use std::fs::File;
use std::net::{Ipv4Addr, TcpListener};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;
use tokio::io::{AsyncBufReadExt as _, BufReader};
use tokio::process::{Child, Command as Program};
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::timeout;

/// The name of the command.
pub(super) const NAME: &str = "demo";

/// The server of NATS, where none is named.
const SERVER: &str = "nats-server";
/// The sites, and what the centre may do at each.
const SITES: [DemoSite; 3] = [
    DemoSite {
        name: "plant1",
        write: &["*"],
        is_managed: true,
    },
    DemoSite {
        name: "plant2",
        write: &["oven"],
        is_managed: true,
    },
    DemoSite {
        name: "plant3",
        write: &[],
        is_managed: false,
    },
];
/// The name of the process of the centre.
const CENTRE: &str = "centre";
/// For how many hours their invitations are valid.
const HOURS: u64 = 1;
/// How long until the whole fleet stands.
const PATIENCE: Duration = Duration::from_secs(60);
/// How often it is looked whether something stands.
const LOOK: Duration = Duration::from_millis(100);
/// How long a process may take to end.
const END_MAX: Duration = Duration::from_secs(10);
/// How many lines of the log of a process are shown that has ended.
const LOG_SHOWN: usize = 5;

/// A site of the demo.
#[derive(Clone, Copy)]
struct DemoSite {
    name: &'static str,
    /// What the centre may switch there.
    write: &'static [&'static str],
    /// The centre may say its configuration.
    is_managed: bool,
}

/// Its parser and help.
pub(super) fn define(lang: Lang) -> Command {
    let usage = "railbus fleet demo [--nats-server FILE]";
    let server = args::flag(lang, "nats-server", FleetText::ServerProgram)
        .value_name("FILE")
        .value_parser(value_parser!(PathBuf));
    super::verb(lang, NAME, FleetText::Demo, usage).arg(server)
}

/// Runs it until it is stopped.
pub(super) fn run(context: &Context, matches: &ArgMatches) -> Result<(), Failure> {
    let server: Option<&PathBuf> = matches.get_one("nats-server");
    let server = server.map_or_else(|| PathBuf::from(SERVER), Clone::clone);
    // It is started in another folder. What is a name alone is looked for on the PATH.
    let server = match server.components().count() {
        1 => server,
        _ => std::path::absolute(&server).unwrap_or(server),
    };
    let named = hub_socket(matches);
    context.block(async {
        let mut stop = Stop::new(context)?;
        // When the terminal is closed: the servers would only read their files again.
        let (closed, over) = watch::channel(false);
        let hangup = signal(SignalKind::hangup());
        let mut hangup = hangup.map_err(|error| system(context.lang, error))?;
        tokio::spawn(async move {
            hangup.recv().await;
            closed.send_replace(true);
        });
        stop.when(over);
        let folder = OwnFolder::make("railbus-fleet-demo");
        let folder = folder.map_err(|error| system(context.lang, error))?;
        let mut fleet = DemoFleet {
            context,
            folder: folder.path(),
            named: named.as_deref(),
            running: JoinSet::new(),
            started: Vec::new(),
            last: None,
            stands: false,
        };
        let end = stop.or(fleet.stand(&server)).await;
        let end = match end {
            Some(Ok(())) => {
                fleet.stands = true;
                let ended = stop.or(fleet.running.join_next()).await;
                ended.flatten().map(|ended| fleet.has_ended(ended.ok()))
            }
            Some(Err(failure)) => Some(failure),
            None => None,
        };
        fleet.end().await;
        end.map_or(Ok(()), Err)
    })
}

/// The system refuses something that it usually grants.
fn system(lang: Lang, error: impl ToString) -> Failure {
    Failure::of(lang, Code::System).because(error)
}

/// A process of the demo that has ended.
type EndedProcess = (String, std::io::Result<std::process::ExitStatus>);

struct DemoFleet<'d> {
    context: &'d Context,
    folder: &'d Path,
    /// The socket of the centre, if one is named.
    named: Option<&'d Path>,
    running: JoinSet<EndedProcess>,
    /// The names of the processes and their numbers.
    started: Vec<(String, Option<Pid>)>,
    /// The last problem of what is tried until it works.
    last: Option<String>,
    /// All of it was there once.
    stands: bool,
}

impl DemoFleet<'_> {
    /// Starts everything, and says what there is.
    async fn stand(&mut self, server: &Path) -> Result<(), Failure> {
        let standing = async {
            let node = self.serve_nats(server)?;
            let centre = self.serve_centre().await?;
            let mut sites = Vec::new();
            for site in SITES {
                sites.push((site.name, self.site(site).await?));
            }
            self.all_online().await?;
            self.say(&node, &centre, &sites)
        };
        match timeout(PATIENCE, standing).await {
            Ok(end) => end,
            Err(_) => {
                // One of them may have ended: that is why.
                let ended = self.running.try_join_next().and_then(Result::ok);
                Err(self.has_ended(ended))
            }
        }
    }

    fn fleet(&self) -> PathBuf {
        self.folder.join("fleet")
    }

    fn log(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{name}.log"))
    }

    /// Founds the fleet and starts its server.
    fn serve_nats(&mut self, server: &Path) -> Result<NodeAddress, Failure> {
        let lang = self.context.lang;
        // Another program could take it before the server does, which would say so.
        let free =
            TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).map_err(|error| system(lang, error))?;
        let address = free
            .local_addr()
            .map_err(|error| system(lang, error))?
            .to_string();
        drop(free);
        let node = NodeAddress::parse(&address).ok_or_else(|| Failure::of(lang, Code::System))?;
        let files = found(std::slice::from_ref(&node), super::now());
        let files = files.map_err(|error| system(lang, error))?;
        init::write(lang, &self.fleet(), &files)?;
        let mut program = Program::new(server);
        program
            .args(["-c", "nats.conf"])
            .current_dir(self.fleet().join("server1"));
        self.start("server1", program, false).map_err(|error| {
            let failure = Failure::of(lang, Code::NoNatsServer);
            failure.because(format!("{}: {error}", server.display()))
        })?;
        Ok(node)
    }

    /// Starts the centre; the link to its pages.
    async fn serve_centre(&mut self) -> Result<String, Failure> {
        let mut program = self.own()?;
        program.args(["fleet", "serve"]).arg(self.fleet());
        program.args(["--listen", "127.0.0.1:0"]);
        if let Some(socket) = self.named {
            program.arg("--socket").arg(socket);
        }
        self.start_pages(CENTRE, program).await
    }

    /// Starts a process that has pages; the link to them.
    async fn start_pages(&mut self, name: &str, program: Program) -> Result<String, Failure> {
        let lang = self.context.lang;
        let said = self
            .start(name, program, true)
            .map_err(|error| system(lang, error))?;
        let mut pages = String::new();
        if let Some(said) = said {
            let mut lines = BufReader::new(said).lines();
            // It ends only with its process. Without a user, the link to set one up comes after
            // that of the pages, and before that of the API.
            while let Some(line) = lines
                .next_line()
                .await
                .map_err(|error| system(lang, error))?
            {
                let mut words = line.split_whitespace();
                match (words.next(), words.next()) {
                    (Some("web" | "setup"), Some(link)) => link.clone_into(&mut pages),
                    (Some("api"), _) => break,
                    _ => {}
                }
            }
            // What it says later is of no interest, but it must not have to wait.
            tokio::spawn(async move { while let Ok(Some(_)) = lines.next_line().await {} });
        }
        Ok(pages)
    }

    /// Starts a site, which joins; the link to its pages.
    async fn site(&mut self, site: DemoSite) -> Result<String, Failure> {
        let DemoSite {
            name,
            write,
            is_managed,
        } = site;
        let (lang, socket) = (self.context.lang, self.folder.join(name));
        let mut program = self.own()?;
        program.args(["serve", "--demo", "--listen", "127.0.0.1:0", "--socket"]);
        program.arg(&socket);
        let pages = self.start_pages(name, program).await?;
        let invitation = enrol::invitation(lang, &self.fleet(), name, HOURS)?
            .0
            .text();
        let body = json!({ "invitation": invitation, "managed": is_managed });
        let path = ["outlets", "fleet", "fleet", "join"];
        let daemon = loop {
            // The centre may not be running yet: the invitation stays valid until it is.
            let joined = async {
                let daemon = DaemonClient::at(&socket).await?;
                daemon.request(Method::POST, &path, &body).await?;
                Ok::<_, Problem>(daemon)
            };
            match joined.await {
                Ok(daemon) => {
                    self.last = None;
                    break daemon;
                }
                Err(problem) => {
                    self.last = Some(self.context.failure(&problem).message().to_owned())
                }
            }
            self.all_run()?;
            tokio::time::sleep(LOOK).await;
        };
        let settings = daemon.outlets().await.map(|outlets| {
            let own = outlets.into_iter().find(|outlet| outlet.kind == "fleet");
            own.map(|outlet| outlet.settings).unwrap_or_default()
        });
        let mut settings = settings.map_err(|problem| self.context.failure(&problem))?;
        settings.insert("write".to_owned(), json!(write));
        let path = ["outlets", "fleet", "fleet"];
        let put = daemon
            .request(Method::PUT, &path, &Value::Object(settings))
            .await;
        put.map_err(|problem| self.context.failure(&problem))?;
        Ok(pages)
    }

    /// Waits until the centre has all sites.
    async fn all_online(&mut self) -> Result<(), Failure> {
        loop {
            if let Ok(hub) = HubClient::find(self.named).await
                && let Ok(told) = hub.sites().await
                && told.sites.iter().filter(|site| site.current).count() == SITES.len()
            {
                return Ok(());
            }
            self.all_run()?;
            tokio::time::sleep(LOOK).await;
        }
    }

    /// Says what there is, and what can be tried.
    fn say(
        &self,
        node: &NodeAddress,
        centre: &str,
        sites: &[(&str, String)],
    ) -> Result<(), Failure> {
        let lang = self.context.lang;
        let rows = || {
            let row = |(site, pages): &(&str, String)| json!({ "site": site, "pages": pages });
            sites.iter().map(row).collect::<Vec<Value>>()
        };
        let text = match self.context.format {
            Format::Json | Format::Ndjson => {
                let server = node.to_string();
                records::line(json!({ "server": server, "centre": centre, "sites": rows() }))
            }
            _ => {
                let all = sites.iter();
                let all = all.map(|(site, pages)| format!("  {site:<9} {pages}\n"));
                let version = env!("CARGO_PKG_VERSION");
                let socket = self
                    .named
                    .map(|path| format!(" --socket {}", path.display()));
                let values: &[(&str, &dyn std::fmt::Display)] = &[
                    ("server", node),
                    ("centre", &centre),
                    ("sites", &all.collect::<String>()),
                    ("socket", &socket.unwrap_or_default()),
                ];
                let what = lang.get(FleetText::DemoTitle);
                format!(
                    "railbus {version}  {what}\n{}\n",
                    lang.fill(FleetText::DemoSays, values)
                )
            }
        };
        out::result(lang, &text)
    }

    /// This program, for a process of its own in the same language.
    fn own(&self) -> Result<Program, Failure> {
        let lang = self.context.lang;
        let own = std::env::current_exe();
        let own = own.map_err(|error| system(lang, error))?;
        let mut program = Program::new(own);
        // Its site is its own, whatever is set here.
        program
            .env("RAILBUS_LANG", lang.name())
            .env_remove("RAILBUS_CONFIG")
            .env_remove("RAILBUS_STATE");
        Ok(program)
    }

    /// Starts a process; what it says, if that is wanted. All else goes to its log.
    fn start(
        &mut self,
        name: &str,
        mut program: Program,
        is_heard: bool,
    ) -> std::io::Result<Option<tokio::process::ChildStdout>> {
        let log = File::create(self.log(name))?;
        let stdout = match is_heard {
            true => Stdio::piped(),
            false => log.try_clone()?.into(),
        };
        program
            .stdin(Stdio::null())
            .stdout(stdout)
            .stderr(log)
            .kill_on_drop(true);
        let mut child: Child = program.spawn()?;
        let said = child.stdout.take();
        let pid = child.id().and_then(|id| i32::try_from(id).ok());
        self.started
            .push((name.to_owned(), pid.and_then(Pid::from_raw)));
        let name = name.to_owned();
        self.running
            .spawn(async move { (name, child.wait().await) });
        Ok(said)
    }

    /// Whether none of the processes has ended.
    fn all_run(&mut self) -> Result<(), Failure> {
        match self.running.try_join_next() {
            Some(ended) => Err(self.has_ended(ended.ok())),
            None => Ok(()),
        }
    }

    /// One of the processes has ended, or the fleet does not stand in time.
    fn has_ended(&mut self, ended: Option<EndedProcess>) -> Failure {
        let lang = self.context.lang;
        if let Some((ended, _)) = &ended {
            // Another process may have its number now.
            self.started.retain(|(name, _)| name != ended);
        }
        let Some((name, _)) = ended else {
            let message = lang.get(FleetText::DemoLate).to_owned();
            let failure = Failure::new(Code::System, message);
            return self.last.take().into_iter().fold(failure, Failure::because);
        };
        let message = lang.fill(FleetText::DemoEnded, &[("name", &name)]);
        let log = std::fs::read_to_string(self.log(&name)).unwrap_or_default();
        let last = log.lines().rev().filter(|line| !line.trim().is_empty());
        let mut last: Vec<&str> = last.take(LOG_SHOWN).collect();
        last.reverse();
        let failure = Failure::new(Code::System, message);
        let failure = last.into_iter().fold(failure, Failure::because);
        // The usual socket may be that of another centre.
        match name == CENTRE && !self.stands && self.named.is_none() {
            true => failure.with_try("railbus fleet demo --socket PATH"),
            false => failure,
        }
    }

    /// Ends all processes, the last one first, and waits for them.
    async fn end(&mut self) {
        for (_, pid) in self.started.iter().rev() {
            if let Some(pid) = pid {
                // Fails if it has ended.
                let _ = kill_process(*pid, Signal::TERM);
            }
        }
        let ended = async { while self.running.join_next().await.is_some() {} };
        // Those that are left are killed as they are dropped.
        let _ = timeout(END_MAX, ended).await;
    }
}
