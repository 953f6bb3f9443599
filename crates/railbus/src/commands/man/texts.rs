//! The texts of `railbus man`.

railbus_words::texts! {
    pub(crate) ManText;

    About { en: "Print or install manual pages.", zh: "显示或安装手册页。" }
    Examples {
        en: "  railbus man set | man -l -
  railbus man --install              the pages of all commands, in both languages
  railbus man --dir target/man",
        zh: "  railbus man set | man -l -
  railbus man --install              安装所有命令的中英文手册页
  railbus man --dir target/man",
    }
    Name { en: "A command; default: railbus itself", zh: "命令名；省略则为程序本身" }
    Install {
        en: "Install all pages where man finds them, and show where",
        zh: "把手册页写到 man 能找到的位置并显示路径",
    }
    Dir { en: "Write all pages below this folder", zh: "把手册页写到此目录下" }
}
