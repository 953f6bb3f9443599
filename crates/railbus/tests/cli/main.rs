//! The commands as their users meet them: streams, forms, languages and exit codes.

mod failures;
mod liar;
mod line;
mod site;
mod sniff;
mod wireshark;
mod words;
