//! `deps-point-down`: `railbus -> site -> host -> bus -> device -> wire`, and `railbus -> sim ->
//! device`, and `keep -> device`. What a crate cannot see it cannot come to need.
//!
//! Dev-dependencies are free: the soak of `sim` takes `bus` to have something to torment.

use super::manifest::{self, Role};
use super::report::Report;
use super::tree::Tree;

/// What one crate may depend on.
struct Layer {
    name: &'static str,
    below: &'static [&'static str],
    /// Whether it may use packages from the registry.
    foreign: bool,
}

const LAYERS: &[Layer] = &[
    Layer {
        name: "wire",
        below: &[],
        foreign: false,
    },
    Layer {
        name: "device",
        below: &["wire"],
        foreign: false,
    },
    Layer {
        name: "cases",
        below: &["device", "wire"],
        foreign: false,
    },
    Layer {
        name: "qemu",
        below: &["cases", "keep", "sim", "device", "wire"],
        foreign: true,
    },
    Layer {
        name: "bus",
        below: &["device", "wire"],
        foreign: true,
    },
    Layer {
        name: "keep",
        below: &["device", "wire"],
        foreign: true,
    },
    Layer {
        name: "sim",
        below: &["device", "wire"],
        foreign: true,
    },
    Layer {
        name: "sniff",
        below: &["wire"],
        foreign: true,
    },
    Layer {
        name: "host",
        below: &["bus", "device", "wire"],
        foreign: true,
    },
    Layer {
        name: "site",
        below: &["host", "bus", "device", "wire"],
        foreign: true,
    },
    Layer {
        name: "opcua",
        below: &["site", "host", "bus", "device", "wire"],
        foreign: true,
    },
    Layer {
        name: "fleet",
        below: &["site", "host", "bus", "device", "wire"],
        foreign: true,
    },
    Layer {
        name: "railbus",
        below: &[
            "opcua", "fleet", "site", "sniff", "host", "bus", "sim", "device", "wire",
        ],
        foreign: true,
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
            None => layer.foreign,
        };
        if allowed || dependency.role == Role::Dev {
            continue;
        }
        let next = match own {
            Some(_) if layer.below.is_empty() => String::from("it stands at the bottom"),
            Some(_) => format!("of our own it may use: {}", layer.below.join(", ")),
            None => String::from("the core has no foreign code; write the few lines, or move up"),
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
                "crates/device/Cargo.toml:6",
                "crates/device/Cargo.toml:7",
                "crates/extra/Cargo.toml:1",
                "crates/sim/Cargo.toml:5",
            ]
        );
    }
}
