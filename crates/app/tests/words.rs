//! The words of the API's document are those that are sent.

use railbus_api::types::Quality;
use railbus_api::words::{ChangeState, EventKindWord, ScanVerdict, SettingAccess, SeverityWord};
use railbus_commission::RecordState;
use railbus_commission::scan::Verdict;
use railbus_commission::settings::Access;
use railbus_store::history::{self, SampleQuality};
use serde::de::DeserializeOwned;

/// Whether the document has a word.
fn has<T: DeserializeOwned>(word: &str) -> bool {
    serde_json::from_value::<T>(word.into()).is_ok()
}

/// All of an enum: with one more variant this does not compile.
macro_rules! every {
    ($of:ident: $($variant:ident),*) => {{
        let _ = |one: $of| match one { $($of::$variant => ()),* };
        [$($of::$variant),*]
    }};
}

#[test]
fn events() {
    for kind in history::EventKind::ALL {
        assert!(has::<EventKindWord>(kind.name()), "{kind:?}");
    }
    for severity in history::Severity::ALL {
        assert!(has::<SeverityWord>(severity.name()), "{severity:?}");
    }
    assert!(!has::<SeverityWord>("fatal"));
}

#[test]
fn settings() {
    for access in every!(Access: Written, AtPowerUp, MakersSoftware, InitPin, InAscii, Fixed) {
        assert!(has::<SettingAccess>(access.name()), "{access:?}");
    }
    for state in
        every!(RecordState: Intent, Done, Pending, Unchanged, Elsewhere, Lost, Untold, Filed)
    {
        let word = serde_json::to_value(state).unwrap_or_default();
        assert!(
            has::<ChangeState>(word.as_str().unwrap_or_default()),
            "{state:?}"
        );
    }
}

#[test]
fn scans_and_samples() {
    for verdict in every!(Verdict: Ok, CouldBe, Refused, Odd, Garbled) {
        assert!(has::<ScanVerdict>(verdict.name()), "{verdict:?}");
    }
    for grade in every!(SampleQuality: Good, Stale, Bad) {
        assert!(has::<Quality>(grade.name()), "{grade:?}");
    }
}
