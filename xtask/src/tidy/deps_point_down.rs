//! `deps-point-down`: crates depend on those below them, as ARCHITECTURE.md shows it, and some may
//! not use some packages. A crate can't come to need what it can't see.
//!
//! Dev-dependencies are free: the soak of `sim` uses `bus` to have something to test.

use super::manifest::{self, Role};
use super::report::Report;
use super::tree::Tree;

/// What one crate may depend on.
struct Layer {
    name: &'static str,
    below: &'static [&'static str],
    /// Which packages from the registry it may use.
    foreign: Foreign,
}

/// Packages from the registry.
enum Foreign {
    /// The core has none.
    No,
    /// Any.
    Any,
    /// Any but these, which belong to other crates.
    Without(&'static [&'static str]),
}

const LAYERS: &[Layer] = &[
    Layer {
        name: "wire",
        below: &[],
        foreign: Foreign::No,
    },
    Layer {
        name: "device",
        below: &["wire"],
        foreign: Foreign::No,
    },
    Layer {
        name: "conformance",
        below: &["device", "wire"],
        foreign: Foreign::No,
    },
    Layer {
        name: "qemu",
        below: &["conformance", "nvm", "sim", "device", "wire"],
        foreign: Foreign::Any,
    },
    Layer {
        name: "bus",
        below: &["device", "wire"],
        foreign: Foreign::Any,
    },
    Layer {
        name: "nvm",
        below: &["device", "wire"],
        foreign: Foreign::Any,
    },
    Layer {
        name: "sim",
        below: &["device", "wire"],
        foreign: Foreign::Any,
    },
    Layer {
        name: "sniff",
        below: &["wire"],
        foreign: Foreign::Any,
    },
    Layer {
        name: "host",
        below: &["bus", "device", "wire"],
        foreign: Foreign::Any,
    },
    // Procedures without I/O: the driver above it has the runtime.
    Layer {
        name: "commission",
        below: &["bus", "device", "wire"],
        foreign: Foreign::Without(&["tokio"]),
    },
    Layer {
        name: "store",
        below: &["commission"],
        foreign: Foreign::Any,
    },
    Layer {
        name: "site",
        below: &["store", "commission", "host", "bus", "device", "wire"],
        foreign: Foreign::Any,
    },
    Layer {
        name: "words",
        below: &["wire"],
        foreign: Foreign::Any,
    },
    // The types of the HTTP API, without a server or a client.
    Layer {
        name: "api",
        below: &["words", "wire"],
        foreign: Foreign::Without(&["axum", "tokio"]),
    },
    // Shared by the command line and the gateway, and contains neither.
    Layer {
        name: "app",
        below: &[
            "api",
            "words",
            "sniff",
            "site",
            "store",
            "commission",
            "host",
            "bus",
            "device",
            "wire",
        ],
        foreign: Foreign::Without(&["axum", "clap"]),
    },
    // The client contains no server and no command line.
    Layer {
        name: "client",
        below: &["app", "api", "words", "site"],
        foreign: Foreign::Without(&["axum", "clap"]),
    },
    // The simulated plant contains no server and no command line.
    Layer {
        name: "plant",
        below: &["app", "api", "words", "site", "sim", "device", "wire"],
        foreign: Foreign::Without(&["axum", "clap"]),
    },
    Layer {
        name: "fleet",
        below: &[
            "site",
            "store",
            "commission",
            "host",
            "bus",
            "device",
            "wire",
        ],
        foreign: Foreign::Any,
    },
    // The gateway does not know which program starts it.
    // Other crates do without what it brings.
    Layer {
        name: "opcua",
        below: &[
            "app",
            "words",
            "site",
            "store",
            "commission",
            "host",
            "bus",
            "device",
            "wire",
        ],
        foreign: Foreign::Without(&["axum", "clap"]),
    },
    Layer {
        name: "gateway",
        below: &[
            "plant",
            "app",
            "api",
            "words",
            "opcua",
            "fleet",
            "site",
            "store",
            "commission",
            "sniff",
            "host",
            "device",
            "wire",
        ],
        foreign: Foreign::Without(&["clap"]),
    },
    // The command line starts the gateway, and serves nothing itself.
    Layer {
        name: "railbus",
        below: &[
            "gateway",
            "plant",
            "client",
            "app",
            "api",
            "words",
            "opcua",
            "fleet",
            "site",
            "store",
            "commission",
            "sniff",
            "host",
            "bus",
            "device",
            "wire",
        ],
        foreign: Foreign::Without(&["axum"]),
    },
];

pub(super) fn check(tree: &Tree, report: &mut Report) {
    for (path, text) in tree.texts(&["crates/*/Cargo.toml"]) {
        let name = path.split('/').nth(1).unwrap_or_default();
        match LAYERS.iter().find(|layer| layer.name == name) {
            Some(layer) => dependencies(layer, path, text, report),
            None => report.add(
                path,
                1,
                format!("crates/{name} has no place in the order of crates"),
                "put it into LAYERS of xtask/src/tidy/deps_point_down.rs, \
                 or make it a module of another crate",
            ),
        }
    }
}

fn dependencies(layer: &Layer, path: &str, text: &str, report: &mut Report) {
    for dependency in manifest::dependencies(text) {
        let package = &dependency.package;
        let own = package.strip_prefix("railbus-");
        let allowed = match own {
            Some(name) => layer.below.contains(&name),
            None => match layer.foreign {
                Foreign::No => false,
                Foreign::Any => true,
                Foreign::Without(others) => !others.contains(&package.as_str()),
            },
        };
        if allowed || dependency.role == Role::Dev {
            continue;
        }
        let next = match own {
            Some(_) if layer.below.is_empty() => String::from("it stands at the bottom"),
            Some(_) => format!("of our own it may use: {}", layer.below.join(", ")),
            None if matches!(layer.foreign, Foreign::No) => {
                String::from("the core has no foreign code; write the few lines, or move up")
            }
            None => format!("{package} is for other crates; move what needs it there"),
        };
        let what = format!("crates/{} must not depend on {package}", layer.name);
        report.add(path, dependency.line, what, next);
    }
}

#[cfg(test)]
mod tests {
    use super::check;

    #[test]
    fn fixture() {
        let found = crate::tidy::found("deps-point-down", check);
        assert_eq!(
            found,
            [
                "crates/client/Cargo.toml:5",
                "crates/commission/Cargo.toml:6",
                "crates/device/Cargo.toml:6",
                "crates/device/Cargo.toml:7",
                "crates/extra/Cargo.toml:1",
                "crates/gateway/Cargo.toml:6",
                "crates/railbus/Cargo.toml:6",
                "crates/sim/Cargo.toml:5",
            ]
        );
    }
}
