//! What holds each requirement that the Sparkplug TCK 3.0 tests at an edge node, by its id there
//! (without `tck-id-`). What an id asks for is in the specification.

use Holder::{Deviation, NotApplicable, Peer, Test};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// What holds a requirement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Holder {
    /// A test in this folder would fail.
    Test(&'static str),
    /// This entry of the table in `interop/tables.py` would not be reached.
    Peer(&'static str),
    /// There is nothing here that it is about.
    NotApplicable(&'static str),
    /// It is done otherwise.
    Deviation(&'static str),
}

const BLOCK: Holder = Test("births_come_first_and_in_one_block");
const METRICS: Holder = Test("births_and_data_say_all_that_a_host_needs_of_each_metric");
const CASE: Holder = Test("no_two_metrics_differ_in_case_only");
const TIMES: Holder = Test("every_message_has_its_topic_and_the_time_at_which_it_is_sent");
const NUMBER: Holder = Test("births_and_the_death_have_the_number_of_the_will");
const SEQ: Holder = Test("after_255_comes_0_whatever_is_told");
const PACKETS: Holder = Test("a_connection_is_as_hosts_expect_it");
const LAYOUT: Holder = Test("a_payload_is_laid_out_as_specified");
const MODULES: Holder = Test("a_module_is_born_while_it_answers");
const CHANGES: Holder = Test("a_value_that_is_not_good_says_so_and_the_next_good_one_too");
const READ: Holder = Test("a_birth_says_what_a_metric_is");
const AGAIN: Holder = Test("a_host_that_asks_gets_all_births_again_in_one_block");
const HOST: Holder = Test("nobody_is_told_anything_while_the_primary_host_is_away");
const STATES: Holder = Test("a_state_counts_unless_it_is_older_than_what_is_known");
const TOPICS: Holder = Test("a_message_is_known_by_its_topic");
const PUBLISHED: Holder = Peer("{5,3.1.1}: QoS 0 and not retained");
const RULES: Holder = Peer("{5,3.1.1}: the rules of Sparkplug");
const LEAVES: Holder = Peer("SIGTERM: NDEATH by the node, and the next number");
const RETURNS: Holder = Peer("primary host: NDEATH when it goes, births when it is back");
const ONE: Holder = NotApplicable("there is one broker, and no list of them");
const ALIASES: Holder = NotApplicable("no metric has an alias");
const DATASETS: Holder = NotApplicable("no metric is a DataSet");
const TEMPLATES: Holder = NotApplicable("no metric is a template");
const UNBORN: Holder = Deviation("a node that was not born says no death: no host knows of it");

/// So many ids have the tests of the TCK for edge nodes.
const COUNT: usize = 164;

const REQUIREMENTS: [(&str, Holder); COUNT] = [
    ("case-sensitivity-metric-names", CASE),
    (
        "message-flow-device-birth-publish-dbirth-match-edge-node-topic",
        TIMES,
    ),
    ("message-flow-device-birth-publish-dbirth-payload", LAYOUT),
    ("message-flow-device-birth-publish-dbirth-qos", PUBLISHED),
    (
        "message-flow-device-birth-publish-dbirth-retained",
        PUBLISHED,
    ),
    ("message-flow-device-birth-publish-dbirth-topic", TIMES),
    ("message-flow-device-birth-publish-nbirth-wait", BLOCK),
    ("message-flow-device-dcmd-subscribe", PACKETS),
    ("message-flow-edge-node-birth-publish-connect", BLOCK),
    (
        "message-flow-edge-node-birth-publish-nbirth-payload",
        LAYOUT,
    ),
    (
        "message-flow-edge-node-birth-publish-nbirth-payload-bdSeq",
        NUMBER,
    ),
    (
        "message-flow-edge-node-birth-publish-nbirth-payload-seq",
        MODULES,
    ),
    ("message-flow-edge-node-birth-publish-nbirth-qos", PUBLISHED),
    (
        "message-flow-edge-node-birth-publish-nbirth-retained",
        PUBLISHED,
    ),
    ("message-flow-edge-node-birth-publish-nbirth-topic", TIMES),
    ("message-flow-edge-node-birth-publish-phid-offline", HOST),
    ("message-flow-edge-node-birth-publish-phid-wait", HOST),
    ("message-flow-edge-node-birth-publish-phid-wait-id", TOPICS),
    (
        "message-flow-edge-node-birth-publish-phid-wait-online",
        HOST,
    ),
    (
        "message-flow-edge-node-birth-publish-phid-wait-timestamp",
        STATES,
    ),
    ("message-flow-edge-node-birth-publish-will-message", PACKETS),
    (
        "message-flow-edge-node-birth-publish-will-message-payload",
        PACKETS,
    ),
    (
        "message-flow-edge-node-birth-publish-will-message-qos",
        PACKETS,
    ),
    (
        "message-flow-edge-node-birth-publish-will-message-topic",
        PACKETS,
    ),
    (
        "message-flow-edge-node-birth-publish-will-message-will-retained",
        PACKETS,
    ),
    ("message-flow-edge-node-ncmd-subscribe", PACKETS),
    ("operational-behavior-data-commands-rebirth-action-1", AGAIN),
    ("operational-behavior-data-commands-rebirth-action-2", BLOCK),
    (
        "operational-behavior-data-commands-rebirth-action-3",
        NUMBER,
    ),
    (
        "operational-behavior-data-commands-rebirth-datatype",
        METRICS,
    ),
    ("operational-behavior-data-commands-rebirth-name", METRICS),
    (
        "operational-behavior-data-commands-rebirth-name-aliases",
        RULES,
    ),
    ("operational-behavior-data-commands-rebirth-value", METRICS),
    ("operational-behavior-data-publish-dbirth-values", METRICS),
    ("operational-behavior-data-publish-nbirth-values", METRICS),
    ("operational-behavior-device-ddeath", MODULES),
    ("operational-behavior-edge-node-birth-sequence-wait", HOST),
    (
        "operational-behavior-edge-node-intentional-disconnect-ndeath",
        UNBORN,
    ),
    (
        "operational-behavior-edge-node-intentional-disconnect-packet",
        LEAVES,
    ),
    (
        "operational-behavior-edge-node-termination-host-offline",
        RETURNS,
    ),
    (
        "operational-behavior-edge-node-termination-host-offline-reconnect",
        RETURNS,
    ),
    (
        "operational-behavior-edge-node-termination-host-offline-timestamp",
        HOST,
    ),
    (
        "operational-behavior-primary-application-state-with-multiple-servers-single-server",
        ONE,
    ),
    (
        "operational-behavior-primary-application-state-with-multiple-servers-state-subs",
        ONE,
    ),
    (
        "operational-behavior-primary-application-state-with-multiple-servers-walk",
        ONE,
    ),
    ("payloads-alias-birth-requirement", ALIASES),
    ("payloads-alias-data-cmd-requirement", ALIASES),
    ("payloads-alias-uniqueness", ALIASES),
    ("payloads-dataset-column-num-headers", DATASETS),
    ("payloads-dataset-column-size", DATASETS),
    ("payloads-dataset-parameter-type-req", DATASETS),
    ("payloads-dataset-types-def", DATASETS),
    ("payloads-dataset-types-num", DATASETS),
    ("payloads-dataset-types-type", DATASETS),
    ("payloads-dataset-types-value", DATASETS),
    ("payloads-dbirth-order", BLOCK),
    ("payloads-dbirth-qos", PUBLISHED),
    ("payloads-dbirth-retain", PUBLISHED),
    ("payloads-dbirth-seq", SEQ),
    ("payloads-dbirth-seq-inc", SEQ),
    ("payloads-dbirth-timestamp", TIMES),
    ("payloads-ddata-order", BLOCK),
    ("payloads-ddata-qos", PUBLISHED),
    ("payloads-ddata-retain", PUBLISHED),
    ("payloads-ddata-seq", SEQ),
    ("payloads-ddata-timestamp", TIMES),
    ("payloads-ddeath-seq", SEQ),
    ("payloads-ddeath-seq-inc", SEQ),
    ("payloads-ddeath-seq-number", SEQ),
    ("payloads-ddeath-timestamp", TIMES),
    ("payloads-metric-datatype-not-req", METRICS),
    ("payloads-metric-datatype-req", METRICS),
    ("payloads-metric-datatype-value", METRICS),
    ("payloads-metric-datatype-value-type", LAYOUT),
    ("payloads-metric-propertyvalue-type-req", METRICS),
    ("payloads-metric-propertyvalue-type-type", LAYOUT),
    ("payloads-metric-propertyvalue-type-value", METRICS),
    ("payloads-metric-timestamp-in-UTC", READ),
    ("payloads-name-birth-data-requirement", METRICS),
    ("payloads-name-requirement", METRICS),
    ("payloads-nbirth-bdseq", NUMBER),
    ("payloads-nbirth-bdseq-repeat", NUMBER),
    ("payloads-nbirth-qos", PUBLISHED),
    ("payloads-nbirth-rebirth-req", METRICS),
    ("payloads-nbirth-retain", PUBLISHED),
    ("payloads-nbirth-seq", MODULES),
    ("payloads-nbirth-timestamp", TIMES),
    ("payloads-ndata-order", BLOCK),
    ("payloads-ndata-qos", PUBLISHED),
    ("payloads-ndata-retain", PUBLISHED),
    ("payloads-ndata-seq", SEQ),
    ("payloads-ndata-timestamp", TIMES),
    ("payloads-ndeath-bdseq", PACKETS),
    ("payloads-ndeath-seq", NUMBER),
    ("payloads-ndeath-will-message", PACKETS),
    ("payloads-ndeath-will-message-publisher", LEAVES),
    (
        "payloads-ndeath-will-message-publisher-disconnect-mqtt311",
        UNBORN,
    ),
    (
        "payloads-ndeath-will-message-publisher-disconnect-mqtt50",
        PACKETS,
    ),
    ("payloads-ndeath-will-message-qos", PACKETS),
    ("payloads-ndeath-will-message-retain", PACKETS),
    ("payloads-propertyset-keys-array-size", METRICS),
    ("payloads-propertyset-quality-value-type", METRICS),
    ("payloads-propertyset-quality-value-value", METRICS),
    ("payloads-propertyset-values-array-size", METRICS),
    ("payloads-sequence-num-always-included", MODULES),
    ("payloads-sequence-num-req-nbirth", MODULES),
    ("payloads-template-dataset-value", DATASETS),
    ("payloads-template-definition-is-definition", TEMPLATES),
    ("payloads-template-definition-members", TEMPLATES),
    ("payloads-template-definition-nbirth", TEMPLATES),
    ("payloads-template-definition-nbirth-only", TEMPLATES),
    ("payloads-template-definition-parameters", TEMPLATES),
    ("payloads-template-definition-parameters-default", TEMPLATES),
    ("payloads-template-definition-ref", TEMPLATES),
    ("payloads-template-instance-is-definition", TEMPLATES),
    ("payloads-template-instance-members", TEMPLATES),
    ("payloads-template-instance-members-birth", TEMPLATES),
    ("payloads-template-instance-members-data", TEMPLATES),
    ("payloads-template-instance-parameters", TEMPLATES),
    ("payloads-template-instance-ref", TEMPLATES),
    ("payloads-template-is-definition", TEMPLATES),
    ("payloads-template-is-definition-definition", TEMPLATES),
    ("payloads-template-is-definition-instance", TEMPLATES),
    ("payloads-template-parameter-name-required", TEMPLATES),
    ("payloads-template-parameter-name-type", TEMPLATES),
    ("payloads-template-parameter-type-req", TEMPLATES),
    ("payloads-template-parameter-type-value", TEMPLATES),
    ("payloads-template-parameter-value", TEMPLATES),
    ("payloads-template-parameter-value-type", TEMPLATES),
    ("payloads-template-ref-definition", TEMPLATES),
    ("payloads-template-ref-instance", TEMPLATES),
    ("payloads-template-version", TEMPLATES),
    ("principles-birth-certificates-order", BLOCK),
    ("principles-persistence-clean-session-311", PACKETS),
    ("principles-persistence-clean-session-50", PACKETS),
    ("topics-dbirth-metrics", METRICS),
    ("topics-dbirth-mqtt", PUBLISHED),
    ("topics-dbirth-seq", SEQ),
    ("topics-dbirth-timestamp", TIMES),
    ("topics-dbirth-topic", TIMES),
    ("topics-ddata-mqtt", PUBLISHED),
    ("topics-ddata-payload", CHANGES),
    ("topics-ddata-seq-num", SEQ),
    ("topics-ddata-timestamp", TIMES),
    ("topics-ddata-topic", TIMES),
    ("topics-ddeath-mqtt", PUBLISHED),
    ("topics-ddeath-seq-num", SEQ),
    ("topics-ddeath-topic", TIMES),
    ("topics-nbirth-bdseq-included", NUMBER),
    ("topics-nbirth-bdseq-matching", PACKETS),
    ("topics-nbirth-metrics", METRICS),
    ("topics-nbirth-mqtt", PUBLISHED),
    ("topics-nbirth-rebirth-metric", METRICS),
    ("topics-nbirth-seq-num", MODULES),
    ("topics-nbirth-timestamp", TIMES),
    ("topics-nbirth-topic", TIMES),
    ("topics-ndata-mqtt", PUBLISHED),
    ("topics-ndata-payload", MODULES),
    ("topics-ndata-seq-num", SEQ),
    ("topics-ndata-timestamp", TIMES),
    ("topics-ndata-topic", TIMES),
    ("topics-ndeath-payload", NUMBER),
    ("topics-ndeath-seq", NUMBER),
    ("topics-ndeath-topic", PACKETS),
];

#[test]
fn every_requirement_stands_here_once() {
    let ids = REQUIREMENTS.iter().map(|(id, _)| id);
    assert!(ids.is_sorted_by(|before, id| before < id));
    let distinct: BTreeSet<&str> = REQUIREMENTS.iter().map(|(id, _)| *id).collect();
    assert_eq!(distinct.len(), COUNT);
}

#[test]
fn what_holds_a_requirement_is_there() {
    let (tests, peers) = (tests(), peers());
    assert!(tests.len() > 30 && peers.len() > 30);
    for (id, holder) in REQUIREMENTS {
        let is_there = match holder {
            Test(name) => tests.contains(name),
            Peer(entry) => expanded(entry).iter().all(|entry| peers.contains(entry)),
            NotApplicable(why) | Deviation(why) => !why.is_empty(),
        };
        assert!(is_there, "{id}: {holder:?}");
    }
}

#[test]
fn alternatives_are_one_entry_each() {
    assert_eq!(
        expanded("{5,3}: a {b,c}"),
        ["5: a b", "5: a c", "3: a b", "3: a c"]
    );
    assert_eq!(expanded("a"), ["a"]);
}

/// The names of the tests in this folder.
fn tests() -> BTreeSet<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/northbound/sparkplug");
    let (mut folders, mut files): (Vec<PathBuf>, Vec<PathBuf>) = (vec![root], Vec::new());
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => folders.push(path),
                false => files.push(path),
            }
        }
    }
    let mut names = BTreeSet::new();
    for file in files {
        let text = std::fs::read_to_string(file).unwrap();
        let lines: Vec<&str> = text.lines().map(str::trim).collect();
        for both in lines.windows(2) {
            let is_test = ["#[test]", "#[tokio::test]"].contains(&both[0]);
            let function = both[1].trim_start_matches("async ").strip_prefix("fn ");
            let name = function.and_then(|function| function.split('(').next());
            names.extend(name.filter(|_| is_test).map(str::to_owned));
        }
    }
    names
}

/// The entries of the table of the peers, without alternatives.
fn peers() -> BTreeSet<String> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../interop/tables.py");
    let text = std::fs::read_to_string(file).unwrap();
    let (_, table) = text.split_once("\nSPARKPLUG = \"\"\"\n").unwrap();
    let (table, _) = table.split_once("\"\"\"").unwrap();
    table.lines().flat_map(expanded).collect()
}

/// What an entry stands for: `{a,b}: c` for `a: c` and `b: c`.
fn expanded(entry: &str) -> Vec<String> {
    let Some((before, rest)) = entry.split_once('{') else {
        return vec![entry.to_owned()];
    };
    let (words, after) = rest.split_once('}').unwrap();
    let afters = expanded(after);
    let mut all = Vec::new();
    for word in words.split(',') {
        all.extend(afters.iter().map(|after| format!("{before}{word}{after}")));
    }
    all
}
