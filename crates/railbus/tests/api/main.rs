//! The daemon as seen by a program that knows nothing of railbus but its HTTP API.

mod about;
mod access;
mod calibration;
mod daemon;
mod flood;
mod hostile;
#[path = "../cli/liar.rs"]
#[expect(dead_code, reason = "the other tests have more use for it")]
mod liar;
mod past;
mod recovery;
mod rights;
mod rules;
mod scans;
mod sending;
mod serving;
mod settings;
mod sim;
mod streams;
mod talk;
mod webhooks;
mod websocket;
