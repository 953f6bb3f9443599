//! The texts of `railbus sim` and its help.

railbus_words::texts! {
    pub(crate) SimFlagText;

    About {
        en: "Simulate lines for any master, byte by byte at real line speed.",
        zh: "按实际线路速度逐字节仿真总线，供任何主站访问。",
    }
    Examples {
        en: "  railbus sim --demo                    five modules on a PTY and on TCP
  railbus sim plant.toml                the lines and modules of a configuration
  railbus sim plant.toml --pty /tmp/v0 --seed 7 --fault 'pump: drop 5%'
  railbus sim plant.toml --control ./ctl
  railbus sim ctl ./ctl power yard cycle",
        zh: "  railbus sim --demo                    五个模块，经 PTY 和 TCP 访问
  railbus sim plant.toml                仿真配置文件中的总线和模块
  railbus sim plant.toml --pty /tmp/v0 --seed 7 --fault 'pump: drop 5%'
  railbus sim plant.toml --control ./ctl
  railbus sim ctl ./ctl power yard cycle",
    }
    Guide {
        en: "A plant is a configuration such as railbus.toml, with keys for the simulation:
  [sim]               seed, speed
  [line.NAME.sim]     pty, tcp, faults
  [module.NAME.sim]   factory, power, dip, init, init_sampled, faults, inputs,
                      turnaround, applies, refuse_aloud, lower_case,
                      answer_bad_frames, insist_on_gap, beyond
  inputs = { di0 = 1, di1 = { every = \"10s\" } }
  inputs = { di2 = { low = \"3s\", after = \"9s\", every = \"42s\" } }
  inputs = { ai1 = 8.71, ai2 = { from = 1.2, to = 8.8, every = \"4m\" } }
  inputs = { ai1 = { from = 4, to = 6, every = \"20s\", soft = true } }

Faults, separated by commas; each may have a duration (mute 10s), or, for a
module, a number of replies (bad once, mute 3x):
  mute            obeys, never answers    drop 5%         requests, replies lost
  deaf            receives nothing        flip 1e-4       bit errors
  dead            has no power            skip 1e-4       characters are lost
  echo            line: adapter echoes    noise 1e-4|2s   line: noise while idle
  delay 200ms±50  late replies            glitch 10%      00 before, FF after
  duplicate 10%   duplicated replies      split 20% 30ms  replies in pieces
  babble|5%       garbage, or as a reply  cuts 10m 2s     no power: every, for
  dup-address 6   address set by mistake  bad             last character wrong
  stuck k1        the output does not move

At the prompt, one command per line; also on stdin, and with railbus sim ctl:
  pump.di1 = 1            power yard on|off|cycle     fault tank mute 10s
  tank.ai1 = 8.71 V       dip yard 3                  fault line main noise 1e-3
  tank.ai1 = auto         reset tank                  fault tank clear mute
  show                    init gate on|off            fault tank clear
  show pump               protocol pump rtu           fault clear
  help                    quit",
        zh: "仿真文件即 railbus.toml 格式的配置，可另含仿真设置：
  [sim]               seed、speed
  [line.名称.sim]     pty、tcp、faults
  [module.名称.sim]   factory、power、dip、init、init_sampled、faults、inputs、
                      turnaround、applies、refuse_aloud、lower_case、
                      answer_bad_frames、insist_on_gap、beyond
  inputs = { di0 = 1, di1 = { every = \"10s\" } }
  inputs = { di2 = { low = \"3s\", after = \"9s\", every = \"42s\" } }
  inputs = { ai1 = 8.71, ai2 = { from = 1.2, to = 8.8, every = \"4m\" } }
  inputs = { ai1 = { from = 4, to = 6, every = \"20s\", soft = true } }

故障，多个以逗号分隔，均可附加持续时间（mute 10s），
模块的故障也可附加应答次数（bad once、mute 3x）：
  mute            执行但从不应答      drop 5%         请求或应答丢失
  deaf            收不到请求          flip 1e-4       字符位翻转
  dead            断电                skip 1e-4       字符丢失
  echo            总线：转换器回显    noise 1e-4|2s   总线：空闲时的干扰
  delay 200ms±50  应答延迟            glitch 10%      应答前多 00、后多 FF
  duplicate 10%   应答重复            split 20% 30ms  应答分段
  babble|5%       持续乱码或以其应答  cuts 10m 2s     断电：平均间隔、时长
  dup-address 6   如同误设了地址      bad             末字符出错
  stuck k1        输出卡住不动

提示符下每行一条命令，也可经管道输入或用 railbus sim ctl 发送：
  pump.di1 = 1            power yard on|off|cycle     fault tank mute 10s
  tank.ai1 = 8.71 V       dip yard 3                  fault line main noise 1e-3
  tank.ai1 = auto         reset tank                  fault tank clear mute
  show                    init gate on|off            fault tank clear
  show pump               protocol pump rtu           fault clear
  help                    quit",
    }
    File { en: "The plant to simulate", zh: "仿真文件" }
    Demo { en: "The demo line: one module of each of five kinds", zh: "演示总线：五种模块各一个" }
    Pty {
        en: "The link to a line's PTY; LINE= where there are several. Demo: /tmp/railbus-main",
        zh: "总线 PTY 的链接；有多条总线时加 LINE=。演示默认 /tmp/railbus-main",
    }
    Tcp {
        en: "Where a line is served as raw bytes over TCP. Demo: 127.0.0.1:4001",
        zh: "总线 TCP 原始字节的监听地址。演示默认 127.0.0.1:4001",
    }
    Seed {
        en: "Random seed; default 0",
        zh: "随机数种子；默认 0",
    }
    Speed { en: "Speed factor relative to real time; default 1", zh: "相对实际时间的倍速；默认 1" }
    FaultFlag {
        en: "Faults: 'pump: drop 5%', 'line: echo'",
        zh: "故障：'pump: drop 5%'、'line: echo'",
    }
    Control { en: "Control socket, see railbus sim ctl", zh: "接收命令的套接字，见 railbus sim ctl" }
    State {
        en: "Keep the modules' settings in this file across restarts",
        zh: "将模块设置保存在此文件中，重启后保留",
    }
    CtlAbout {
        en: "Send a command to a running simulator, or those from stdin, one per line.",
        zh: "向运行中的仿真器发送命令；未给出时从标准输入读取，每行一条。",
    }
    CtlExamples {
        en: "  railbus sim ctl ./ctl power yard cycle
  railbus sim ctl ./ctl 'tank.ai1 = 8.71 V'",
        zh: "  railbus sim ctl ./ctl power yard cycle
  railbus sim ctl ./ctl 'tank.ai1 = 8.71 V'",
    }
    CtlSocket { en: "The path given to --control", zh: "--control 所指定的路径" }
    CtlOrder { en: "Command; see railbus help sim", zh: "命令；见 railbus help sim" }
}
