//! What `railbus audit` says.

crate::texts::texts! {
    AuditText;

    About {
        en: "Checks and prints the log of what was done and by whom.",
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
        en: "Says whether every record is there, as it was written.",
        zh: "检查每条记录是否齐全且未被改动。",
    }
    Export {
        en: "Prints every record with its hash: a JSON document to a line, or CSV.",
        zh: "逐行输出每条记录及其哈希：JSON 或 CSV。",
    }
    Whole {
        en: "whole: {entries} entries, {records} records from number {first} on",
        zh: "完整：{entries} 个条目，自第 {first} 号起共 {records} 条记录",
    }
    BrokenAt {
        en: "record {record} is missing, or not as it was written",
        zh: "第 {record} 号记录缺失或已被改动",
    }
}
