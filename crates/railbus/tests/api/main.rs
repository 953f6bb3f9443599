//! The streams and the operations of the daemon's API, as a program meets them that knows
//! nothing of railbus but its HTTP.

mod about;
mod daemon;
mod flood;
mod hostile;
mod rules;
mod scans;
mod settings;
mod sim;
mod streams;
mod talk;
mod webhooks;
mod websocket;
