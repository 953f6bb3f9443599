//! Types of the API for a server that prints many of them: they borrow what they print.

use crate::types::{Kind, LeaseInfo, Quality, Reason, Value};
use serde::Serialize;

/// A [`PointInfo`](crate::types::PointInfo), which has the same JSON and says what the fields mean.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[expect(missing_docs, reason = "they are those of `PointInfo`")]
pub struct PointView<'a> {
    pub path: &'a str,
    pub module: &'a str,
    pub label: &'a str,
    pub kind: Kind,
    pub index: u8,
    #[serde(skip_serializing_if = "NameView::is_empty")]
    pub name: NameView<'a>,
    pub value: Option<Value>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub raw: Option<u16>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub decimals: Option<u8>,
    pub quality: Quality,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<Reason>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub age_ms: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_age_ms: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time: Option<&'a str>,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub hidden: bool,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub locked: bool,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub confirm: bool,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub hold: bool,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub interlock: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_on_ms: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub min_off_ms: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub on_until: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pulse_until: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lease: Option<LeaseInfo>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pulse_ms: Option<u64>,
}

/// A display name, by language.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct NameView<'a> {
    /// In English.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub en: Option<&'a str>,
    /// In Chinese.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub zh: Option<&'a str>,
}

impl NameView<'_> {
    const fn is_empty(&self) -> bool {
        self.en.is_none() && self.zh.is_none()
    }
}
