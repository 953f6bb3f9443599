//! The texts of `railbus audit`.

railbus_words::texts! {
    pub(crate) AuditText;

    About {
        en: "Check and export the audit log: what was done, and by whom.",
        zh: "检查并导出操作审计日志。",
    }
    Examples {
        en: "  railbus audit verify
  railbus audit export -o csv > audit.csv
  railbus audit export --config railbus.toml > audit.ndjson",
        zh: "  railbus audit verify
  railbus audit export -o csv > audit.csv
  railbus audit export --config railbus.toml > audit.ndjson",
    }
    Verify {
        en: "Check that every record is present and unaltered.",
        zh: "检查每条记录是否齐全且未被改动。",
    }
    Export {
        en: "Print every record with its hash: one JSON document per line, or CSV.",
        zh: "逐行输出每条记录及其哈希：JSON 或 CSV。",
    }
    Whole {
        en: "intact: entries {entries}, records {records}, from number {first}",
        zh: "完整：{entries} 个条目，自第 {first} 号起共 {records} 条记录",
    }
    BrokenAt {
        en: "record {record} is missing or was altered",
        zh: "第 {record} 号记录缺失或已被改动",
    }
}
