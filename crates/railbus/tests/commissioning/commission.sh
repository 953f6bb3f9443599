#!/bin/sh
# Forty modules out of their boxes, on two lines with one person at each: all answer at the address
# and the speed of the factory. On a line they get their power one after another, and each its own
# place before the next.
#
# What a person does with his hands goes to the simulator (`railbus sim ctl`); all the rest is
# what he would type.
set -eu

home=$PWD
power() { railbus sim ctl "$home/ctl" "power $1 $2" >/dev/null; }

# The name that the scan gave to the module at the factory's address.
newcomer() { sed -n 's/^\[module\.\([a-z0-9]*_1\)\]$/\1/p' railbus.toml; }

# commission NAME LINE ADDRESS
commission() {
    power "$1" on
    railbus -q scan -l "$2" --addr 1 --add --yes >>scan.txt
    found=$(newcomer)
    [ -n "$found" ] || { echo "nobody at address 1 of $2 for $1" >&2; exit 1; }
    sed -i "s/^\[module\.$found\]$/[module.$1]/" railbus.toml
    case $found in
    eda*) railbus -q config set "$1" "address=$3" baud=19200 checksum=on --yes ;;
    r55*)
        # It takes an address only within ten seconds of its power-up.
        (sleep 3; power "$1" cycle) &
        railbus -q config set "$1" "address=$3" --yes
        wait
        ;;
    *) railbus -q config set "$1" "address=$3" baud=19200 --yes ;;
    esac >>set.txt
}

# commission_line LINE FIRST: twenty modules, in a folder of its own.
commission_line() {
    mkdir "$1.d"
    cd "$1.d"
    printf '[line.%s]\nport = "pty:%s/%s"\n' "$1" "$home" "$1" >railbus.toml
    number=$2
    address=2
    while [ $address -le 21 ]; do
        commission "$(printf 'm%02d' "$number")" "$1" $address
        number=$((number + 1))
        address=$((address + 1))
    done
}

commission_line north 1 & north=$!
commission_line south 21 & south=$!
# If one of them fails, the other ends, too.
trap 'kill $north $south 2>/dev/null || true' EXIT
wait $north
wait $south

# Both are one site.
cat north.d/railbus.toml south.d/railbus.toml >railbus.toml
railbus -q config backup -O site.json

# One breaks down, and a new one is put in its place.
railbus sim ctl ./ctl reset m06 >/dev/null
railbus -q config restore site.json --module m06 --yes
railbus plan --exit-code -o json >plan.json
