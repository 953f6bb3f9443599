//! The configuration of a running site, and the adapters of its lines: the daemon is tested from
//! outside, by a program that uses its socket and knows nothing of railbus but its HTTP API.

mod adapter;
mod adapters;
mod daemon;
mod edits;
mod ends;
mod keys;
mod kills;
