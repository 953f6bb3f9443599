//! The simulated modules pass every case.

use railbus_conformance::{Case, CaseStep, Simulated, Subject, all, folder, run};
use railbus_device::Family;
use serde_json::Value;

fn cases() -> Vec<Case> {
    all().expect("lists that can be read")
}

#[test]
fn every_case_holds_of_the_simulated_module() {
    let mut failures = Vec::new();
    for case in cases() {
        for Subject { setup, options } in &case.modules {
            let mut bench = Simulated::new(*setup, *options).expect("a possible module");
            failures.extend(run(&case, setup, &mut bench).err());
        }
    }
    let text: Vec<String> = failures.iter().map(ToString::to_string).collect();
    assert!(text.is_empty(), "\n{}", text.join("\n"));
}

/// Well-formed data that no EDA9060A has: it has four channels of a kind [EDA9060A §4.8].
const IMPOSSIBLE: [&str; 2] = ["9060a-asc-112200-nochk", "9060a-asc-112200-chk"];

/// Every frame that a datasheet prints and that can be sent to a module is in the list; and if the
/// reply is printed, so is the reply.
#[test]
fn printed_frames_are_in_the_list() {
    let exchanges = exchanges();
    let mut missing = Vec::new();
    for file in ["ascii.json", "lc02.json", "r55.json", "rtu.json"] {
        for vector in vectors(file) {
            let text = |key: &str| vector[key].as_str().unwrap_or_default();
            let possible = !IMPOSSIBLE.contains(&text("id"));
            if text("origin") != "printed" || text("verdict") != "ok" || !possible {
                continue;
            }
            let frame = |key| hex(text(key));
            let there = exchanges.iter().any(|(family, request, reply)| {
                let ours = match text("direction") {
                    "request" => *request == frame("hex"),
                    _ => *request == frame("request") && *reply == frame("hex"),
                };
                ours && is_of(text("device"), *family)
            });
            if !there {
                missing.push(format!("{} {}: {}", file, text("id"), text("hex")));
            }
        }
    }
    assert!(missing.is_empty(), "\n{}", missing.join("\n"));
}

/// Every request of the lists with its reply.
fn exchanges() -> Vec<(Family, Vec<u8>, Vec<u8>)> {
    let mut exchanges = Vec::new();
    for case in cases() {
        for (_, step) in &case.steps {
            if let CaseStep::Ask(request, reply) = step {
                for subject in &case.modules {
                    exchanges.push((subject.setup.family, request.clone(), reply.clone()));
                }
            }
        }
    }
    exchanges
}

fn vectors(file: &str) -> Vec<Value> {
    let path = folder().join("..").join(file);
    let text = std::fs::read_to_string(path).expect("vectors");
    serde_json::from_str(&text).expect("a list of vectors")
}

fn is_of(device: &str, family: Family) -> bool {
    match family {
        Family::R55 => device == "0x55 relay board",
        _ => device == family.to_string(),
    }
}

fn hex(text: &str) -> Vec<u8> {
    let bytes = text.split_whitespace();
    bytes
        .map(|byte| u8::from_str_radix(byte, 16).expect("a byte"))
        .collect()
}
