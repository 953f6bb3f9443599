//! The commands as users see them: streams, forms, languages and exit codes.

mod config;
mod contract;
mod dead;
mod doctor;
mod exits;
mod failures;
mod help;
mod liar;
mod line;
mod measure;
mod outlets;
mod outputs;
mod published;
mod raw;
mod replay;
mod scan;
mod shells;
mod site;
mod sniff;
mod stranger;
mod terminal;
mod users;
mod wait;
mod whose;
mod wireshark;
mod words;
