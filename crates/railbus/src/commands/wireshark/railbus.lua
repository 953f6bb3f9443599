-- Dissects RS-485 lines of remote I/O modules: Modbus RTU, the EDA/ADAM ASCII set, LC-02 and the
-- 0x55/0x22 relay boards on one wire. Each packet of link type USER0 is one frame, as
-- `railbus sniff --write` keeps them. The verdicts are those of `railbus sniff`; tests hold the
-- two together. Put in place by `railbus sniff --install-wireshark`.

local railbus = Proto("railbus", "RS-485 I/O modules")

local f = railbus.fields
f.protocol = ProtoField.string("railbus.protocol", "Protocol")
f.role = ProtoField.string("railbus.role", "Role")
f.address = ProtoField.uint8("railbus.address", "Address", base.DEC_HEX)
f.meaning = ProtoField.string("railbus.meaning", "Meaning")
f.verdict = ProtoField.string("railbus.verdict", "Verdict")
f.also = ProtoField.string("railbus.also", "Also a frame of")
f.after = ProtoField.double("railbus.after_ms", "Reply time in ms")
f.asked = ProtoField.framenum("railbus.asked", "Request", base.NONE, frametype.REQUEST)

local bad = ProtoExpert.new("railbus.bad", "no right frame", expert.group.CHECKSUM,
  expert.severity.WARN)
local no = ProtoExpert.new("railbus.refused", "the module refused", expert.group.RESPONSE_CODE,
  expert.severity.NOTE)
railbus.experts = { bad, no }

local direction = Field.new("frame.packet_flags_direction")
local line_number = Field.new("frame.interface_id")
local line_text = Field.new("frame.interface_description")

-- After so many seconds a request counts as unanswered, and after so many nobody answers it.
local PATIENCE, LATE_MAX = 0.3, 2.0

local bxor = bit.bxor
local spread = table.unpack or unpack

local function crc16(b, n)
  local crc = 0xFFFF
  for i = 1, n do
    crc = bxor(crc, b[i])
    for _ = 1, 8 do
      local odd = crc % 2 == 1
      crc = math.floor(crc / 2)
      if odd then crc = bxor(crc, 0xA001) end
    end
  end
  return crc
end

local function sum8(b, from, to)
  local sum = 0
  for i = from, to do sum = sum + b[i] end
  return sum % 256
end

local function word(b, i) return b[i] * 256 + b[i + 1] end

local function find(protocol, role, address, verdict, trust, name, asked)
  return { protocol = protocol, role = role, address = address, verdict = verdict or "ok",
    trust = trust, name = name, asked = asked }
end

-- How sure it is that bytes are what they were read as.
local ENVELOPE, MARKS, SUM, CRC, PAIRED = 1, 2, 3, 4, 5

-- Modbus RTU ----------------------------------------------------------------------------------

local FUNCTIONS = { [1] = "read coils", [2] = "read inputs", [3] = "read registers",
  [4] = "read input registers", [5] = "write coil", [6] = "write register", [8] = "diagnosis",
  [15] = "write coils", [16] = "write registers", [43] = "read identification" }

-- Sub-functions of 08: those that change nothing, and those that are said again.
local function diagnosis_reads(sub) return sub == 0 or sub == 2 or sub >= 11 and sub <= 18 end
local DIAGNOSIS_ECHOED = { [0] = true, [10] = true, [20] = true }

local function rtu_request(b)
  local n = #b
  if n < 7 or n > 256 or not FUNCTIONS[b[2]] or crc16(b, n) ~= 0 then return nil end
  if b[2] == 43 then
    local asked = { protocol = "rtu", address = b[1], code = 43, b = b, identity = b[4] }
    return n == 7 and b[3] == 14
      and find("rtu", "request", b[1], "ok", CRC, FUNCTIONS[43], asked) or nil
  end
  if n < 8 then return nil end
  local code, at, count = b[2], word(b, 3), word(b, 5)
  local most = code <= 2 and 2000 or code <= 4 and 125 or code == 15 and 1968 or 123
  if code == 5 or code == 6 or code == 8 then
    if n ~= 8 then return nil end
  else
    if count < 1 or count > most or at + count - 1 > 65535 then return nil end
    if code <= 4 then
      if n ~= 8 then return nil end
    else
      local bytes = code == 15 and math.ceil(count / 8) or 2 * count
      if n ~= 9 + bytes or b[7] ~= bytes then return nil end
    end
  end
  local asked = { protocol = "rtu", address = b[1], code = code, b = b,
    silent = b[1] == 0 and code > 4 and not (code == 8 and diagnosis_reads(at)) }
  if code <= 2 then asked.bytes = math.ceil(count / 8) end
  if code == 3 or code == 4 then asked.bytes = 2 * count end
  return find("rtu", "request", b[1], "ok", CRC, FUNCTIONS[code], asked)
end

-- How long a reply with an identification is; where it is not there whole, nothing, and how many
-- bytes are missing at least. Each object is a number, a length and as many bytes.
local function identity_len(b)
  local n, len = #b, 8
  if n < 8 then return nil, 8 - n end
  for _ = 1, b[8] do
    if n < len + 2 then return nil, len + 2 - n end
    len = len + 2 + b[len + 2]
  end
  if n < len then return nil, len - n end
  return len + 2
end

local function identity_reply_to(asked, b)
  local n = #b
  if n < 4 then return nil, "short" end
  if b[3] ~= 14 then return nil, "other" end
  if b[4] ~= asked.identity then return nil, "form" end
  local len, more = identity_len(b)
  if not len then return nil, n + more + 2 > 256 and "form" or "short" end
  if len > 256 then return nil, "form" end
  if n < len then return nil, "short" end
  if crc16(b, len) ~= 0 then return nil, "checksum" end
  if n ~= len then return nil, "form" end
  return find("rtu", "reply", b[1], "ok", PAIRED, FUNCTIONS[43])
end

-- What the reply to a request is: a find, or why it is none.
local function rtu_reply_to(asked, b)
  local n = #b
  if n == 0 or (b[1] ~= asked.address and asked.address ~= 0) then return nil, "other" end
  if n < 2 then return nil, "short" end
  if b[2] == asked.code + 128 then
    if n < 5 then return nil, "short" end
    if crc16(b, 5) ~= 0 then return nil, "checksum" end
    if n ~= 5 then return nil, "form" end
    return find("rtu", "reply", b[1], "refused", PAIRED, "refused")
  end
  if b[2] ~= asked.code then return nil, "other" end
  if asked.identity then return identity_reply_to(asked, b) end
  local len = 8
  if asked.bytes then
    if n < 3 then return nil, "short" end
    if b[3] ~= asked.bytes then return nil, "form" end
    len = 5 + asked.bytes
  end
  if n < len then return nil, "short" end
  if crc16(b, len) ~= 0 then return nil, "checksum" end
  if not asked.bytes then
    -- What is asked by 08 comes in place of what was sent, unless that is to come back.
    local answers = asked.code == 8 and not DIAGNOSIS_ECHOED[word(asked.b, 3)]
    for i = 3, answers and 4 or 6 do
      if b[i] ~= asked.b[i] then return nil, "form" end
    end
  end
  if n ~= len then return nil, "form" end
  return find("rtu", "reply", b[1], "ok", PAIRED, FUNCTIONS[asked.code])
end

local function rtu_reply(b)
  local n = #b
  if n < 5 or crc16(b, n) ~= 0 then return nil end
  local code = b[2] % 128
  if not FUNCTIONS[code] then return nil end
  if b[2] >= 128 then
    return n == 5 and find("rtu", "reply", b[1], "refused", CRC, "refused") or nil
  end
  if code <= 4 then
    local whole = b[3] > 0 and n == 5 + b[3] and b[3] <= 250 and (code < 3 or b[3] % 2 == 0)
    return whole and find("rtu", "reply", b[1], "ok", CRC, FUNCTIONS[code]) or nil
  end
  if code == 43 then
    local whole = b[3] == 14 and n <= 256 and identity_len(b) == n
    return whole and find("rtu", "reply", b[1], "ok", CRC, FUNCTIONS[43]) or nil
  end
  if n ~= 8 then return nil end
  if code > 8 then
    local count = word(b, 5)
    if count < 1 or count > (code == 15 and 1968 or 123) then return nil end
  end
  return find("rtu", "reply", b[1], "ok", CRC, FUNCTIONS[code])
end

-- 0x55 boards ---------------------------------------------------------------------------------

local R55 = { [0x10] = "read state", [0x11] = "off", [0x12] = "on", [0x13] = "all outputs",
  [0x14] = "group off", [0x15] = "group on", [0x16] = "group toggle", [0x20] = "toggle",
  [0x21] = "pulse on", [0x22] = "pulse off", [0x40] = "read address", [0x41] = "write address",
  [0x70] = "read variable", [0x71] = "write variable" }
-- The twins that nobody answers.
local TWINS = { [0x31] = 0x11, [0x32] = 0x12, [0x33] = 0x13, [0x34] = 0x14, [0x35] = 0x15,
  [0x36] = 0x16, [0x30] = 0x20, [0x37] = 0x21, [0x38] = 0x22 }
local CHANNELS = { [0x11] = true, [0x12] = true, [0x20] = true, [0x21] = true, [0x22] = true }

local function r55(b)
  if #b ~= 8 or (b[1] ~= 0x55 and b[1] ~= 0x22) or sum8(b, 1, 7) ~= b[8] then return nil end
  local code = TWINS[b[3]] or b[3]
  local known = R55[code]
  if b[1] == 0x22 then
    known = R55[b[3]]
    return find("r55", "reply", b[2], known and "ok" or "unknown", known and SUM or ENVELOPE, known)
  end
  if CHANNELS[code] and (b[7] < 1 or b[7] > 32) then known = nil end
  if not known then return find("r55", "request", b[2], "unknown", ENVELOPE, nil) end
  local asked = { protocol = "r55", address = b[2], code = code,
    anyone = code == 0x40 and b[2] == 245,
    silent = TWINS[b[3]] ~= nil or b[2] == 245 and code ~= 0x40 }
  return find("r55", "request", b[2], "ok", SUM, known, asked)
end

local function r55_reply_to(asked, b)
  if b[1] ~= 0x22 then return nil, "other" end
  if b[2] and b[2] ~= asked.address and not asked.anyone then return nil, "other" end
  if b[3] and b[3] ~= asked.code then return nil, "other" end
  if #b < 8 then return nil, "short" end
  if sum8(b, 1, 7) ~= b[8] then return nil, "checksum" end
  if #b ~= 8 then return nil, "form" end
  return find("r55", "reply", b[2], "ok", PAIRED, R55[b[3]])
end

-- LC-02 ---------------------------------------------------------------------------------------

local LC02 = { [1] = "read configuration", [2] = "configure", [3] = "read outputs and inputs",
  [4] = "write outputs", [5] = "set pulses", [6] = "read pulses" }
local LC02_LEN = { [1] = 6, [2] = 9, [3] = 6, [4] = 8, [5] = 8, [6] = 6 }
local LC02_DATA = { [1] = 4, [2] = 0, [3] = 2, [4] = 0, [5] = 0, [6] = 2 }

local function lc02_request(b)
  local n = #b
  if n < 6 or b[1] ~= 0x4C or b[2] ~= 0x57 or LC02_LEN[b[4]] ~= n or b[n] ~= 13
    or sum8(b, 3, n - 2) ~= b[n - 1] then
    return nil
  end
  local code = b[4]
  local right = code ~= 2 or b[7] == 0
  if code == 4 then right = b[5] == 0xFF or (b[5] <= 7 and b[6] <= 1) end
  if code == 5 then right = b[6] >= 1 and b[6] <= 200 end
  if not right then return nil end
  local asked = { protocol = "lc02", address = b[3], other = code == 2 and b[5] or b[3],
    code = code }
  return find("lc02", "request", b[3], "ok", SUM, LC02[code], asked)
end

-- The reply with so many data bytes; `pulses` have a width of 1 to 200.
local function lc02_open(b, data, pulses)
  local n, head = #b, { 0x6C, 0x63 }
  for i = 1, math.min(n, 2) do
    if b[i] ~= head[i] then return "other" end
  end
  if n < 5 + data then return "short" end
  if b[5 + data] ~= 13 then return "form" end
  if sum8(b, 3, 3 + data) ~= b[4 + data] then return "checksum" end
  if n ~= 5 + data or pulses and (b[5] < 1 or b[5] > 200) then return "form" end
  return nil
end

local function lc02_reply_to(asked, b)
  if b[3] and b[3] ~= asked.address and b[3] ~= asked.other then return nil, "other" end
  local why = lc02_open(b, LC02_DATA[asked.code], asked.code == 6)
  if why then return nil, why end
  return find("lc02", "reply", b[3], "ok", PAIRED, LC02[asked.code])
end

local function lc02_reply(b)
  for _, data in ipairs({ 4, 2, 0 }) do
    if not lc02_open(b, data) then return find("lc02", "reply", b[3], "ok", SUM, "reply") end
  end
  return nil
end

-- ASCII ---------------------------------------------------------------------------------------

local HEX = "[0-9A-Fa-f][0-9A-Fa-f]"

-- Requests by delimiter and pattern of what follows the address: name, and the good reply as its
-- first character, whether the address follows, and the pattern of the rest.
local ASCII = {
  { "$", "^M$", "read name", "!", true, "^[ -~]+$", 16 },
  { "$", "^F$", "read firmware", "!", true, "^[ -~]+$", 16 },
  { "$", "^2$", "read configuration", "!", true, "^" .. HEX:rep(3) .. "$" },
  { "$", "^3$", "read pulses", "!", true, "^" .. HEX:rep(2) .. "$", nil, "width" },
  { "$", "^4$", "read the latched sample", "!", false, "^[01]" .. HEX:rep(2) .. "00$" },
  { "$", "^5$", "has it restarted?", "!", true, "^[01]$" },
  { "$", "^6$", "read outputs and inputs", "!", false, "^" .. HEX:rep(2) .. "00$" },
  { "$", "^I$", "is INIT* grounded?", "!", true, "^[01]$" },
  { "%", "^" .. HEX:rep(4) .. "$", "configure", "!", true, "^$" },
  { "#", "^" .. HEX:rep(2) .. "$", "write outputs", ">", false, "^$" },
  { "#", "^4" .. HEX:rep(2) .. "$", "set pulses", "!", true, "^$", nil, nil, "width" },
  { "@", "^$", "read outputs and inputs", ">", false, "^" .. HEX:rep(2) .. "$" },
  { "~", "^0$", "watchdog status", "!", true, "^" .. HEX .. "$" },
  { "~", "^1$", "clear the watchdog", "!", true, "^$" },
  { "~", "^2$", "read the watchdog", "!", true, "^[01]" .. HEX .. "$" },
  { "~", "^3[01]" .. HEX .. "$", "set the watchdog", "!", true, "^$" },
  { "~", "^4$", "read safe outputs", "!", true, "^" .. HEX:rep(2) .. "$" },
  { "~", "^5" .. HEX:rep(2) .. "$", "set safe outputs", "!", true, "^$" },
  { "~", "^O.+$", "rename", "!", true, "^$", nil, nil, "name" },
}

local function text_of(b)
  local n = #b
  if n < 2 or n > 128 or b[n] ~= 13 then return nil end
  for i = 1, n - 1 do
    if b[i] < 32 or b[i] > 126 then return nil end
  end
  return string.char(spread(b, 1, n - 1))
end

-- The characters before a right checksum.
local function unsealed(text, lower)
  local body, digits = text:match("^(.*)(" .. HEX .. ")$")
  if not body or (not lower and digits ~= digits:upper()) then return nil end
  local sum = 0
  for i = 1, #body do sum = sum + body:byte(i) end
  return tonumber(digits, 16) == sum % 256 and body or nil
end

local function width(digits)
  local tenths = tonumber(digits, 16)
  return tenths >= 1 and tenths <= 200
end

local function ascii_request_of(text, checksum)
  if #text + (checksum and 3 or 1) > 33 then return nil end
  local trust = checksum and SUM or MARKS
  if text == "#**" or text == "~**" then
    local asked = { protocol = "ascii", silent = true }
    return find("ascii", "request", nil, "ok", trust, "all modules", asked)
  end
  local mark, digits, body = text:match("^([$%%#@~])(" .. HEX .. ")(.*)$")
  if not mark then return nil end
  for _, known in ipairs(ASCII) do
    if known[1] == mark and body:match(known[2]) then
      local right = true
      if known[9] == "width" then right = width(body:sub(4, 5)) end
      if known[9] == "name" then right = #body <= 17 end
      if right then
        local address = tonumber(digits, 16)
        local other = mark == "%" and tonumber(body:sub(1, 2), 16) or address
        local asked = { protocol = "ascii", address = address, other = other, form = known,
          checksum = checksum, outputs = known[3] == "write outputs" }
        return find("ascii", "request", address, "ok", trust, known[3], asked)
      end
    end
  end
  return nil
end

local function ascii_body(form, body)
  local fits = body:match(form[6]) and #body <= (form[7] or 33)
  return fits and (form[8] ~= "width" or width(body:sub(3, 4)))
end

-- The first characters up to a CR, whatever they are.
local function line_of(b)
  for i = 1, math.min(#b, 33) do
    if b[i] == 13 then return i > 1 and string.char(spread(b, 1, i - 1)) or "", i end
  end
  return nil
end

-- The length of a reply with so many characters in its body, CR included.
local function ascii_len(checksum, addressed, body)
  return body + 2 + (addressed and 2 or 0) + (checksum and 2 or 0)
end

local function ascii_len_max(asked)
  local form = asked.form
  local body = form[6]:gsub("[%^$]", ""):gsub("%[.-%]", "x")
  return ascii_len(asked.checksum, form[5], form[7] or #body)
end

-- What a beginning without its CR can still become.
local function ascii_unfinished(asked, b)
  local mark, form, why = string.char(b[1]), asked.form, "other"
  local forms = { { form[4], form[5], ascii_len_max(asked) },
    { "?", true, ascii_len(asked.checksum, true, 0) } }
  if asked.outputs then
    forms[3] = { "?", false, ascii_len(asked.checksum, false, 0) }
    forms[4] = { "!", false, ascii_len(asked.checksum, false, 0) }
  end
  for _, one in ipairs(forms) do
    if one[1] == mark then
      local reason = #b < one[3] and "short" or "form"
      if one[2] and #b >= 3 then
        local digits = string.char(b[2], b[3])
        local address = digits:match("^" .. HEX .. "$") and tonumber(digits, 16)
        if not address then
          reason = "form"
        elseif address ~= asked.address and address ~= asked.other then
          reason = "other"
        end
      end
      if reason == "short" then return reason end
      why = reason
    end
  end
  return why
end

local function ascii_reply_to(asked, b)
  if asked.silent or not b[1] then return nil, "other" end
  local text, len = line_of(b)
  if not text then return nil, ascii_unfinished(asked, b) end
  local mark = text:sub(1, 1)
  if not mark:match("[!>?]") then return nil, "other" end
  local refused = find("ascii", "reply", asked.address, "refused", PAIRED, "refused")
  if asked.checksum then
    text = unsealed(text, false)
    if not text then return nil, "checksum" end
  end
  local form = asked.form
  if asked.outputs and (text == "?" or text == "!") then return refused end
  local function from(digits)
    if not digits:match("^" .. HEX .. "$") then return nil, "form" end
    local address = tonumber(digits, 16)
    if address ~= asked.address and address ~= asked.other then return nil, "other" end
    return address
  end
  if mark == "?" then
    if #text ~= 3 then return nil, "form" end
    local address, why = from(text:sub(2, 3))
    if not address then return nil, why end
    return refused
  end
  if mark ~= form[4] then return nil, "other" end
  local body, said = text:sub(2), asked.address
  if form[5] then
    if #body < 2 then return nil, "form" end
    local address, why = from(body:sub(1, 2))
    if not address then return nil, why end
    said, body = address, body:sub(3)
  end
  if not ascii_body(form, body) or len ~= #b then return nil, "form" end
  return find("ascii", "reply", said, "ok", PAIRED, form[3])
end

-- A reply whose request was not heard: to which of these could it be?
local SUPPOSED = { "read outputs and inputs", "read configuration", "read pulses",
  "write outputs", "read name" }

local function ascii_reply_of(text, checksum)
  if #text + (checksum and 3 or 1) > 33 then return nil end
  local trust = checksum and SUM or MARKS
  if text == "?" or text == "!" then
    return find("ascii", "reply", nil, "refused", trust, "refused")
  end
  local address = tonumber(text:match("^.(" .. HEX .. ")") or "", 16)
  if text:match("^%?" .. HEX .. "$") then
    return find("ascii", "reply", address, "refused", trust, "refused")
  end
  for _, name in ipairs(SUPPOSED) do
    for _, form in ipairs(ASCII) do
      if form[3] == name and text:sub(1, 1) == form[4] then
        local body = text:sub(2)
        local addressed = form[5]
        if addressed then body = address and body:sub(3) or nil end
        if body and ascii_body(form, body) then
          return find("ascii", "reply", addressed and address or nil, "ok", trust, name)
        end
      end
    end
  end
  return nil
end

local function ascii(b, pending, finds)
  local text = text_of(b)
  if not text or not text:match("^[$%%#@~!>?]") then return end
  local sealed = unsealed(text, true)
  local before = #finds
  if sealed then finds[#finds + 1] = ascii_request_of(sealed, true) end
  finds[#finds + 1] = ascii_request_of(text, false)
  local judged = false
  if pending and pending.protocol == "ascii" then
    local _, why = ascii_reply_to(pending, b)
    judged = why ~= "other"
  end
  if not judged then
    sealed = unsealed(text, false)
    if sealed then finds[#finds + 1] = ascii_reply_of(sealed, true) end
    finds[#finds + 1] = ascii_reply_of(text, false)
  end
  local is_reply = text:match("^[!>?]") ~= nil
  if #finds == before and not (judged and is_reply) then
    local address = not is_reply and tonumber(text:match("^.(" .. HEX .. ")") or "", 16) or nil
    finds[#finds + 1] = find("ascii", is_reply and "reply" or "request", address, "unknown",
      ENVELOPE, nil)
  end
end

-- What no protocol takes ----------------------------------------------------------------------

local REPLY_TO = { rtu = rtu_reply_to, r55 = r55_reply_to, lc02 = lc02_reply_to,
  ascii = ascii_reply_to }

local function broken_rtu(b)
  local n = #b
  if n < 3 or not FUNCTIONS[b[2] % 128] then return nil end
  if b[2] >= 128 then
    return n == 5 and find("rtu", "reply", b[1], "bad checksum", ENVELOPE) or nil
  end
  local code, request, reply = b[2], n == 8, false
  if code <= 4 then reply = b[3] > 0 and n == 5 + b[3] end
  if code == 43 then
    request, reply = n == 7, b[3] == 14 and n >= 10
  elseif code > 8 then
    request, reply = b[7] ~= nil and n == 9 + b[7], n == 8
  end
  local role = request and "request" or reply and "reply" or nil
  return role and find("rtu", role, b[1], "bad checksum", ENVELOPE) or nil
end

local function reply_len_max(asked)
  if asked.identity then return 256 end
  if asked.protocol == "rtu" then return asked.bytes and 5 + asked.bytes or 8 end
  if asked.protocol == "lc02" then return 5 + LC02_DATA[asked.code] end
  return asked.protocol == "ascii" and ascii_len_max(asked) or 8
end

local function marked(b)
  local n, c = #b, string.char(b[1])
  if (b[1] == 0x55 or b[1] == 0x22) and n <= 8 and not broken_rtu(b) then
    local flaw = n == 8 and "bad checksum" or "bad short"
    return n > 1 and find("r55", b[1] == 0x55 and "request" or "reply", b[2], flaw, ENVELOPE)
      or nil
  end
  if (b[1] == 0x4C and b[2] == 0x57) or (b[1] == 0x6C and b[2] == 0x63) then
    local flaw = "bad short"
    if n >= 5 and b[n] == 13 then
      flaw = sum8(b, 3, n - 2) == b[n - 1] and "unknown" or "bad checksum"
    end
    return find("lc02", b[1] == 0x4C and "request" or "reply", b[3], flaw, ENVELOPE)
  end
  if n >= 3 and c:match("[$%%#@~!>?]") then
    for i = 2, n do
      if b[i] < 32 or b[i] > 126 then return nil end
    end
    return find("ascii", c:match("[!>?]") and "reply" or "request", nil, "bad short", ENVELOPE)
  end
  return nil
end

local function judge(b, pending)
  local n = #b
  if n >= 4 and n <= 256 and crc16(b, n) == 0 then
    if n == 5 and b[2] >= 128 then return find("rtu", "reply", b[1], "refused", ENVELOPE) end
    return find("rtu", nil, b[1], "unknown", ENVELOPE)
  end
  if pending then
    if pending.protocol == "rtu" and n == 3 and b[2] == pending.code + 128
      and (b[1] == pending.address or pending.address == 0) then
      return find("rtu", "reply", pending.address, "refused", PAIRED, "refused, without CRC")
    end
    local _, why = REPLY_TO[pending.protocol](pending, b)
    if why ~= "other" and n <= math.max(reply_len_max(pending), 8) + 2 then
      return find(pending.protocol, "reply", pending.address, "bad " .. (why or "form"), PAIRED)
    end
  end
  return marked(b) or broken_rtu(b) or find(nil, nil, nil, "bad foreign", ENVELOPE)
end

-- All readings, best first; `pending` is the request that waits.
local function read(b, pending, late)
  local finds = {}
  if pending then finds[1] = (REPLY_TO[pending.protocol](pending, b)) end
  finds[#finds + 1] = r55(b)
  finds[#finds + 1] = lc02_request(b)
  finds[#finds + 1] = lc02_reply(b)
  ascii(b, pending, finds)
  finds[#finds + 1] = rtu_request(b)
  finds[#finds + 1] = rtu_reply(b)
  local best
  for _, one in ipairs(finds) do
    if not best or one.trust > best.trust then best = one end
  end
  if not best then return judge(b, pending), {} end
  if late then
    for _, one in ipairs(finds) do
      if one.role == "request" and one.protocol == best.protocol then best = one break end
    end
  end
  local also, seen = {}, { [best.protocol] = true }
  for _, one in ipairs(finds) do
    local weak = one.trust == ENVELOPE and best.trust == PAIRED
    if not seen[one.protocol] and not weak then
      also[#also + 1], seen[one.protocol] = one.protocol, true
    end
  end
  return best, also
end

-- Frames in order -----------------------------------------------------------------------------

local told, waiting = {}, {}

function railbus.init()
  told, waiting = {}, {}
end

-- Seconds of one character, by what the line's description says of speed and format.
local function character(text)
  local baud, format = (text or ""):match("^(%d+) (8%u%d)")
  return (format == "8N1" or not format) and 10 / (baud or 9600) or 11 / baud
end

local function first_look(b, pinfo)
  local number = line_number()
  local line = number and number.value or 0
  local text = line_text()
  local pending = waiting[line]
  local at = pinfo.rel_ts
  local way = direction()
  if pending and at - pending.over >= LATE_MAX then pending = nil end
  if way and way.value == 2 then pending = nil end
  local late = pending and (pending.silent or at - pending.over >= PATIENCE)
  local best, also = read(b, pending, late)
  local result = { best = best, also = also }
  local over = at + #b * character(text and text.value)
  if pending and (best.trust == PAIRED) and best.role == "reply" then
    result.after, result.number = 1000 * (at - pending.over), pending.number
  end
  if best.role == "request" and best.asked then
    pending = best.asked
    pending.over, pending.number = over, pinfo.number
  elseif best.role == "request" and not best.verdict:match("^bad") then
    pending = nil
  elseif best.trust == PAIRED and not best.verdict:match("^bad") then
    pending = nil
  end
  waiting[line] = pending
  return result
end

function railbus.dissector(buffer, pinfo, tree)
  local n = buffer:len()
  if n == 0 then return 0 end
  local result = told[pinfo.number]
  if not result then
    local b = {}
    for i = 1, n do b[i] = buffer(i - 1, 1):uint() end
    result = first_look(b, pinfo)
    told[pinfo.number] = result
  end
  local best = result.best
  pinfo.cols.protocol = best.protocol or "rs485"
  local arrow = best.role == "request" and "→" or best.role == "reply" and "←" or "?"
  local address = best.address and (" " .. best.address) or ""
  local text = arrow .. address .. " " .. (best.name or "") .. " [" .. best.verdict .. "]"
  pinfo.cols.info = text
  local item = tree:add(railbus, buffer(), "RS-485 frame, " .. text)
  if best.protocol then item:add(f.protocol, best.protocol) end
  if best.role then item:add(f.role, best.role) end
  if best.address then item:add(f.address, best.address) end
  if best.name then item:add(f.meaning, best.name) end
  local verdict = item:add(f.verdict, best.verdict)
  for _, protocol in ipairs(result.also) do item:add(f.also, protocol) end
  if result.after then
    item:add(f.after, result.after)
    item:add(f.asked, result.number)
  end
  if best.verdict:match("^bad") then verdict:add_proto_expert_info(bad, best.verdict) end
  if best.verdict == "refused" then verdict:add_proto_expert_info(no) end
  return n
end

DissectorTable.get("wtap_encap"):add(wtap.USER0, railbus)
