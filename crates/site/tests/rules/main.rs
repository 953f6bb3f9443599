//! Rules: read, as state machines in virtual time, over the past, and live with relay boards.

#[allow(dead_code, reason = "other tests want more of it")]
#[path = "../service/board.rs"]
mod board;
mod engine;
mod live;
mod past;
mod read;

use railbus_site::Config;
use railbus_site::config::Rule;

/// A line with a relay board, an analog module and a module that times pulses itself.
const SITE: &str = "[line.main]\nport = \"/dev/railbus-test-nothing-here\"\n\
    [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n\
    [module.oven.point]\nk8.confirm = true\n\
    [module.tank]\nline = \"main\"\nmodel = \"emd2a2q\"\naddress = 5\n\
    range = { low = 0, high = 5, unit = \"m\" }\n\
    [module.pump]\nline = \"main\"\nmodel = \"eda9060a\"\naddress = 1\n";

fn site(rule: &str) -> String {
    format!("{SITE}[rule.night]\n{rule}\n")
}

/// The one rule of a site.
fn rule(text: &str) -> Rule {
    Config::parse(&site(text)).unwrap().rules["night"].clone()
}
