//! The configuration of a site at work, and the adapters of its lines: a daemon is met as a
//! program meets it that asks over its socket, and knows nothing of railbus but its HTTP.

mod adapter;
mod adapters;
mod daemon;
mod edits;
mod ends;
mod keys;
mod kills;
