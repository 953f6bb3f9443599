//! The texts of `railbus export`.

railbus_words::texts! {
    pub(crate) ExportText;

    About { en: "Export the configuration for another tool.", zh: "为其他工具导出配置。" }
    Examples {
        en: "  railbus export csv > points.csv
  railbus export mbpoll              a command line for each Modbus module",
        zh: "  railbus export csv > points.csv
  railbus export mbpoll              每个 Modbus 模块一条命令",
    }
    Form { en: "mbpoll or csv", zh: "mbpoll 或 csv" }
    LeftOut {
        en: "left out (not Modbus, or on a line that mbpoll does not support): {modules}",
        zh: "未导出，因非 Modbus 或 mbpoll 不支持其总线：{modules}",
    }
}
