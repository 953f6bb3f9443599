//! Bodies of requests.

use serde::de::{DeserializeOwned, Error};

/// Parses a body. It must be an object: a list would be accepted for a type whose fields are all
/// optional, and `[]` is no command.
pub(super) fn parse<T: DeserializeOwned>(body: &[u8]) -> Result<T, serde_json::Error> {
    match body.trim_ascii_start().first() {
        Some(b'{') => serde_json::from_slice(body),
        _ => Err(serde_json::Error::custom("the body must be an object")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_api::types::ToggleRequest;

    #[test]
    fn a_list_is_no_command() {
        assert!(parse::<ToggleRequest>(b" {} ").is_ok());
        for wrong in ["[]", "[false]", "", "null", "{", "{}x"] {
            assert!(parse::<ToggleRequest>(wrong.as_bytes()).is_err(), "{wrong}");
        }
    }
}
