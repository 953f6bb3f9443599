// From the datasheets, for each model: terminals, ratings, pitfalls. English, Chinese.
import type { Pair } from "../i18n/index.svelte";

export interface Model {
  /** The numbers on the housing, and what is there. */
  terminals: (readonly [string, Pair])[];
  facts: Pair[];
}

const same = (text: string): Pair => [text, text];

const CONTACTS: Pair = [
  "Contacts: 5 A at 250 VAC or 30 VDC, resistive load; one normally open and one normally closed each",
  "触点：5 A 250 VAC 或 30 VDC（阻性负载）；每路一常开、一常闭",
];
const BUS: Pair = [
  "RS-485, up to 32 modules, 1200 m of twisted pair",
  "RS-485，最多 32 个模块，双绞线 1200 米",
];
const POWER_UP: Pair = ["All relays release at power-up", "上电时所有继电器断开"];
const EDA_PLUS: Pair = ["RS-485 positive (A)", "RS-485 正（A）"];
const EDA_MINUS: Pair = ["RS-485 negative (B)", "RS-485 负（B）"];
const PLUS: Pair = ["supply, positive", "电源正"];
const GROUND: Pair = ["supply, ground", "电源地"];

const contact = (n: number): Pair => [
  `relay ${n}: normally open, common, normally closed`,
  `继电器 ${n}：常开、公共、常闭`,
];
const maker = (n: number): Pair => [`relay ${n}: normally open, common`, `继电器 ${n}：常开、公共`];

export const MODELS: Partial<Record<string, Model>> = {
  eda9060a: {
    terminals: [
      ["1–4", same("DI0 DI1 DI2 DI3")],
      ["5", ["DGND, common of the inputs", "DGND，输入公共端"]],
      ["7", EDA_PLUS],
      ["8", EDA_MINUS],
      ["9", PLUS],
      ["10", GROUND],
      ["11 12 13", contact(0)],
      ["14 15 16", contact(1)],
      ["17 18", maker(2)],
      ["19 20", maker(3)],
    ],
    facts: [
      ["Supply 10 to 24 VDC, at most 1.5 W", "电源 10–24 VDC，最大 1.5 W"],
      ["Contacts: 8 A 125 VAC, 5 A 250 VAC, 5 A 30 VDC", "触点：8 A 125 VAC，5 A 250 VAC，5 A 30 VDC"],
      [
        "Times pulses itself: 0.1 to 20 s, one width for the whole module",
        "模块自行计时点动：0.1–20 秒，整个模块共用一个宽度",
      ],
      ["Reports itself as 9060; the protocol is changed only by the maker's software", "自报型号为 9060；协议只能用厂家软件更改"],
    ],
  },
  eda9050: {
    terminals: [
      ["1–5", same("DO7 DO6 DO5 DO4 DO3")],
      ["6", ["INIT*: to ground LC-02, open ASCII", "INIT*：接地为 LC-02，悬空为 ASCII"]],
      ["7", EDA_PLUS],
      ["8", EDA_MINUS],
      ["9", PLUS],
      ["10", GROUND],
      ["11 12 13", same("DO2 DO1 DO0")],
      ["14–20", same("DI0 … DI6")],
    ],
    facts: [
      ["Supply 10 to 30 VDC, below 0.2 W", "电源 10–30 VDC，低于 0.2 W"],
      ["Outputs: open collector, 100 mA", "输出：集电极开路，100 mA"],
      ["An input that is not connected reads high", "未接的输入读为高"],
    ],
  },
  erc8: {
    terminals: [],
    facts: [
      ["Supply 85 to 265 VAC or 110 to 360 VDC", "电源 85–265 VAC 或 110–360 VDC"],
      CONTACTS,
      BUS,
      POWER_UP,
      ["No timer of its own: pulses are timed by the daemon", "模块无计时器：点动由守护进程计时"],
    ],
  },
  r55: {
    terminals: [],
    facts: [
      ["9600 8N1 always; up to 32 channels", "固定 9600 8N1；最多 32 路"],
      ["Times pulses itself, up to 4 h 39 min", "模块自行计时点动，最长 4 小时 39 分"],
      [
        "The address is stored, or set by DIP switch; a new one is taken within 10 s of power-up",
        "地址为存储或拨码；上电 10 秒内才接受新地址",
      ],
    ],
  },
  emd2a2q: {
    terminals: [
      ["2 3 4", ["two analog inputs", "两路模拟量输入"]],
      ["5 6", same("RS-485")],
      ["7 8", ["supply, 9 to 28 VDC", "电源 9–28 VDC"]],
      ["11 12 13", same("OUT2")],
      ["16 17 18", same("OUT1")],
    ],
    facts: [["Accuracy 1 % of full scale", "精度：满量程的 1 %"], CONTACTS, BUS, POWER_UP],
  },
};
