//! The texts of the daemon itself: on its terminal, and on the page that replaces missing pages.

railbus_words::texts! {
    pub(crate) GatewayText;

    TlsRead {
        en: "certificate reloaded; SHA-256 {fingerprint}",
        zh: "已重新读取证书；SHA-256 {fingerprint}",
    }
    ServeChecked {
        en: "{file}: valid; lines: {lines}, modules: {modules}",
        zh: "{file}：有效，{lines} 条总线，{modules} 个模块",
    }
    ServesDemo {
        en: "demo line with 5 simulated modules, no real hardware",
        zh: "演示总线，5 个仿真模块，均非真实设备",
    }
    ServeStop {
        en: "press Ctrl-C to stop; outputs keep their state",
        zh: "按 Ctrl-C 停止；输出保持原状",
    }
    CantServeSite { en: "can't serve the site", zh: "无法提供服务" }
    NoSocket { en: "can't listen on the socket {path}", zh: "无法监听套接字 {path}" }
    ServesNew {
        en: "{file}: does not exist yet; created with the first line or module",
        zh: "{file}：尚不存在，添加第一条总线或模块时创建"
    }
    Reloaded {
        en: "configuration reloaded; lines kept: {kept}; opened: {opened}; closed: {closed}",
        zh: "已重新读取配置；保留的总线：{kept}；打开：{opened}；关闭：{closed}",
    }
    NotReloaded { en: "no changes made", zh: "未作任何更改" }
    ServeSetup { en: "(one-time link, 15 min)", zh: "（一次性链接，15 分钟内有效）" }
    PageMissing {
        en: "This railbus was built without its web pages.",
        zh: "此 railbus 构建时未包含网页。",
    }
    PageBuild {
        en: "To have them, build it with this command (it needs Node 20.19 or newer, or Python):",
        zh: "要包含网页，请用以下命令构建（需要 Node 20.19 以上版本，或 Python）：",
    }
    PageWorks {
        en: "Everything else works: the API, and the command line, which asks this daemon:",
        zh: "其余功能均可用：API，以及通过本守护进程工作的命令行：",
    }
}
