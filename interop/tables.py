"""What the datasheets promise, as data: every function, register, limit and refusal of every
module, one entry a line. `{60..67}` stands for one entry for each number and `{a,b}` for one for
each word. A check names the entries that it exercises; the runner counts both, and an entry that
no check exercises is a failure."""

import itertools
import re

# Modules in Modbus RTU ---------------------------------------------------------------------

ERC8 = """
power-up: relays off
power-up: settings kept
fc01 coil {60..67}
fc01 every run of 60-67
fc01 past the end from {60..67}: exception 2
fc01 coil {0,59,68,96,65535}: exception 2
fc01 past 65535: exception 2
fc01 count {0,2001}: exception 3
fc03 register {0..2}
fc03 every run of 0-2
fc03 past the end from {0..2}: exception 2
fc03 register {3,65535}: exception 2
fc03 count {0,126}: exception 3
fc05 coil {60..67} {on,off}
fc05 coil {0,59,68,96,65535}: exception 2
fc05 value {0001,0100,5500,FFFF}: exception 3
fc06 address {1..32}
fc06 address {0,33,247,256,65535}: exception 3
fc06 address: reply from the old one
fc06 speed {0..3}
fc06 speed: silent at the old one
fc06 speed {4,255,256,65535}: exception 3
fc06 parity {0..2}
fc06 parity: silent in the old one
fc06 parity {3,256,65535}: exception 3
fc06 register {3,60,65535}: exception 2
fc0f every run of 60-67
fc0f past the end from {60..67}: exception 2
fc0f coil {0,59,68,96}: exception 2
fc0f count {0,1969}: exception 3
fc0f byte count too {small,large}: exception 3
fc{02,04,10}: exception 1
fc{07,08,0B,0C,11,14,15,16,17,18,2B,41}: exception 1
broadcast fc06 address: obeyed, silent
broadcast fc06 bad address: nothing
broadcast fc06 {speed,parity}: nothing
broadcast {fc05,fc0f}: nothing
broadcast {fc01,fc03,fc10}: nothing
another address: silent
wrong CRC: silent
frame of {1..3} bytes: silent
a frame of {ascii,lc02,r55}: silent
"""

ERC8_SWITCHES = """
answer-bad: wrong CRC: exception 8
answer-bad: wrong CRC to {another address,address 0}: silent
applies=restart: {address,speed,parity} old until power-up
applies=restart: stored settings are read
"""

EMD2A2Q = """
power-up: relays off
power-up: settings and calibration kept
fc01 coil {8,9}
fc01 every run of 8-9
fc01 past the end from {8,9}: exception 2
fc01 coil {0,7,10,65535}: exception 2
fc01 count {0,2001}: exception 3
fc03 register {0..7}
fc03 every run of 0-7
fc03 past the end from {0..7}: exception 2
fc03 register {8,65535}: exception 2
fc03 count {0,126}: exception 3
fc05 coil {8,9} {on,off}
fc05 coil {0,7,10}: exception 2
fc05 value {0001,0100,FFFF}: exception 3
fc06 register {0,6,7}, read only: exception 2
fc06 register {8,65535}: exception 2
fc06 address {1..32}
fc06 address {0,33,256,65535}: exception 3
fc06 address: reply from the old one
fc06 speed {0..4}
fc06 speed: silent at the old one
fc06 speed {5,256,65535}: exception 3
fc06 parity {0..2}
fc06 parity: silent in the old one
fc06 parity {3,256}: exception 3
fc06 voltage {1,500,2000}
fc06 voltage {0,2001,65535}: exception 3
fc06 command {zero,span}: bit stands until it is done
fc06 command zero: both inputs read 0
fc06 command span: both inputs read the voltage
fc06 command restore: address, speed, voltage, calibration
fc06 command restore: relays stay
fc06 command: {restore before zero,zero before span}
fc06 command bits 3-15: nothing
fc0f every run of 8-9
fc0f past the end from {8,9}: exception 2
fc0f coil {0,7,10}: exception 2
fc0f count {0,1969}: exception 3
fc0f byte count too {small,large}: exception 3
fc10 register {1..5}
fc10 several registers
fc10 several with a bad value: exception 3, nothing
fc10 several with a read-only one: exception 2, nothing
fc10 register {0,6,7}, read only: exception 2
fc10 past the end from {7,8}: exception 2
fc10 count {0,124}: exception 3
fc10 byte count too {small,large}: exception 3
fc{02,04}: exception 1
fc{07,08,0B,0C,11,14,15,16,17,18,2B,41}: exception 1
analog {1,2} {0,871,2000}
analog {1,2} below 0 reads 0
broadcast {fc05,fc0f,fc06,fc10}: obeyed, silent
broadcast fc06 address: obeyed, silent
broadcast {fc01,fc03}: nothing
broadcast bad value: nothing
another address: silent
wrong CRC: silent
frame of {1..3} bytes: silent
a frame of {ascii,lc02,r55}: silent
"""

EMD2A2Q_SWITCHES = """
answer-bad: wrong CRC: exception 8
applies=restart: {address,speed,parity} old until power-up
applies=restart: stored settings are read
"""

EDA9060A_RTU = """
power-up: relays off
power-up: settings kept
fc01 coil {0..15}
fc01 every run of 0-3
fc01 coils 4-15 read 0
fc01 past the end from {0,4,15}: silent
fc01 coil {16,65535}: silent
fc01 count {0,2001}: silent
fc02 input {0..15}
fc02 every run of 0-3
fc02 inputs 4-15 read 0
fc02 open inputs read 1
fc02 past the end from {0,4,15}: silent
fc02 input {16,65535}: silent
fc02 count 0: silent
fc03 register {0..3}
fc03 every run of 0-3
fc03 past the end from {0..3}: silent
fc03 register {4,65535}: silent
fc03 count 0: silent
fc05 coil {0..3} {on,off}
fc05 coil {4,15,16}: silent
fc05 value {0001,0100,FFFF}: silent
fc0f every run of 0-3
fc0f 16 coils as printed
fc0f bits 4-15 ignored
fc0f past the end from {0,15}: silent
fc0f coil 16: silent
fc0f count 0: silent
fc0f byte count too {small,large}: silent
fc10 address {1,2,85,247,248,255}
fc10 address: reply from the old one
fc10 address 0: silent
fc10 speed {3..7}
fc10 speed: silent at the old one
fc10 speed {0,2,8,255}: silent
fc10 pulse mask {0..15}
fc10 pulse mask {16,128}: silent
fc10 pulse width {1,10,100,200}
fc10 pulse width {0,201,255}: silent
fc10 both registers
fc10 both with a bad value: silent, nothing
fc10 register {2,3,65535}: silent
fc10 past the end from {0,1}: silent
fc10 count 0: silent
fc10 byte count too {small,large}: silent
maps: written at 0, read at 1
maps: written at 1, read at 2
maps: echo of read {1,2} at its own number
fc{04,06}: silent
fc{07,08,0B,0C,11,14,15,16,17,18,2B,41}: silent
pulse of {1,10,200} tenths
pulse: 0 does nothing
pulse: a second 1 starts the width anew
pulse: a change of mode or width leaves it alone
pulse: read back as 1, then 0
pulse: level channels of the same write stay
broadcast {fc05,fc0f,fc10}: obeyed, silent
broadcast {fc01,fc02,fc03}: nothing
another address: silent
wrong CRC: silent
frame of {1..3} bytes: silent
a frame of {ascii,lc02,r55}: silent
"""

EDA9060A_SWITCHES = """
aloud: {fc04,fc06,fc07}: exception 1
aloud: {fc01,fc02,fc03,fc05,fc0f,fc10} past the end: exception 2
aloud: fc05 value 0001: exception 3
aloud: fc10 {address 0,speed 8,width 0,mask 16}: exception 3
aloud: wrong CRC: silent
aloud: another address: silent
aloud: broadcast: silent
applies=restart: {address,speed} old until power-up
applies=restart: stored settings are read
"""

EDA9050_RTU = """
power-up: outputs off
power-up: settings kept
fc01 coil {0..7}
fc01 every run of 0-7
fc01 past the end from {0,4,7}: silent
fc01 coil {8,65535}: silent
fc01 count {0,9,2001}: silent
fc02 input {0..6}
fc02 every run of 0-6
fc02 open inputs read 1
fc02 past the end from {0,3,6}: silent
fc02 input {7,8}: silent
fc02 count {0,8}: silent
fc05 coil {0..7} {on,off}
fc05 coil {8,16}: silent
fc05 value {0001,0100,FFFF}: silent
fc0f every run of 0-7
fc0f past the end from {0,4,7}: silent
fc0f coil 8: silent
fc0f count {0,9}: silent
fc0f byte count too {small,large}: silent
fc10 address {1,2,85,247,248,255}
fc10 address: reply from the old one
fc10 address 0: silent
fc10 speed {3..7}
fc10 speed: silent at the old one
fc10 speed {0,2,8,255}: silent
fc10 register {1,2}: silent
fc10 count {0,2}: silent
fc10 byte count too {small,large}: silent
fc{03,04,06}: silent
fc{07,08,0B,0C,11,14,15,16,17,18,2B,41}: silent
broadcast {fc05,fc0f,fc10}: obeyed, silent
broadcast {fc01,fc02}: nothing
another address: silent
wrong CRC: silent
frame of {1..3} bytes: silent
a frame of {ascii,lc02,r55}: silent
INIT* pin: nothing
"""

# Modules in ASCII and LC-02 ----------------------------------------------------------------

_ASCII = """
$AAM name
$AAM at every address 00-FF
$AA2 configuration
$AA2 speed {03..07}
$AA6 each {output,input}
$AA6 open inputs read 1
$AA6 unused bits are 0
#AA00dd every value
#AA1cdd each channel {on,off}
%AA address {00,01,0A,0D,7F,FF}
%AA speed {03..07}
%AA speed: silent at the old one
%AA checksum {on,off}
%AA: reply in the old speed and checksum state
%AA: survives power-off
%AA type {00,41}: silent
%AA speed {00,02,08,FF}: silent
%AA format {01,20,41,80,C0}: silent
power-up: outputs off
checksum on: every command
checksum on: every reply carries one
checksum on: {missing,wrong,lower-case,of another frame}: silent, nothing
checksum off: one too many: silent
syntax: {no delimiter,unknown letter,no address,half an address,bad digit,blank}: silent
syntax: {body too short,body too long,lower-case hex,reply delimiter}: silent
syntax: LF ignored
syntax: a delimiter starts anew
syntax: more than 32 characters are discarded
syntax: a request in two pieces
another address: silent, nothing
ADAM command {$AAF,$AA4,$AA5,$AAI,$AAP,#**,~**,~AA0,@AA}: silent
a frame of {lc02,rtu,r55}: silent
"""

ASCII_9060A = _ASCII + """
%AA reply: the old address
#AA00dd above 0F: silent
#AA1c channel {4,5,6,7,8,F}: silent
#AA1c value {02,10,FF}: silent
#AAoo order {01,0F,20,FF}: silent
#AA4mmww mask {0..15}
#AA4mmww width {01,0A,C8}
#AA4mmww mask {10,F0,FF}: silent
#AA4mmww width {00,C9,FF}: silent
#AA4mmww survives power-off
$AA3 mask and width
pulse of {1,10,200} tenths
pulse: 0 does nothing
pulse: a second 1 starts the width anew
pulse: a change of mode or width leaves it alone
pulse: each bit by its own mode
pulse: ended by power-off
address 00 in Modbus: broadcast only
"""

ASCII_9050 = _ASCII + """
%AA reply: the new address
#AA1c channel {8,9,F}: silent
#AA1c value {02,10,FF}: silent
#AAoo order {01,0F,20,FF}: silent
no pulses: $AA3: silent
no pulses: #AA4mmww: silent
INIT* pin: {to LC-02 and back,settings and outputs stay}
INIT* pin: ASCII silent while grounded
printed 082 without delimiter: silent
"""

ASCII_SWITCHES = """
aloud: {bad value,unknown command,syntax} gets ?AA
aloud: another address: silent
lower-case: taken
applies=restart: {address,speed,checksum} old until power-up
applies=address: address at once, {speed,checksum} at power-up
"""

_LC02 = """
01 configuration: model in BCD, type 00
01 speed {03..07}
02 address {00,01,0A,0D,7F,FF}
02 speed {03..07}
02 speed: silent at the old one
02 reply: the old address, 5 bytes
02 survives power-off
02 speed {00,02,08,FF}: silent
02 third byte {01,40}: silent
03 each {output,input}
03 open inputs read 1
03 as printed
04 all: every value
04 each channel {on,off}
04 value {02,FF} for one channel: silent
0D as {address,checksum,data}
every command at every address that makes 0D
wrong {checksum,end byte,start byte}: silent, nothing
unknown command {00,07,30,FF}: silent
another address: silent, nothing
too {short,long}: silent
garbage before a request is skipped
a frame of {ascii,rtu,r55}: silent
power-up: outputs off
"""

LC02_9060A = _LC02 + """
04 all above 0F: silent
04 channel {04,07,FE}: silent
05 mask {0..15}
05 width {1,10,200}
05 mask {16,255}: silent
05 width {0,201,255}: silent
05 reply: 5 bytes
06 mask and width
pulse of {1,200} tenths
pulse: 0 does nothing
"""

LC02_9050 = _LC02 + """
04 channel {08,10,FE}: silent
05: silent
06: silent
"""

# 0x55 boards -------------------------------------------------------------------------------

R55 = """
printed table: {on,off} {1..32}
printed table: all {on,off}
10 state
{11,12,31,32} each channel
{11,12,20,21,22} channel 0: silent
{11,12,20,21,22} channel above the count: silent
{11,12,20,21,22} channel {33,255}: silent
{31,32,30,37,38} channel above the count: nothing
{13,33} every bit
{14,15,16,34,35,36} walking mask
{14,15,16,34,35,36} keep the others
{13,14,15,16} bits above the count: nothing
{20,30} each channel, twice
{21,22,37,38} each channel
{21,22,37,38} time {0,1,1000,65536,16777215} ms
{21,37} after {12,13,15,16,20,22}: cancelled
{22,38} after {11,13,14,16,20,21}: cancelled
jog: another channel's command leaves it
jog: ended by power-off
{10..16} reply: own code, state after
{20,21,22} reply: the state
{30..38} never answered
40 to {245,own address}
41 within the window: answered from the old address
41 every address but 0 and 245
41 address {0,245}: silent, nothing
41 survives power-off
41 after 8 s: obeyed
41 after the window: silent, nothing
41 with a DIP switch: silent, nothing
41 to 245: obeyed, silent
DIP switch is the address
DIP switch 0: stored address
10 to 245: silent
{11..16} to 245: obeyed, silent
{20..22} to 245: obeyed, silent
{30..38} to 245: obeyed, silent
{70,71} on a board without variables: silent
{70,71} index {0,31}
{70,71} index {32,255}: silent
71 value {0,1,16777215}
71 to 245: obeyed, silent
70 to 245: silent
variables are 0 after power-up
unknown function {00,0F,17,19,23,2F,39,3F,42,72,FF}: silent
wrong {sum,start byte}: silent, nothing
another address: silent, nothing
resynchronisation: garbage before a request
resynchronisation: 55 before a request
resynchronisation: half a request before a request
chain of 32 without a gap
chain: only the last is answered
two boards obey one broadcast
mixed board: inputs in D1-D2, outputs in D3-D4
mixed board: outputs above 16: silent
input board: the inputs
input board: commands: no effect
power-up: relays off
a frame of {ascii,lc02,rtu}: silent
"""

# The line of `railbus sim --demo`, with all families on one wire ----------------------------

DEMO = """
{pump,gate,oven,yard,tank} answers
{pump,gate,oven,yard,tank} obeys
{oven,tank} by {pymodbus,libmodbus,mbpoll}
another speed: silent
a module that is not there: silent in {ascii,lc02,rtu,r55}
no reply before the wire has carried it
a link that goes with the program
"""

# The daemon's Modbus TCP server, in front of modules of all families ------------------------

MODBUS_TCP = """
{hall,gate,door,oven,tank,yard} by {pymodbus,libmodbus,mbpoll}: read
{hall,gate,door,oven,tank,yard} by {pymodbus,libmodbus,mbpoll}: switched and read back
{hall,gate,door,oven,tank,yard} by {pymodbus,libmodbus,mbpoll}: all coils at once
{inputs,analog registers,status registers} by {pymodbus,libmodbus,mbpoll}
an input that changes
own map: nothing beside it
uniform map: {coils,outputs as inputs,units of its own}
uniform map: {words,scaled values,floating-point values} by {pymodbus,libmodbus,mbpoll}
uniform map: an output that is not there
uniform map: {bits by a mask,a read with a write}
rights: without `write` nothing moves
rights: an output that is not in `write`
rights: all coils of a request or none
rights: an output in `write`
an output that {is interlocked,is locked,asks for confirmation}
power off: never an old value
power off: {0B,status 3,others go on}
power on: {good again,the true state}
a killed line: {never an old value,0A,status 4,good again}
a write to a dead module: {hall,gate,door,oven,tank,yard}
a write to a dead module: {other units go on,its own unit waits,0B}
a write to a dead module: too many that wait
a write that was not answered: {0B,the last command unknown,the truth afterwards}
closed: length {0,1,255,256,65535}
closed: {protocol 1,HTTP,TLS}
closed: what came before is answered
function {07,08,41}: 01
function {16,17} without registers: 02
quantity: 03
values of FC05: 03
a body that is no request: 03
addresses outside: 02
a unit that is none: 0A
the gateway itself: {name,01}
a module's name
a message byte by byte
messages in one piece
connections: {eight work,the ninth is closed,a free place}
half a message: {not at once,closed,more bytes give no more time}
two masters at once: {pymodbus,libmodbus,pipelined}
two masters at once: {simulator,API,mbpoll} agree
TLS, role {gates,bakers,visitor,none,both}: {reads all,nothing else moves}
TLS, role {gates,bakers}: switches
TLS: refused, {without a certificate,stranger,TLS 1.1,plain Modbus TCP}
TLS: role and name in the audit log
"""

# The daemon's Modbus gateway to a line -------------------------------------------------------

MODBUS_LINE = """
{oven,tank,door} by {pymodbus,libmodbus,mbpoll}: as in the API
{oven,tank,door} by {pymodbus,libmodbus,mbpoll}: switched and read back
settings by {pymodbus,libmodbus,mbpoll}: read
a module that is not configured by {pymodbus,libmodbus,mbpoll}: read
the module's own exceptions by {pymodbus,libmodbus,mbpoll}
without `write` by {pymodbus,libmodbus,mbpoll}: 01, nothing moves
rights: an output in `write`
rights: an output that is not in `write`: 01
rules: an output that is locked: 01
rules: an output that is interlocked: 04
a register of settings: 01
a coil that is no known output: 01
all modules at once: 01
a function that is not known: 01
no address of a module: 0A
a dead unit: {0B,others answer in time,back}
a killed line: {0A,back}
many requests in one piece
too many that wait: 06
a read behind a write shows it
equal reads at once are one
connections: {eight work,the ninth is closed}
closed: no Modbus
"""

# The daemon's MQTT client, with mosquitto -----------------------------------------------------

MQTT = """
{5,3.1.1,5 with TLS,3.1.1 with TLS}: every topic
{5,3.1.1,5 with TLS,3.1.1 with TLS}: switched and read back
{5,3.1.1,5 with TLS,3.1.1 with TLS}: a pulse
{5,3.1.1,5 with TLS,3.1.1 with TLS}: JSON
{5,3.1.1,5 with TLS,3.1.1 with TLS}: once under an id
{5,3.1.1,5 with TLS,3.1.1 with TLS}: an interlock
{5,3.1.1,5 with TLS,3.1.1 with TLS}: a group and a scene
{5,3.1.1,5 with TLS,3.1.1 with TLS}: bad payloads switch nothing
{5,3.1.1,5 with TLS,3.1.1 with TLS}: a retained command
{5,3.1.1,5 with TLS,3.1.1 with TLS}: rights
{5,5 with TLS}: an answer to who asked
{5,5 with TLS}: an expiry
on connect: info, states, and `online` last
a dead module: None and offline, never ON
a dead module: {the others go on,back again}
{another name,another site}: nothing is left
kill -9: offline within 10 s
SIGSTOP: offline within 15 s
a broker with an empty store
a frozen broker: the newest value afterwards
a removed outlet leaves nothing
a renamed outlet keeps its values
a renamed outlet with fewer modules leaves nothing
{device,component}: every point is an entity
{device,component}: commands as they were told
{device,component}: told again when Home Assistant is back
{device,component}: the other form takes over
{device,component}: nothing is left of what is no more
discovery: after the values and before `online`
auto: 3.1.1 where 5 is refused
version 5 only
the test says what the broker is
a certificate of one's own
why not: {no broker,a wrong authority,a certificate for another name,TLS where there is none}
why not: {no TLS where it is wanted,no certificate of one's own,a wrong user,a wrong password}
why not: {a file that is not there,a topic that is not allowed}
the password is never shown
{5,3.1.1}, batch: every change while the broker is there
{5,3.1.1}, batch: every change of an outage, once and in its order
{5,3.1.1}, batch: what was on the disk comes after a kill, and then a gap
5, batch: what nobody receives stays
{5,3.1.1}, batch: without replay_days nothing is kept
faults, {5,3.1.1}: dead within the keep-alive
faults, {5,3.1.1}: alive again
faults, {5,3.1.1}: what was true
faults, {5,3.1.1}: what is so now
faults, {5,3.1.1}: no change is missing
faults, {5,3.1.1}: commands act once and soon
faults, {5,3.1.1}: every command that acted has its result
faults, {5,3.1.1}: was a test
"""

# The daemon as a Sparkplug edge node, with mosquitto and pysparkplug ------------------------------

SPARKPLUG = """
{5,3.1.1}: the connection
{5,3.1.1}: NBIRTH
{5,3.1.1}: DBIRTH of {oven,hall,tank,yard}
{5,3.1.1}: the values
{5,3.1.1}: a change
{5,3.1.1}: stale
{5,3.1.1}: switched and read back
{5,3.1.1}: each metric is a command
{5,3.1.1}: refused: {no right,an input,unknown metric,wrong type,old,no timestamp,retained}
{5,3.1.1}: refused: the next one is done
{5,3.1.1}: ignored
{5,3.1.1}: a dead module: {DDEATH,DBIRTH,the others go on,not born by a rebirth}
{5,3.1.1}: a command to a dead module
{5,3.1.1}: rebirth
{5,3.1.1}: the will has the number of the birth
{5,3.1.1}: QoS 0 and not retained
{5,3.1.1}: the rules of Sparkplug
kill -9: NDEATH, and the next number
SIGTERM: NDEATH by the node, and the next number
an outlet that is disabled: NDEATH by the node, and the next number
a broker with an empty store: births with the next number
a module that is removed: DDEATH
lives: the rules of Sparkplug
primary host: no births while it is absent
primary host: births when it is there
primary host: an older offline is ignored
primary host: NDEATH when it goes, births when it is back
primary host: the rules of Sparkplug
every change: {without a broker,without the primary host,never again}
every change: the rules of Sparkplug
faults: {dead within the keep-alive,alive again,what was true,what is so now}
faults: {no change is missing,commands act once and soon,was a test}
"""

# The daemon's OPC UA server, with asyncua --------------------------------------------------------

OPCUA = """
browse: lines, modules and points
browse: types
read: value, status and source time
read: a dead module
read: stale
watch: after a pause
watch: a shorter queue
watch, {no filter,filter,interval 0,interval 60 s,interval -1}: from the beginning
watch, {no filter,filter,interval 0,interval 60 s,interval -1}: a change
watch, {no filter,filter,interval 0,interval 60 s,interval -1}: a dead module
watch, {no filter,filter,interval 0,interval 60 s,interval -1}: source times
watch, {no filter,filter}: stale
write: switched and read back
write: several at once
write: refused
write: a dead module
write: a relay that does not move
call: {done,refused}
rights: {points,role,nobody,token}
rights: a wrong password
history: as it was
limits: sessions and connections
security: a client that is not trusted
security: {Basic256Sha256,Aes256_Sha256_RsaPss}
security: nobody without signing in
security: without encryption on this machine only
security: the key is its owner's alone
a reload: what is gone is said, and the others go on
an account that is locked: its connections end
a line that is gone: every value is said to be
kill -9: the same server afterwards
"""

# All ways out of the daemon at once ------------------------------------------------------------

ONE_TRUTH = """
{known,a change,a silent module,it is back}: {WebSocket,watch,history,MQTT,Sparkplug,OPC UA}
{known,a change,a silent module,it is back}: {OPC UA history,Modbus TCP}
read too seldom: {WebSocket,watch,history,MQTT,Sparkplug,OPC UA,OPC UA history,Modbus TCP}
"""

# The same with node-opcua ----------------------------------------------------------------------

OPCUA_NODE = """
browse: {from Objects to points,types and properties,attributes that every node has}
read: {status and times,never read and stale}
write: done
write: refused, and nothing moves
write: a module without power
call: {done,refused}
rights: {role and points,who is nobody}
watch, {plain,filter}: {a change,a module without power,stale and then gone}
history: {forwards and backwards,in pages,where it begins and ends}
limits: {sessions,nodes in one request}
a reload: the others go on
security: {endpoints,a client that is not trusted,an account that is locked}
security: {Basic256Sha256,Aes256_Sha256_RsaPss}
"""

# The servers of a fleet, with nats-py as site and as centre --------------------------------------

FLEET = """
a site reaches the centre
the centre reaches a site
a site reads its documents
a site publishes nowhere else
a site hears nothing else
an answer goes nowhere else
headers reach nothing else
only keys of the fleet are accepted
a revoked key is not accepted
what people did stays
the system key does what it is for
"""

FLEET_SITE = """
a site and its centre
servers that are away
servers that lose what they acknowledged
a centre that is away or refuses
a session that the centre ends
a site that is not let in
credentials that are replaced
"""

FLEET_HUB = """
a site and the centre
a site asked through the centre
a centre that dies
a centre that is suspended
machines with one key
not all has arrived
a site that is silent
groups of sites
a site that is removed
two processes of the centre
a centre without servers
"""

FLEET_JOIN = """
a site joins by an invitation
what is no invitation is refused
an invitation counts once
an invited key may only ask
a key is renewed
what was issued can be revoked
"""

FLEET_COMMANDS = """
a far output: {switched,over,a pulse,several,a group,a scene}
a far output: the audit log of the site says who
a far output: {not among those allowed,locked,of a dead module}
a key: once, whoever repeats it
a key: not for another command
a command: written down, then its end, and nothing else
a command: {no answer,nobody there,refused,not known for ever}
a command that is late: not carried out
a site that is killed meanwhile: what is said of it is so
a centre that is killed meanwhile: another one ends it
two processes of the centre: one end
what was sent twice: carried out once
what is only asked: not carried out
over the network: {nobody without an account,each by its role,the record says who,a session,TLS}
"""

FLEET_BULK = """
many sites: {each has its own result,at two processes at once}
many sites: once, whoever repeats it
many sites: {so many at a time,stopped at another process,stopped by Ctrl-C,their number is said}
many sites: {stop,kill,the servers are away,by the command line}
"""

FLEET_CONFIG = """
a site's configuration: {the key of the centre,what it has is not replaced unseen}
a site's configuration: {a wrong one is refused with its line,the site's own tables are refused}
a site's configuration: {kept where the site works with it,taken back where a module is lost}
a site's configuration: {refused at the site,kill -9 during the trial,a change at the site}
a site's configuration: {signed by another key,of another site,an old version}
a site's configuration: {one that is away takes part when it comes,one without the key takes none}
"""

FLEET_LEADERS = """
leaders that die
"""

# The daemon's Modbus RTU slave, in front of the same modules ----------------------------------

MODBUS_RTU_SLAVE = """
{hall,gate,door,oven,tank,yard} by {pymodbus,libmodbus,mbpoll}: read
{hall,gate,door,oven,tank,yard} by {pymodbus,libmodbus,mbpoll}: switched and read back
inputs and registers by {pymodbus,libmodbus,mbpoll}
no module by {pymodbus,libmodbus,mbpoll}: silence
a broadcast: {silence,nothing moves}
rights by {pymodbus,libmodbus,mbpoll}: nothing moves
a dead module by {pymodbus,libmodbus,mbpoll}: {0B,others go on,good again}
a dead module by {pymodbus,libmodbus}: no success
a slow write: {05,another is refused,its end is told}
an adapter that echoes: {read,switched once}
a PLC and SCADA at the same time
"""

TABLES = {
    "ERC-8": ERC8,
    "ERC-8 switches": ERC8_SWITCHES,
    "EMD-2A2Q": EMD2A2Q,
    "EMD-2A2Q switches": EMD2A2Q_SWITCHES,
    "EDA9060A Modbus": EDA9060A_RTU,
    "EDA9060A Modbus switches": EDA9060A_SWITCHES,
    "EDA9050 Modbus": EDA9050_RTU,
    "EDA9060A ASCII": ASCII_9060A,
    "EDA9050 ASCII": ASCII_9050,
    "ASCII switches": ASCII_SWITCHES,
    "EDA9060A LC-02": LC02_9060A,
    "EDA9050 LC-02": LC02_9050,
    "0x55 boards": R55,
    "demo line": DEMO,
    "Modbus TCP": MODBUS_TCP,
    "Modbus gateway to a line": MODBUS_LINE,
    "MQTT": MQTT,
    "Sparkplug": SPARKPLUG,
    "OPC UA": OPCUA,
    "OPC UA, node-opcua": OPCUA_NODE,
    "one truth": ONE_TRUTH,
    "fleet": FLEET,
    "fleet, a site": FLEET_SITE,
    "fleet, the centre": FLEET_HUB,
    "fleet, keys": FLEET_JOIN,
    "fleet, commands": FLEET_COMMANDS,
    "fleet, commands to many sites": FLEET_BULK,
    "fleet, configuration": FLEET_CONFIG,
    "fleet, leaders": FLEET_LEADERS,
    "Modbus RTU slave": MODBUS_RTU_SLAVE,
}


def _words(text):
    """The words of a brace: `60..67` or `a,b`; numbers keep the leading zeros of the first."""
    if ".." not in text:
        return text.split(",")
    first, last = text.split("..")
    return [str(n).zfill(len(first)) for n in range(int(first), int(last) + 1)]


def expand(line):
    """`{a,b} c` is `a c` and `b c`."""
    parts = re.split(r"\{([^}]*)\}", line)
    choices = [_words(part) if n % 2 else [part] for n, part in enumerate(parts)]
    return ["".join(choice) for choice in itertools.product(*choices)]


def entries(table):
    """The entries of one table, in order."""
    lines = [line for line in TABLES[table].splitlines() if line]
    return [entry for line in lines for entry in expand(line)]
