//! Questions and results of procedures, in the types of the API.

use railbus_api::settings::{Calibration, SettingsQuestion};
use railbus_commission::{Calibrated, Question};
use std::time::Duration;

fn values(readings: [u16; 2]) -> [f64; 2] {
    readings.map(|hundredths| f64::from(hundredths) / 100.0)
}

/// A question of a procedure, and the timeout of its answer.
pub fn question(question: Question, wait: Duration) -> SettingsQuestion {
    let (step, voltage, readings) = match question {
        Question::ZeroReady(readings) => ("zero", None, readings),
        Question::SpanReady(voltage, readings) => ("span", Some(voltage), readings),
    };
    SettingsQuestion {
        step: step.to_owned(),
        readings: values(readings),
        voltage: voltage.map(|hundredths| f64::from(hundredths) / 100.0),
        wait_s: wait.as_secs(),
    }
}

/// How far a calibration got.
pub fn calibration(done: &Calibrated) -> Calibration {
    Calibration {
        before: done.before.map(values),
        zero: done.zero.map(values),
        span: done.span.map(values),
    }
}
